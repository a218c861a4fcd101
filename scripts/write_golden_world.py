"""Writes tests/fixtures/world-v1.zip: a small world that every later version must read. Run once per format version.

    python scripts/write_golden_world.py

Negative indices, flat axes, both layers, a custom direction, instances, near geometry, object ids, a texture with
holes.
"""

from __future__ import annotations

import sys
import zipfile
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from bake.scenes import village  # noqa: E402
from farfield.bake.bake import bake  # noqa: E402
from farfield.bake.options import BakeOptions  # noqa: E402
from farfield.store.memory import MemoryStore  # noqa: E402

TARGET = ROOT / "tests/fixtures/world-v1.zip"
OPTIONS = BakeOptions(leaf_size=8.0, resolution=32, directions="5+0.3,0.2,0.9", corner=(4.0, 6.0, -0.125), workers=1)


def main() -> None:
    """Bakes the village and packs the world."""
    store = MemoryStore()
    bake(replace(village(), name="golden"), store, OPTIONS)
    with zipfile.ZipFile(TARGET, "w", zipfile.ZIP_DEFLATED) as archive:
        for key in store.list():
            archive.writestr(zipfile.ZipInfo(key, (2026, 1, 1, 0, 0, 0)), store.get(key), zipfile.ZIP_DEFLATED)
    print(f"{TARGET}: {TARGET.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
