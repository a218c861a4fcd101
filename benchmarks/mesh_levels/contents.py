"""What the tiles of a level hold: merged copies, instances, or what stands once, with textures of its level's size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from farfield.scene.model import Mesh, Texture
from mesh_levels.cells import Cell, Contents
from mesh_levels.chains import COMPRESSED, save_webp, shrinking, shrunk, texel, within
from mesh_levels.glb import joined, placed, write
from mesh_levels.i3dm import cmpt, i3dm
from mesh_levels.packages import gltfpack

ATLAS = "facades "
"""Begin of the names of materials whose texture is the atlas of a cell."""
Box = NDArray[np.float64]
"""(2, 3) lower and upper corner, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Content:
    """A file of a tile."""

    name: str
    """Relative to the tileset."""
    box: Box
    cost: int
    """Bytes that a viewer which has nothing else fetches for it."""


@dataclass(slots=True)
class Shelf:
    """Files of a tileset: models, and textures that they share."""

    folder: Path
    texels: dict[str, float] = field(default_factory=dict)
    """Material -> metres a texel, of the exact mesh."""

    @property
    def work(self) -> Path:
        """For what is made on the way."""
        path = self.folder / "work"
        path.mkdir(exist_ok=True, parents=True)
        return path

    def pack(self, stem: str, mesh: Mesh, error: float) -> Content:
        """Compresses a mesh to content/STEM.glb, its textures as large as an error in metres asks for."""
        textures = {
            m.name: self._texture(mesh, k, error) for k, m in enumerate(mesh.materials) if m.texture is not None
        }
        source, target = self.work / "whole.glb", self.folder / f"content/{stem}.glb"
        target.parent.mkdir(exist_ok=True)
        write(source, mesh, {name: f"../{texture}" for name, texture in textures.items()})
        # gltfpack writes addresses anew, relative to what it writes.
        size = gltfpack(source, target, *COMPRESSED)
        size += sum((self.folder / texture).stat().st_size for texture in textures.values())
        return Content(f"content/{stem}.glb", box_of(mesh), size)

    def _texture(self, mesh: Mesh, row: int, error: float) -> str:
        material = mesh.materials[row]
        texture = material.texture
        assert texture is not None
        if material.name not in self.texels:
            self.texels[material.name] = texel(mesh, row)
        factor = shrinking(self.texels[material.name], error, min(texture.pixels.shape[:2]))
        name = f"textures/{material.name.replace(' ', '-')}-{factor}.webp"
        path = self.folder / name
        if not path.exists():
            path.parent.mkdir(exist_ok=True, parents=True)
            save_webp(path, shrunk(texture.pixels, factor))
        return name


class Contained(Protocol):
    """Makes the contents of tiles."""

    def content(self, level: int, cell: Cell, leaves: Sequence[Cell]) -> Content:
        """Of the tile of a level that holds these leaf cells."""
        ...


@dataclass(slots=True)
class Kinds:
    """Meshes that are placed many times: each simplified once a level."""

    contents: Contents
    errors: Mapping[int, float]
    shelf: Shelf
    instanced: bool
    rungs: dict[tuple[str, int], Mesh] = field(default_factory=dict)
    models: dict[tuple[str, int], Content] = field(default_factory=dict)

    def content(self, level: int, cell: Cell, leaves: Sequence[Cell]) -> Content:
        """See Contained."""
        own: dict[str, list[NDArray[np.float64]]] = {}
        for leaf in leaves:
            for kind, transforms in self.contents.placements[leaf].items():
                own.setdefault(kind, []).append(transforms)
        together = {kind: np.concatenate(parts) for kind, parts in own.items()}
        stem = f"{level}_{cell[0]}_{cell[1]}"
        return self._instances(stem, level, together) if self.instanced else self._merged(stem, level, together)

    def _merged(self, stem: str, level: int, placements: dict[str, NDArray[np.float64]]) -> Content:
        copies = [placed(self._rung(kind, level), t) for kind, own in placements.items() for t in own]
        return self.shelf.pack(stem, joined(copies), self.errors[level])

    def _instances(self, stem: str, level: int, placements: dict[str, NDArray[np.float64]]) -> Content:
        tiles, boxes, cost = [], [], 0
        for kind, transforms in placements.items():
            if (kind, level) not in self.models:
                name = f"model-{kind}-{level}".replace(" ", "-")
                self.models[kind, level] = self.shelf.pack(name, self._rung(kind, level), self.errors[level])
            model = self.models[kind, level]
            cost += model.cost
            tiles.append(i3dm(Path(model.name).name, transforms))
            corners = np.array(np.meshgrid(*model.box.T, indexing="ij")).reshape(3, -1)
            boxes.append(np.moveaxis(transforms[:, :, :3] @ corners + transforms[:, :, 3:], 1, 2).reshape(-1, 3))
        raw = cmpt(tiles)
        (self.shelf.folder / f"content/{stem}.cmpt").write_bytes(raw)
        points = np.concatenate(boxes)
        return Content(f"content/{stem}.cmpt", np.stack([points.min(0), points.max(0)]), cost + len(raw))

    def _rung(self, kind: str, level: int) -> Mesh:
        if (kind, level) not in self.rungs:
            transforms = [own[kind] for own in self.contents.placements.values() if kind in own]
            scale = max(np.cbrt(np.linalg.det(t[:, :, :3])).max() for t in transforms)
            error = self.errors[level] / scale
            # Scans have seams of normals that hold a mesh together at any error without -sp.
            self.rungs[kind, level] = within(self.contents.kinds[kind], error, self.shelf.work, "-sp")
        return self.rungs[kind, level]


@dataclass(slots=True)
class Once:
    """What stands once: simplified tile by tile. Atlases of cells are halved from level to level and put together."""

    contents: Contents
    errors: Mapping[int, float]
    shelf: Shelf

    def content(self, level: int, cell: Cell, leaves: Sequence[Cell]) -> Content:
        """See Contained."""
        mesh = joined([mesh for leaf in leaves for mesh in self.contents.unique[leaf]])
        # Across the seams of an atlas nothing may move.
        options = () if any(material.name.startswith(ATLAS) for material in mesh.materials) else ("-sp",)
        made = within(mesh, self.errors[level], self.shelf.work, *options)
        stem = f"{level}_{cell[0]}_{cell[1]}"
        return self.shelf.pack(
            stem, with_one_atlas(made, f"{max(level, 0)}_{cell[0]}_{cell[1]}", max(level, 0)), self.errors[level]
        )


def with_one_atlas(mesh: Mesh, name: str, level: int) -> Mesh:
    """Puts the atlases of a mesh, those named `facades …`, into one, smaller by 2^level; side by side in a square."""
    rows = [k for k, material in enumerate(mesh.materials) if material.name.startswith(ATLAS)]
    if not rows or mesh.uvs is None:
        return mesh
    small = [shrunk(mesh.materials[k].texture.pixels, 2**level) for k in rows]  # type: ignore[union-attr]
    columns = int(np.ceil(np.sqrt(len(small))))
    height, width = (max(picture.shape[axis] for picture in small) for axis in (0, 1))
    pixels = np.full((-(-len(small) // columns) * height, columns * width, 4), 255, np.uint8)
    uvs, triangle_material = mesh.uvs.copy(), mesh.triangle_material.copy()
    for place, (row, picture) in enumerate(zip(rows, small, strict=True)):
        y, x = height * (place // columns), width * (place % columns)
        pixels[y : y + picture.shape[0], x : x + picture.shape[1]] = picture
        own = np.unique(mesh.triangles[mesh.triangle_material == row])
        uvs[own] = (mesh.uvs[own] * picture.shape[1::-1] + (x, y)) / pixels.shape[1::-1]
        triangle_material[mesh.triangle_material == row] = rows[0]
    atlas = replace(mesh.materials[rows[0]], name=f"atlas {name}", texture=Texture(pixels))
    materials = tuple(atlas if k == rows[0] else material for k, material in enumerate(mesh.materials))
    return replace(mesh, uvs=uvs, triangle_material=triangle_material, materials=materials)


def box_of(mesh: Mesh) -> Box:
    """The bounds of the vertices that are used."""
    used = mesh.positions[mesh.triangles.ravel()]
    return np.stack([used.min(0), used.max(0)])
