"""Which meshes near geometry shares, and the instances that a leaf lists in the index: objects of BEN 4."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from farfield.octree.grid import CellKey, Grid
from farfield.represent.geometry.forms import Form, errors_at
from farfield.represent.geometry.impostor import impostors_of
from farfield.scene.model import Instances, MeshSource
from farfield.scene.stored.scene import MeshSummary
from farfield.world.index import ERROR_SPACING, MESH_FARTHEST, MOST_INSTANCES, Impostor, InstancedMesh, MeshLevel
from farfield.world.keys import texture_key
from farfield.world.reach import level_values

if TYPE_CHECKING:
    from farfield.bake.context import BakeContext

FEWEST_TRIANGLES = 96
"""Of a mesh that is placed once, to be kept whole: those of fewer have no levels, and are cheaper with all else."""
MOST_EDGES = 2.0
"""Leaf edges that it may be long: leaves then need little of it that does not lie in them."""
HALVINGS = 2
"""Of the sides of images in levels: they take a tenth of the bytes or less. Halved more often they would save next to
nothing, and coarse pictures show the joints of a pavement that they lose."""
SEEN = 1.5
"""Times the error of a form that is told of it: by 1 - FLIP / FLIP of nothing of whole pictures near leaves that are
drawn by it are worse than its own pictures say. With this Tokyo's level is told to .02, those of statues are still told
.03 to .07 too good (docs/performance.md, Near geometry)."""
WIDTHS = 3
"""Views that errors are told for."""


def shared_meshes(instances: Instances, summaries: Sequence[MeshSummary], grid: Grid) -> NDArray[np.bool_]:
    """(meshes,) which are kept whole, as files of their own that leaves place.

    Those that are placed more than once; and single objects, no blocks of buildings, no longer than MOST_EDGES leaves
    with triangles enough for levels, so that viewers can be sent one after the other, as far as no leaf has more than
    it may list.
    """
    placements = np.bincount(instances.mesh, minlength=len(summaries))
    shared = placements > 1
    triangles = np.array([summary.triangles for summary in summaries], np.int64)
    once = (placements == 1)[instances.mesh] & (instances.objects == 1)
    rows = np.flatnonzero(once & (triangles >= FEWEST_TRIANGLES)[instances.mesh])
    boxes = [_box(summaries[mesh]) for mesh in instances.mesh[rows].tolist()]
    if not boxes:
        return shared
    lower, upper = np.array(boxes).transpose(1, 0, 2)
    turn = instances.transform[rows]
    extent = np.einsum("nij,nj->ni", np.abs(turn[:, :, :3]), upper - lower)
    small = (extent <= MOST_EDGES * grid.leaf_size).all(axis=1)
    middle = np.einsum("nij,nj->ni", turn[:, :, :3], (lower + upper) / 2) + turn[:, :, 3]
    leaves, of, count = np.unique(grid.leaf_index(middle[small]), axis=0, return_inverse=True, return_counts=True)
    if len(leaves):
        shared[instances.mesh[rows[small][count[of.ravel()] <= MOST_INSTANCES]]] = True
    return shared


def have_own_facades(sources: Sequence[MeshSource]) -> NDArray[np.bool_]:
    """(meshes,) which are buildings with an image each: leaves pack what they show of them, and need no other."""
    return np.array([getattr(source, "facades", None) == "unique" for source in sources], np.bool_)


class Listing:
    """Which leaves list all that is placed in them, told from the plan alone."""

    def __init__(self, context: BakeContext) -> None:
        self._context = context
        self._risky: NDArray[np.bool_] | None = None
        self._lists: dict[CellKey, bool] = {}

    def has_all(self, position: int) -> bool:
        """Whether each instance of a shared mesh that reaches into a leaf is listed, in whichever leaf its place is.

        position: of the leaf in the plan. Meshes are loaded only where so much is placed that it may not be listed.
        """
        if self._risky is None:
            self._risky = self._in_crowds()
        rows = self._shared_in(position)
        rows = rows[self._risky[rows]]
        places = np.unique(_places(self._context, rows), axis=0).tolist()
        return all(self._lists_all(CellKey(0, *place)) for place in places)

    def _lists_all(self, key: CellKey) -> bool:
        """Whether a leaf has no more places than it may list."""
        if key not in self._lists:
            places = _places(self._context, self._shared_in(self._context.leaf_of[key]))
            self._lists[key] = int((places == key[1:]).all(axis=1).sum()) <= MOST_INSTANCES
        return self._lists[key]

    def _in_crowds(self) -> NDArray[np.bool_]:
        """(instances,) which reach into a leaf that more reach into than it may list."""
        found = np.zeros(len(self._context.job.scene.instances.mesh), np.bool_)
        for position in range(len(self._context.job.plan.leaves)):
            rows = self._shared_in(position)
            if len(rows) > MOST_INSTANCES:
                found[rows] = True
        return found

    def _shared_in(self, position: int) -> NDArray[np.int64]:
        rows = np.unique(self._context.job.plan.rows(position)[0])
        return np.asarray(rows[self._context.shared[self._context.job.scene.instances.mesh[rows]]], np.int64)


def _places(context: BakeContext, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(k, 3) index of the leaf that is the place of each instance."""
    table = context.job.scene.instances
    found = np.empty((len(rows), 3))
    for mesh in np.unique(table.mesh[rows]).tolist():
        own = table.mesh[rows] == mesh
        turn = table.transform[rows[own]]
        found[own] = turn[:, :, :3] @ context.mesh_anchor(mesh) + turn[:, :, 3]
    return context.grid.leaf_index(found)


def instances_in(context: BakeContext, key: CellKey, position: int, shared: Sequence[int]) -> tuple[InstancedMesh, ...]:
    """Instances whose place a leaf is, by mesh, their meshes' levels stored; none when there are more than may be.

    position: of the leaf in the plan. shared: the meshes that reach into it. Of each instance one leaf alone is the
    place: that of the middle of its first triangle, in which there is something of it for certain.
    """
    table, corner = context.job.scene.instances, context.grid.bounds(key)[0]
    rows = np.unique(context.job.plan.rows(position)[0])
    found: list[tuple[int, NDArray[np.int64]]] = []
    for mesh in shared:
        own = rows[table.mesh[rows] == mesh]
        own = own[(_places(context, own) == [key.x, key.y, key.z]).all(axis=1)]
        if len(own):
            found.append((mesh, own))
    if sum(len(own) for _, own in found) > MOST_INSTANCES:
        return ()
    return tuple(_listed(context, mesh, own, corner) for mesh, own in found)


def _listed(context: BakeContext, mesh: int, rows: NDArray[np.int64], corner: NDArray[np.float64]) -> InstancedMesh:
    table = context.job.scene.instances
    transforms = table.transform[rows].copy()
    transforms[:, :, 3] -= corner
    flat = transforms.reshape(len(rows), 12)
    order = np.lexsort((*flat.T, table.first_object[rows]))
    lower, upper = (_triple(side) for side in _box(context.job.summaries[mesh]))
    # As the leaf's geometry has them: single precision, in as few digits as tell it.
    places = tuple(tuple(float(str(value)) for value in row) for row in flat[order].astype(np.float32))
    levels = context.mesh_levels(mesh)
    context.keep(key for level in levels for key, _ in level_values(level))
    impostors = context.mesh_impostors(mesh)
    context.keep(texture_key(name) for one in impostors for name, _ in one.images)
    return InstancedMesh((lower, upper), levels, tuple(table.first_object[rows[order]].tolist()), places, impostors)


def make_mesh_levels(context: BakeContext, mesh: int) -> tuple[MeshLevel, ...]:
    """The full mesh, and all levels that it has. Errors are told for the size that most instances have."""
    forms = context.mesh_forms(mesh)
    full = context.mesh_file(mesh, 0, 0)
    extent = forms[0].extent * _scale(context.job.scene.instances, mesh)
    found = [MeshLevel(full.hash, full.bytes, full.triangles, tuple(sorted(full.images.items())))]
    for shape in range(0 if full.images else 1, len(forms)):
        file = context.mesh_file(mesh, shape, HALVINGS)
        errors = _errors(context, forms, shape, extent, HALVINGS)
        found.append(MeshLevel(file.hash, file.bytes, file.triangles, tuple(sorted(file.images.items())), errors))
    return tuple(found)


def make_impostors(context: BakeContext, mesh: int) -> tuple[Impostor, ...]:
    """Images of a mesh from round about, without those for whose bytes one of its levels shows as much.

    None at all where it has no levels, as boxes have none, or light does not fall on it.
    """
    levels = context.mesh_levels(mesh)
    if len(levels) == 1 or any(one.unlit for one in context.meshes.get(mesh).materials):
        return ()
    form = context.mesh_forms(mesh)[0]
    extent = form.extent * _scale(context.job.scene.instances, mesh)
    found = []
    for one in impostors_of(form.chunk, context.mesh_table(mesh), _box(context.job.summaries[mesh])):
        as_form = Form(form.chunk, one.errors, 0.0, form.extent, 0.0, ())
        errors = _errors(context, (as_form,), 0, extent, 0)
        size = np.mean([len(data) for data in one.images])
        if not any(_size(level) <= size and _is_like(level, errors) for level in levels):
            found.append(Impostor(one.rows, tuple(map(context.image_of, one.images)), errors))
    return tuple(found)


def _size(level: MeshLevel) -> int:
    """Bytes of all that it needs."""
    return sum(size for _, size in level_values(level))


def _is_like(level: MeshLevel, errors: Sequence[int]) -> bool:
    """Whether it errs no more, from wherever it is seen."""
    return all(own <= other for own, other in zip(level.errors or (0,) * WIDTHS, errors, strict=True))


def _errors(context: BakeContext, forms: Sequence[Form], shape: int, extent: float, halvings: int) -> tuple[int, ...]:
    farthest = MESH_FARTHEST * context.grid.pitch(0)
    widths = (farthest / ERROR_SPACING**n for n in range(WIDTHS))
    each = (SEEN * errors_at(forms, shape, extent, width, halvings) for width in widths)
    return tuple(round(255 * min(error, 1.0)) for error in each)


def _scale(instances: Instances, mesh: int) -> float:
    """Times that the mesh is as large as it is placed, the median."""
    turn = instances.transform[instances.mesh == mesh][:, :, :3]
    return float(np.median(np.cbrt(np.abs(np.linalg.det(turn)))))


def _box(summary: MeshSummary) -> NDArray[np.float64]:
    """(2, 3) of a mesh, in its frame."""
    if not len(summary.boxes):
        return np.zeros((2, 3))
    return np.stack([summary.boxes[:, 0].min(axis=0), summary.boxes[:, 1].max(axis=0)])


def _triple(values: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
