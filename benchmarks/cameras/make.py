"""Writes the cameras of the quality benchmark: `python benchmarks/cameras/make.py`. They are committed.

NAME.json: 12 cameras inside the scene that look across it, with far field from r on. NAME_far.json: 12 cameras at its
edge, for near radius 4 r. NAME_farther.json: 12 cameras away from it, for 16 r. Leaf sizes as in bench_quality.py.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from farfield.geometry.cameras import vertical_fov

SIZE = 640, 480
SCENES = {
    "tokyo": (128.0, 500.0, (192.0, 1388.0)),
    "forest": (32.0, 100.0, (0.0, 0.0)),
    "statues": (4.0, 14.0, (0.0, 0.0)),
}
"""Leaf size, half of the side, middle; metres."""


def main() -> None:
    """Writes all six files."""
    for name, (leaf, half, middle) in SCENES.items():
        radius = leaf * SIZE[0] / (2 * 512 * math.tan(math.radians(30)))
        inside = frames(np.array(middle), half * np.array([0.15, 0.9]), leaf * np.array([0.35, 1.0]), 1.5 * radius, 1)
        outside = frames(np.array(middle), half * np.array([0.9, 1.2]), leaf * np.array([0.6, 2.2]), 5.0 * radius, 2)
        ring = half + radius * np.array([16.5, 18.0])
        away = frames(np.array(middle), ring, leaf * np.array([2.0, 9.0]), half + 17.0 * radius, 3, 10.0)
        for file, path in ((f"{name}.json", inside), (f"{name}_far.json", outside), (f"{name}_farther.json", away)):
            text = ",\n".join(json.dumps(frame) for frame in path)
            (Path(__file__).parent / file).write_text(f'{{"fps": 30, "frames": [\n{text}\n]}}\n')


def frames(
    middle: np.ndarray, ring: np.ndarray, heights: np.ndarray, reach: float, seed: int, aside: float = 25.0
) -> list[dict[str, object]]:
    """Twelve cameras on a ring that look `aside` degrees past its middle at most, at the ground `reach` away."""
    random = np.random.default_rng(seed)
    found = []
    for k in range(12):
        angle = math.radians(30 * k + random.uniform(-12, 12))
        away = ring[0] + (ring[1] - ring[0]) * random.uniform()
        height = heights[0] + (heights[1] - heights[0]) * ((5 * k) % 12) / 11
        heading = angle + math.pi + math.radians(random.uniform(-aside, aside))
        eye = [*(middle + away * np.array([math.cos(angle), math.sin(angle)])), height]
        target = [eye[0] + reach * math.cos(heading), eye[1] + reach * math.sin(heading), 0.25 * heights[0]]
        found.append(
            {
                "t": k,
                "eye": [round(float(v), 3) for v in eye],
                "target": [round(float(v), 3) for v in target],
                "fov": round(vertical_fov(60.0, SIZE), 4),
            }
        )
    return found


if __name__ == "__main__":
    main()
