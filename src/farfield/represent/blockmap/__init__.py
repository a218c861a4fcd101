"""BlockMaps: the buildings of a square in one small picture, seen by casting rays through it (BLK)."""
