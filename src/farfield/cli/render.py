"""`farfield render`: a picture of a world from its representations, or of a source from its triangles."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from farfield.cli.options import JsonOption, numbers, size
from farfield.cli.output import in_bytes, in_time, report

if TYPE_CHECKING:
    from farfield.geometry.cameras import Camera
    from farfield.view.left_out import LeftOut
    from farfield.view.picture import Picture
    from farfield.view.shading import Light
    from farfield.view.splats import Splats

SAMPLES_OF_WORLDS = 16
SAMPLES_OF_SOURCES = 64
"""Samples a pixel: 16 of a true picture still carry noise of their own."""

PlaceArgument = Annotated[
    str, typer.Argument(metavar="WORLD|SOURCE", help="A baked world, or a file that bake would read.")
]
EyeOption = Annotated[str, typer.Option(metavar="X,Y,Z", help="Where the camera is, local metres.")]
TargetOption = Annotated[str, typer.Option(metavar="X,Y,Z", help="What it looks at.")]
OutputOption = Annotated[Path, typer.Option("-o", "--output", metavar="PNG", help="The picture to write.")]
FovOption = Annotated[float | None, typer.Option(metavar="DEGREES", help="Vertical; default: 60 degrees across.")]
SizeOption = Annotated[str, typer.Option("--size", metavar="WxH", help="Pixels.")]
SunOption = Annotated[str, typer.Option(metavar="AZIMUTH,ELEVATION", help="Degrees; azimuth from north, clockwise.")]
SkyOption = Annotated[
    str, typer.Option(metavar="R,G,B|clear", help="One colour, 0 to 255, or a clear sky that follows the sun.")
]
HazeOption = Annotated[float | None, typer.Option(metavar="M", min=0, help="How far one can see; default: for ever.")]
AmbientOption = Annotated[float, typer.Option(min=0, help="Light from everywhere; the sun's is 1.")]
NearOption = Annotated[
    float | None, typer.Option(metavar="M", min=0, help="Leaves nearer than this are geometry; default: r of the cut.")
]
FarOnlyOption = Annotated[bool, typer.Option("--far-only", help="Leave out what is within the near radius.")]
CellsOption = Annotated[
    str | None, typer.Option(metavar="WORLD", help="For a source with --far-only: whose leaves are left out.")
]
SamplesOption = Annotated[
    int | None, typer.Option(metavar="N", help="Samples a pixel, a square number; default 16, of a source 64.")
]
TransparentOption = Annotated[bool, typer.Option("--transparent", help="Nothing instead of sky; PNG with alpha.")]
LayersOption = Annotated[str, typer.Option(metavar="A,B", help="Of colour, depth, normal, id; written beside the PNG.")]
ViewsOption = Annotated[
    int | None, typer.Option(metavar="N", min=1, max=26, help="Views drawn of a cell; default: tiles by what they add.")
]
LeastGainOption = Annotated[
    float, typer.Option(metavar="PX", min=0, help="Pixels of a view that a kilobyte of a tile must add to be drawn.")
]
DepthLayersOption = Annotated[int, typer.Option(metavar="1|2", min=1, max=2, help="Depth layers drawn of a view.")]
SplatsOption = Annotated[
    str, typer.Option(metavar="SHAPE", help="Or, to compare: discs, warped-discs, ellipses, connected, sphericity.")
]
BiasOption = Annotated[float, typer.Option(help="1 draws cells twice as coarse, -1 twice as fine.")]


def command(
    place: PlaceArgument,
    eye: EyeOption,
    target: TargetOption,
    output: OutputOption,
    fov: FovOption = None,
    picture_size: SizeOption = "640x480",
    sun: SunOption = "225,35",
    ambient: AmbientOption = 0.3,
    sky: SkyOption = "158,191,235",
    haze: HazeOption = None,
    near_radius: NearOption = None,
    far_only: FarOnlyOption = False,
    cells_from: CellsOption = None,
    samples: SamplesOption = None,
    transparent: TransparentOption = False,
    layers: LayersOption = "colour",
    views: ViewsOption = None,
    least_gain: LeastGainOption = 10.0,
    depth_layers: DepthLayersOption = 2,
    bias: BiasOption = 0.0,
    splats: SplatsOption = "covered",
    as_json: JsonOption = False,
) -> None:
    """Render WORLD, or the true picture of SOURCE, to a PNG.

    Depth is written as NAME.depth.npy (metres, float32; that of splats up to one of their pixels too far), normals as
    NAME.normal.png, ids as NAME.id.npy.
    """
    wanted, shape = _layers(layers), _splats(splats)
    width_height = size(picture_size, "--size")
    camera = _camera(eye, target, fov, width_height)
    light = _light(sun, ambient, sky, haze)
    if _is_world(place):
        picture = _of_world(
            place, camera, width_height, light, _grid(samples or SAMPLES_OF_WORLDS), wanted,
            views=views, least_gain=least_gain, layers=depth_layers, bias=bias, near_radius=near_radius,
            far_only=far_only, splats=shape,
        )  # fmt: skip
    else:
        left_out = _left_out(cells_from, camera, width_height, near_radius) if far_only else None
        picture = _of_source(place, camera, width_height, light, _grid(samples or SAMPLES_OF_SOURCES), wanted, left_out)
    files = picture.save(output, None if transparent else light.backdrop(camera, width_height), wanted)
    report(_facts(picture, files), as_json=as_json, text=_text(picture, files))


def _is_world(place: str) -> bool:
    from farfield.store.opening import is_archive, is_url

    return is_url(place) or is_archive(place) or (Path(place) / "world.json").exists()


def _light(sun: str, ambient: float, sky: str, haze: float | None) -> Light:
    from farfield.errors import OptionError
    from farfield.view.shading import Light

    azimuth, elevation = numbers(sun, 2, "--sun")
    if haze is not None and not haze > 0:
        raise OptionError(f"one cannot see {haze} m", "--haze", "a number of metres above 0")
    if sky == "clear":
        return Light(ambient, azimuth=azimuth, elevation=elevation, sky="clear", haze=haze)
    red, green, blue = (min(255, max(0, round(part))) for part in numbers(sky, 3, "--sky"))
    return Light(ambient, azimuth=azimuth, elevation=elevation, sky=(red, green, blue), haze=haze)


def _layers(text: str) -> tuple[str, ...]:
    from farfield.errors import OptionError
    from farfield.view.picture import LAYERS

    names = tuple(name.strip() for name in text.split(","))
    names = tuple("colour" if name == "color" else name for name in names)
    for name in names:
        if name not in LAYERS:
            raise OptionError(f"no layer {name!r}", "--layers", f"layers are {', '.join(LAYERS)}")
    return names


def _splats(text: str) -> Splats:
    from farfield.errors import OptionError
    from farfield.view.splats import Splats

    known = {splats.value: splats for splats in Splats}
    if text not in known:
        raise OptionError(f"no splats {text!r}", "--splats", f"splats are {', '.join(known)}")
    return known[text]


def _camera(eye: str, target: str, fov: float | None, width_height: tuple[int, int]) -> Camera:
    from farfield.geometry.cameras import Camera, vertical_fov

    ex, ey, ez = numbers(eye, 3, "--eye")
    tx, ty, tz = numbers(target, 3, "--target")
    return Camera((ex, ey, ez), (tx, ty, tz), vertical_fov(60.0, width_height) if fov is None else fov)


def _grid(samples: int) -> int:
    """Samples along each axis of a pixel."""
    from farfield.errors import OptionError

    side = math.isqrt(max(samples, 0))
    if not 1 <= side <= 16 or side * side != samples:
        raise OptionError(f"{samples} samples a pixel", "--samples", "a square number: 1, 4, 9, 16, … 256")
    return side


def _of_world(
    place: str,
    camera: Camera,
    width_height: tuple[int, int],
    light: Light,
    supersampling: int,
    written: tuple[str, ...],
    **options: Any,
) -> Picture:
    from farfield.store import open_store
    from farfield.view.renderer import RenderOptions, render_world
    from farfield.world.world import World

    chosen = RenderOptions(
        supersampling=supersampling, light=light, normals="normal" in written, ids="id" in written, **options
    )
    return render_world(World.open(open_store(place)), camera, width_height, chosen)


def _of_source(
    place: str,
    camera: Camera,
    width_height: tuple[int, int],
    light: Light,
    supersampling: int,
    written: tuple[str, ...],
    left_out: LeftOut | None,
) -> Picture:
    from farfield.scene.read import read_scene
    from farfield.view.truth import TruthOptions, draw_truth

    options = TruthOptions(supersampling, light, left_out, normals="normal" in written, ids="id" in written)
    return draw_truth(read_scene([Path(place)]), camera, width_height, options)


def _left_out(
    cells_from: str | None, camera: Camera, width_height: tuple[int, int], near_radius: float | None
) -> LeftOut:
    """The leaves of a world that its own far field would leave out."""
    from farfield.errors import OptionError
    from farfield.store import open_store
    from farfield.view.left_out import LeftOut
    from farfield.view.renderer import picture_radius
    from farfield.world.world import World

    if cells_from is None:
        raise OptionError("which cells are far depends on a world", "--far-only", "name it with --cells-from WORLD")
    world = World.open(open_store(cells_from))
    radius = picture_radius(world, camera, width_height) if near_radius is None else near_radius
    return LeftOut(world.grid, camera.eye, radius)


def _facts(picture: Picture, files: list[Path]) -> dict[str, Any]:
    found = picture.statistics
    return {
        "seconds": round(found.seconds, 3),
        "cells": found.cells,
        "orthoviews": found.orthoviews,
        "splats": found.splats,
        "triangles": found.triangles,
        "tile_bytes": found.tile_bytes,
        "warnings": found.warnings,
        "files": files,
    }


def _text(picture: Picture, files: list[Path]) -> str:
    found = picture.statistics
    drawn = f"{found.cells:,} cells, {found.orthoviews:,} orthoviews, {found.splats:,} splats" if found.cells else ""
    triangles = f"{found.triangles:,} triangles" if found.triangles else ""
    parts = ", ".join(filter(None, [drawn, triangles])) or "nothing seen"
    text = f"{', '.join(map(str, files))}: {parts}, {in_bytes(found.tile_bytes)} of tiles in {in_time(found.seconds)}"
    if found.warnings:
        text += f"\n{found.warnings} cells have missing or damaged tiles, their parents stand in (farfield verify)"
    return text
