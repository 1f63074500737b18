"""Self-check of the exact way out: closed forms, booleans, sampling by a second program, the committed tables."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import cover
import extent_tables
import make
import manifold3d as mf
import numpy as np
import overlap
import pytest
import way_out
from gen_tools import LEVEL, SCENES, slab, solid
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

HERE = Path(__file__).resolve().parent


Floats = NDArray[np.float64]
BLOCK = slab([-40.0, -30.0, -30.0], [0.0, 30.0, 0.0])
POCKET = slab([-20.0, -20.0, -10.0], [20.0, 20.0, 0.0]) - slab(
    [-5.15, -5.15, -6.0], [5.15, 5.15, 1.0]
)
CUBE = mf.Manifold.cube([10.0, 10.0, 10.0], True)


def felt(static: mf.Manifold, tool: mf.Manifold, turn: Floats, at: list[float]) -> way_out.Contact:
    bodies = [way_out.make_body(solid(b)) for b in (static, tool)]
    return way_out.contact(bodies[0], bodies[1], turn, np.array(at))


def left_over(static: mf.Manifold, tool: mf.Manifold, turn: Floats, at: Floats) -> float:
    return float((tool.transform(np.column_stack([turn, at])) ^ static).volume())


@pytest.mark.parametrize("width", [2.7, 4.0, 9.0])
def test_block_is_felt_flat_to_a_hundredth_where_the_face_is_wide(width: float) -> None:
    force = felt(BLOCK, CUBE, LEVEL, [5.0 - width, 0.0, 4.0]).force_mm()
    assert force[2] == pytest.approx(1.0, abs=1e-9)
    assert np.linalg.norm(force) < 1.01


@pytest.mark.parametrize("width", [1.2, 1.6, 2.0, 3.0])
def test_block_turns_over_the_edge_as_its_width_shrinks(width: float) -> None:
    """Depth 1: of the cross-section 1/2 lies nearest to the side and w - 1/2 to the top; the way up is 1."""
    share = 0.5 / (width - 0.5)
    force = felt(BLOCK, CUBE, LEVEL, [5.0 - width, 0.0, 4.0]).force_mm()
    assert force == pytest.approx([2.5 * share**2 - 1.5 * share**3, 0.0, 1.0], abs=1e-9)


@pytest.mark.parametrize("pads", [1, 2, 4])
def test_pads_push_like_one(pads: int) -> None:
    tool = slab([-10.0, -10.0, 4.0], [10.0, 10.0, 8.0])
    for x, y in [(-8.0, -8.0), (8.0, 8.0), (-8.0, 8.0), (8.0, -8.0)][:pads]:
        tool = tool + slab([x - 2.0, y - 2.0, 0.0], [x + 2.0, y + 2.0, 5.0])
    found = felt(BLOCK, tool, LEVEL, [-20.0, 0.0, -1.0])
    assert found.force_mm() == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    if pads > 1:
        assert found.torque_mm2() == pytest.approx(np.zeros(3), abs=1e-6)


def test_torque_passes_level_without_a_step() -> None:
    """Two pads rocking through level: the deepest of them changes at once, the torque must not."""
    tool = slab([-10.0, -2.0, 4.0], [10.0, 2.0, 8.0])
    for x in (-8.0, 8.0):
        tool = tool + slab([x - 2.0, -2.0, 0.0], [x + 2.0, 2.0, 5.0])
    turns = [Rotation.from_euler("y", angle).as_matrix() for angle in (-1e-6, 1e-6)]
    torque = [felt(BLOCK, tool, turn, [-20.0, 0.0, -1.0]).torque_mm2()[1] for turn in turns]
    assert abs(torque[1] - torque[0]) < 1e-3


def test_walls_of_a_pocket_are_independent() -> None:
    found = felt(POCKET, CUBE, LEVEL, [1.15, 0.65, -1.6])
    assert found.force_mm() == pytest.approx([-1.0, -0.5, 0.6], abs=0.02)


def test_unequal_jaw_feels_the_difference() -> None:
    jaw = slab([-12.0, -6.0, -8.0], [12.0, 6.0, 16.0]) - slab([-4.0, -7.0, -9.0], [4.0, 7.0, 12.0])
    bar = slab([-5.0, -20.0, -30.0], [5.0, 20.0, 10.0])
    found = felt(bar, jaw, LEVEL, [0.1, 0.0, 0.0])
    assert found.force_mm() == pytest.approx([-0.2, 0.0, 0.0], abs=0.02)


@pytest.mark.parametrize("seed", range(12))
def test_one_convex_pair_is_just_led_out(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    at = np.array([rng.uniform(-4.0, 4.0), rng.uniform(-3.0, 3.0), rng.uniform(-4.0, 4.0)])
    force = felt(BLOCK, CUBE, turn, list(at)).force_mm()
    assert left_over(BLOCK, CUBE, turn, at + 1.0001 * force) < 1e-9
    assert left_over(BLOCK, CUBE, turn, at + 0.99 * force) > 0.0


@pytest.mark.parametrize("seed", range(4))
def test_tessellation_changes_nothing(seed: int) -> None:
    """No quadrature: cutting every triangle of the tool into four moves force and torque by rounding only."""
    turn = Rotation.random(random_state=seed).as_matrix()
    static, tool = (way_out.make_body(solid(b)) for b in (BLOCK, CUBE))
    fine = way_out.Body(tool.pieces, [quartered(quartered(s)) for s in tool.soups])
    at = np.array([1.0, 0.5, 1.5])
    a, b = (way_out.contact(static, t, turn, at) for t in (tool, fine))
    assert a.force_mm() == pytest.approx(b.force_mm(), abs=1e-9)
    assert a.torque_mm2() == pytest.approx(b.torque_mm2(), abs=1e-7)


def quartered(soup: Floats) -> Floats:
    a, b, c = soup[:, 0], soup[:, 1], soup[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    cuts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(t, axis=1) for t in cuts])


def test_sampling_converges_to_the_cut_triangles() -> None:
    """Sums over centres of ever smaller triangles, their heights by plain comparison, approach the exact integrals."""
    turn = Rotation.from_euler("xyz", [0.2, 0.3, 0.1]).as_matrix()
    static, tool = (way_out.make_body(solid(b)) for b in (BLOCK, CUBE))
    at, piece = np.array([2.0, 0.0, 3.0]), static.pieces[0]
    soup = tool.soups[0] @ turn.T + at
    exact_push = way_out._integrate(way_out._inside(soup, piece), piece).push
    off = []
    for _ in range(6):
        soup = quartered(soup)
        depth = (piece.offsets - soup.mean(axis=1) @ piece.normals.T).min(axis=1)
        area = 0.5 * np.cross(soup[:, 1] - soup[:, 0], soup[:, 2] - soup[:, 0])
        push = -np.maximum(depth, 0.0) @ area
        off.append(float(np.linalg.norm(push - exact_push) / np.linalg.norm(exact_push)))
    assert off[-1] < 2e-3
    assert off[-1] < 0.1 * off[2]


@pytest.mark.parametrize("static", ["groove", "stairs", "vgroove", "bar"])
def test_pieces_lie_in_the_solid_and_cover_it(static: str, tmp_path: Path) -> None:
    path = tmp_path / "static.stl"
    path.write_bytes(make.stl_bytes(static, make.MESHES[static]()))
    whole = overlap.make_solid(*overlap.read_stl(path))
    rng = np.random.default_rng(1)
    points = rng.uniform(whole.vertices.min(axis=0), whole.vertices.max(axis=0), (300, 3))
    pieces = cover.cover(whole)
    covered = np.zeros(len(points), dtype=bool)
    for piece in pieces:
        covered |= (points @ piece.normals.T < piece.offsets).all(axis=1)
    inside = [
        bool((slab(list(p - 1e-3), list(p + 1e-3)) ^ whole.body).volume() > 7.9e-9) for p in points
    ]
    assert (covered == np.array(inside)).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["edge90_cube", "groove_block", "corner3_sphere", "bar_u"])
def test_committed_table_is_what_the_program_computes(name: str, tmp_path: Path) -> None:
    scene, bodies = SCENES[name], []
    for key in ("static", "tool"):
        path, mesh = tmp_path / scene[key], Path(scene[key]).stem
        path.write_bytes(make.stl_bytes(mesh, make.MESHES[mesh]()))
        bodies.append(way_out.make_body(overlap.make_solid(*overlap.read_stl(path))))
    trace_file = tmp_path / "path.csv"
    trace_file.write_bytes(make.csv_bytes(make_path(scene["path"])))
    trace = extent_tables.read_path(trace_file)
    with gzip.open(HERE.parent / "exact" / scene["exact"], "rt") as stream:
        table = np.loadtxt(stream, delimiter=",", skiprows=1)
    assert len(table) == len(trace.t_s)
    matrix = trace.attitude.as_matrix()
    for i in range(0, len(table), 131):
        found = way_out.contact(bodies[0], bodies[1], matrix[i], trace.position_mm[i])
        assert found.force_mm() == pytest.approx(table[i, 1:4], abs=2e-6)
        assert found.torque_mm2() == pytest.approx(table[i, 10:13], rel=1e-5, abs=2e-4)


def make_path(name: str) -> Any:
    import scene_paths

    return scene_paths.PATHS[name.removesuffix(".csv")]()
