"""Near geometry of a leaf and its levels: fewer triangles and smaller images, with what that changes (BEN 4.1.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from farfield.bake.context import BakeContext, LeafMaterials, MeshForm
from farfield.bake.instances import HALVINGS, SEEN, WIDTHS, instances_in
from farfield.octree.grid import CellKey
from farfield.represent.chunk import Chunk, merge
from farfield.represent.geometry.forms import Form, errors_at, forms_of
from farfield.represent.geometry.leaf_atlas import with_atlas
from farfield.represent.geometry.write import PlacedMesh, leaf_glb
from farfield.world.index import ERROR_SPACING, GeometryEntry, GeometryLevel, InstancedMesh
from farfield.world.keys import content_hash, geometry_key
from farfield.world.reach import form_values

FEWEST_BYTES = 2 << 10
"""Geometry of a leaf that takes no more is not made any coarser. A statue of 6 kB is 3 s at 2,000 B/s."""
SMALLER = 0.7
"""Share of the bytes of the level before that a level takes at most, with all that it needs."""
WORST = 0.35
"""Error from where a pixel is as wide as one of the leaf's pictures, beyond which a level is not made: façades smear,
and pictures show as much for fewer bytes."""


@dataclass(frozen=True, slots=True)
class _Part:
    """Something of a leaf: its own triangles, or a mesh that is placed in it."""

    forms: Sequence[Form]
    extent: float
    """Metres along the longest side, as it is placed."""
    count: int = 1


@dataclass(frozen=True, slots=True)
class NearGeometry:
    """What a leaf has."""

    entry: GeometryEntry
    instances: tuple[InstancedMesh, ...]
    files: dict[str, bytes]
    """Its forms by key."""
    opaque: bool
    """See Record.opaque."""


def near_geometry(
    context: BakeContext, key: CellKey, position: int, parts: dict[int, list[Chunk]], materials: LeafMaterials
) -> NearGeometry:
    """Stores a leaf's geometry in all its forms, and what is placed in it. parts: mesh -> its clipped pieces."""
    own = [piece for mesh, pieces in parts.items() if not context.shared[mesh] for piece in pieces]
    shared = [mesh for mesh in parts if context.shared[mesh]]
    chunk = merge(own) if own else None
    opaque = chunk is None or all(materials.materials[n].alpha_cutoff is None for n in np.unique(chunk.materials))
    side = context.job.options.atlas_side
    atlased = (
        with_atlas(chunk, materials.materials, side, context.material_image) if chunk is not None and side else None
    )
    if atlased is not None:
        chunk = atlased.chunk
        materials = LeafMaterials(context.table(atlased.materials), atlased.materials, {})
    made = _Made(context, key, position, shared, materials)
    full, data = made.form(chunk, 0, 0)
    made.keep(full, data)
    instances = instances_in(context, key, position, shared)
    levels = () if _size(full) <= FEWEST_BYTES else made.levels(full, made.parts(chunk), context.grid.pitch(0))
    if atlased is not None:
        context.forget(atlased.texture)
    return NearGeometry(_entry(full, levels), instances, made.files, opaque)


@dataclass(frozen=True, slots=True)
class _Made:
    """Makes the forms of one leaf."""

    context: BakeContext
    key: CellKey
    position: int
    shared: Sequence[int]
    materials: LeafMaterials
    files: dict[str, bytes] = field(default_factory=dict)
    """What is kept, by key."""

    def form(
        self, chunk: Chunk | None, shape: int, halvings: int, errors: tuple[int, ...] = ()
    ) -> tuple[GeometryLevel, bytes]:
        """One, and its file. chunk: the leaf's own triangles. shape: which form of meshes. halvings: of images."""
        images: dict[str, int] = {}
        meshes = [self.context.mesh_file(mesh, shape, halvings) for mesh in self.shared]
        for mesh in meshes:
            images |= mesh.images
        placed = [_placed(self.context, self.key, self.position, *one) for one in zip(self.shared, meshes, strict=True)]
        image = self.context.naming(halvings, images)
        data = leaf_glb(self.key, self.context.grid.leaf_size, chunk, self.materials.materials, placed, image)
        name = content_hash(data)
        triangles = 0 if chunk is None else len(chunk.triangles)
        files = tuple(dict.fromkeys((mesh.hash, mesh.bytes) for mesh in meshes))
        counts = [len(one.objects) for one in placed]
        drawn = triangles + sum(count * mesh.triangles for count, mesh in zip(counts, meshes, strict=True))
        needs = files, tuple(sorted(images.items()))
        level = GeometryLevel(name, len(data), triangles, sum(counts), *needs, errors, drawn)
        return level, data

    def parts(self, chunk: Chunk | None) -> list[_Part]:
        """What has levels: the leaf's own triangles, if there are any, then each mesh that is placed in it."""
        # Where there are BlockMaps alone these stand in for what is far, for fewer bytes than simplified buildings.
        simplified = self.context.job.options.orthoviews
        forms: tuple[Form, ...] = forms_of(chunk, self.materials.table, simplified) if chunk is not None else ()
        found = [_Part(forms, forms[0].extent)] if forms else []
        for mesh in self.shared:
            scale = np.cbrt(np.abs(np.linalg.det(_transforms(self.context, self.position, mesh)[:, :, :3])))
            of = self.context.mesh_forms(mesh)
            found.append(_Part(of, float(of[0].extent * scale.mean()), len(scale)))
        return found

    def keep(self, form: GeometryLevel, data: bytes) -> None:
        """Stores one, with all that it needs."""
        self.context.keep(key for key, _ in form_values(self.key, form))
        self.files[geometry_key(self.key, form.hash)] = data
        self.context.store.put(geometry_key(self.key, form.hash), data)

    def levels(self, full: GeometryLevel, parts: Sequence[_Part], pitch: float) -> tuple[GeometryLevel, ...]:
        """From fine to coarse, as long as each takes much less than the one before and shows something."""
        found: list[GeometryLevel] = []
        last = full
        # Images take most, and are missed least: they are made smaller before the triangles are made fewer.
        later = 1 if full.textures else 0
        steps = max(len(part.forms) for part in parts) - 1 + later
        own = parts[0].forms if len(parts) > len(self.shared) else ()
        for level in range(1, steps + 1):
            shape = level - later
            errors = _errors(parts, shape, pitch)
            if errors[0] > WORST:
                break
            chunk = own[min(shape, len(own) - 1)].chunk if own else None
            made, data = self.form(chunk, shape, HALVINGS, tuple(round(255 * error) for error in errors))
            if _size(made) <= SMALLER * _size(last):
                self.keep(made, data)
                found.append(made)
                last = made
        return tuple(found)


def _errors(parts: Sequence[_Part], shape: int, pitch: float) -> tuple[float, ...]:
    """Of the leaf at a level, mean of its parts by how large they look, for each view (ERROR_SPACING)."""
    weights = np.array([part.count * part.extent**2 for part in parts])
    found = []
    for width in pitch / ERROR_SPACING ** np.arange(WIDTHS):
        each = [errors_at(part.forms, shape, part.extent, float(width), HALVINGS) for part in parts]
        found.append(min(SEEN * float(np.average(each, weights=weights)), 1.0))
    return tuple(found)


def _size(form: GeometryLevel) -> int:
    """Bytes of all that it needs."""
    return form.bytes + sum(size for _, size in (*form.meshes, *form.textures))


def _entry(full: GeometryLevel, levels: tuple[GeometryLevel, ...]) -> GeometryEntry:
    files = full.hash, full.bytes, full.triangles, full.instances, full.meshes, full.textures
    return GeometryEntry(*files, drawn=full.drawn, levels=levels)


def _placed(context: BakeContext, key: CellKey, position: int, mesh: int, file: MeshForm) -> PlacedMesh:
    chosen = _chosen(context, position, mesh)
    table = context.job.scene.instances
    transforms = table.transform[chosen].copy()
    transforms[:, :, 3] -= context.grid.bounds(key)[0]
    order = np.lexsort((*transforms.reshape(len(chosen), -1).T, table.first_object[chosen]))
    return PlacedMesh(file.hash, transforms[order], table.first_object[chosen][order].astype(np.uint32))


def _transforms(context: BakeContext, position: int, mesh: int) -> NDArray[np.float64]:
    return context.job.scene.instances.transform[_chosen(context, position, mesh)]


def _chosen(context: BakeContext, position: int, mesh: int) -> NDArray[np.int64]:
    """Instances of a mesh that reach into a leaf."""
    instances = np.unique(context.job.plan.rows(position)[0])
    return np.asarray(instances[context.job.scene.instances.mesh[instances] == mesh])
