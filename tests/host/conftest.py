"""Fixtures of the host tests: meshes made on the spot, and one small scene baked through the public API."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest
import trimesh
from crease.cli import main
from host_tools import Run, Said, write_path


@pytest.fixture(scope="session")
def crease() -> Run:
    """The command `crease` in this process: crease("info", path) -> Said."""

    def run(*args: object) -> Said:
        out, err = io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(err):
            try:
                status = main([str(arg) for arg in args])
            except SystemExit as stop:
                status = int(stop.code or 0)
        return Said(status, out.getvalue(), err.getvalue())

    return run


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("host")


@pytest.fixture(scope="session")
def block_stl(folder: Path) -> Path:
    """Block of 80 x 80 x 40 mm, its top in the plane z = 0, in mm."""
    path = folder / "block.stl"
    trimesh.creation.box(bounds=[[-40, -40, -40], [40, 40, 0]]).export(path)
    return path


@pytest.fixture(scope="session")
def ball_stl(folder: Path) -> Path:
    """Ball of radius 10 mm about the origin, in mm."""
    path = folder / "ball.stl"
    trimesh.creation.icosphere(subdivisions=4, radius=10.0).export(path)
    return path


@pytest.fixture(scope="session")
def scene_crs(folder: Path, block_stl: Path, ball_stl: Path, crease: Run) -> Path:
    """Image of the ball against the block."""
    path = folder / "scene.crs"
    said = crease("bake", block_stl, ball_stl, "-o", path, "--unit", "mm", "--spacing", "1.5mm")
    assert said.status == 0, said.err
    return path


@pytest.fixture(scope="session")
def press_csv(folder: Path) -> Path:
    """The ball comes down on the block, 2 mm deep, and slides along it."""
    down = np.linspace([0.0, 0.0, 0.012], [0.0, 0.0, 0.008], 200)
    along = np.linspace([0.0, 0.0, 0.008], [0.015, 0.005, 0.008], 200)
    return write_path(folder / "press.csv", np.concatenate([down, along]))


@pytest.fixture(scope="session")
def press_out(folder: Path, scene_crs: Path, press_csv: Path, crease: Run) -> Path:
    """The table of the press."""
    path = folder / "press_out.csv"
    said = crease("replay", scene_crs, press_csv, "-o", path)
    assert said.status == 0, said.err
    return path
