"""The held tool's wrench beside that of least motion over the meshes themselves: no image, no samples, no planes."""

from __future__ import annotations

from pathlib import Path

import make_six
import numpy as np
import numpy.typing as npt
import pytest
import six_judge
import six_least
import six_run
import six_shapes
from crease import bake, make_mesh
from crease.replay.trajectory import Trajectory, check_rows
from scipy.spatial.transform import Rotation
from six_judge import Case, Felt, Solids

F64 = npt.NDArray[np.float64]

TICKS = {"corner": 900, "jaw": 1100, "key": 900, "ladder": 800, "spanner": 900}
OFF_MAX_MM = {
    "corner": 0.003,
    "jaw": 0.008,
    "key": 0.03,
    "ladder": 0.006,
    "spanner": 0.015,
}
"""RMS of force over the stiffness, and of torque over that and the tool's radius. A jump a tick late is most of it."""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scenes as their script writes them."""
    folder = tmp_path_factory.mktemp("least")
    for name in TICKS:
        make_six.write_scene(folder, name)
    return folder


def begin_of(path: Trajectory, ticks: int) -> Trajectory:
    """Its first ticks."""
    return check_rows(path.rows[:ticks], "path")


def coupled(case: Case, path: Trajectory, images: Path) -> Felt:
    """The coupled tick, without friction."""
    return six_run.run_coupled(case.image(images), case.springs, path)[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", list(TICKS))
def test_wrench_is_that_of_least_motion_over_the_meshes(
    name: str, data: Path, tmp_path: Path
) -> None:
    case = Case.load(data, name)
    path = begin_of(case.path, TICKS[name])
    right, unsettled = six_least.follow(case, path)
    ours = coupled(case, path, tmp_path)
    assert unsettled == 0
    assert np.abs(right.wrench[:, :3]).max() > 0.3
    assert max(six_judge.off_rms_mm(case, ours.wrench, right.wrench)) < OFF_MAX_MM[name]


def test_least_motion_answers_as_the_exact_rows_of_a_scene(data: Path) -> None:
    case = Case.load(data, "corner")
    path = begin_of(case.path, 400)
    felt, _ = six_least.follow(case, path)
    ticks, right = case.exact
    some = ticks < 400
    assert max(six_judge.off_rms_mm(case, felt.wrench[ticks[some]], right[some])) < 1e-3


@pytest.mark.slow
def test_tool_that_pegs_hold_at_their_rims_goes_in(data: Path, tmp_path: Path) -> None:
    """Walls that end where chamfers begin, and chamfers that end where walls do, hold nothing beyond that."""
    case = Case.load(data, "ladder")
    path = begin_of(six_judge.halved(case.path), 1100)
    felt = coupled(case, path, tmp_path)
    solids = Solids(case.mesh("static"), case.mesh("tool"))
    assert six_judge.felt_early_N(solids, path, felt.wrench) <= 0.0
    assert (felt.held[600:800, 2] - path.rows[600:800, 3]).max() < 0.1e-3
    assert six_judge.largest_change_N(case, felt.wrench) < 0.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lean_rad", "ways_rad"),
    [
        (0.9, np.linspace(0.0, np.pi / 4, 9)),
        (0.45, np.arange(26) * 2.0 * np.pi / 26),
    ],
    ids=["between", "tip"],
)
def test_round_edge_is_outside_between_its_samples(lean_rad: float, ways_rad: F64) -> None:
    """Edges of a peg on a table: samples lie on chords of 11 degrees, 0.046 mm inside of the edge above the chamfer.

    Of the tip's 26 some have no other of their edge in their cluster: taken as straight they were 0.029 mm inside.
    """
    table, peg = six_shapes.table(), six_shapes.peg()
    meshes = [
        make_mesh(s.to_mesh().vert_properties, s.to_mesh().tri_verts, 1e-3) for s in (table, peg)
    ]
    scene, solids = bake(*meshes, voxel_m=1e-3, spacing_m=2e-3), Solids(*meshes)
    z = np.concatenate([np.linspace(42.0, 29.5, 320), np.full(20, 29.5)])
    at_m = 1e-3 * np.column_stack([np.zeros((len(z), 2)), z])
    for way in ways_rad:
        lean = Rotation.from_rotvec(lean_rad * np.array([np.cos(way), np.sin(way), 0.0]))
        turns = Rotation.from_quat(np.tile(lean.as_quat(), (len(z), 1)))
        path = six_judge.trajectory(six_judge.poses(at_m, turns))
        felt = six_run.run_coupled(scene, (2000.0, 5.0), path)[0]
        assert felt.wrench[-1, 2] > 0.5
        assert six_judge.felt_early_N(solids, path, felt.wrench) < 0.02
        assert solids.depth_mm(felt.held[-1]) < 0.01
