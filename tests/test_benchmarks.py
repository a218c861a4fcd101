"""Every benchmark runs, in small sizes, and gives figures that JSON knows."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from farfield.cli import main
from farfield.cli.bench import FOLDER, PREFIX

NAMES = sorted(path.stem.removeprefix(PREFIX) for path in FOLDER.glob(f"{PREFIX}*.py"))


IN_A_BROWSER = ("page",)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in IN_A_BROWSER])
def test_a_benchmark_in_small(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", name, "--quick", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)


@pytest.mark.browser
@pytest.mark.parametrize("name", IN_A_BROWSER)
def test_a_benchmark_in_a_browser_in_small(name: str) -> None:
    """In a process of its own: the browser of the other tests may be open in this one."""
    command = [sys.executable, "-m", "farfield", "bench", name, "--quick", "--json"]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    assert json.loads(ended.stdout)["flight"]["fetched_while_held"] == 0


def test_they_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench"]) == 0
    assert capsys.readouterr().out.split() == NAMES
    assert main(["bench", "nonsense"]) == 2
    assert "no benchmark 'nonsense'" in capsys.readouterr().err
