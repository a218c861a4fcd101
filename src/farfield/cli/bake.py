"""`farfield bake`: from sources to a world."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from farfield.cli.options import JsonOption
from farfield.cli.output import in_bytes, in_time, report
from farfield.cli.progress import shown_progress

SourcesArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="SOURCE…", help="Files to bake: glTF, OBJ, PLY, STL, footprints, OpenStreetMap, CityJSON, scene.toml."
    ),
]
WorldOption = Annotated[
    str,
    typer.Option("-o", "--output", metavar="WORLD", help="Folder, or URL s3://, gs://, az://, of the world to make."),
]
LeafSizeOption = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="Edge of a leaf cell, metres; default: the smallest power of two with at most 2,000 occupied leaves and "
        "at least 10,000 triangles in one; of BlockMaps alone 262,144 and 300.",
    ),
]
ResolutionOption = Annotated[
    int | None,
    typer.Option(
        metavar="PX", help="Pixels of an orthoview across a leaf; default: 512, of BlockMaps alone their side."
    ),
]
DirectionsOption = Annotated[
    str, typer.Option(metavar="PRESET", help="5, 9, 9c, 13, 17, 26, or unit vectors x,y,z joined by +.")
]
LayersOption = Annotated[int, typer.Option(metavar="1|2", help="Depth layers of a view.")]
RepresentOption = Annotated[
    str, typer.Option(metavar="A,B", help="Representations: orthoview, blockmap, or both, and geometry.")
]
BlockmapOption = Annotated[
    str | None,
    typer.Option(metavar="N:M", help="Size of BlockMaps: 16:64, 32:192 or 64:256; default: 64:256."),
]
WorkersOption = Annotated[int, typer.Option(metavar="N", min=0, help="Worker processes; 0: one a processor.")]
SchedulerOption = Annotated[
    str, typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers bake instead, such as tcp://host:8786.")
]
QualityOption = Annotated[str, typer.Option(metavar="PRESET", help="compact, normal or high.")]
_BLOCKMAP = "64:256"
"""The size of BlockMaps unless told."""


def command(
    sources: SourcesArgument,
    output: WorldOption,
    leaf_size: LeafSizeOption = None,
    resolution: ResolutionOption = None,
    directions: DirectionsOption = "17",
    depth_layers: LayersOption = 2,
    represent: RepresentOption = "orthoview,geometry",
    blockmap: BlockmapOption = None,
    workers: WorkersOption = 0,
    scheduler: SchedulerOption = "",
    quality: QualityOption = "normal",
    as_json: JsonOption = False,
) -> None:
    """Bake SOURCE… into a world; goes on where an interrupted bake of the same input stopped."""
    from farfield.bake.options import BakeOptions, default_resolution
    from farfield.pipeline import bake_sources

    kinds = _kinds(represent)
    size = _blockmap_size(kinds, blockmap)
    options = BakeOptions(
        leaf_size=leaf_size,
        resolution=default_resolution("orthoview" in kinds, size) if resolution is None else resolution,
        directions=directions,
        depth_layers=depth_layers,
        quality=quality,
        workers=workers,
        scheduler=scheduler,
        orthoviews="orthoview" in kinds,
        geometry="geometry" in kinds,
        blockmap=size,
    )
    with shown_progress() as progress:
        facts = bake_sources(sources, output, options, progress)
    report(facts, as_json=as_json, text=_summary(facts, output))


def _kinds(represent: str) -> set[str]:
    from farfield.errors import OptionError

    names = {name.strip() for name in represent.split(",") if name.strip()}
    unknown = names - {"orthoview", "blockmap", "geometry"}
    if unknown or not names - {"geometry"}:
        what = f"cannot represent by {', '.join(sorted(unknown)) or 'nothing for what is far'}"
        raise OptionError(what, "--represent", "orthoview, blockmap, or both, and geometry, with commas between them")
    return names


def _blockmap_size(kinds: set[str], told: str | None) -> str:
    from farfield.errors import OptionError

    if "blockmap" in kinds:
        return _BLOCKMAP if told is None else told
    if told is not None:
        raise OptionError("no BlockMaps are asked for", "--blockmap", "leave it out, or add blockmap to --represent")
    return ""


def _summary(facts: dict[str, Any], output: str) -> str:
    return (
        f"{output}: {facts['triangles']:,} triangles in {in_time(facts['seconds'])} "
        f"({facts['triangles_per_second']:,.0f}/s), {facts['cells']:,} cells in {facts['levels']} levels, "
        f"{facts['orthoviews']:,} orthoviews, {in_bytes(facts['bytes'])} from {in_bytes(facts['source_bytes'])}"
    )
