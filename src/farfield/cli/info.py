"""`farfield info`: what is in a world."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from farfield.cli.options import JsonOption, WorldArgument
from farfield.cli.output import in_bytes, report

if TYPE_CHECKING:
    from farfield.world.world import World


def command(world: WorldArgument, as_json: JsonOption = False) -> None:
    """Say what is in WORLD."""
    from farfield.store import open_store
    from farfield.world.world import World

    facts = _facts(World.open(open_store(world)))
    report(facts, as_json=as_json, text=_text(facts))


def _facts(world: World) -> dict[str, Any]:
    manifest = world.manifest
    statistics = manifest.statistics
    by_level = Counter(entry.cell.level for entry in world.cells())
    return {
        "name": manifest.name,
        "generation": manifest.generation,
        "generator": manifest.generator,
        "bounds": manifest.bounds,
        "crs": manifest.crs,
        "origin": manifest.origin,
        "leaf_size": manifest.grid.leaf_size,
        "resolution": manifest.grid.resolution,
        "levels": manifest.octree.top_level + 1,
        "cells_by_level": [by_level[level] for level in range(manifest.octree.top_level + 1)],
        "directions": [direction.number for direction in manifest.directions],
        "depth_layers": manifest.depth_layers,
        "triangles": statistics.triangles,
        "objects": statistics.objects,
        "cells": statistics.cells,
        "orthoviews": statistics.orthoviews,
        "tiles": statistics.tiles,
        "bytes": statistics.bytes,
        "source_bytes": statistics.source_bytes,
        "credits": manifest.credits,
        "servers": manifest.servers.addresses if manifest.servers else (),
    }


def _text(facts: dict[str, Any]) -> str:
    lower, upper = facts["bounds"]
    extent = " x ".join(f"{high - low:,.1f}" for low, high in zip(lower, upper, strict=True))
    cells = ", ".join(f"{count:,}" for count in facts["cells_by_level"])
    rows = {
        "name": facts["name"],
        "generation": f"{facts['generation']}, written by {facts['generator']}",
        "extent": f"{extent} m, from {tuple(round(value, 2) for value in lower)}",
        "place": f"{facts['crs'] or 'no coordinate system'}, origin {tuple(facts['origin'])}",
        "leaves": f"{facts['leaf_size']:g} m, {facts['resolution']} pixels",
        "levels": f"{facts['levels']}, cells from the leaves up: {cells}",
        "directions": f"{len(facts['directions'])}, {facts['depth_layers']} depth layers",
        "scene": f"{facts['triangles']:,} triangles, {facts['objects']:,} objects, {in_bytes(facts['source_bytes'])}",
        "world": f"{facts['orthoviews']:,} orthoviews, {facts['tiles']:,} tiles, {in_bytes(facts['bytes'])}",
        "credits": "; ".join(facts["credits"]) or "none",
    }
    if facts["servers"]:
        rows["servers"] = f"{len(facts['servers'])}: {', '.join(facts['servers'])}"
    return "\n".join(f"{name:<12} {value}" for name, value in rows.items())
