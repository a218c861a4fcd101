"""Levels of detail of a mesh by gltfpack, and textures no larger than a level needs.

Simplified as far as an error bound allows (-si 0 -se E), which is then the geometric error. Tried on trees drawn with a
pixel as large as the error: a share of the triangles instead (-si 0.25 -se 1) gives 15 to 22 dB where the bound gives
27 to 41; -sa is worse by 4 to 10 dB at the same triangles; -sp -sv changes nothing.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from farfield.geometry.color import linear_from_srgb, srgb_from_linear
from farfield.scene.model import Material, Mesh
from mesh_levels.glb import read, write
from mesh_levels.packages import gltfpack

COMPRESSED = ("-cc", "-tr", "-vp", "12", "-vt", "14")
"""Highest meshopt compression. 12 bits for positions: steps of an eighth of a level's error; 14 for texture
coordinates, because façades repeat."""
EXACT = ("-noq", "-tr", "-km")
SMALLEST_TEXTURE = 64


def within(mesh: Mesh, error: float, work: Path, *options: str) -> Mesh:
    """What gltfpack makes of a mesh within an error in metres."""
    side = float((mesh.positions.max(0) - mesh.positions.min(0)).max())
    return simplified(mesh, work, "-si", "0", "-se", f"{min(error / side, 1.0):.9f}", *options)


def simplified(mesh: Mesh, work: Path, *options: str) -> Mesh:
    """What gltfpack leaves of a mesh; its textures stay as they are. A mesh of which it leaves nothing stays whole."""
    own = {material.name: material for material in mesh.materials}
    bare = replace(mesh, materials=tuple(_bare(material) for material in mesh.materials))
    source, target = work / "source.glb", work / "simplified.glb"
    write(source, bare, dict.fromkeys(own, "none.webp"))
    Image.new("RGB", (1, 1)).save(work / "none.webp")
    gltfpack(source, target, *EXACT, *options)
    try:
        made = read(target)
    except Exception:
        return mesh
    return replace(made, materials=tuple(own[material.name] for material in made.materials))


def texel(mesh: Mesh, material: int) -> float:
    """Metres: side of a texel of a material's texture on the surface, on average."""
    texture, uvs = mesh.materials[material].texture, mesh.uvs
    assert texture is not None
    assert uvs is not None
    corners = mesh.triangles[mesh.triangle_material == material]
    a, b, c = (mesh.positions[corners[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    p, q, r = (uvs[corners[:, k]].astype(np.float64) for k in range(3))
    across = np.abs((q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]).sum()
    texels = across * texture.pixels.shape[0] * texture.pixels.shape[1]
    return float(np.sqrt(area / max(texels, 1e-12)))


def shrunk(pixels: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """(h, w, 4) -> (h / factor, w / factor, 4): averaged in linear light, weighted by alpha."""
    height, width = (side // factor for side in pixels.shape[:2])
    blocks = pixels[: height * factor, : width * factor].reshape(height, factor, width, factor, 4).astype(np.float32)
    alpha = blocks[..., 3:] / 255
    weight = np.maximum(alpha.sum((1, 3)), 1e-6)
    color = (linear_from_srgb(blocks[..., :3] / 255) * alpha).sum((1, 3)) / weight
    out = np.concatenate([srgb_from_linear(color) * 255, alpha.mean((1, 3)) * 255], -1)
    return np.floor(out + 0.5).astype(np.uint8)


def shrinking(texel_side: float, error: float, side: int) -> int:
    """The power of two by which a texture may shrink so that its texels stay within half of an error."""
    factor = 1
    while 2 * factor * texel_side <= error / 2 and side // (2 * factor) >= SMALLEST_TEXTURE:
        factor *= 2
    return factor


def save_webp(path: Path, pixels: NDArray[np.uint8], quality: int = 85, effort: int = 4) -> None:
    """Writes a texture; without alpha when it is opaque. effort: 0..6."""
    image = Image.fromarray(pixels)
    opaque = bool((pixels[..., 3] == 255).all())
    (image.convert("RGB") if opaque else image).save(path, "WEBP", quality=quality, method=effort)


def _bare(material: Material) -> Material:
    return replace(material, alpha_cutoff=None)
