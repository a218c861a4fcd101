"""Many intricate objects floating in space: the unstructured test world (29,264 objects of 97,000 triangles)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.errors import OptionError
from farfield.scene.gltf.write import write_glb
from farfield.scene.procedural.blobs import blob
from farfield.scene.procedural.made import MadeScene, finish, given_mesh, prepare, source_table


@dataclass(frozen=True, slots=True)
class ObjectsOptions:
    """Size of the objects scene."""

    count: int = 29_264
    """Objects."""
    triangles: int = 97_000
    """Triangles an object; meshes that are given keep theirs."""
    kinds: int = 8
    """Different meshes among them."""
    diameter: float = 10.0
    """Metres: longest side of an object before it is scaled by 0.7 to 1.3."""
    spacing: float = 2.2
    """Mean distance of neighbours, in diameters."""
    seed: int = 0
    meshes: tuple[Path, ...] = ()
    """Mesh files to use in place of made ones."""


def make_objects(directory: Path, options: ObjectsOptions | None = None) -> MadeScene:
    """Writes the scene: meshes, instance tables, scene.toml. The same options give the same bytes.

    Raises OptionError for sizes that make no scene, InputError for a given mesh that cannot be read.
    """
    chosen = options or ObjectsOptions()
    if chosen.count < 1 or chosen.kinds < 1 or chosen.triangles < 12 or chosen.diameter <= 0 or chosen.spacing <= 0:
        raise OptionError("count, kinds, triangles, diameter and spacing must be positive", "make objects")
    prepare(directory)
    kinds = len(chosen.meshes) or min(chosen.kinds, chosen.count)
    table = floating(chosen)
    parts = []
    for kind in range(kinds):
        np.save(directory / f"objects-{kind}.npy", table[kind::kinds])
        parts.append(_source(directory, kind, chosen))
    return finish(directory, parts)


def floating(options: ObjectsOptions) -> NDArray[np.float64]:
    """(count, 8) x, y, z, quaternion, scale: a jittered cubic lattice on z >= 0, each object turned at random."""
    random = np.random.default_rng(options.seed)
    side = int(np.ceil(options.count ** (1 / 3) - 1e-9))
    cells = np.sort(random.permutation(side**3)[: options.count])
    lattice = np.stack(np.unravel_index(cells, (side, side, side)), -1)
    jitter = random.uniform(-0.3, 0.3, lattice.shape)
    places = (lattice + 0.5 + jitter) * options.spacing * options.diameter
    turn = random.standard_normal((options.count, 4))
    scale = random.uniform(0.7, 1.3, options.count)
    order = random.permutation(options.count)
    return np.column_stack([places, turn, scale])[order]


def _source(directory: Path, kind: int, options: ObjectsOptions) -> str:
    table = f"objects-{kind}.npy"
    if options.meshes:
        given = given_mesh(options.meshes[kind])
        scale = options.diameter / float((given.high - given.low).max())
        return source_table(given.path, table, scale, -scale * (given.low + given.high) / 2)
    name = f"object-{kind}.glb"
    write_glb(directory / name, blob(options.triangles, options.diameter, options.seed * 1000 + kind))
    return source_table(name, table)
