"""Hits of the tool that are passed over, since they are no deeper than what is known, on parts' paths and beside."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt
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


FOUND = {
    "hits of a zone that gave way for lack of room": (
        "part_spanner",
        (
            -0.0305582955,
            0.0261525363,
            0.0260155052,
            -0.155203015,
            0.0570110045,
            0.00128119742,
            0.986235321,
        ),
    ),
    "a lane that is near, and in no zone of its hit": (
        "bar_u",
        (
            0.000873916957,
            -0.0379255228,
            -0.00357098551,
            0.995841622,
            0.0491023697,
            0.075703375,
            0.0125470245,
        ),
    ),
    "lanes of a round surface beside the sides that its mean tells": (
        "part_spanner",
        (
            -0.028957095,
            0.0262139551,
            0.0299287625,
            0.104221024,
            0.0536921024,
            0.0878559723,
            0.98921001,
        ),
    ),
}
"""Poses at which hits were passed over that are deeper, by 30 to 270 um, while not asked for all half-spaces."""


def run(program: Path, scene: str, rows: npt.NDArray[np.float64], job: Path) -> dict[str, float]:
    """What the program says of the poses of a scene, (n, 8)."""
    image = (ROOT / f"build/scenes/{scene}.crs").read_bytes()
    job.write_bytes(path_job(image, rows.astype("<f4")))
    said = subprocess.run([program, job], capture_output=True, text=True, check=True).stdout.split()
    return {name: float(value) for name, value in zip(said[::2], said[1::2], strict=True)}


@pytest.mark.slow
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
    found = run(program, scene, np.concatenate([rows, beside]), tmp_path / "poses.job")
    assert found["hits"] > 1500, found
    assert found["deep"] > 50, found
    assert found["short_um"] <= SLACK_UM, found
    assert found["work"] < 0.05 * found["alone"], found


@pytest.mark.parametrize("why", FOUND)
def test_what_was_passed_over_once_is_measured(program: Path, why: str, tmp_path: Path) -> None:
    scene, pose = FOUND[why]
    found = run(program, scene, np.array([[*pose, 1e-3]]), tmp_path / "pose.job")
    assert found["hits"] > 0, found
    assert found["short_um"] <= SLACK_UM, found
