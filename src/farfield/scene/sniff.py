"""What a file really is, by its first bytes."""

from __future__ import annotations

import mmap
from pathlib import Path

from farfield.errors import InputError

_MAGIC: tuple[tuple[bytes, str], ...] = (
    (b"glTF", "GLB"),
    (b"ply\n", "PLY"),
    (b"ply\r", "PLY"),
    (b"fgb\x03", "FlatGeobuf"),
    (b"SQLite format 3\x00", "GeoPackage"),
    (b"PAR1", "Parquet"),
    (b"\x89PNG", "PNG image"),
    (b"\xff\xd8\xff", "JPEG image"),
    (b"PK\x03\x04", "ZIP archive"),
    (b"\x1f\x8b", "gzip archive"),
    (b"%PDF", "PDF"),
    (b"b3dm", "3D Tiles b3dm"),
    (b"LASF", "LAS point cloud"),
    (b"II*\x00", "TIFF image"),
    (b"MM\x00*", "TIFF image"),
    (b"Kaydara FBX", "FBX"),
    (b"\x93NUMPY", "NumPy array"),
    (b"BZh", "bzip2 archive"),
    (b"<!DOCTYPE html", "HTML page"),
    (b"<html", "HTML page"),
    (b"version https://git-lfs", "Git LFS pointer"),
)

_EXTENSION = {"GLB": ".glb", "glTF": ".gltf", "PLY": ".ply", "OBJ": ".obj", "STL": ".stl", "FlatGeobuf": ".fgb",
              "GeoPackage": ".gpkg", "Parquet": ".parquet", "GeoJSON": ".geojson",
              "CityJSON": ".city.json", "OSM-PBF": ".osm.pbf", "OSM-XML": ".osm"}  # fmt: skip

_SPELT_WITH_A_VOWEL = {"OBJ", "STL", "HTML", "LAS", "FBX", "OSM-PBF", "OSM-XML"}


def file_kind(path: Path) -> str:
    """Name of the format the first bytes speak of; empty when they do not tell. Raises OSError."""
    with path.open("rb") as file:
        head = file.read(4096)
    for magic, kind in _MAGIC:
        if head.startswith(magic):
            return kind
    if head[4:15] == b"\x0a\x09OSMHeader":
        return "OSM-PBF"
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text.startswith(b"{"):
        return _json_kind(text)
    if text.startswith(b"<osm") or (text.startswith(b"<?xml") and b"<osm" in text):
        return "OSM-XML"
    if _is_binary_stl(head, path.stat().st_size) or (text[:5].lower() == b"solid" and b"facet" in text):
        return "STL"
    words = {line.split(b" ")[0].strip() for line in text.split(b"\n")[:-1]}
    return "OBJ" if b"v" in words and b"\x00" not in head else ""


def expect(path: Path, *kinds: str) -> None:
    """Raises InputError, saying what the file really is, when it is recognised as something else."""
    kind = file_kind(path)
    if not kind or kind in kinds:
        return
    article = "an" if kind.split()[0] in _SPELT_WITH_A_VOWEL else "a"
    noun = kind if " " in kind else f"{kind} file"
    known = kind in _EXTENSION
    hint = f"rename it to {path.stem}{_EXTENSION[kind]}" if known else "check what was downloaded or exported"
    raise InputError(f"is {article} {noun}, not {' or '.join(kinds)}", str(path), hint)


def holds_city(path: Path) -> bool:
    """Whether a JSON file is CityJSON, wherever in it that is said. Raises OSError."""
    if (kind := file_kind(path)) or path.stat().st_size == 0:
        return kind == "CityJSON"
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        return text.find(b'"CityObjects"') >= 0


def _json_kind(text: bytes) -> str:
    compact = b"".join(text.split())
    if b'"type":"CityJSON' in compact or b'"CityObjects"' in compact:
        return "CityJSON"
    if b'"type":"FeatureCollection"' in compact or b'"type":"Feature"' in compact:
        return "GeoJSON"
    return "glTF" if b'"asset"' in compact else ""


def _is_binary_stl(head: bytes, size: int) -> bool:
    return len(head) >= 84 and size == 84 + 50 * int.from_bytes(head[80:84], "little")
