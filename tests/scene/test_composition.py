"""scene.toml, instance tables, and what is said about mistakes in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from farfield.errors import InputError, OptionError
from farfield.scene.model import Scene
from farfield.scene.procedural.ground import PATTERNS, ground_texture
from farfield.scene.read import read_scene
from farfield.scene.tables import read_table
from scene.small_gltf import triangle_file


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    triangle_file().write(tmp_path / "a.glb")
    return tmp_path


def compose(folder: Path, text: str) -> Scene:
    (folder / "scene.toml").write_text(text)
    return read_scene([folder])


def test_scaled_then_turned_then_moved(folder: Path) -> None:
    scene = compose(folder, '[[source]]\npath = "a.glb"\ntranslate = [10, 20, 30]\nrotate = 90\nscale = [2, 3, 4]\n')
    matrix = scene.instances.transform[0]
    np.testing.assert_allclose(matrix @ [1, 0, 0, 1], [10, 22, 30], atol=1e-12)
    np.testing.assert_allclose(matrix @ [0, 1, 1, 1], [7, 20, 34], atol=1e-12)


def test_matrix_credits_and_bytes(folder: Path) -> None:
    text = 'credits = ["A", "B"]\n[[source]]\npath = "a.glb"\nmatrix = [[1, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7]]\n'
    scene = compose(folder, text)
    assert scene.instances.transform[0, :, 3].tolist() == [5, 6, 7]
    assert scene.credits == ("A", "B")
    assert scene.source_bytes == len(text) + (folder / "a.glb").stat().st_size


def test_a_scene_is_called_by_its_name_its_folder_or_its_file(folder: Path) -> None:
    source = '[[source]]\npath = "a.glb"\n'
    assert compose(folder, source).name == folder.name
    assert compose(folder, f'name = "Yard"\n{source}').name == "Yard"
    assert read_scene([folder / "a.glb", folder / "scene.toml"]).name == "a"


def test_placements_follow_the_sources_own_transform(folder: Path) -> None:
    np.save(folder / "t.npy", np.array([[100, 0, 0, 90, 2.0], [0, 50, 0, 0, 1]], np.float32))
    scene = compose(folder, '[[source]]\npath = "a.glb"\ninstances = "t.npy"\ntranslate = [1, 0, 0]\n')
    assert scene.object_count == 2
    assert scene.instances.first_object.tolist() == [1, 2]
    assert len(scene.meshes) == 1
    np.testing.assert_allclose(scene.instances.transform[0] @ [0, 0, 0, 1], [100, 2, 0], atol=1e-12)
    np.testing.assert_allclose(scene.instances.transform[1] @ [0, 0, 0, 1], [1, 50, 0])


def test_equal_sources_are_one_mesh_and_objects_are_numbered_through(folder: Path) -> None:
    scene = compose(folder, '[[source]]\npath = "a.glb"\n[[source]]\npath = "a.glb"\n[[ground]]\nsize = 4\n')
    assert len(scene.meshes) == 2
    assert scene.instances.mesh.tolist() == [0, 0, 1]
    assert scene.instances.first_object.tolist() == [1, 2, 3]


def test_every_form_of_table_says_the_same(tmp_path: Path) -> None:
    x, y, z, heading, scale = np.random.default_rng(0).uniform(1, 80, (5, 7))
    half = np.deg2rad(heading) / 2
    forms = {
        "five": np.stack([x, y, z, heading, scale], -1),
        "seven": np.stack([x, y, z, heading, scale, scale, scale], -1),
        "eight": np.stack([x, y, z, 0 * x, 0 * x, np.sin(half), np.cos(half), scale], -1),
    }
    for name, table in forms.items():
        np.save(tmp_path / f"{name}.npy", table)
    expected = read_table(tmp_path / "five.npy")
    np.save(tmp_path / "matrices.npy", expected)
    columns = {"x": x, "y": y, "z": z, "heading": heading, "scale": scale, "species": ["oak"] * 7}
    pyarrow.parquet.write_table(pyarrow.table(columns), tmp_path / "columns.parquet")
    for name in ("seven.npy", "eight.npy", "matrices.npy", "columns.parquet"):
        np.testing.assert_allclose(read_table(tmp_path / name), expected, atol=1e-9)
    # A heading of 90 degrees turns x towards y.
    np.save(tmp_path / "turn.npy", [[0.0, 0, 0, 90]])
    np.testing.assert_allclose(read_table(tmp_path / "turn.npy")[0] @ [1, 0, 0, 1], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[[source]]\npath = 'a'\nsc = 2", "unknown key `sc` in [[source]] 1 (docs/scene-toml.md lists the keys)"),
        ("sources = 2", "unknown key `sources` (docs/scene-toml.md lists the keys)"),
        ("[[ground]]\nsize = 1\n[[ground]]\nsize = [1]",
         "Expected `array` of length 2, got 1 in size of [[ground]] 2 (docs/scene-toml.md lists the keys)"),
        ("[[source]]\nscale = 1", "missing key `path` in [[source]] 1 (docs/scene-toml.md lists the keys)"),
        ("credits = []", "names no source (add a [[source]] with a path)"),
        ("[[ground]]\nsize = 1\ntexture = 'moon'",
         "unknown texture 'moon' in [[ground]] (one of plain, grass, asphalt, paving, earth)"),
        ("[[ground]]\nsize = 1\ncolour = 'red'", "'red' is not a colour (write it like \"#8a8a80\")"),
        ("[[ground]]\nsize = -1", "size and tile of [[ground]] must be positive (give metres)"),
        ("[[ground]]\nsize = 1\nat = [1, 2, 3]",
         'at needs a crs (add e.g. crs = "EPSG:6677" at the top, or use translate)'),
        ("[[source]]\npath = 'a.glb'\nscale = 2\nmatrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0]]",
         "matrix stands beside translate, rotate or scale (give one or the other)"),
        ("[[source]]\npath = 'scene.toml'", "includes itself (take it out of its own sources)"),
    ],
)  # fmt: skip
def test_mistakes(folder: Path, text: str, line: str) -> None:
    with pytest.raises(InputError) as caught:
        compose(folder, text)
    assert str(caught.value) == f"{folder}/scene.toml: {line}"


def test_text_that_is_not_toml(folder: Path) -> None:
    with pytest.raises(InputError, match=r"scene.toml: is not TOML: .*line 1.* \(mend that line\)"):
        compose(folder, "[[source]\n")


@pytest.mark.parametrize(
    ("array", "line"),
    [
        (np.zeros((3, 6)), "has the shape (3, 6) (save shape (k, 3, 4), or (k, 4), (k, 5), (k, 7) or (k, 8))"),
        (
            np.array(["a"]),
            "holds <U1, not numbers (save floats of shape (k, 3, 4), or (k, 4), (k, 5), (k, 7) or (k, 8))",
        ),
    ],
)
def test_tables_that_cannot_be_used(tmp_path: Path, array: np.ndarray, line: str) -> None:
    np.save(tmp_path / "t.npy", array)
    with pytest.raises(InputError) as caught:
        read_table(tmp_path / "t.npy")
    assert str(caught.value) == f"{tmp_path}/t.npy: {line}"


def test_the_rest_of_a_mixed_scene_is_read(folder: Path) -> None:
    scene = compose(folder, '[[source]]\npath = "a.glb"\n[[source]]\npath = "b.glb"\n')
    assert len(scene.instances.mesh) == 1
    assert scene.warnings == (f"left out: {folder}/b.glb: there is no such file (check the path)",)


def test_located_sources_share_the_lowest_origin(folder: Path) -> None:
    text = 'crs = "EPSG:6677"\n' + "".join(
        f'[[source]]\npath = "a.glb"\nat = [{x}, {y}, 12]\n' for x, y in ((-6190.5, -35325.0), (-9000.0, -30000.0))
    )
    scene = compose(folder, text)
    assert scene.crs == "EPSG:6677"
    assert scene.origin == (-9216, -35840, 0)
    np.testing.assert_allclose(scene.instances.transform[0, :, 3], [3025.5, 515, 12])
    np.testing.assert_allclose(scene.instances.transform[1, :, 3], [216, 5840, 12])
    fixed = compose(folder, "origin = [-10240, -40960, 0]\n" + text)
    np.testing.assert_allclose(fixed.instances.transform[0, :, 3], [4049.5, 5635, 12])


def test_absurd_placements_are_left_out(folder: Path) -> None:
    table = np.zeros((6, 4))
    table[4], table[5] = [np.nan, 0, 0, 0], [3e7, 0, 0, 0]
    np.save(folder / "t.npy", table)
    scene = compose(folder, '[[source]]\npath = "a.glb"\ninstances = "t.npy"\n')
    assert len(scene.instances.mesh) == 4
    assert scene.warnings == (
        f"{folder}/a.glb: left out 2 placements that are NaN, infinite or more than 10,000 km from the rest",
    )


def test_no_source_at_all() -> None:
    with pytest.raises(OptionError, match="no source is given"):
        read_scene([])


@pytest.mark.parametrize("pattern", PATTERNS)
def test_ground_repeats_without_a_seam_in_its_own_colour(pattern: str) -> None:
    pixels = ground_texture(pattern).pixels.astype(float)[..., :3]
    np.testing.assert_allclose(pixels.mean((0, 1)), PATTERNS[pattern].color, atol=4)
    if not PATTERNS[pattern].slabs and pattern != "plain":
        inner = np.abs(np.diff(pixels, axis=0)).mean()
        assert np.abs(pixels[0] - pixels[-1]).mean() < 1.3 * inner
