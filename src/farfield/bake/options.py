"""What a bake can be told."""

from __future__ import annotations

from dataclasses import dataclass

from farfield.errors import OptionError
from farfield.geometry.directions import Direction, parse
from farfield.octree.grid import Grid
from farfield.represent.blockmap.blockmap import BlockMapSize
from farfield.represent.orthoview.quality import QUALITIES
from farfield.world.keys import content_hash

BAKE_VERSION = 27
"""Grows whenever the same input would give other bytes; older records are then baked again."""


def default_resolution(orthoviews: bool, blockmap: str) -> int:
    """Pixels across a leaf: of worlds without orthoviews as many as their BlockMaps have texels. Raises OptionError."""
    return 512 if orthoviews else BlockMapSize.parse(blockmap).side


@dataclass(frozen=True, slots=True)
class BakeOptions:
    """Options of `bake`. Raises OptionError when a value cannot be used."""

    leaf_size: float | None = None
    """Edge of a leaf, metres; None: see plan.default_leaf_size."""
    resolution: int = 512
    """Pixels of an orthoview across a leaf's edge, a multiple of 8."""
    directions: str = "17"
    """Preset of directions, or unit vectors (geometry.directions.parse)."""
    depth_layers: int = 2
    """Depth layers of a view: 1 or 2."""
    quality: str = "normal"
    """Preset of the codec: compact, normal, high."""
    samples: int = 2
    """Samples of a leaf pixel along each axis."""
    corner: tuple[float, float, float] | None = None
    """Lower corner of cell 0/0/0/0, local metres, for a grid that is given; None: just below the scene."""
    workers: int = 0
    """Worker processes; 0: one for each processor."""
    scheduler: str = ""
    """Address of a Dask scheduler whose workers bake instead, such as tcp://host:8786; empty: this machine bakes."""
    orthoviews: bool = True
    """Whether cells have pictures with depth."""
    geometry: bool = True
    """Whether near geometry is written, and, beside orthoviews, that of cells above merged."""
    blockmap: str = ""
    """Size of the BlockMaps of cells, side:columns, such as "64:256"; empty: they have none."""
    object_ids: bool = True
    """Whether object ids of the first layer are written."""
    atlas_side: int = 1024
    """Texels along the sides of the image that the images of a leaf's near geometry are packed into, at most; 0: they
    stay as they are."""

    def __post_init__(self) -> None:
        if self.leaf_size is not None and not 0 < self.leaf_size < 1e7:
            raise OptionError(f"{self.leaf_size} is not a leaf size", "--leaf-size", "metres, above 0")
        if not (16 <= self.resolution <= 2048 and self.resolution % 8 == 0):
            raise OptionError(f"{self.resolution} is not a resolution", "--resolution", "a multiple of 8, 16 to 2048")
        if self.depth_layers not in (1, 2):
            raise OptionError(f"{self.depth_layers} is not a number of layers", "--depth-layers", "1 or 2")
        if self.quality not in QUALITIES:
            raise OptionError(f"{self.quality!r} is not a preset", "--quality", f"one of {', '.join(QUALITIES)}")
        if not 1 <= self.samples <= 8:
            raise OptionError(f"{self.samples} samples", "samples", "1 to 8 along each axis")
        if self.atlas_side and not (64 <= self.atlas_side <= 8192 and self.atlas_side % 8 == 0):
            raise OptionError(
                f"{self.atlas_side} is not a side of an atlas", "atlas_side", "0, or a multiple of 8, 64 to 8192"
            )
        if self.scheduler and self.workers:
            raise OptionError(
                f"{self.workers} workers beside a scheduler", "--workers", "leave it out: the cluster's workers bake"
            )
        parse(self.directions)
        if self.blockmap:
            BlockMapSize.parse(self.blockmap)
        if not (self.orthoviews or self.blockmap):
            what = "nothing is left to show what is far"
            raise OptionError(what, "--represent", "orthoview, blockmap, or both, and geometry")

    def direction_list(self) -> tuple[Direction, ...]:
        """The chosen directions, ascending by number."""
        return parse(self.directions)

    def signature(self, grid: Grid) -> str:
        """Hash of everything but the geometry that decides a cell's bytes."""
        vectors = [(d.number, d.vector) for d in self.direction_list()]
        facts = (BAKE_VERSION, grid.leaf_size, grid.resolution, grid.corner, vectors)
        chosen = (self.depth_layers, self.quality, self.samples, self.geometry, self.object_ids, self.atlas_side)
        kinds = self.orthoviews, self.blockmap
        return content_hash(repr((facts, chosen, kinds)).encode())
