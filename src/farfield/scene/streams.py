"""Surfaces read a part at a time, so that one larger than memory can be cut up before it is loaded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from farfield.scene.cleaning import RawSurface
from farfield.scene.model import Material

BATCH = 1 << 18
"""About the most triangles that are read at a time."""

_VERTEX_BYTES, _TRIANGLE_BYTES = 48, 14
"""Of a Mesh: position, normal, texture coordinates and colour; corners and material."""

_BLOCK = 1 << 12
"""Vertices that are read together when scattered ones are wanted."""


@dataclass(frozen=True, slots=True, eq=False)
class Vertices:
    """Some vertices as a file gives them, nothing checked."""

    positions: NDArray[np.float64]
    """(k, 3)."""
    normals: NDArray[np.float64] | None = None
    """(k, 3)."""
    uvs: NDArray[np.float32] | None = None
    """(k, 2)."""
    colors: NDArray[np.uint8] | None = None
    """(k, 4)."""


class SurfaceStream(Protocol):
    """A RawSurface of one material that stays in its file. All reading raises what the format's reader raises."""

    @property
    def vertices(self) -> int:
        """How many there are."""
        ...

    @property
    def faces(self) -> int:
        """How many there are; triangles, where the format knows nothing else."""
        ...

    @property
    def material(self) -> Material:
        """Of all triangles."""
        ...

    @property
    def crease_cosine(self) -> float:
        """See `RawSurface.crease_cosine`."""
        ...

    @property
    def shares_vertices(self) -> bool:
        """Whether triangles may have vertices in common."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """What of its looks cannot be read."""
        ...

    def rows(self, start: int, stop: int) -> Vertices:
        """The vertices from `start` up to but not including `stop`."""
        ...

    def batches(self) -> Iterator[NDArray[np.int64]]:
        """(k, 3) corners of the triangles, in the order of the file, about BATCH at a time; may point outside."""
        ...


def _nothing() -> None:
    return None


@dataclass(frozen=True, slots=True)
class MeshStream:
    """A mesh whose surfaces can be read a part at a time."""

    surfaces: tuple[SurfaceStream, ...]
    files: tuple[Path, ...]
    """All that is read; the first is the one that was named."""
    part: int = 0
    """Which of the meshes in the file."""
    forget: Callable[[], None] = _nothing
    """Gives up what reading has kept in memory, such as decoded textures."""

    @property
    def loaded_bytes(self) -> int:
        """About what the mesh takes once it is loaded, as the headers have it."""
        return sum(_VERTEX_BYTES * s.vertices + _TRIANGLE_BYTES * s.faces for s in self.surfaces)


@runtime_checkable
class StreamedSource(Protocol):
    """A MeshSource that may be read a part at a time."""

    @property
    def name(self) -> str:
        """For people."""
        ...

    def stream(self) -> MeshStream | None:
        """The mesh, of which only headers are read; None: it has to be loaded whole. Raises InputError."""
        ...


def whole(stream: SurfaceStream) -> RawSurface:
    """All of it at once."""
    vertices = stream.rows(0, stream.vertices)
    batches = list(stream.batches())
    return RawSurface(
        positions=vertices.positions,
        triangles=np.concatenate(batches) if batches else np.zeros((0, 3), np.int64),
        normals=vertices.normals,
        uvs=vertices.uvs,
        colors=vertices.colors,
        materials=(stream.material,),
        crease_cosine=stream.crease_cosine,
    )


def gather(stream: SurfaceStream, numbers: NDArray[np.int64]) -> Vertices:
    """The vertices of these numbers, which ascend. Reads each block of the file that holds any of them once."""
    if not len(numbers):
        return stream.rows(0, 0)
    blocks = numbers // _BLOCK
    starts = np.flatnonzero(np.append(True, blocks[1:] != blocks[:-1]))
    parts = []
    for own in np.split(numbers, starts[1:]):
        first, last = int(own[0]), int(own[-1]) + 1
        rows = stream.rows(first, last)
        parts.append(rows if len(own) == last - first else _taken(rows, own - first))
    return Vertices(
        np.concatenate([part.positions for part in parts]),
        _joined([part.normals for part in parts]),
        _joined([part.uvs for part in parts]),
        _joined([part.colors for part in parts]),
    )


def _taken(vertices: Vertices, rows: NDArray[np.int64]) -> Vertices:
    return Vertices(
        vertices.positions[rows],
        None if vertices.normals is None else vertices.normals[rows],
        None if vertices.uvs is None else vertices.uvs[rows],
        None if vertices.colors is None else vertices.colors[rows],
    )


def _joined(parts: list[NDArray[Any] | None]) -> NDArray[Any] | None:
    """None where the stream has no such thing."""
    given = [part for part in parts if part is not None]
    return np.concatenate(given) if given else None
