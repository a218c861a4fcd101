"""Pure geometry: directions and their lattices, boxes, cameras, normals. No state, no files."""
