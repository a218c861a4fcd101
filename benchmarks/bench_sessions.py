"""Many viewers that move, each in a session with one server process: what deciding takes, and what each gets (BEN-6).

    farfield bench sessions [--quick] [--json]
    python benchmarks/bench_sessions.py [--clients N] [--seconds S] [--bandwidth B] [--world DIR]

200 viewers in a process of their own fly circles over all of Tokyo (`farfield bench tokyo` leaves its world), say five
times a second where they are, and take 250 kB/s each. Told are the milliseconds of processor time of a decision and of
a look at all that could be sent, the server's memory a viewer, bytes and seconds to the first value of the best and the
worst served, and the shares of a core that server and viewers took: together they are no more than the machine has.
Quick: eight viewers in the town of the tests.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import fmean, median
from typing import Any

from websockets.asyncio.client import connect

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.serve.push.endpoint import PushLimits
from farfield.serve.run import ServeOptions, serving
from farfield.store.contract import Store
from farfield.store.directory import DirectoryStore
from farfield.store.opening import open_store
from farfield.world.world import World

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.world import town

WORLD = Path(__file__).parents[1] / "worlds/tokyo23/world-1"
CLIENTS, SECONDS = 200, 30.0
BANDWIDTH = 250_000.0
"""Bytes a second of each viewer."""
VIEW_SECONDS = 0.2


def run(quick: bool = False) -> dict[str, Any]:
    """Figures."""
    if not quick:
        return measured(open_store(str(WORLD)), CLIENTS, SECONDS) if WORLD.exists() else {"skipped": "no world"}
    with tempfile.TemporaryDirectory(prefix="farfield-sessions-") as folder:
        store = DirectoryStore(Path(folder) / "town")
        bake(town(), store, BakeOptions(leaf_size=8.0, resolution=32, directions="5", workers=1))
        return measured(store, 8, 2.0)


def measured(store: Store, clients: int, seconds: float, bandwidth: float = BANDWIDTH) -> dict[str, Any]:
    """So many viewers for so long."""
    from farfield.stream.scheduler import Scheduler

    bounds = World.open(store).manifest.bounds
    looks, decisions = _timed(Scheduler, "follow"), _timed(Scheduler, "next")
    limits = PushLimits(sessions=clients)
    with serving(store, ServeOptions(port=0, sessions=limits)) as url:
        # Reads the index, and loads the scheduler, before anything is measured.
        _clients(url, bounds, 1, 1.0, bandwidth)
        before = _memory()
        looks.clear()
        decisions.clear()
        begun = time.process_time()
        told = _clients(url, bounds, clients, seconds, bandwidth)
        used, took = _memory() - before, time.process_time() - begun
    received, first = told["bytes"], told["first_seconds"]
    return {
        "clients": clients,
        "seconds": seconds,
        "decisions": len(decisions),
        "decision_ms": _spread(decisions),
        "looks": len(looks),
        "look_ms": _spread(looks),
        "memory_a_client_mb": round(used / clients / 1e6, 2),
        "bytes": {"least": min(received), "median": median(received), "most": max(received)},
        "first_value_seconds": {"median": round(median(first), 2), "most": round(max(first), 2)},
        "ended_early": told["ended_early"],
        "cores": {"server": round(took / seconds, 2), "viewers": round(told["processor_seconds"] / seconds, 2)},
    }


def _timed(owner: type, name: str) -> list[float]:
    """Seconds of processor time of every call of a method from now on."""
    found: list[float] = []
    method: Callable[..., Any] = getattr(owner, name)

    def wrapped(*args: Any) -> Any:
        begun = time.thread_time()
        try:
            return method(*args)
        finally:
            found.append(time.thread_time() - begun)

    setattr(owner, name, wrapped)
    return found


def _spread(seconds: list[float]) -> dict[str, float]:
    """Milliseconds."""
    ordered = sorted(seconds)
    high = ordered[int(0.99 * (len(ordered) - 1))]
    return {"mean": round(1e3 * fmean(seconds), 3), "p99": round(1e3 * high, 3)}


def _memory() -> int:
    """Bytes of this process, now or at most."""
    status = Path("/proc/self/statm")
    if status.exists():
        return int(status.read_text().split()[1]) * resource.getpagesize()
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _clients(url: str, bounds: Any, count: int, seconds: float, bandwidth: float) -> dict[str, Any]:
    command = [sys.executable, __file__, "--fly", json.dumps([url, bounds, count, seconds, bandwidth])]
    found: dict[str, Any] = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return found


async def fly(url: str, bounds: Any, count: int, seconds: float, bandwidth: float) -> dict[str, Any]:
    """So many viewers at once."""
    begun = time.process_time()
    flights = [_Flight(url, bounds, n / count, seconds, bandwidth) for n in range(count)]
    await asyncio.gather(*(flight.run() for flight in flights))
    return {
        "bytes": [flight.bytes for flight in flights],
        "first_seconds": [flight.first for flight in flights],
        "ended_early": sum(flight.ended_early for flight in flights),
        "processor_seconds": time.process_time() - begun,
    }


class _Flight:
    """One viewer on a circle; `share` tells it from the others."""

    def __init__(self, url: str, bounds: Any, share: float, seconds: float, bandwidth: float) -> None:
        self.url, self.share, self.seconds, self.bandwidth = url, share, seconds, bandwidth
        (x0, y0, _), (x1, y1, z1) = bounds
        self.middle = ((x0 + x1) / 2, (y0 + y1) / 2)
        self.radius = (0.1 + 0.3 * share) * min(x1 - x0, y1 - y0)
        self.height = z1 + 0.02 * (x1 - x0)
        self.bytes, self.first, self.ended_early = 0, seconds, False

    async def run(self) -> None:
        """From hello to the end of its time."""
        async with connect(self.url.replace("http", "ws") + "stream", max_size=1 << 20) as socket:
            await socket.send(json.dumps({"type": "hello", "version": 1}))
            begun = time.monotonic()
            telling = asyncio.create_task(self._tell(socket, begun))
            try:
                async with asyncio.timeout(self.seconds):
                    await self._take(socket, begun)
                self.ended_early = True
            except TimeoutError:
                pass
            finally:
                telling.cancel()

    async def _take(self, socket: Any, begun: float) -> None:
        """Acknowledges what comes, as fast as its link would bring it."""
        pieces, free_at = 0, begun
        async for message in socket:
            if isinstance(message, str):
                continue
            pieces += 1
            if pieces == 1:
                self.first = time.monotonic() - begun
            self.bytes += len(message)
            free_at = max(free_at, time.monotonic()) + len(message) / self.bandwidth
            await asyncio.sleep(max(free_at - time.monotonic(), 0))
            await socket.send(json.dumps({"type": "ack", "pieces": pieces}))

    async def _tell(self, socket: Any, begun: float) -> None:
        speed = 30.0
        while True:
            angle = 2 * math.pi * self.share * 7 + speed * (time.monotonic() - begun) / self.radius
            (x, y), ahead = self.middle, (-math.sin(angle), math.cos(angle))
            eye = (x + self.radius * math.cos(angle), y + self.radius * math.sin(angle), self.height)
            view = {
                "type": "view",
                "eye": eye,
                "forward": (0.95 * ahead[0], 0.95 * ahead[1], -0.3),
                "fov": 46.8,
                "size": (640, 480),
                "velocity": (speed * ahead[0], speed * ahead[1], 0.0),
                "turning": speed / self.radius,
            }
            await socket.send(json.dumps(view))
            await asyncio.sleep(VIEW_SECONDS)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--clients", type=int, default=CLIENTS)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--bandwidth", type=float, default=BANDWIDTH)
    parser.add_argument("--world", type=Path, default=WORLD)
    parser.add_argument("--fly", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.fly:
        print(json.dumps(asyncio.run(fly(*json.loads(given.fly)))))
    else:
        store = open_store(str(given.world))
        print(json.dumps(measured(store, given.clients, given.seconds, given.bandwidth), indent=1))


if __name__ == "__main__":
    main()
