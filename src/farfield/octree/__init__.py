"""The tree of cells: keys, bounds, the lattice of every direction, the cut for a viewpoint."""
