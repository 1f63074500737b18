"""What a recording is refused for, and what the line says that it is for."""

from __future__ import annotations

from pathlib import Path

import pytest
from host_tools import Run


@pytest.fixture(scope="module")
def run_crr(
    tmp_path_factory: pytest.TempPathFactory, scene_crs: Path, press_csv: Path, crease: Run
) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.crr"
    table = path.with_name("loop.csv")
    said = crease("hil", scene_crs, "--operator", press_csv, "-o", path, "--table", table)
    assert path.exists(), said.err
    return path


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--stiffness", "500"),
        ("--damping", "1"),
        ("--response", "extent"),
        ("--coverage", "hard"),
        ("--lookups", "40"),
        ("--force-max", "5"),
        ("--skips", "none"),
        ("--repeat", "2"),
    ],
)
def test_replay_of_a_recording_refuses_what_the_recording_has_itself(
    tmp_path: Path, scene_crs: Path, run_crr: Path, crease: Run, option: str, value: str
) -> None:
    said = crease("replay", scene_crs, run_crr, "-o", tmp_path / "a.csv", option, value)
    assert said.status == 2
    assert said.err.startswith(f"error: {option}: {run_crr} is a recording, which runs again with")
    assert said.err.count("\n") == 1
    assert not (tmp_path / "a.csv").exists()


def test_view_says_what_a_recording_is_for(
    tmp_path: Path, scene_crs: Path, run_crr: Path, crease: Run
) -> None:
    page = ("-o", tmp_path / "a.html")
    for words in ((run_crr,), (scene_crs, run_crr), (run_crr, "--scene", scene_crs)):
        said = crease("view", *words, *page)
        assert said.status == 2
        assert said.err.startswith(f"error: {run_crr}: is a recording of the loop, which a page")
        assert "`crease plot`" in said.err
        assert said.err.count("\n") == 1


def test_view_says_what_a_table_of_a_loop_is_for(
    tmp_path: Path, scene_crs: Path, run_crr: Path, crease: Run
) -> None:
    table = run_crr.with_name("loop.csv")
    said = crease("view", scene_crs, table, "-o", tmp_path / "a.html")
    assert said.status == 1
    assert "is of a loop" in said.err
    assert "`crease plot`" in said.err


def test_a_recording_in_place_of_a_path_is_told_what_makes_a_table_of_it(
    tmp_path: Path, scene_crs: Path, run_crr: Path, crease: Run
) -> None:
    said = crease("hil", scene_crs, "--operator", run_crr, "-o", tmp_path / "b.crr")
    assert said.status == 1
    assert (
        f"{run_crr}: is a recording of the loop, no path and no table; `crease replay" in said.err
    )
