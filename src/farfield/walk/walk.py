"""A recorded path gone through again with the real server over a slow link (BEN 6)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from farfield.progress import NoProgress, Progress
from farfield.serve.run import ServeOptions, serving
from farfield.store.contract import Store
from farfield.stream.tree import CellTree
from farfield.view.path import CameraPath
from farfield.walk.frames import Frame, FrameDrawer, frames
from farfield.walk.link import SlowLink
from farfield.walk.measure import (
    HeldBoards,
    HeldGeometry,
    HeldKind,
    HeldMerged,
    HeldMeshes,
    HeldPictures,
    Measure,
    Sample,
    samples,
)
from farfield.walk.objects import WorldObjects, read_objects
from farfield.walk.observer import Poses
from farfield.walk.session import Received, Walker, stream_walk
from farfield.world.world import World

SAMPLES_A_SECOND = 10
SETTLED = 3
"""Second from which on walks are judged: nothing can be there at first."""


@dataclass(frozen=True, slots=True)
class WalkOptions:
    """How a path is gone through."""

    bandwidth: float
    """Bytes a second that the link carries to the viewer."""
    latency: float = 0.0
    """Seconds that it takes, each way."""
    size: tuple[int, int] = (640, 480)
    """Width and height of the picture, pixels."""
    near_radius: float | None = None
    """Metres within which leaves are geometry; None: r, as the cut defines it."""
    seconds: float = 0.0
    """Of the path; 0: all of it."""
    ground: bool = False
    """Whether the ground counts among the objects."""
    frames: int = 0
    """Seconds from one frame that is drawn to the next; 0: none are."""


@dataclass(frozen=True, slots=True)
class WalkResult:
    """What came of it."""

    mean_quality: float
    """0 to 1, the mean from second SETTLED on; nan: nothing was in view."""
    quality: list[float]
    """Mean of each second."""
    bytes: int
    """That passed the link, after manifest and index."""
    missing_after: float | None
    """Last moment from second SETTLED on at which an object in view had no representation at all; None: none was."""
    missing: list[int]
    """Most objects in view at once, in each second, of which nothing was held."""
    received: Received = field(default_factory=Received)
    frames: list[Frame] = field(default_factory=list)
    """As they were seen."""

    @property
    def mean_psnr(self) -> float:
        """dB, of frames from second SETTLED on."""
        return _mean_of([frame.psnr for frame in self.frames if frame.second >= SETTLED])

    @property
    def mean_flip(self) -> float:
        """Of frames from second SETTLED on."""
        return _mean_of([frame.flip for frame in self.frames if frame.second >= SETTLED])


@dataclass(frozen=True, slots=True)
class WalkedWorld:
    """A world, and what a viewer that has read its manifest and index knows of it."""

    world: World
    tree: CellTree
    objects: WorldObjects
    """All, with the ground."""

    @classmethod
    def of(cls, store: Store) -> WalkedWorld:
        """Reads index and near geometry. Raises WorldError and StoreError."""
        world = World.open(store)
        tree = CellTree.of(world)
        return cls(world, tree, read_objects(world, tree))

    def measure(self, options: WalkOptions) -> Measure:
        """Of a viewer that holds nothing."""
        directions = [(d.number, d.vector) for d in self.world.manifest.directions]
        kinds: list[HeldKind] = [HeldGeometry(self.tree, options.near_radius), HeldPictures(self.tree, directions)]
        if options.near_radius != 0:
            kinds += [HeldMerged(self.tree), HeldMeshes(self.tree), HeldBoards(self.tree)]
        return Measure(self.objects if options.ground else self.objects.without_ground(), kinds, options.size)


def walk(store: Store, path: CameraPath, options: WalkOptions, progress: Progress | None = None) -> WalkResult:
    """Serves a world and goes along a path in it, in real time, in a session with the server.

    Raises OptionError: a bandwidth or latency that is none; InputError: a path that is none; WorldError, StoreError,
    ServeError.
    """
    progress = progress or NoProgress()
    link = SlowLink(options.bandwidth, options.latency)
    walker = Walker(Poses(path), options.size, options.near_radius, options.seconds)
    walked = WalkedWorld.of(store)
    progress.start(round(walker.length), "seconds walked")
    with serving(store, ServeOptions(port=0)) as url:
        received = stream_walk(url, walker, link, progress.advance)
    progress.finish()
    found = judge(walked, walker, options, received)
    if not options.frames:
        return found
    drawer = FrameDrawer(walked.world, options.size, options.near_radius)
    return replace(found, frames=drawn(drawer, walker, received, options.frames, progress))


def drawn(drawer: FrameDrawer, walker: Walker, received: Received, every: int, progress: Progress) -> list[Frame]:
    """A frame every so many seconds. Raises MissingExtraError without flip-evaluator."""
    poses = [(float(second), walker.poses.at(second)) for second in range(0, math.ceil(walker.length), every)]
    progress.start(len(poses), "frames drawn")
    found = []
    for frame in frames(drawer, [(at, key) for at, key, _ in received.arrivals], poses):
        found.append(frame)
        progress.advance()
    progress.finish()
    return found


def judge(walked: WalkedWorld, walker: Walker, options: WalkOptions, received: Received) -> WalkResult:
    """The quality of what arrived."""
    times = np.arange(round(walker.length * SAMPLES_A_SECOND)) / SAMPLES_A_SECOND
    poses = ((at, walker.poses.at(at)) for at in times.tolist())
    arrivals = [(at, key) for at, key, _ in received.arrivals]
    found = list(samples(walked.measure(options), arrivals, poses))
    return summed_up(times.tolist(), found, received)


def summed_up(times: Sequence[float], found: Sequence[Sample], received: Received) -> WalkResult:
    """times: seconds of the samples, SAMPLES_A_SECOND from 0 on."""
    seconds = [found[n : n + SAMPLES_A_SECOND] for n in range(0, len(found), SAMPLES_A_SECOND)]
    late = [at for at, one in zip(times, found, strict=True) if at >= SETTLED and one.missing]
    return WalkResult(
        _mean([one for at, one in zip(times, found, strict=True) if at >= SETTLED]),
        [_mean(own) for own in seconds],
        received.bytes,
        late[-1] if late else None,
        [max(one.missing for one in own) for own in seconds],
        received,
    )


def _mean(found: Sequence[Sample]) -> float:
    """Of the moments at which something is in view."""
    return _mean_of([one.quality for one in found if one.in_view])


def _mean_of(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else math.nan
