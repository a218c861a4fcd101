"""Every decoder reads what it is given or refuses it with the project's own error, in time and in bounded memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzz.apart import Apart
from fuzz.decoders import DECODERS, decoders
from fuzz.judge import Fault, Outcome, case

NAMES = [make.__name__.removeprefix("_") for make in DECODERS]
SAMPLE = 200
"""Cases of each decoder that always run."""
CASES = 100_000
"""Of all of them together, of those marked slow."""


def tried(apart: Apart, decoder: str, data: bytes) -> Outcome:
    found = apart.judge(decoder, data)
    assert isinstance(found, Outcome), str(found)
    return found


@pytest.mark.parametrize("name", NAMES)
def test_a_sample(apart: Apart, name: str) -> None:
    decoder = decoders()[name]
    found: Counter[bool] = Counter()
    for number in range(SAMPLE):
        found[tried(apart, name, case(decoder, Random(f"{name} {number}"))).read] += 1
    # Damage that is never read only ever meets the first check.
    assert found[True] > SAMPLE / 50
    assert found[False] > SAMPLE / 5


@pytest.mark.parametrize("name", NAMES)
def test_valid_values_are_read(apart: Apart, name: str) -> None:
    decoder = decoders()[name]
    # A record is read as that of one cell: the others are refused.
    corpus = decoder.corpus[:1] if name == "record" else decoder.corpus
    for value in corpus:
        assert tried(apart, name, value).read
        for shell in decoder.shells:
            part = shell.open(value)
            assert part is None or tried(apart, name, shell.close(value, part)).read, shell.name


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_any_bytes(apart: Apart, name: str, data: st.DataObject) -> None:
    decoder = decoders()[name]
    value, shell = data.draw(st.sampled_from(decoder.corpus)), data.draw(st.sampled_from(decoder.shells))
    part = data.draw(st.binary(max_size=300))
    tried(apart, name, part if shell.open(value) is None else shell.close(value, part))
    at = data.draw(st.integers(0, len(value)))
    tried(apart, name, value[:at] + part)


NODES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
TREES = st.recursive(NODES, lambda node: st.lists(node, max_size=4) | st.dictionaries(st.text(max_size=5), node))


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_any_json(apart: Apart, name: str, data: st.DataObject) -> None:
    """One member of a document, replaced by whatever JSON can say."""
    decoder = decoders()[name]
    shell = next((shell for shell in decoder.shells if shell.json), None)
    if shell is None:
        return
    document = json.loads(shell.open(decoder.corpus[0]) or b"")
    place = document
    while isinstance(place, dict | list) and place:
        key = data.draw(st.sampled_from(list(place) if isinstance(place, dict) else range(len(place))))
        if data.draw(st.booleans()) or not isinstance(place[key], dict | list):
            place[key] = data.draw(TREES)
            break
        place = place[key]
    tried(apart, name, shell.close(decoder.corpus[0], json.dumps(document).encode()))


@pytest.mark.slow
def test_at_length(tmp_path: Path) -> None:
    """In a process of its own: what a kernel does to memory that is not its own would end this one."""
    tests = Path(__file__).parents[1]
    path = os.pathsep.join([str(tests), str(tests.parent / "src"), os.environ.get("PYTHONPATH", "")])
    with (tmp_path / "log").open("w+", encoding="utf-8") as log:
        done = subprocess.run(
            [sys.executable, "-m", "fuzz.run", str(CASES)],
            env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.PIPE, stderr=log, check=False,
        )  # fmt: skip
        log.seek(0)
        assert done.returncode == 0, log.read()[-2000:]
    report = json.loads(done.stdout)
    assert report["faults"] == []
    assert report["cases"] == CASES
    print(report)


@pytest.mark.parametrize(
    ("faulty", "says"),
    [
        ("hangs", "not done"),
        ("fails", "raises IndexError"),
        ("devours", "allocates 100000"),
        ("unusable", "raises IndexError"),
        ("dies", "ends the process, exit code -9"),
        ("sticks", "ends the process, exit code -14"),
    ],
)
def test_the_judge_finds_what_it_is_there_to_find(apart: Apart, faulty: str, says: str) -> None:
    found = apart.judge(faulty, b"", seconds=0.05)
    assert isinstance(found, Fault)
    assert says in found.what
    assert apart.judge("reads", b"").read  # type: ignore[union-attr]
    assert not apart.judge("refuses", b"").read  # type: ignore[union-attr]
