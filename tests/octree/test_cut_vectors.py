"""The cut vectors that Python and TypeScript share are what the code gives."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from farfield.octree.cut import cut, view_bin
from farfield.octree.grid import CellKey, Grid

REPOSITORY = Path(__file__).parents[2]
FILES = sorted((REPOSITORY / "tests/vectors/cut").glob("*.json"))


@pytest.fixture(scope="module")
def writer() -> ModuleType:
    """scripts/write_cut_vectors.py."""
    spec = importlib.util.spec_from_file_location("write_cut_vectors", REPOSITORY / "scripts/write_cut_vectors.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_cuts_are_those_of_the_vectors(writer: ModuleType, path: Path) -> None:
    world = json.loads(path.read_text())
    grid = Grid(**{k: tuple(v) if isinstance(v, list) else v for k, v in world["grid"].items()})
    tree = writer.known_tree(grid, [tuple(leaf) for leaf in world["leaves"]])
    for case in world["cases"]:
        eye = np.array(case["eye"])
        found = cut(tree, grid, eye, case["radius"], case["near"])
        assert [str(key) for key in found.pictures] == case["pictures"]
        assert [str(key) for key in found.geometry] == case["geometry"]
        chosen = [CellKey.parse(key) for key in case["pictures"] + case["geometry"]]
        assert [view_bin(grid.bounds(key).mean(0), eye) for key in chosen] == case["bins"]


def test_the_script_writes_the_vectors(writer: ModuleType) -> None:
    assert {path.name: path.read_text() for path in FILES} == writer.written()
