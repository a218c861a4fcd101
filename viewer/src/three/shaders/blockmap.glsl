// What both stages know of BlockMaps.

const float BELOW = 0.001; // metres by which the box reaches below code 1
