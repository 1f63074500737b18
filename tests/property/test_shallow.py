"""Hits of the tool that are passed over, since they are no deeper than what is known, on parts' paths and beside."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from crease.replay.trajectory import load_trajectory
from jobs import COUPLE_C, FIRMWARE_C, ROOT, path_job, path_rows

FLAGS = ("-std=c11", "-D_POSIX_C_SOURCE=200809L", "-ffp-contract=off", "-fno-math-errno", "-O2")
SLACK_UM = 0.1
"""A way that is longer by less is as long: CR_WAY_SLACK_M."""
EVERY = 10
"""Poses of a path of which one is taken."""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """tests/check/shallow.c."""
    made = tmp_path_factory.mktemp("shallow") / "shallow"
    sources = [
        *(ROOT / f"tests/check/{part}.c" for part in ("shallow", "blob")),
        *FIRMWARE_C,
        *COUPLE_C,
    ]
    includes = [f"-I{ROOT / folder}" for folder in ("firmware", "tests/check", "tests/unit")]
    subprocess.run(["gcc", *FLAGS, *includes, *sources, "-lm", "-o", made], check=True)
    return made


@pytest.mark.parametrize(
    "scene", ["edge90_cube", "cylinder_ball", "bar_u", "part_spanner", "groove_block"]
)
def test_what_is_passed_over_is_no_deeper(program: Path, scene: str, tmp_path: Path) -> None:
    """Each lane by itself, where nothing is known yet, against all together; also a few mm and degrees beside."""
    rows = path_rows(load_trajectory(ROOT / f"build/meshes/{scene}.csv"))[::EVERY].astype(
        np.float64
    )
    beside, draw = rows.copy(), np.random.default_rng(3)
    beside[:, :3] += draw.normal(0.0, 3e-3, (len(rows), 3))
    beside[:, 3:7] += draw.normal(0.0, 0.08, (len(rows), 4))
    beside[:, 3:7] /= np.linalg.norm(beside[:, 3:7], axis=1, keepdims=True)
    image = (ROOT / f"build/scenes/{scene}.crs").read_bytes()
    job = tmp_path / "poses.job"
    job.write_bytes(path_job(image, np.concatenate([rows, beside]).astype("<f4")))
    said = subprocess.run([program, job], capture_output=True, text=True, check=True).stdout.split()
    found = {name: float(value) for name, value in zip(said[::2], said[1::2], strict=True)}
    assert found["hits"] > 1500, found
    assert found["deep"] > 50, found
    assert found["short_um"] <= SLACK_UM, found
    assert found["work"] < 0.05 * found["alone"], found
