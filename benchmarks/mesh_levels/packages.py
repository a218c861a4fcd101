"""The npm packages of the comparison: gltfpack, meshoptimizer, 3d-tiles-renderer, three. No part of farfield.

    cd benchmarks/mesh_levels && npm ci

FARFIELD_MESH_LEVELS names another folder that holds their node_modules.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

FOLDER = Path(__file__).parent
NEEDED = ("gltfpack", "meshoptimizer", "3d-tiles-renderer", "three")


def node_modules() -> Path:
    """Where the packages are, or would be."""
    return Path(os.environ.get("FARFIELD_MESH_LEVELS", FOLDER)) / "node_modules"


def missing() -> str | None:
    """Why the comparison cannot run here; None: it can."""
    lacking = [name for name in NEEDED if not (node_modules() / name).exists()]
    if lacking:
        return f"no npm package {', '.join(lacking)} in {node_modules()}: npm ci in benchmarks/mesh_levels"
    return None if shutil.which("node") else "no Node.js"


def gltfpack(source: Path, target: Path, *options: str) -> int:
    """Runs gltfpack; returns the bytes of what it wrote. Raises RuntimeError with what it said."""
    program = node_modules() / "gltfpack/cli.js"
    command = ["node", str(program), "-i", str(source), "-o", str(target), *options]
    ended = subprocess.run(command, capture_output=True, text=True)
    if ended.returncode:
        raise RuntimeError(f"gltfpack {' '.join(options)}: {ended.stderr or ended.stdout}")
    return target.stat().st_size
