"""Plain surface files, taken as they are (z up unless told otherwise): OBJ with MTL, PLY, STL."""

from farfield.scene.surfaces.obj import read_obj
from farfield.scene.surfaces.ply import read_ply
from farfield.scene.surfaces.stl import read_stl

__all__ = ["read_obj", "read_ply", "read_stl"]
