"""MTL: the colours and textures of an OBJ file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from farfield.errors import InputError
from farfield.geometry.color import linear_from_srgb
from farfield.scene.model import Material, Texture
from farfield.scene.textures import decode_image

MASK = 0.5
_OPTION_WIDTH = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2, "-bm": 1, "-blendu": 1, "-blendv": 1, "-clamp": 1, "-texres": 1,
                 "-boost": 1, "-imfchan": 1, "-type": 1}  # fmt: skip


def read_mtl(path: Path) -> tuple[dict[str, Material], list[str]]:
    """Materials by name, and warnings: a missing library or texture leaves plain colours."""
    try:
        lines = path.read_text("utf-8", "replace").splitlines()
    except OSError:
        return {}, [f"{path}: there is no such file; its materials are drawn white"]
    entries: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    for line in lines:
        keyword, _, rest = line.strip().partition(" ")
        if keyword == "newmtl":
            current = entries.setdefault(rest.strip(), {})
        elif keyword:
            current[keyword] = rest.strip()
    warnings: list[str] = []
    cache: dict[str, Texture | None] = {}
    return {name: _material(name, entry, path, cache, warnings) for name, entry in entries.items()}, warnings


def _material(
    name: str, entry: dict[str, str], library: Path, cache: dict[str, Texture | None], warnings: list[str]
) -> Material:
    """Kd is taken as sRGB, as exporters write it; with a texture, as a factor that is nearly always white."""
    words = [float(word) for word in entry.get("Kd", "1 1 1").split()[:3]]
    red, green, blue = linear_from_srgb(np.array((words + words[-1:] * 2)[:3])).tolist()
    texture = _texture(entry["map_Kd"], library, cache, warnings) if "map_Kd" in entry else None
    alpha = float(entry["d"].split()[-1]) if "d" in entry else 1.0
    masked = "map_d" in entry or (texture is not None and bool((texture.pixels[..., 3] < 128).any()))
    return Material(name, (red, green, blue, alpha), texture, MASK if masked else None)


def _texture(value: str, library: Path, cache: dict[str, Texture | None], warnings: list[str]) -> Texture | None:
    file = _file_name(value)
    if file not in cache:
        try:
            cache[file] = decode_image(library.parent / file.replace("\\", "/"), str(library))
        except InputError as error:
            cache[file] = None
            warnings.append(f"{library}: texture {file}: {error.what}; its material's colour is used")
    return cache[file]


def _file_name(value: str) -> str:
    """The name after any options, which all take a fixed number of words."""
    words = value.split()
    while words and words[0] in _OPTION_WIDTH:
        words = words[1 + _OPTION_WIDTH[words[0]] :]
    return " ".join(words)
