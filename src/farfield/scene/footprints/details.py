"""What some files tell of a building besides its outline and height: colours, and where its walls begin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

SIDES: dict[str, tuple[int, ...]] = {"lift": (), "wall_color": (4,), "roof_color": (4,)}
"""Field -> shape of a building's part of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Details:
    """Of n buildings. None stands for zeros: most files tell nothing of this."""

    lift: NDArray[np.float64] | None = None
    """(n,) metres that a building's bottom lies above the ground; where it does, the bottom has a face."""
    wall_color: NDArray[np.uint8] | None = None
    """(n, 4) sRGB and alpha of the walls; alpha 0: drawn from the seed."""
    roof_color: NDArray[np.uint8] | None = None
    """(n, 4) likewise of the roof."""

    def of(self, rows: NDArray[np.int64]) -> Details:
        """Copies for some buildings, in the order given."""
        return Details(**{name: array[rows] for name, array in self.told().items()})

    def told(self) -> dict[str, NDArray[Any]]:
        """Fields of which any building has something."""
        fields = ((name, getattr(self, name)) for name in SIDES)
        return {name: array for name, array in fields if array is not None and array.any()}

    @classmethod
    def joined(cls, parts: Sequence[Details], counts: Sequence[int]) -> Details:
        """Several, one after the other; counts: buildings of each."""
        told = [part.told() for part in parts]
        names = [name for name in SIDES if any(name in fields for fields in told)]
        return cls(**{name: _joined(name, told, counts) for name in names})


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """Of the n features of a table."""

    height: NDArray[np.float64]
    """(n,) metres from the ground to the roof, NaN where unknown."""
    details: Details = field(default_factory=Details)
    seed: NDArray[np.uint32] | None = None
    """(n,) what looks are drawn from; None: from place and height."""


def _joined(name: str, told: Sequence[dict[str, NDArray[Any]]], counts: Sequence[int]) -> NDArray[Any]:
    kind = np.float64 if name == "lift" else np.uint8
    blank = (np.zeros((count, *SIDES[name]), kind) for count in counts)
    return np.concatenate([fields.get(name, zeros) for fields, zeros in zip(told, blank, strict=True)])
