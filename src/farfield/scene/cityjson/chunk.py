"""City objects of one place as a mesh source: flat arrays, triangulated and coloured when loaded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.cityjson.appearance import Image
from farfield.scene.cityjson.decoded import DecodedImages
from farfield.scene.cityjson.faces import Faces
from farfield.scene.cityjson.kinds import Family, Role
from farfield.scene.cityjson.palette import default_colors, roles_told
from farfield.scene.cityjson.triangulate import Triangles, triangulate
from farfield.scene.cityjson.walls import STEEPEST, facade_uvs
from farfield.scene.faults import counted
from farfield.scene.footprints.facades import VARIANTS, facade_material, plain_material, variant_of, wall_tints
from farfield.scene.footprints.rings import stretches
from farfield.scene.model import Material, Mesh, Texture

_CUTOFF = 0.5
_DECODED = DecodedImages()


@dataclass(frozen=True, slots=True, eq=False)
class CityChunk:
    """Some objects of a file; `corner` is the mesh's zero."""

    name: str
    faces: Faces
    """Their owners are numbered from 0; ascending."""
    seed: NDArray[np.uint32]
    """(n,) what an object's looks are drawn from."""
    height: NDArray[np.float64]
    """(n,) metres from its lowest to its highest point."""
    images: tuple[Image, ...]
    """Each is decoded when the chunk is loaded."""
    facades: bool

    @property
    def corner(self) -> NDArray[np.float64]:
        """(3,) coordinates of the mesh's zero: the lowest corner, whole metres."""
        return np.asarray(np.floor(self.faces.points.min(axis=0)))

    def of_own_images(self) -> CityChunk:
        """The same with only the images that its faces have."""
        textured = self.faces.image >= 0
        used, number = np.unique(self.faces.image[textured], return_inverse=True)
        image = self.faces.image.copy()
        image[textured] = number
        images = tuple(self.images[k] for k in used.tolist())
        return replace(self, faces=replace(self.faces, image=image), images=images)

    def load(self) -> Mesh:
        """Triangulates the faces: 100,000 triangles take about 0.2 s."""
        textures, warnings = _textures(self.images)
        faces = self.faces
        absent = np.array([texture is None for texture in textures], bool)
        if absent.any():
            gone = (faces.image >= 0) & absent[faces.image]
            faces = replace(faces, image=np.where(gone, np.int32(-1), faces.image))
        places = (faces.points - self.corner)[faces.corner]
        triangles = triangulate(places, faces.ring_start, faces.face_start)
        if triangles.dropped:
            warnings.append(f"{self.name}: left out {counted(triangles.dropped, 'surface')} of zero area")
        return _Looks(self, faces, places, triangles).mesh(textures, tuple(warnings))


@dataclass(frozen=True, slots=True, eq=False)
class _Looks:
    """A chunk being drawn."""

    chunk: CityChunk
    faces: Faces
    places: NDArray[np.float64]
    """(c, 3) in the mesh's frame."""
    triangles: Triangles

    def mesh(self, textures: list[Texture | None], warnings: tuple[str, ...]) -> Mesh:
        """Materials, colours and texture coordinates of every face; corners that no triangle has are dropped."""
        faces, chunk, found = self.faces, self.chunk, self.triangles
        role = roles_told(faces.role, faces.family, found.normal[:, 2])
        variant = variant_of(chunk.seed, chunk.height)
        windowed = self._windowed(role)
        colors = self._colors(role, variant, windowed)
        kind = np.where(windowed, 1 + variant[faces.owner], np.where(faces.image >= 0, 1 + VARIANTS + faces.image, 0))
        used, material = np.unique(kind * 2 + ~faces.single, return_inverse=True)
        kept, corners = np.unique(found.corners, return_inverse=True)
        face_of = np.repeat(np.arange(len(faces)), faces.sizes)[kept]
        return Mesh(
            positions=self.places[kept],
            triangles=corners.reshape(-1, 3).astype(np.uint32),
            normals=found.normal[face_of].astype(np.float32),
            materials=tuple(_material(int(number), textures) for number in used) or (plain_material(),),
            triangle_material=material.reshape(-1)[found.face].astype(np.uint16),
            uvs=self._uvs(windowed)[kept],
            colors=colors[face_of],
            triangle_object=faces.owner[found.face].astype(np.uint32),
            object_count=len(chunk.seed),
            warnings=warnings + (() if len(found.face) else (f"{chunk.name}: has no usable triangles",)),
        )

    def _windowed(self, role: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(f,) walls that get a façade: bare ones of buildings that have no windows of their own."""
        faces = self.faces
        real = np.zeros(len(self.chunk.seed), bool)
        real[faces.owner[role == Role.WINDOW]] = True
        bare = (faces.image < 0) & (faces.color[:, 3] == 0)
        normal = self.triangles.normal
        upright = (np.abs(normal[:, 2]) <= STEEPEST) & normal.any(1)
        wall = (faces.family == Family.BUILDING) & (role == Role.WALL)
        return np.asarray(wall & bare & upright & ~real[faces.owner] & self.chunk.facades)

    def _colors(
        self, role: NDArray[np.uint8], variant: NDArray[np.int64], windowed: NDArray[np.bool_]
    ) -> NDArray[np.uint8]:
        """(f, 4) of the faces; white where an image says it all."""
        faces, seed = self.faces, self.chunk.seed
        plain, tinted = (wall_tints(seed, variant, textured)[faces.owner] for textured in (False, True))
        walls = np.where(windowed[:, None], tinted, plain)
        colors = default_colors(role, faces.family, self.triangles.normal[:, 2], seed[faces.owner], walls)
        given = faces.color[:, 3] > 0
        colors[given, :3] = faces.color[given, :3]
        colors[faces.image >= 0] = 255
        return colors

    def _uvs(self, windowed: NDArray[np.bool_]) -> NDArray[np.float32]:
        """(c, 2): those of the file, its v turned downwards, and of the façades."""
        faces = self.faces
        uvs = np.zeros((len(faces.corner), 2), np.float32)
        if len(faces.uv):
            uvs[:] = faces.uv * np.array([1, -1], np.float32) + np.array([0, 1], np.float32)
        walls = np.flatnonzero(windowed)
        starts = faces.ring_start[faces.face_start]
        corners = stretches(starts[walls], starts[walls + 1])
        owner = faces.owner[walls]
        uvs[corners] = facade_uvs(
            self.places[corners], faces.sizes[walls], self.triangles.normal[walls], owner, self.chunk.seed[owner]
        )
        return uvs


def _material(number: int, textures: list[Texture | None]) -> Material:
    """Of twice a kind (plain, façades, images), plus one when it is seen from both sides."""
    kind, both = divmod(number, 2)
    if kind <= VARIANTS:
        return _own_material(kind, bool(both))
    texture = textures[kind - 1 - VARIANTS]
    assert texture is not None
    cutoff = _CUTOFF if texture.pixels[..., 3].min() < 255 else None
    return Material("image", texture=texture, alpha_cutoff=cutoff, double_sided=bool(both))


@lru_cache(maxsize=2 * (VARIANTS + 1))
def _own_material(kind: int, both: bool) -> Material:
    return replace(plain_material() if kind == 0 else facade_material(kind - 1), double_sided=both)


def _textures(images: tuple[Image, ...]) -> tuple[list[Texture | None], list[str]]:
    """Each image decoded, or None and a line that says why not: the same one in all chunks that have the image."""
    found: list[Texture | None] = []
    lines = []
    for image in images:
        try:
            found.append(_DECODED.get(image))
        except InputError as error:
            found.append(None)
            lines.append(f"{image.path}: {error.what}; its surfaces have default colours")
    return found, lines
