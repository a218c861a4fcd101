"""farfield: bakes any 3D scene into a hierarchy of small pictures with depth and shows it in a web page."""

__version__ = "0.1.0"
