"""Building footprints with heights, extruded: table, heights, rings, chunks, prisms, façades."""

from farfield.scene.footprints.read import FootprintChunk, read_footprints

__all__ = ["FootprintChunk", "read_footprints"]
