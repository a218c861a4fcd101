/** Words of 32 bits a pixel of a decoded tile (see DecodedTile.pixels). */
export const WORDS = 3;
