"""A baked world as its readers see it: manifest, index, tiles."""
