"""Object id tiles: which object each pixel of an orthoview tile shows; fetched only for picking (spec/orthoview.md)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.represent.orthoview import container, planes
from farfield.represent.orthoview.container import Plane, TileHeader
from farfield.represent.orthoview.layer import OrthoLayer

MAGIC = b"FFID"
OBJECTS = 7
"""Kind of the only plane."""


def encode_object_tile(layer: OrthoLayer, direction: int, index: int, level: int) -> bytes:
    """The ids of one layer. Raises ValueError when it keeps none, has no valid pixel, or a number does not fit."""
    if layer.objects is None:
        raise ValueError("the layer keeps no object ids")
    height, width = layer.shape
    mask = np.ascontiguousarray(layer.valid)
    ids = layer.objects[mask].astype(np.uint32)
    header = TileHeader(direction, index, level, layer.x, layer.y, width, height, layer.depth_base, ids.size)
    plane = planes.object_plane(planes.places_of(mask, ids.size), ids)
    return container.pack(MAGIC, header, [Plane(OBJECTS, container.CODED, plane)])


def decode_object_tile(data: bytes, layer: OrthoLayer, where: str = "") -> NDArray[np.uint32]:
    """(h, w) uint32 ids of the pixels of `layer`, 0 where nothing is.

    layer: decoded from the orthoview tile that the ids belong to: its valid pixels give the order.
    Raises CorruptTileError for anything but a whole tile of that layer; allocates at most 32 bytes a pixel of it.
    """
    header, stored = container.unpack(data, MAGIC, where)
    height, width = layer.shape
    mask = np.ascontiguousarray(layer.valid)
    place = (layer.x, layer.y, width, height, int(np.count_nonzero(mask)))
    if (header.x, header.y, header.width, header.height, header.valid) != place:
        raise CorruptTileError("the object ids belong to another tile", where)
    ids = np.zeros(mask.shape, np.uint32)
    plane = stored.get(OBJECTS)
    if plane is not None and plane.codec == container.CODED:
        ids[mask] = planes.read_objects(plane.stored, planes.places_of(mask, header.valid), where)
        return ids
    content = container.inflated(stored, OBJECTS, "objects", 4 * header.valid, where)
    difference = np.frombuffer(content, np.uint8).reshape(4, -1).T
    ids[mask] = np.cumsum(np.ascontiguousarray(difference).view(">u4")[:, 0], dtype=np.uint32)
    return ids
