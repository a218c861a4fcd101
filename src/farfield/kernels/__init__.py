"""Compiled inner loops: flat arrays in and out, one algorithm a file, each with a plain twin in the tests."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path


def _drop_stale_kernels() -> None:
    """Forget compiled kernels when any source file here has changed since they were compiled.

    Numba looks at the file of the kernel alone; a helper that was compiled into it may stand in another.
    """
    folder = Path(__file__).parent
    facts = ((path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(folder.glob("*.py")))
    state = repr(list(facts))
    stamp = folder / "__pycache__" / "sources.stamp"
    # A folder that cannot be written to holds no compiled kernels either: numba keeps them elsewhere.
    with suppress(OSError):
        if stamp.exists() and stamp.read_text() == state:
            return
        for index in stamp.parent.glob("*.nbi"):
            index.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(state)


_drop_stale_kernels()
