"""Every benchmark runs, in small sizes, and gives figures that JSON knows."""

from __future__ import annotations

import json

import pytest

from farfield.cli import main
from farfield.cli.bench import FOLDER, PREFIX

NAMES = sorted(path.stem.removeprefix(PREFIX) for path in FOLDER.glob(f"{PREFIX}*.py"))


IN_A_BROWSER = ("page",)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.browser] * (name in IN_A_BROWSER)) for name in NAMES]
)
def test_a_benchmark_in_small(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", name, "--quick", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)


def test_they_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench"]) == 0
    assert capsys.readouterr().out.split() == NAMES
    assert main(["bench", "nonsense"]) == 2
    assert "no benchmark 'nonsense'" in capsys.readouterr().err
