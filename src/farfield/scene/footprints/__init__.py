"""Building footprints with heights, extruded: table, heights, rings, chunks, prisms, façades."""

from farfield.scene.footprints.features import FootprintChunk
from farfield.scene.footprints.read import read_footprints

__all__ = ["FootprintChunk", "read_footprints"]
