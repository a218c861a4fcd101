"""What buildings are used for, from words of a column in several languages; told by the lowest bits of their seeds."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

UNKNOWN, RESIDENTIAL, OFFICE, INDUSTRIAL, RETAIL = range(5)
_BITS = 3

_WORDS: dict[int, tuple[str, ...]] = {
    INDUSTRIAL: ("indust", "factory", "warehouse", "manufactur", "hangar", "fabrik", "lager", "gewerbe",
                 "usine", "entrepôt", "entrepot", "agric", "fábrica", "fabrica", "almacén", "almacen", "magazzin",
                 "fabriek", "工場", "工业", "工業", "倉庫", "仓库", "運輸", "農林"),
    RESIDENTIAL: ("resid", "résid", "dwelling", "apartment", "house", "housing", "detached", "terrace", "dormitor",
                  "hotel", "hôtel", "wohn", "habitation", "logement", "maison", "vivienda", "abitaz", "abitativ",
                  "woon", "住宅", "住居", "宿泊", "住宿"),
    OFFICE: ("office", "business", "government", "civic", "public", "school", "universit", "hospital", "büro", "buero",
             "verwaltung", "bureau", "tertiaire", "administra", "oficina", "uffici", "direzional", "kantoor", "業務",
             "事務所", "オフィス", "官公庁", "文教", "办公"),
    RETAIL: ("retail", "shop", "store", "market", "restaurant", "commerc", "handel", "laden", "geschäft",
             "magasin", "comercio", "comercial", "tienda", "negozi", "winkel", "商業", "店舗", "商业"),
}  # fmt: skip
"""Parts of words, in the order in which they are looked for: a warehouse is no house."""


def uses_of(column: NDArray[Any]) -> NDArray[np.uint32]:
    """(n,) uint32 use of each text; UNKNOWN for numbers and words that say nothing."""
    known: dict[Any, int] = {}
    return np.array([known.setdefault(value, _use(value)) for value in column.tolist()], np.uint32)


def _use(value: Any) -> int:
    if not isinstance(value, str):
        return UNKNOWN
    text = value.lower()
    return next((use for use, words in _WORDS.items() if any(word in text for word in words)), UNKNOWN)


def with_use(seed: NDArray[np.uint32], use: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Seeds whose lowest bits are the use."""
    return ((seed >> np.uint32(_BITS)) << np.uint32(_BITS)) | use


def use_of(seed: NDArray[np.uint32]) -> NDArray[np.int64]:
    """(n,) use that the seeds tell; UNKNOWN where the bits are none."""
    use = (seed & np.uint32((1 << _BITS) - 1)).astype(np.int64)
    return np.where(use <= RETAIL, use, UNKNOWN)
