"""A Dask scheduler and its workers as processes of this machine, for tests of the bake on a cluster."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

IDLE_SECONDS = 120
"""After which scheduler and workers end by themselves, should a test be killed before it can end them."""


class LocalCluster:
    """One scheduler on a free port and workers without nannies: killed, they stay dead."""

    def __init__(self, folder: Path, **environment: str) -> None:
        """folder: for what the processes write; environment: additional variables, for Dask's configuration."""
        self._folder = folder
        self._environment = environment
        self._file = folder / "scheduler.json"
        self._scheduler = self._start("dask_scheduler", "--port", "0", "--idle-timeout", f"{IDLE_SECONDS}s")
        self.workers: list[subprocess.Popen[bytes]] = []

    @property
    def address(self) -> str:
        """Of the scheduler, once it runs."""
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            if self._file.exists() and (text := self._file.read_text()):
                return str(json.loads(text)["address"])
            time.sleep(0.05)
        raise TimeoutError("the scheduler did not start")

    def add_worker(self, *, threads: int = 1, **environment: str) -> subprocess.Popen[bytes]:
        """Starts a worker, whose current folder is not the test's; environment: additional variables.

        `first` among them is a folder that Python looks for modules in before all others.
        """
        ends = ("--death-timeout", f"{IDLE_SECONDS}s")
        self.workers.append(self._start("dask_worker", "--nthreads", str(threads), "--no-nanny", *ends, **environment))
        return self.workers[-1]

    def stop_scheduler(self) -> None:
        """Kills the scheduler alone."""
        _kill(self._scheduler)

    def stop_workers(self) -> None:
        """Kills the workers alone."""
        for worker in self.workers:
            _kill(worker)

    def stop(self) -> None:
        """Kills everything that was started."""
        self.stop_workers()
        self.stop_scheduler()

    def _start(self, command: str, *arguments: str, **environment: str) -> subprocess.Popen[bytes]:
        line = [sys.executable, "-m", f"distributed.cli.{command}", "--host", "127.0.0.1", "--no-dashboard"]
        path = os.pathsep.join(environment.pop("first", "").split() + [entry for entry in sys.path if entry])
        return subprocess.Popen(
            [*line, "--scheduler-file", str(self._file), *arguments],
            cwd=self._folder,
            env=os.environ
            | {"DASK_TEMPORARY_DIRECTORY": str(self._folder), "PYTHONPATH": path}
            | self._environment
            | environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )


def _kill(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
