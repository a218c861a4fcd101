"""How high buildings of OpenStreetMap are and where they begin, by their tags; what is usual for their kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from farfield.scene.footprints.heights import STOREY, TALLEST, numbers

HEIGHT_KEYS = (
    "height", "building:height", "building:levels", "roof:height", "roof:levels", "min_height", "building:min_height",
    "building:min_level", "building:levels:underground", "layer", "location",
)  # fmt: skip
"""Tags that are looked at here, beside `building` and `building:part`."""

Tags = Mapping[str, str]

USUAL = {
    3.0: "garage garages carport shed hut kiosk toilets service static_caravan container bunker guardhouse tent",
    4.0: "roof bungalow greenhouse glasshouse greenhouse_horticulture conservatory cabin boathouse pavilion",
    6.0: "stable barn cowshed sty farm_auxiliary riding_hall retail supermarket kindergarten sports_hall fire_station",
    7.0: "house detached semidetached_house semi terrace farm farmhouse villa residential houseboat",
    8.0: "chapel industrial warehouse manufacture factory works storage_tank transformer_tower depot",
    10.0: "school public civic commercial parking train_station hangar sports_centre construction temple mosque",
    12.0: "apartments office hotel dormitory hospital university government museum castle palace silo synagogue block",
    15.0: "church grandstand stadium monastery theatre",
    25.0: "cathedral tower minaret",
}
"""Metres -> kinds of buildings that are about so high where nothing is known of them."""
_USUAL = {kind: metres for metres, kinds in USUAL.items() for kind in kinds.split()}
_BY_AREA = ((30.0, 3.0), (80.0, 4.0), (400.0, 7.0), (np.inf, 10.0))
"""Square metres up to which a building of any other kind has some metres of height."""
SLAB = 0.4
"""Metres: thickness of a roof on pillars."""


def known_heights(tags: Sequence[Tags]) -> NDArray[np.float64]:
    """(n,) metres from the ground to the top of the roof, NaN where no tag tells it."""
    column = _columns(tags)
    height = np.full(len(tags), np.nan)
    levels, roof = column["building:levels"], _positive(column["roof:height"])
    roof = np.where(np.isnan(roof), _positive(column["roof:levels"]) * STOREY, roof)
    by_levels = np.nan_to_num(levels) * STOREY + np.nan_to_num(roof)
    by_levels = np.where(np.isnan(levels), np.nan, by_levels)
    dome = _lift(column) + roof  # A roof above others, without walls.
    for values in (column["height"], column["building:height"], by_levels, dome):
        height = np.where(np.isnan(height) & (values > 0) & (values < TALLEST), values, height)
    return height


def lifts(tags: Sequence[Tags], height: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) metres above the ground where walls begin; a roof on pillars begins just below its top, `height`."""
    column = _columns(tags)
    lift = _lift(column)
    pillars = np.array([kind_of(own) == "roof" for own in tags], bool) & ~(lift > 0)
    lift = np.where(pillars, np.maximum(height - SLAB, 0.0), lift)
    return np.where((lift > 0) & (lift < TALLEST), lift, 0.0)


def underground(tags: Sequence[Tags]) -> NDArray[np.bool_]:
    """(n,) what lies below the ground, as far as tags tell."""
    column = _columns(tags)
    nothing_above = np.isnan(known_heights(tags))
    below = (column["layer"] < 0) & (nothing_above | np.array([kind_of(own) == "roof" for own in tags], bool))
    cellar = (column["building:levels:underground"] > 0) & nothing_above
    said = np.array([own.get("location") == "underground" for own in tags], bool)
    return np.asarray(said | below | cellar)


def usual_heights(tags: Sequence[Tags], areas: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) metres that buildings of a kind usually have; areas: (n,) square metres."""
    by_area = np.select([areas < limit for limit, _ in _BY_AREA], [metres for _, metres in _BY_AREA])
    return np.array([_USUAL.get(kind_of(own), metres) for own, metres in zip(tags, by_area, strict=True)], np.float64)


def kind_of(tags: Tags) -> str:
    """What a building or a part of one is, in a word of the map; "yes" where it is just that."""
    part = tags.get("building:part", "no")
    return part if part not in ("no", "yes") else tags.get("building", "yes")


def _lift(column: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    lift = np.where(np.isnan(column["min_height"]), column["building:min_height"], column["min_height"])
    return np.where(np.isnan(lift), column["building:min_level"] * STOREY, lift)


def _columns(tags: Sequence[Tags]) -> dict[str, NDArray[np.float64]]:
    return {key: numbers(np.array([own.get(key) for own in tags], object)) for key in HEIGHT_KEYS}


def _positive(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(values > 0, values, np.nan)
