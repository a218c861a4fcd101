"""A tileset of mesh levels of detail as a user of 3D Tiles would build it, and the page that shows it or a world."""
