"""Colours of surfaces whose looks the file does not give."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from farfield.scene.cityjson.kinds import Family, Role
from farfield.scene.footprints.facades import roof_colors

_OF_FAMILY = {
    Family.OTHER: (168, 164, 156),
    Family.BUILDING: (196, 188, 174),
    Family.BUILDING_DETAIL: (186, 180, 170),
    Family.BRIDGE: (160, 156, 148),
    Family.TUNNEL: (140, 138, 132),
    Family.ROAD: (92, 92, 94),
    Family.RAILWAY: (118, 108, 98),
    Family.SQUARE: (150, 144, 134),
    Family.WATER: (70, 104, 132),
    Family.PLANTS: (98, 126, 64),
    Family.TREE: (72, 104, 48),
    Family.LAND_USE: (142, 148, 104),
    Family.TERRAIN: (122, 126, 88),
    Family.FURNITURE: (112, 116, 118),
}
_OF_ROLE = {
    Role.GROUND: (112, 106, 98),
    Role.WINDOW: (70, 84, 98),
    Role.DOOR: (104, 78, 58),
    Role.INNER: (226, 222, 214),
    Role.TRAFFIC: (92, 92, 94),
    Role.BESIDE_TRAFFIC: (142, 138, 130),
    Role.WATER: (70, 104, 132),
}
_PITCHED = np.array([[146, 82, 62], [128, 74, 58], [160, 100, 74], [108, 76, 66], [92, 92, 98], [112, 112, 116]])
"""Tiles and slate."""
_FLATTEST = 0.94
"""Vertical share of the normal of a roof from which it is flat (20 degrees)."""
_UPRIGHT = 0.3
"""Up to this vertical share a surface stands, with more of it it lies."""
_BUILT = (Family.BUILDING, Family.BUILDING_DETAIL)


def roles_told(role: NDArray[np.uint8], family: NDArray[np.uint8], rise: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(f,) roles; of surfaces of buildings that have none by where they face: up a roof, down the ground, else a wall.

    rise: (f,) vertical share of the normal.
    """
    lying = np.where(rise > 0, Role.ROOF, Role.GROUND)
    by_normal = np.where(np.abs(rise) <= _UPRIGHT, Role.WALL, lying)
    unsaid = (role == Role.UNSAID) & np.isin(family, _BUILT)
    return np.where(unsaid, by_normal, role).astype(np.uint8)


def default_colors(
    role: NDArray[np.uint8],
    family: NDArray[np.uint8],
    rise: NDArray[np.float64],
    seed: NDArray[np.uint32],
    walls: NDArray[np.uint8],
) -> NDArray[np.uint8]:
    """(f, 4) uint8 sRGB. seed: (f,) of the object. walls: (f, 4) what walls of the object's buildings have."""
    table = np.array([_OF_FAMILY[family] for family in Family], np.float64)
    colors = table[family] * (0.93 + 0.14 * _share(seed, 3))[:, None]
    for own, color in _OF_ROLE.items():
        colors[role == own] = color
    out = np.full((len(role), 4), 255, np.uint8)
    out[:, :3] = np.clip(np.floor(colors + 0.5), 0, 255)
    built = np.isin(family, _BUILT)
    roofs = np.flatnonzero(built & (role == Role.ROOF))
    flat = rise[roofs] >= _FLATTEST
    out[roofs[flat]] = roof_colors(seed[roofs[flat]])
    out[roofs[~flat], :3] = _pitched(seed[roofs[~flat]])
    of_walls = (family == Family.BUILDING) & (role == Role.WALL)
    out[of_walls] = walls[of_walls]
    return out


def _pitched(seed: NDArray[np.uint32]) -> NDArray[np.float64]:
    kind = (seed >> np.uint32(4)) % np.uint32(len(_PITCHED))
    return np.asarray(np.floor(_PITCHED[kind] * (0.88 + 0.2 * _share(seed, 11))[:, None] + 0.5))


def _share(seed: NDArray[np.uint32], shift: int) -> NDArray[np.float64]:
    """(n,) in 0..1, told by the seed."""
    return ((seed >> np.uint32(shift)) & np.uint32(255)).astype(np.float64) / 255
