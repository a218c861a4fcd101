"""Runs what is asynchronous for callers that are not."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeVar

from anyio.from_thread import start_blocking_portal

Result = TypeVar("Result")


def run_apart(work: Callable[[], Awaitable[Result]]) -> Result:
    """The result of an asynchronous function, run in a loop and a thread of its own.

    asyncio.run refuses callers that have a loop running already, as notebooks and Playwright do. Raises what the
    function raises; an interrupt cancels it.
    """
    with start_blocking_portal() as portal:
        return portal.call(work)
