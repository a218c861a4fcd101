"""Replacing what a scene holds in a region, without reading the rest of it (OV 4.1, updates)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from farfield.bake.survey import MeshCache, survey, survey_mesh
from farfield.errors import OptionError
from farfield.progress import Progress
from farfield.scene.footprints import order
from farfield.scene.footprints.change import Columns, Standing, Table, replaced, tables_of
from farfield.scene.footprints.features import FootprintChunk, chunk_at
from farfield.scene.footprints.order import Square
from farfield.scene.model import Instances, MeshSource, Scene
from farfield.scene.options import Facades, Region, inside
from farfield.scene.stored.footprints import StoredFootprints
from farfield.scene.stored.scene import MeshSummary, StoredScene, object_count
from farfield.scene.stored.sources import words_of
from farfield.store.contract import Store
from farfield.world.attributes import put_table, read_table


def with_region(stored: StoredScene, fresh: Scene | None, region: Region, store: Store, progress: Progress) -> Scene:
    """The stored scene, what lies in a region of it replaced by what of `fresh` lies there.

    Footprints and placements of meshes lie where their middle is. Of what is larger than the region nothing is
    replaced: the ground below it stays. Where `fresh` has no footprints at all the present ones stay, and likewise
    placements; without `fresh` everything goes. fresh: read with this region, in the frame of the stored scene.

    region: x0, y0, x1, y1 in the scene's CRS. Raises OptionError: it cannot be told which footprints are meant.
    """
    scene = stored.scene
    footprints = [isinstance(source, StoredFootprints) for source in scene.meshes]
    is_chunk = np.array(footprints, bool)[scene.instances.mesh]
    parts = [_placements(stored, fresh, ~is_chunk, region, progress)]
    families = _footprints(stored, fresh, is_chunk, region, store)
    return replace(_gathered(scene, fresh, [*parts, *families.values()]), families=tuple(families))


@dataclass(frozen=True, slots=True)
class _Rows:
    """Instances with sources of their own."""

    sources: list[MeshSource]
    """(k,) of each instance."""
    transform: NDArray[np.float64]
    first_object: NDArray[np.int64]
    """Told apart within these rows alone."""
    objects: NDArray[np.int64]
    attributes: list[str]

    @classmethod
    def of(cls, scene: Scene, rows: NDArray[np.int64]) -> _Rows:
        """Some of a scene."""
        own, parts = scene.instances, scene.attribute_parts
        sources = [scene.meshes[mesh] for mesh in own.mesh[rows].tolist()]
        attributes = [parts[row] if parts else "" for row in rows]
        return cls(sources, own.transform[rows], own.first_object[rows], own.objects[rows], attributes)

    @classmethod
    def joined(cls, parts: Sequence[_Rows]) -> _Rows:
        """Several, one after the other; at least one. What is one object in a part is one in the whole."""
        before = np.cumsum([0, *(int(part.first_object.max(initial=0)) for part in parts)])
        return cls(
            [source for part in parts for source in part.sources],
            np.concatenate([part.transform for part in parts]),
            np.concatenate([part.first_object + shift for part, shift in zip(parts, before[:-1], strict=True)]),
            np.concatenate([part.objects for part in parts]),
            [name for part in parts for name in part.attributes],
        )


def _gathered(scene: Scene, fresh: Scene | None, parts: list[_Rows]) -> Scene:
    rows = _Rows.joined(parts)
    # The same mesh may be told of twice, by the scene that stands and by the fresh one.
    names = [msgspec.json.encode(words_of(source) or id(source)) for source in rows.sources]
    meshes = dict(zip(reversed(names), reversed(rows.sources), strict=True))
    number = {name: k for k, name in enumerate(meshes)}
    mesh = np.array([number[name] for name in names], np.int32)
    instances = Instances(mesh, rows.transform, rows.first_object, rows.objects)
    added = fresh or Scene((), instances)
    return replace(
        scene,
        meshes=tuple(meshes.values()),
        instances=instances,
        object_count=object_count(rows.first_object, rows.objects),
        attribute_parts=tuple(rows.attributes),
        credits=tuple(dict.fromkeys(scene.credits + added.credits)),
        warnings=added.warnings,
    )


def _placements(
    stored: StoredScene, fresh: Scene | None, rows: NDArray[np.bool_], region: Region, progress: Progress
) -> _Rows:
    """The placements that are no footprints."""
    present = _Rows.of(stored.scene, np.flatnonzero(rows))
    if fresh is not None:
        solid = [not isinstance(source, FootprintChunk) for source in fresh.meshes]
        if not any(solid):
            return present
        chosen = np.array(solid, bool)[fresh.instances.mesh]
        summaries = _summaries(stored, fresh, progress)
        chosen &= _within(fresh, summaries, region)
    else:
        chosen = None
    stays = np.flatnonzero(rows & ~_within(stored.scene, stored.summaries, region))
    kept = _Rows.of(stored.scene, stays)
    if fresh is None or chosen is None:
        return kept
    return _Rows.joined([kept, _Rows.of(fresh, np.flatnonzero(chosen))])


def _summaries(stored: StoredScene, fresh: Scene, progress: Progress) -> list[MeshSummary]:
    """Of the fresh meshes: those that the scene has are known, the others are loaded; footprints need none."""
    empty = MeshSummary(np.zeros((0, 2, 3)), 1, "")
    known = [
        empty if isinstance(source, FootprintChunk) else found
        for source, found in zip(fresh.meshes, stored.known(fresh.meshes), strict=True)
    ]
    cache = MeshCache(fresh)
    return survey(known, lambda wanted: (survey_mesh(cache, mesh, fresh.meshes[mesh]) for mesh in wanted), progress)


def _within(scene: Scene, summaries: Sequence[MeshSummary], region: Region) -> NDArray[np.bool_]:
    """(k,) which instances have their middle in the region and are no larger than it."""
    own = scene.instances
    boxes = np.tile([[np.inf] * 3, [-np.inf] * 3], (len(own.mesh), 1, 1))
    for mesh, summary in enumerate(summaries):
        if not len(summary.boxes):
            continue
        low, high = summary.boxes[:, 0].min(0), summary.boxes[:, 1].max(0)
        rows = own.mesh == mesh
        middle = own.transform[rows, :, :3] @ ((low + high) / 2) + own.transform[rows, :, 3]
        reach = np.abs(own.transform[rows, :, :3]) @ ((high - low) / 2)
        boxes[rows] = np.stack([middle - reach, middle + reach], 1)
    # A mesh in pieces is one thing.
    _, which = np.unique(own.first_object, return_inverse=True)
    whole = np.tile([[np.inf] * 3, [-np.inf] * 3], (int(which.max(initial=-1)) + 1, 1, 1))
    np.minimum.at(whole[:, 0], which, boxes[:, 0])
    np.maximum.at(whole[:, 1], which, boxes[:, 1])
    boxes = whole[which] + np.array(scene.origin)
    width, depth = region[2] - region[0], region[3] - region[1]
    size = boxes[:, 1] - boxes[:, 0]
    small = (size[:, 0] <= width) & (size[:, 1] <= depth)
    with np.errstate(invalid="ignore"):  # What cannot be read lies nowhere.
        return np.asarray(small & inside(boxes.mean(1), region))


@dataclass(frozen=True, slots=True)
class _StoredChunk:
    """A chunk of the scene as `replaced` takes it."""

    source: StoredFootprints
    attributes: str
    store: Store

    @property
    def square(self) -> Square:
        return self.source.square

    @property
    def count(self) -> int:
        return self.source.count

    def table(self) -> Table:
        columns: Columns = read_table(self.store, self.attributes) if self.attributes else {}
        return Table(self.source.features(), columns)


def _footprints(
    stored: StoredScene, fresh: Scene | None, rows: NDArray[np.bool_], region: Region, store: Store
) -> dict[str, _Rows]:
    """The footprints of every file that the scene has or had."""
    families: dict[str, list[int]] = {}
    for row in np.flatnonzero(rows).tolist():
        source = stored.scene.meshes[stored.scene.instances.mesh[row]]
        assert isinstance(source, StoredFootprints)
        families.setdefault(source.family, []).append(row)
    for family in stored.scene.families:
        families.setdefault(family, [])
    tables = _tables(fresh)
    given = {_meant(name, families, len(tables)): table for name, table in tables.items()}
    for family in given:
        families.setdefault(family, [])
    for family, own in families.items():
        if own and (fresh is None or family in given):
            _check_unmoved(stored.scene, family, own)
    return {
        family: _family(stored.scene, family, own, given.get(family), region, store)
        if fresh is None or family in given
        else _Rows.of(stored.scene, np.array(own, np.int64))
        for family, own in families.items()
    }


def _check_unmoved(scene: Scene, family: str, rows: list[int]) -> None:
    """Raises OptionError for footprints that do not stand at their own coordinates."""
    transforms = scene.instances.transform[rows]
    sources = [scene.meshes[scene.instances.mesh[row]] for row in rows]
    squares = {(s.level, s.prefix) for s in sources if isinstance(s, StoredFootprints)}
    first = sources[0]
    assert isinstance(first, StoredFootprints)
    corner = chunk_at(first.square, first.features(), family, first.facades).corner
    straight = (transforms[:, :, :3] == np.eye(3)).all() and len(squares) == len(rows)
    if not straight or not np.array_equal(transforms[0, :, 3], corner - scene.origin):
        raise _moved(family)


def _moved(family: str) -> OptionError:
    return OptionError("footprints that a scene.toml moves cannot be replaced by region", family,
                       "update from everything instead, without --region")  # fmt: skip


def _meant(name: str, families: dict[str, list[int]], given: int) -> str:
    """The file of the scene whose footprints those of another one replace; given: how many files are.

    Raises OptionError when that cannot be told.
    """
    if name in families or not families or given > 1:
        return name
    if len(families) > 1:
        known = ", ".join(families)
        raise OptionError("the world has footprints of several files", name, f"put the new ones in place of: {known}")
    return next(iter(families))


def _tables(fresh: Scene | None) -> dict[str, tuple[Table | None, Facades]]:
    """What was read of each file of footprints, and whether with façades."""
    if fresh is None:
        return {}
    own = fresh.instances
    for row, mesh in enumerate(own.mesh.tolist()):
        chunk = fresh.meshes[mesh]
        if isinstance(chunk, FootprintChunk):
            still = np.concatenate([np.eye(3), (chunk.corner - fresh.origin)[:, None]], axis=1)
            if not np.array_equal(own.transform[row], still):
                raise _moved(chunk.family)
    found: dict[str, tuple[Table | None, Facades]] = dict.fromkeys(fresh.families, (None, True))
    for family in found:
        placed = [
            (source, int(own.first_object[row]))
            for row, mesh in enumerate(own.mesh.tolist())
            if isinstance(source := fresh.meshes[mesh], FootprintChunk) and source.family == family
        ]
        if len({chunk.square for chunk, _ in placed}) < len(placed):
            raise _moved(family)
        if placed:
            tables = tables_of([chunk for chunk, _ in placed], fresh.attributes, [first for _, first in placed])
            found[family] = Table.joined(list(tables)), placed[0][0].facades
    return found


def _family(
    scene: Scene, family: str, rows: list[int], given: tuple[Table | None, Facades] | None, region: Region, store: Store
) -> _Rows:
    standing: list[Standing] = []
    for row in rows:
        source = scene.meshes[scene.instances.mesh[row]]
        assert isinstance(source, StoredFootprints)
        part = scene.attribute_parts[row] if scene.attribute_parts else ""
        standing.append(_StoredChunk(source, part, store))
    table, facades = given or (None, True)
    if table is None and standing:
        facades = scene.meshes[scene.instances.mesh[rows[0]]].facades  # type: ignore[attr-defined]
    change = replaced(standing, table, region, order.most_in_mesh(facades), family, facades)
    kept = _Rows.of(scene, np.array([rows[k] for k in change.kept], np.int64))
    transforms = np.tile(np.eye(3, 4), (len(change.made), 1, 1))
    for k, (chunk, _) in enumerate(change.made):
        transforms[k, :, 3] = chunk.corner - np.array(scene.origin)
    new = _Rows(
        [StoredFootprints.of(chunk, store) for chunk, _ in change.made],
        transforms,
        np.arange(1, len(change.made) + 1),
        np.array([len(chunk.features) for chunk, _ in change.made], np.int64),
        [put_table(store, columns) for _, columns in change.made],
    )
    return _Rows.joined([kept, new])
