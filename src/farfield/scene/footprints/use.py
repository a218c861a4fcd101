"""What buildings are used for, from words of a column in several languages; told by the lowest bits of their seeds."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNKNOWN, RESIDENTIAL, OFFICE, INDUSTRIAL, RETAIL = range(5)
_BITS = 3

_WORDS: dict[int, tuple[str, str]] = {
    INDUSTRIAL: (
        "indust factory warehouse manufactur hangar usine entrepôt entrepot agric fábrica fabrica almac magazzin",
        "fabrik lager gewerbe fabriek 工場 工业 工業 倉庫 仓库 運輸 農林",
    ),
    RESIDENTIAL: (
        "resid résid dwelling apartment house housing townhouse farmhouse detached semidetached terrace dormitor hotel "
        "hôtel habitation logement maison vivienda abitaz abitativ",
        "wohn woon 住宅 住居 宿泊 住宿",
    ),
    OFFICE: (
        "office business government civic public school universit hospital bureau tertiaire administra oficina uffici "
        "direzional",
        "büro buero verwaltung kantoor 業務 事務所 オフィス 官公庁 文教 办公",
    ),
    RETAIL: (
        "retail shop store market supermar supermerc hypermar restaurant commerc magasin comerci tienda negozi",
        "handel laden geschäft winkel 商業 店舗 商业",
    ),
}
"""Beginnings of words, and what may stand inside them as well: German and Dutch join words, Chinese and Japanese do not
part them. In the order in which they are looked for: a public market is an office."""
_MEANT = {
    use: re.compile(rf"(?<![^\W\d_])(?:{'|'.join(begins.split())})|{'|'.join(anywhere.split())}")
    for use, (begins, anywhere) in _WORDS.items()
}


def uses_of(column: NDArray[Any]) -> NDArray[np.uint32]:
    """(n,) uint32 use of each text; UNKNOWN for numbers and words that say nothing. Each text is understood once."""
    values = column.tolist()
    known = {value: _use(value) for value in set(values)}
    return np.array([known[value] for value in values], np.uint32)


def _use(value: Any) -> int:
    if not isinstance(value, str):
        return UNKNOWN
    text = value.lower()
    return next((use for use, meant in _MEANT.items() if meant.search(text)), UNKNOWN)


def with_use(seed: NDArray[np.uint32], use: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Seeds whose lowest bits are the use."""
    return ((seed >> np.uint32(_BITS)) << np.uint32(_BITS)) | use


def use_of(seed: NDArray[np.uint32]) -> NDArray[np.int64]:
    """(n,) use that the seeds tell; UNKNOWN where the bits are none."""
    use = (seed & np.uint32((1 << _BITS) - 1)).astype(np.int64)
    return np.where(use <= RETAIL, use, UNKNOWN)
