"""The objects world: statues of about 97,000 triangles under random transforms (OV 6, Table 1)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from farfield.scene.model import Mesh
from farfield.scene.procedural.objects import ObjectsOptions
from farfield.scene.read import read_scene

DATA = Path(os.environ.get("FARFIELD_SHARED_DATA", Path(__file__).parents[2] / "shared/data"))
STATUES = ("pan", "theodoric_the_great", "jenner", "horse_head", "eagle")
TRIANGLES, COUNT = 97_000, 29_264


def statues() -> tuple[Path, ...]:
    """The scanned statues as they are, or none when they are not at hand."""
    paths = tuple(DATA / "threedscans_statues" / f"{name}.glb" for name in STATUES)
    return paths if all(path.exists() for path in paths) else ()


def objects_options(folder: Path, sixteenths: int = 1) -> ObjectsOptions:
    """So many sixteenths of the paper's objects: the statues reduced to 97,000 triangles, or made ones without them."""
    return ObjectsOptions(COUNT * sixteenths // 16, meshes=tuple(_reduced(path, folder) for path in statues()))


def _reduced(statue: Path, folder: Path) -> Path:
    """The statue by quadric errors, a binary PLY."""
    import fast_simplification

    mesh: Mesh = read_scene([statue]).meshes[0].load()
    points, triangles = fast_simplification.simplify(
        mesh.positions.astype(np.float32), mesh.triangles.astype(np.int32), target_count=TRIANGLES
    )
    vertices = np.ascontiguousarray(points, "<f4")
    faces = np.empty(len(triangles), [("n", "u1"), ("items", "<i4", 3)])
    faces["n"], faces["items"] = 3, triangles
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{statue.stem}.ply"
    path.write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())
    return path
