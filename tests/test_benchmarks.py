"""Every benchmark runs, in small sizes, and gives figures that JSON knows."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

from farfield.cli import main
from farfield.cli.bench import FOLDER, PREFIX

NAMES = sorted(path.stem.removeprefix(PREFIX) for path in FOLDER.glob(f"{PREFIX}*.py"))


ALONE = ("mesh_levels", "page", "standing", "steady", "webgpu")
IN_A_BROWSER = ("bandwidth", "city", "culling", "flight", "frames", "growth", "light", *ALONE)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in IN_A_BROWSER])
def test_a_benchmark_in_small(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", name, "--quick", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)


@pytest.mark.browser
@pytest.mark.parametrize("name", [name for name in IN_A_BROWSER if name not in ALONE])
def test_a_benchmark_in_a_browser_in_small(name: str) -> None:
    assert _in_a_process(name)


@pytest.mark.browser
def test_the_page_in_small() -> None:
    assert _in_a_process("page")["flight"]["fetched_while_held"] == 0


@pytest.mark.browser
def test_steadiness_in_small() -> None:
    """Fading leaves less temporal error and about the same picture."""
    without, fading = _in_a_process("steady")["town"].values()
    assert 0 < fading["moved"] < without["moved"]
    assert fading["psnr"] > without["psnr"] - 1.5


@pytest.mark.browser
def test_standing_in_small() -> None:
    """What adds most for its bytes comes first, and in the end all is there either way."""
    town = _in_a_process("standing")["town"]
    nearest, benefit = town["nearest"], town["benefit"]
    middle, last = list(nearest["flip"])[1:3]
    assert benefit["flip"][middle] < 1.05 * nearest["flip"][middle]
    assert benefit["flip"][last] < 1.2 * nearest["flip"][last]
    assert 0 < benefit["complete"] < 2 * nearest["complete"]


@pytest.mark.browser
def test_mesh_levels_in_small() -> None:
    """Both viewers draw the scene, and what the link lets through is what they get."""
    found = _in_a_process("mesh_levels")
    if "skipped" in found:
        pytest.skip(found["skipped"])
    for viewer, limits in found["small"].items():
        assert limits["100000"]["bytes"] <= 100_000, viewer
        assert limits["8000000"]["complete"] == 1, viewer
        assert limits["8000000"]["primitives"] > 100, viewer
        assert limits["8000000"]["psnr_covered"] > 15, viewer


@pytest.mark.browser
def test_webgpu_in_small() -> None:
    """Both ways draw the same picture."""
    found = _in_a_process("webgpu")
    if "skipped" in found:
        pytest.skip(found["skipped"])
    for figures in found.values():
        assert figures["splats"] > 10_000
        assert figures["psnr"]["listed"] >= 40


def _in_a_process(name: str) -> dict[str, Any]:
    """The figures of a benchmark in a process of its own: the browser of the other tests may be open in this one."""
    command = [sys.executable, "-m", "farfield", "bench", name, "--quick", "--json"]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    found: dict[str, Any] = json.loads(ended.stdout)
    return found


def test_they_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench"]) == 0
    assert capsys.readouterr().out.split() == NAMES
    assert main(["bench", "nonsense"]) == 2
    assert "no benchmark 'nonsense'" in capsys.readouterr().err
