"""Imports run one way, and no module grows without being noticed."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "src/farfield"

ORDER = [
    {"errors", "progress", "inflate", "__init__"},
    {"packed"},
    {"geometry"},
    {"kernels"},
    {"scene"},
    {"octree"},
    {"represent"},
    {"store"},
    {"world"},
    {"scene.stored"},
    {"bake", "serve", "view", "quality", "stream"},
    {"walk"},
    {"pipeline"},
    {"cli"},
    {"__main__"},
]
"""Part of the package → what it may import: the parts in earlier lines, and itself. A folder in a part may have a line
of its own."""

BESIDE = {("bake", "view"), ("view", "quality"), ("view", "stream"), ("serve", "stream"), ("serve", "view")}
"""Imports between parts of one line that may be."""

LONGEST = 500
"""Lines. A longer module has a second subject."""


def modules() -> dict[str, Path]:
    """Dotted name below farfield → file; a folder's `__init__` has the folder's name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)] = path
    return found


@cache
def imports() -> dict[str, dict[str, bool]]:
    """Module → what it imports of farfield → whether at its top (so that a cycle would matter at once)."""
    known = modules()
    return {name: dict(_imports_of(path, known)) for name, path in known.items()}


def _imports_of(path: Path, known: dict[str, Path]) -> list[tuple[str, bool]]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    top = set(map(id, tree.body))
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        found += [(_module(name, known), id(node) in top) for name in names if name.split(".")[0] == "farfield"]
    return found


def _module(name: str, known: dict[str, Path]) -> str:
    """The longest part of `farfield.a.b.name` that is a module."""
    parts = name.split(".")[1:]
    while parts and ".".join(parts) not in known:
        parts.pop()
    return ".".join(parts) or "__init__"


def part_of(module: str) -> str:
    """The part that a module belongs to."""
    folder = ".".join(module.split(".")[:2])
    return folder if any(folder in parts for parts in ORDER) else module.split(".")[0]


def rank(part: str) -> int:
    """Line of ORDER that a part is in."""
    for line, parts in enumerate(ORDER):
        if part in parts:
            return line
    pytest.fail(f"src/farfield/{part} has no place in the order of tests/test_layers.py")


def test_imports_run_one_way() -> None:
    wrong = []
    for module, imported in imports().items():
        here = part_of(module)
        for other in imported:
            there = part_of(other)
            if here != there and rank(there) >= rank(here) and (here, there) not in BESIDE:
                wrong.append(f"{module} imports {other}")
    assert not wrong, "\n".join(wrong)


def test_there_are_no_cycles() -> None:
    """Among imports at the top of modules; a folder's `__init__` that gathers its own modules is not one."""
    graph = {
        module: {other for other, top in imported.items() if top and other != module}
        for module, imported in imports().items()
    }
    finished: set[str] = set()

    def visit(module: str, trail: tuple[str, ...]) -> None:
        if module in trail:
            pytest.fail(" → ".join([*trail[trail.index(module) :], module]))
        if module not in finished:
            for other in sorted(graph[module]):
                visit(other, (*trail, module))
            finished.add(module)

    for module in graph:
        visit(module, ())


def test_modules_stay_short() -> None:
    lengths = {name: path.read_text(encoding="utf-8").count("\n") for name, path in modules().items()}
    longest = sorted(lengths.items(), key=lambda item: -item[1])[:5]
    print("longest modules:", ", ".join(f"{name} {lines}" for name, lines in longest))
    assert all(lines <= LONGEST for _, lines in longest), longest


@pytest.mark.parametrize(("module", "absent"), [("farfield.serve", "farfield.bake"), ("farfield.cli", "numpy")])
def test_what_is_heavy_is_not_loaded_unasked(module: str, absent: str) -> None:
    code = f"import sys, {module}; sys.exit(any(name.startswith({absent!r}) for name in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
