"""KHR_draco_mesh_compression: the attributes and indices of a compressed primitive."""

from __future__ import annotations

from typing import Any

import DracoPy
import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.faults import EXPORT_AGAIN
from farfield.scene.gltf.container import Document


def decode_primitive(
    document: Document, extension: dict[str, Any]
) -> tuple[dict[str, NDArray[Any]], NDArray[np.uint32]]:
    """Attribute name -> (n, k) in the stored type, and (m, 3) triangles. Raises InputError."""
    raw = document.view_bytes(extension["bufferView"]).tobytes()
    try:
        decoded = DracoPy.decode(raw)
    except Exception as error:  # DracoPy raises bare exceptions of several kinds for damaged input
        raise InputError("is damaged: its Draco data cannot be decoded", document.where, EXPORT_AGAIN) from error
    stored = {entry["unique_id"]: entry["data"] for entry in decoded.attributes}
    attributes = {name: stored[number] for name, number in extension["attributes"].items() if number in stored}
    faces = getattr(decoded, "faces", None)
    if faces is None:
        raise InputError("is damaged: a Draco primitive holds points, not triangles", document.where, EXPORT_AGAIN)
    return attributes, np.asarray(faces, np.uint32).reshape(-1, 3)
