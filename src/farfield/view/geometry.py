"""Triangles drawn into a frame in perspective, with the rasteriser that draws the orthoviews."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.frustum import cut_to_frustum
from farfield.kernels.project import project_perspective, to_clip
from farfield.kernels.rasterise import rasterise
from farfield.kernels.samples import fill_frame
from farfield.kernels.surface import FAR, NOTHING
from farfield.represent.chunk import Chunk, merge
from farfield.represent.clipping import append_pieces
from farfield.represent.materials import MaterialTable, TexturePool
from farfield.scene.model import Material
from farfield.view.frame import Frame
from farfield.view.shading import Light

NEAR_PLANE = 1e-3
"""Metres in front of the eye from which on triangles are drawn."""
BATCH = 1 << 20
"""Triangles drawn at once: about 150 MB; every batch also looks at each sample once."""
_NO_LIMIT = np.empty((0, 0), dtype=np.float32)
_AS_THEY_COME = np.empty(0, dtype=np.uint32)


class GeometryPass:
    """Draws batches of triangles into a frame, in front of or behind what is there already.

    Holds two buffers as large as the frame's. Surfaces are never culled: both sides are drawn and lit.
    """

    def __init__(self, frame: Frame, light: Light) -> None:
        self.frame = frame
        self.triangles = 0
        """Triangles drawn so far that reach into the frustum, pieces counted."""
        self._sun = light.sun.astype(np.float32)
        width, height = frame.sample_size
        rows = frame.camera.matrix((width, height))[:, :3]
        self._matrix = np.ascontiguousarray(rows)
        with np.errstate(divide="ignore"):
            self._z = np.where(np.isinf(frame.depth), FAR, np.float32(-1.0) / frame.depth).astype(np.float32)
        self._ids = np.empty(frame.depth.shape, dtype=np.uint32)

    def draw(self, chunk: Chunk, materials: MaterialTable) -> None:
        """Draws a chunk whose positions are relative to the eye (metres, world axes)."""
        clip = np.empty(chunk.positions.shape)
        to_clip(chunk.positions, self._matrix, clip)
        chunk, clip = self._cut(chunk, clip)
        if len(chunk.triangles) == 0:
            return
        self.triangles += len(chunk.triangles)
        screen = np.empty((len(clip), 4), dtype=np.float32)
        project_perspective(clip, screen)
        self._ids.fill(NOTHING)
        rasterise(screen, chunk.surface, materials.arrays, _NO_LIMIT, _AS_THEY_COME, _NO_LIMIT, self._z, self._ids)
        frame = self.frame
        fill_frame(
            screen, chunk.surface, materials.arrays, self._sun, self._z, self._ids,
            frame.depth, frame.surface, frame.normal, frame.objects,
        )  # fmt: skip

    def _cut(self, chunk: Chunk, clip: NDArray[np.float64]) -> tuple[Chunk, NDArray[np.float64]]:
        """The chunk without what is outside the frustum, cut where it would not project."""
        width, height = self.frame.sample_size
        whole = np.empty(len(chunk.triangles), dtype=np.int32)
        room = 1024
        while True:
            source = np.empty(room, dtype=np.int32)
            corners, weights = np.empty((room, 3, 3)), np.empty((room, 3, 3))
            kept, pieces = cut_to_frustum(
                clip, chunk.triangles, NEAR_PLANE, float(width), float(height), whole, source, corners, weights
            )
            if pieces <= room:
                break
            room = pieces
        cut = append_pieces(chunk, whole[:kept], source[:pieces], weights[:pieces])
        return cut, np.concatenate([clip, corners[:pieces].reshape(-1, 3)])


class Batches:
    """Collects chunks and draws them many at once: every drawing also looks at each sample."""

    def __init__(self, drawing: GeometryPass) -> None:
        self.drawing = drawing
        self._materials: list[Material] = []
        self._pool = TexturePool()
        self._table: MaterialTable | None = None
        self._chunks: list[Chunk] = []
        self._count = 0

    def add_materials(self, materials: tuple[Material, ...]) -> int:
        """Number of the first of a mesh's materials in the table."""
        base = len(self._materials)
        self._materials += materials
        self._table = None
        return base

    def add(self, chunk: Chunk) -> None:
        """Takes a chunk relative to the eye, its materials numbered in the table."""
        self._chunks.append(chunk)
        self._count += len(chunk.triangles)
        if self._count >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Draws what is left; to be called at the end."""
        if not self._chunks:
            return
        if self._table is None:
            self._table = MaterialTable.build(self._materials, self._pool)
        self.drawing.draw(merge(self._chunks), self._table)
        self._chunks, self._count = [], 0
