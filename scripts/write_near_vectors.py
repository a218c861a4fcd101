"""Writes tests/vectors/near/*.bin: near geometry as it is stored, for pytest and vitest alike.

    python scripts/write_near_vectors.py

A shared mesh of three materials with all that vertices can have, and a leaf that places it. The same every time.
`version-1/` holds the same as farfield wrote them until 2026-11-29, without a dictionary, which readers must go on to
read; this script leaves it alone.
"""

from __future__ import annotations

import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests"))

from fuzz.decoders import decoders  # noqa: E402

FOLDER = REPOSITORY / "tests/vectors/near"

if __name__ == "__main__":
    for name in ("leaf", "mesh"):
        (FOLDER / f"{name}.bin").write_bytes(decoders()[name].corpus[1])
