// What both stages know of BlockMaps.

// Parts of a texel's width that the box reaches beyond the lowest and the highest point: what comes in from above is above the tops.
const float MARGIN = 64.0;
