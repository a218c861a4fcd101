"""CityJSON and CityJSONSeq: documents, objects, geometries, appearance, chunks."""

from farfield.scene.cityjson.chunk import CityChunk
from farfield.scene.cityjson.read import read_cityjson

__all__ = ["CityChunk", "read_cityjson"]
