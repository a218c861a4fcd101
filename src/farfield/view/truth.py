"""The true picture of a scene: its triangles, drawn with many samples a pixel. What pictures are compared with."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.geometry.cameras import Camera
from farfield.geometry.frustum import Frustum
from farfield.represent.blocks import BLOCK, BlockedMesh, transformed_boxes
from farfield.represent.chunk import Chunk
from farfield.represent.clipping import assemble, clip_to_cells
from farfield.scene.model import Scene
from farfield.view.frame import Frame
from farfield.view.geometry import BATCH, Batches, GeometryPass
from farfield.view.left_out import LeftOut
from farfield.view.picture import Picture, Statistics
from farfield.view.shading import Light


@dataclass(frozen=True, slots=True)
class TruthOptions:
    """How a true picture is drawn."""

    supersampling: int = 8
    """Samples a pixel along each axis; 16 in all still carry noise of their own."""
    light: Light = field(default_factory=Light)
    left_out: LeftOut | None = None
    """Cells to leave out, None: everything is drawn."""
    normals: bool = False
    """Keep the normals."""
    ids: bool = False
    """Keep the object ids."""


def draw_truth(scene: Scene, camera: Camera, size: tuple[int, int], options: TruthOptions | None = None) -> Picture:
    """Draws a scene from its geometry.

    size: width and height, pixels. A mesh that cannot be loaded is left out and counted as a warning. Takes about 1 s
    a million samples and million triangles; memory of 20 bytes a sample, one mesh and one batch.
    """
    begun = time.perf_counter()
    options = options or TruthOptions()
    frame = Frame.empty(camera, size, options.supersampling, options.normals, options.ids)
    gathered = Batches(GeometryPass(frame, options.light))
    frustum = Frustum.of(camera, size)
    warnings = 0
    for mesh in np.unique(scene.instances.mesh):
        try:
            loaded = scene.meshes[int(mesh)].load()
        except InputError:
            warnings += 1
            continue
        blocked = BlockedMesh.from_mesh(loaded)
        base = gathered.add_materials(loaded.materials)
        for instance in _nearest_first(np.flatnonzero(scene.instances.mesh == mesh), scene, camera):
            transform = scene.instances.transform[instance]
            placed = _Placed(blocked, transform, base, int(scene.instances.first_object[instance]))
            for chunk in placed.seen(camera, frustum, options.left_out):
                gathered.add(chunk)
    gathered.flush()
    statistics = Statistics(
        seconds=time.perf_counter() - begun, triangles=gathered.drawing.triangles, warnings=warnings
    )
    return replace(frame.develop(options.light), statistics=statistics)


@dataclass(frozen=True, slots=True)
class _Placed:
    """An instance of a mesh."""

    mesh: BlockedMesh
    transform: NDArray[np.float64]
    material_base: int
    object_base: int

    def seen(self, camera: Camera, frustum: Frustum, left_out: LeftOut | None) -> Iterator[Chunk]:
        """What of it is in the frustum and not left out, relative to the eye."""
        boxes = transformed_boxes(self.mesh.boxes, self.transform)
        visible = touches_all(frustum, boxes)
        eye = np.array(camera.eye, dtype=np.float64)
        if left_out is not None:
            shown, mixed = left_out.sort(boxes - np.array(left_out.grid.corner))
            yield from self._cut(np.flatnonzero(visible & mixed), left_out, eye)
            visible &= shown
        # What is drawn first hides most of the rest, whose masks then need not be looked at.
        away = np.linalg.norm(boxes.mean(1) - eye, axis=1)
        order = np.argsort(away, kind="stable")
        for blocks in _runs(order[visible[order]]):
            placed = self.mesh.placed(self._relative(eye), blocks, self.material_base, self.object_base)
            yield placed.chunk()

    def _cut(self, blocks: NDArray[np.int64], left_out: LeftOut, eye: NDArray[np.float64]) -> Iterator[Chunk]:
        corner, leaf_size = np.array(left_out.grid.corner), left_out.grid.leaf_size
        for run in _runs(blocks):
            placed = self.mesh.placed(self._relative(corner), run, self.material_base, self.object_base)
            pieces = clip_to_cells(placed.positions, placed.triangles, leaf_size)
            kept = pieces.of(left_out.keeps(pieces.cell))
            if len(kept.source):
                yield assemble(placed, kept, eye - corner)

    def _relative(self, origin: NDArray[np.float64]) -> NDArray[np.float64]:
        transform = np.array(self.transform, dtype=np.float64)
        transform[:, 3] -= origin
        return transform


def _nearest_first(instances: NDArray[np.int64], scene: Scene, camera: Camera) -> NDArray[np.int64]:
    away = np.linalg.norm(scene.instances.transform[instances][:, :, 3] - np.array(camera.eye), axis=1)
    return instances[np.argsort(away, kind="stable")]


def touches_all(frustum: Frustum, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(b, 2, 3) boxes -> (b,) bool: which may be seen, as `Frustum.touches`."""
    normals, offsets = frustum.planes[:, :3], frustum.planes[:, 3]
    inner = np.where(normals > 0, boxes[:, 1, None], boxes[:, 0, None])
    return np.asarray(((inner * normals).sum(-1) + offsets >= 0).all(-1))


def _runs(blocks: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Blocks in runs of at most a batch."""
    step = BATCH // BLOCK
    for first in range(0, len(blocks), step):
        yield blocks[first : first + step]
