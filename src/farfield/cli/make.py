"""`farfield make`: test worlds of any size, made by rule."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from farfield.cli.options import JsonOption
from farfield.cli.output import in_bytes, report
from farfield.errors import OptionError

NAMES = ("objects", "landscape", "garden", "terrain")


def command(
    name: Annotated[str, typer.Argument(metavar="NAME", help=f"One of {', '.join(NAMES)}.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder to write the scene into.")],
    seed: Annotated[int, typer.Option(min=0, help="The same seed makes the same scene.")] = 0,
    mesh: Annotated[
        list[Path] | None,
        typer.Option(help="Mesh file for objects, trees or statues in place of made ones; repeatable."),
    ] = None,
    count: Annotated[
        int | None, typer.Option(min=1, help="How many objects (29264; terrain 216) or statues (257).")
    ] = None,
    triangles: Annotated[
        int | None, typer.Option(min=12, help="Triangles of an object (97000), tree (12000), statue (1983).")
    ] = None,
    kinds: Annotated[int | None, typer.Option(min=1, help="objects: different meshes among them (8).")] = None,
    side: Annotated[float | None, typer.Option(help="landscape: metres along a side (2000).")] = None,
    forest: Annotated[float | None, typer.Option(min=0, max=1, help="landscape: share that is forest (0.4).")] = None,
    trees: Annotated[float | None, typer.Option(min=0, help="landscape: trees per hectare of forest (65).")] = None,
    towns: Annotated[int | None, typer.Option(min=0, help="landscape: how many (3).")] = None,
    as_json: JsonOption = False,
) -> None:
    """Make a scene: `objects` floating in space, a `landscape` with forests and towns, a `garden` or a `terrain`.

    Writes DIR/scene.toml and, for a garden of statues and a terrain with trees, a walk through it, DIR/path.json.
    """
    given = {"seed": seed, "meshes": tuple(mesh or ()), "triangles": triangles, "count": count, "kinds": kinds,
             "side": side, "forest": forest, "trees": trees, "towns": towns}  # fmt: skip
    if name not in NAMES:
        raise OptionError(f"there is no scene {name!r} to make", "make", f"one of {', '.join(NAMES)}")
    made = _make(name, output, {key: value for key, value in given.items() if value is not None})
    facts = {"triangles": made.triangles, "bytes": made.bytes, "scene": made.path}
    text = f"{made.path}: {made.triangles:,} triangles counted with instances, {in_bytes(made.bytes)}"
    report(facts, as_json=as_json, text=text)


def _make(name: str, output: Path, given: dict[str, Any]) -> Any:
    from farfield.scene.procedural.garden import GardenOptions, make_garden
    from farfield.scene.procedural.landscape import LandscapeOptions, make_landscape
    from farfield.scene.procedural.objects import ObjectsOptions, make_objects
    from farfield.scene.procedural.terrain import TerrainOptions, make_terrain

    if name == "objects":
        _only(name, given, {"seed", "meshes", "triangles", "count", "kinds"})
        return make_objects(output, ObjectsOptions(**given))
    if name == "terrain":
        _only(name, given, {"seed", "meshes", "triangles", "count"})
        return make_terrain(output, TerrainOptions(**given))
    if name == "garden":
        _only(name, given, {"seed", "meshes", "triangles", "count"})
        return make_garden(output, GardenOptions(**given))
    _only(name, given, {"seed", "meshes", "triangles", "side", "forest", "trees", "towns"})
    fields = {"triangles": "tree_triangles", "forest": "forest_share", "trees": "trees_per_hectare"}
    return make_landscape(output, LandscapeOptions(**{fields.get(key, key): value for key, value in given.items()}))


def _only(name: str, given: dict[str, Any], known: set[str]) -> None:
    for key in given:
        if key not in known:
            raise OptionError(f"--{key} has no meaning for {name}", "make", "leave it out")
