"""A slow link lets bytes through as fast as it should, by the real clock."""

from __future__ import annotations

import asyncio
import math
import time

import pytest

from farfield.errors import OptionError
from farfield.serve.throttle import BURST_SECONDS
from farfield.walk.link import SlowLink
from farfield.walk.loops import run_apart


def test_bytes_pass_one_after_the_other() -> None:
    link = SlowLink(20_000)

    async def carry() -> float:
        begun = time.monotonic()
        await asyncio.gather(link.carry(2_000), link.carry(4_000))
        return time.monotonic() - begun

    took = run_apart(carry)
    assert 0.3 - BURST_SECONDS - 0.01 <= took < 0.6
    assert link.bytes == 6_000


@pytest.mark.parametrize(("bandwidth", "latency"), [(0, 0), (-1, 0), (math.nan, 0), (math.inf, 0), (1, -1), (1, 60)])
def test_links_that_are_none(bandwidth: float, latency: float) -> None:
    with pytest.raises(OptionError):
        SlowLink(bandwidth, latency)


def test_where_a_loop_runs_already() -> None:
    async def outer() -> float:
        return run_apart(inner)

    async def inner() -> float:
        await asyncio.sleep(0)
        return 1.0

    async def failing() -> float:
        raise OptionError("no")

    assert run_apart(outer) == 1.0
    with pytest.raises(OptionError, match="no"):
        run_apart(failing)
