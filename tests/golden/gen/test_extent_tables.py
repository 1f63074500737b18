"""Self-check of the exact extent of the overlap: formulas, finite differences, the committed tables."""

from __future__ import annotations

import gzip
from pathlib import Path

import extent_tables
import make
import manifold3d as mf
import numpy as np
import overlap
import pytest
import scene_paths
from gen_tools import LEVEL, SCENES, slab, solid
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

HERE = Path(__file__).resolve().parent


Floats = NDArray[np.float64]
WALL = solid(slab([-150.0, -150.0, -50.0], [150.0, 150.0, 0.0]))


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Meshes and paths of the scenes that the tests below visit."""
    out = tmp_path_factory.mktemp("meshes")
    for name in (
        "block45k",
        "cube60_50",
        "cube60_2700",
        "groove",
        "groove_tool",
        "corner",
        "ball15",
        "bar",
        "u_tool",
    ):
        (out / f"{name}.stl").write_bytes(make.stl_bytes(name, make.MESHES[name]()))
    for name in ("edge90_cube", "groove_block", "corner3_sphere", "bar_u"):
        (out / f"{name}.csv").write_bytes(make.csv_bytes(scene_paths.PATHS[name]()))
    return out


def load(built: Path, name: str) -> tuple[overlap.Solid, overlap.Solid, extent_tables.Trace]:
    scene = SCENES[name]
    bodies = (overlap.make_solid(*overlap.read_stl(built / scene[k])) for k in ("static", "tool"))
    static, tool = bodies
    return static, tool, extent_tables.read_path(built / scene["path"])


@pytest.mark.parametrize("depth", [1e-3, 0.5, 3.0])
def test_ball_on_plane_has_its_geometric_depth(depth: float) -> None:
    ball = solid(mf.Manifold.sphere(15.0, 128))
    found = overlap.contact(WALL, ball, LEVEL, np.array([1.3, -2.1, 15.0 - depth]))
    assert len(found.areas) == 1
    assert found.areas[0].depth_mm == pytest.approx(depth, abs=1e-6)
    assert found.areas[0].normal == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert found.torque_mm2(np.array([1.3, -2.1, 15.0 - depth]))[2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("lean_deg", [0.0, 20.0, 45.0])
def test_cube_on_wall_has_its_geometric_depth(lean_deg: float) -> None:
    cube = solid(mf.Manifold.cube([60.0, 60.0, 60.0], True))
    turn = Rotation.from_rotvec(np.radians([lean_deg, 0.5 * lean_deg, 10.0])).as_matrix()
    lowest = float((cube.vertices @ turn.T)[:, 2].min())
    found = overlap.contact(WALL, cube, turn, np.array([3.0, 2.0, -lowest - 1.25]))
    assert found.force_mm() == pytest.approx([0.0, 0.0, 1.25], abs=1e-6)


def test_touching_and_clear_poses_have_no_force() -> None:
    cube = solid(mf.Manifold.cube([60.0, 60.0, 60.0], True))
    for height in (30.0, 31.0):
        found = overlap.contact(WALL, cube, LEVEL, np.array([0.0, 0.0, height]))
        assert not found.areas
        assert found.force_mm() == pytest.approx(np.zeros(3))


def test_concave_crease_gives_one_area_per_wall() -> None:
    bed = slab([-50.0, -50.0, -20.0], [50.0, 50.0, 0.0]) + slab(
        [20.0, -50.0, -20.0], [50.0, 50.0, 40.0]
    )
    cube = solid(mf.Manifold.cube([20.0, 20.0, 20.0], True))
    found = overlap.contact(solid(bed), cube, LEVEL, np.array([10.5, 0.0, 8.75]))
    assert len(found.areas) == 2
    assert found.force_mm() == pytest.approx([-0.5, 0.0, 1.25], abs=1e-6)


def test_convex_edge_gives_one_area_between_the_walls() -> None:
    block = solid(slab([-100.0, -100.0, -100.0], [0.0, 100.0, 0.0]))
    turn = Rotation.from_euler("y", 45.0, degrees=True).as_matrix()
    cube = solid(mf.Manifold.cube([20.0, 20.0, 20.0], True))
    root = float(np.sqrt(0.5))
    found = overlap.contact(block, cube, turn, np.array([root, 0.0, root]) * (10.0 - 2.0))
    assert len(found.areas) == 1
    assert found.force_mm() == pytest.approx([2.0 * root, 0.0, 2.0 * root], abs=1e-6)


def test_fork_on_a_bar_has_two_opposite_areas() -> None:
    bar = solid(slab([-20.0, -80.0, -15.0], [20.0, 80.0, 15.0]))
    fork = slab([-29.0, -15.0, -20.0], [29.0, 15.0, 35.0]) - slab(
        [-19.0, -20.0, -30.0], [19.0, 20.0, 25.0]
    )
    found = overlap.contact(bar, solid(fork), LEVEL, np.array([0.25, 0.0, 0.0]))
    assert sorted(a.depth_mm for a in found.areas) == pytest.approx([0.75, 1.25], abs=1e-6)
    assert found.force_mm() == pytest.approx([-1.25 + 0.75, 0.0, 0.0], abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["edge90_cube", "corner3_sphere"])
def test_normal_is_the_reversed_volume_gradient(built: Path, name: str) -> None:
    static, tool, trace = load(built, name)
    matrix = trace.attitude.as_matrix()
    for tick in np.linspace(0.2, 0.8, 5) * len(trace.t_s):
        i, step = int(tick), 1e-4
        slope = np.zeros(3)
        for axis in range(3):
            move = step * np.eye(3)[axis]
            ahead = overlap.contact(static, tool, matrix[i], trace.position_mm[i] + move).volume_mm3
            behind = overlap.contact(
                static, tool, matrix[i], trace.position_mm[i] - move
            ).volume_mm3
            slope[axis] = (ahead - behind) / (2.0 * step)
        found = overlap.contact(static, tool, matrix[i], trace.position_mm[i])
        assert len(found.areas) == 1
        assert found.imbalance < 1e-9
        assert found.areas[0].normal == pytest.approx(-slope / np.linalg.norm(slope), abs=1e-4)


def test_tessellation_of_flat_faces_does_not_matter(built: Path) -> None:
    static, fine, trace = load(built, "edge90_cube")
    coarse = overlap.make_solid(*overlap.read_stl(built / "cube60_50.stl"))
    matrix = trace.attitude.as_matrix()
    for i in range(100, len(trace.t_s), 300):
        pair = [
            overlap.contact(static, t, matrix[i], trace.position_mm[i]).force_mm()
            for t in (fine, coarse)
        ]
        assert pair[0] == pytest.approx(pair[1], abs=1e-6)


@pytest.mark.parametrize("name", ["edge90_cube", "groove_block", "corner3_sphere", "bar_u"])
def test_committed_table_is_what_the_program_computes(built: Path, name: str) -> None:
    static, tool, trace = load(built, name)
    with gzip.open(HERE.parent / "exact_extent" / SCENES[name]["exact"], "rt") as stream:
        table = np.loadtxt(stream, delimiter=",", skiprows=1)
    assert len(table) == len(trace.t_s)
    matrix = trace.attitude.as_matrix()
    for i in range(0, len(table), 97):
        found = overlap.contact(static, tool, matrix[i], trace.position_mm[i])
        row = extent_tables.row_of(found, float(trace.t_s[i]), trace.position_mm[i])
        assert row == pytest.approx(table[i], rel=1e-5, abs=2e-5)


def test_the_stylus_feels_what_a_point_feels() -> None:
    """Its tip against floor and wall, in closed form: depth below z = 0 and beyond x = 20 mm, in a convex room."""
    with gzip.open(HERE.parent / "exact_extent" / SCENES["groove_stylus"]["exact"], "rt") as stream:
        table = np.loadtxt(stream, delimiter=",", skiprows=1)
    tip, _ = scene_paths.PATHS["groove_stylus"]()
    point = np.zeros((len(tip), 3))
    point[:, 0] = np.minimum(0.0, 20.0 - tip[:, 0])
    point[:, 2] = np.maximum(0.0, -tip[:, 2])
    off = np.linalg.norm(table[:, 1:4] - point, axis=1)
    assert (np.count_nonzero(point, axis=1) == 2).sum() > 100
    # Where the tip leaves the corner a plane ends beside the cone for a few ticks, less than 0.05 mm below it.
    assert off.max() < 0.05
    assert (off > 2e-6).sum() <= 10


@pytest.mark.parametrize(
    "name", sorted({scene["path"].removesuffix(".csv") for scene in SCENES.values()})
)
def test_committed_table_starts_and_ends_in_free_space(name: str) -> None:
    with gzip.open(HERE.parent / "exact_extent" / f"{name}.csv.gz", "rt") as stream:
        table = np.loadtxt(stream, delimiter=",", skiprows=1)
    assert np.isfinite(table).all()
    assert np.diff(table[:, 0]) == pytest.approx(0.001, abs=1e-9)
    assert table[[0, -1], 4] == pytest.approx(0.0)
    assert 0.5 < table[:, 4].max() < 13.0
