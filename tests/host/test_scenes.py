"""Tables of scenes: read, baked when out of date, and the demonstration on top."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from crease.bake.scene_list import load_specs
from crease.bake.scene_list import main as scenes_main
from crease.base.errors import CreaseError
from crease.draw.demo import main as demo_main

ENTRY = """
[{name}]
about = "Ball on a block."
static = "block.stl"
tool = "ball.stl"
path = "press.csv"
unit = "mm"
tool_unit = "mm"
voxel_mm = 4.0
spacing_mm = 2.5
stiffness_N_m = 500.0
"""


@pytest.fixture
def table(tmp_path: Path, block_stl: Path, ball_stl: Path, press_csv: Path) -> Path:
    """A table with the two scenes of the demonstration, both the ball on the block; meshes beside it."""
    for source in (block_stl, ball_stl, press_csv):
        (tmp_path / source.name).write_bytes(source.read_bytes())
    path = tmp_path / "scenes.toml"
    path.write_text("".join(ENTRY.format(name=name) for name in ("edge90_sphere", "edge90_cube")))
    return path


def test_lengths_of_the_table_become_metres(table: Path) -> None:
    spec = load_specs(table, table.parent)["edge90_cube"]
    assert (spec.voxel_m, spec.spacing_m) == pytest.approx((4e-3, 2.5e-3))
    assert (spec.unit_m, spec.tool_unit_m, spec.stiffness_N_m) == (1e-3, 1e-3, 500.0)
    assert spec.static == table.parent / "block.stl"
    assert spec.exact is None


@pytest.mark.parametrize("text", ["[a]\nabout = 1\n", "not toml", "a = 3\n"])
def test_bad_table_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "scenes.toml"
    path.write_text(text)
    with pytest.raises(CreaseError, match=r"scenes\.toml: cannot be read"):
        load_specs(path, tmp_path)


@pytest.mark.slow
def test_only_what_is_out_of_date_is_baked(table: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = table.parent, table.parent / "out"
    command = [str(table), str(folder), str(out), "edge90_sphere"]
    assert scenes_main(command) == 0
    assert "edge90_sphere.crs" in capsys.readouterr().out
    assert sorted(path.name for path in out.iterdir()) == [
        "edge90_sphere.crs",
        "edge90_sphere.crs.glb",
    ]
    assert scenes_main(command) == 0
    assert capsys.readouterr().out == ""
    later = (out / "edge90_sphere.crs").stat().st_mtime + 10.0
    os.utime(folder / "ball.stl", (later, later))
    assert scenes_main(command) == 0
    assert "edge90_sphere.crs" in capsys.readouterr().out


def test_unknown_scene_is_refused(table: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert scenes_main([str(table), str(table.parent), str(table.parent / "out"), "moon"]) == 1
    assert "error: " in (said := capsys.readouterr().err)
    assert "no scene moon; there are edge90_sphere, edge90_cube" in said


@pytest.mark.slow
def test_demonstration_writes_tables_and_pictures(table: Path) -> None:
    folder, images, out = table.parent, table.parent / "out", table.parent / "demo"
    assert scenes_main([str(table), str(folder), str(images)]) == 0
    assert demo_main([str(table), str(folder), str(images), str(out)]) == 0
    names = {path.name for path in out.iterdir()}
    assert names == {
        "corner.html",
        "corner.png",
        *(f"{scene}.png" for scene in ("edge90_sphere", "edge90_cube")),
        *(
            f"{scene}.{kind}.csv"
            for scene in ("edge90_sphere", "edge90_cube")
            for kind in ("way_out", "fixed45")
        ),
    }
    assert all(path.stat().st_size > 5_000 for path in out.iterdir())


def test_demonstration_without_images_is_an_error(
    table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = table.parent / "demo"
    assert demo_main([str(table), str(table.parent), str(table.parent / "none"), str(out)]) == 1
    assert capsys.readouterr().err.startswith("error: ")
