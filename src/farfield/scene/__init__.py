"""What is read: a Scene of instances of meshes. One reader per format; procedural scenes."""
