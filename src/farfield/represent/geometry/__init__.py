"""Near geometry: the triangles of a leaf and the meshes its instances share, as GLB (spec/world.md)."""
