"""`farfield walk`: a recorded path gone through again with the real server over a slow link."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from farfield.cli.options import JsonOption, WorldArgument, size
from farfield.cli.output import in_bytes, report
from farfield.cli.progress import shown_progress

if TYPE_CHECKING:
    from farfield.walk.walk import WalkResult

PathOption = Annotated[Path, typer.Option("--path", metavar="JSON", help="A recorded camera path.")]
BandwidthOption = Annotated[
    float, typer.Option("--bandwidth", metavar="B", help="Bytes a second that the link carries to the viewer.")
]
LatencyOption = Annotated[float, typer.Option("--latency", metavar="S", help="Seconds that the link takes, each way.")]
PlotOption = Annotated[Path | None, typer.Option("--plot", metavar="PNG", help="Draw quality over time.")]
FramesOption = Annotated[
    int, typer.Option("--frames", metavar="N", min=0, help="Also compare a frame with the true one every N seconds.")
]
SizeOption = Annotated[str, typer.Option("--size", metavar="WxH", help="Pixels of the picture.")]
NearOption = Annotated[
    float | None, typer.Option(metavar="M", min=0, help="Leaves nearer than this are geometry; default: r of the cut.")
]
SecondsOption = Annotated[float, typer.Option(metavar="S", min=0, help="Of the path; default: all of it.")]
GroundOption = Annotated[bool, typer.Option("--ground", help="Count the ground among the objects.")]


def command(
    world: WorldArgument,
    path: PathOption,
    bandwidth: BandwidthOption,
    latency: LatencyOption = 0.0,
    plot: PlotOption = None,
    frames: FramesOption = 0,
    picture_size: SizeOption = "640x480",
    near_radius: NearOption = None,
    seconds: SecondsOption = 0.0,
    ground: GroundOption = False,
    as_json: JsonOption = False,
) -> None:
    """Replay a path through WORLD with a real server over a slow link, and tell how good what arrives is.

    Quality is 1 where every object in view is shown as well as its full model would be, weighted by how large they are
    in the picture; the mean is taken from second 3 on.
    """
    width_height = size(picture_size, "--size")
    from farfield.store import open_store
    from farfield.view.path import read_path
    from farfield.walk.walk import WalkOptions, walk

    recorded = read_path(path)
    options = WalkOptions(bandwidth, latency, width_height, near_radius, seconds, ground, frames)
    with shown_progress() as progress:
        found = walk(open_store(world), recorded, options, progress)
    if plot is not None:
        from farfield.walk.plot import plot_quality

        plot_quality(plot, {f"{bandwidth:,.0f} B/s": found.quality}, title=Path(world).name)
    report(_facts(found), as_json=as_json, text=_text(found))


def _facts(found: WalkResult) -> dict[str, Any]:
    facts: dict[str, Any] = {
        "mean_quality": round(found.mean_quality, 4),
        "quality": [round(value, 4) for value in found.quality],
        "bytes": found.bytes,
        "missing_after": found.missing_after,
        "missing": found.missing,
    }
    if found.frames:
        facts["frames"] = [frame.facts() for frame in found.frames]
        facts["psnr"], facts["flip"] = found.mean_psnr, found.mean_flip
    return facts


def _text(found: WalkResult) -> str:
    lines = [
        f"{second:>4} s {100 * value:5.1f} % {'#' * round(40 * value) if value == value else ''}"
        for second, value in enumerate(found.quality)
    ]
    missing = "nothing" if found.missing_after is None else f"something until {found.missing_after:.1f} s"
    lines.append(f"mean from second 3 on: {100 * found.mean_quality:.1f} %, {in_bytes(found.bytes)}; {missing} missing")
    if found.frames:
        lines.append(f"frames: PSNR {found.mean_psnr:.1f} dB, FLIP {found.mean_flip:.3f}")
    return "\n".join(lines)
