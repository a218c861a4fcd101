"""What a surface is a part of, and what part: the few kinds that decide how it looks when the file does not say."""

from __future__ import annotations

from enum import IntEnum


class Family(IntEnum):
    """Kinds of city objects."""

    OTHER = 0
    BUILDING = 1
    """Its walls get façades."""
    BUILDING_DETAIL = 2
    """Installations, rooms, furniture."""
    BRIDGE = 3
    TUNNEL = 4
    ROAD = 5
    RAILWAY = 6
    SQUARE = 7
    WATER = 8
    PLANTS = 9
    TREE = 10
    LAND_USE = 11
    TERRAIN = 12
    FURNITURE = 13


class Role(IntEnum):
    """Kinds of semantic surfaces."""

    UNSAID = 0
    """Follows from where the surface faces."""
    ROOF = 1
    WALL = 2
    GROUND = 3
    WINDOW = 4
    DOOR = 5
    INNER = 6
    """Walls, floors and ceilings of rooms."""
    TRAFFIC = 7
    BESIDE_TRAFFIC = 8
    """Pavements, verges, traffic islands."""
    WATER = 9
    HIDDEN = 10
    """Closes a volume where there is nothing; never drawn."""


_FAMILIES = {
    "Building": Family.BUILDING,
    "BuildingPart": Family.BUILDING,
    "BuildingStorey": Family.BUILDING,
    "BuildingUnit": Family.BUILDING,
    "Road": Family.ROAD,
    "Railway": Family.RAILWAY,
    "Waterway": Family.WATER,
    "TransportSquare": Family.SQUARE,
    "TransportationSquare": Family.SQUARE,
    "WaterBody": Family.WATER,
    "PlantCover": Family.PLANTS,
    "SolitaryVegetationObject": Family.TREE,
    "LandUse": Family.LAND_USE,
    "TINRelief": Family.TERRAIN,
    "CityFurniture": Family.FURNITURE,
}
_BEGINNINGS = (("Building", Family.BUILDING_DETAIL), ("Bridge", Family.BRIDGE), ("Tunnel", Family.TUNNEL))

_ROLES = {
    "RoofSurface": Role.ROOF,
    "OuterCeilingSurface": Role.GROUND,
    "OuterFloorSurface": Role.ROOF,
    "WallSurface": Role.WALL,
    "GroundSurface": Role.GROUND,
    "Window": Role.WINDOW,
    "Door": Role.DOOR,
    "InteriorWallSurface": Role.INNER,
    "CeilingSurface": Role.INNER,
    "FloorSurface": Role.INNER,
    "TrafficArea": Role.TRAFFIC,
    "AuxiliaryTrafficArea": Role.BESIDE_TRAFFIC,
    "WaterSurface": Role.WATER,
    "ClosureSurface": Role.HIDDEN,
    "WaterClosureSurface": Role.HIDDEN,
    "TransportationHole": Role.HIDDEN,
}


def family_of(kind: object) -> Family:
    """Of a city object's type; extensions (+…) and what is unknown are OTHER."""
    if not isinstance(kind, str):
        return Family.OTHER
    found = _FAMILIES.get(kind)
    if found is not None:
        return found
    return next((family for beginning, family in _BEGINNINGS if kind.startswith(beginning)), Family.OTHER)


def role_of(kind: object) -> Role:
    """Of a semantic surface's type."""
    return _ROLES.get(kind, Role.UNSAID) if isinstance(kind, str) else Role.UNSAID
