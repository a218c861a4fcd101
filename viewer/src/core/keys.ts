/** Names of a world's values in its store (spec/world.md). `cell` is "level/x/y/z". */
export const orthoviewKey = (cell: string, direction: number, layer: number, hash: string): string =>
  `orthoview/${cell}/${direction}/${layer}-${hash}`;
export const indexKey = (cell: string, hash: string): string => `index/${cell}-${hash}`;
export const geometryKey = (cell: string, hash: string): string => `geometry/${cell}-${hash}`;
export const meshKey = (hash: string): string => `mesh/${hash}`;
export const textureKey = (hash: string): string => `texture/${hash}`;
