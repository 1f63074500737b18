"""The time that a bake is foreseen to take, by work counted: no clock is held to anything here."""

from __future__ import annotations

import math

import pytest
import trimesh
from crease.bake.bake import BakeOptions, bake_scene
from crease.base.progress import Forecast
from crease.mesh.mesh import Mesh, make_mesh

OPTIONS = BakeOptions(voxel_m=2e-3, spacing_m=2e-3)


def mesh_of(shape: trimesh.Trimesh) -> Mesh:
    return make_mesh(shape.vertices, shape.faces, 1e-3, source="shape", digest_sha256="0" * 64)


def box(side_mm: float, pieces: int = 1) -> trimesh.Trimesh:
    shape = trimesh.creation.box(extents=(side_mm,) * 3)
    for _ in range(pieces - 1):
        shape = shape.subdivide()
    return shape


SHAPES = {
    "box": lambda: box(40.0),
    "box of many triangles": lambda: box(40.0, 5),
    "ball": lambda: trimesh.creation.icosphere(subdivisions=4, radius=20.0),
    "pipe": lambda: trimesh.creation.annulus(r_min=12.0, r_max=18.0, height=30.0, sections=48),
    "thin plate": lambda: trimesh.creation.box(extents=(60.0, 40.0, 1.3)),
    "cone": lambda: trimesh.creation.cone(radius=15.0, height=40.0, sections=24),
    "ring": lambda: trimesh.creation.torus(major_radius=20.0, minor_radius=6.0),
}


class Counted(Forecast):
    """A forecast by weights alone, with what was foreseen and what was counted, in work."""

    def __init__(self) -> None:
        self.parts: list[float] = []
        super().__init__(lambda _name, part, _left_s: self.parts.append(part), clock=lambda: 0.0)
        self.foreseen: dict[str, tuple[float, float]] = {}
        self.counted: dict[str, float] = {}

    def foresee(self, name: str, units: float, unit_s: float) -> None:
        self.foreseen[name] = units, unit_s
        super().foresee(name, units, unit_s)

    def begin(self, name: str, units: float | None = None) -> None:
        super().begin(name, units)
        self.counted[name] = self.foreseen[name][0] if units is None else units


@pytest.mark.parametrize("shape", SHAPES)
def test_the_work_foreseen_is_that_counted_within_a_factor_of_two(shape: str) -> None:
    work = Counted()
    bake_scene(mesh_of(SHAPES[shape]()), mesh_of(box(10.0)), OPTIONS, work)
    work.end()
    assert set(work.counted) >= {"shell", "distances", "creases", "checking", "measuring"}
    before = {name: units * unit_s for name, (units, unit_s) in work.foreseen.items()}
    after = {name: units * work.foreseen[name][1] for name, units in work.counted.items()}
    whole = sum(after.values())
    assert 0.5 < sum(before.values()) / whole < 2.0
    for name, counted in after.items():
        if counted > 0.1 * whole:
            assert 0.5 < before[name] / counted < 2.0, f"{name}: {before[name]} of {counted}"


def test_samples_of_a_shell_are_those_foreseen() -> None:
    work = Counted()
    result = bake_scene(mesh_of(box(40.0)), mesh_of(box(10.0)), OPTIONS, work)
    points = result.report["points"]
    assert isinstance(points, int)
    assert 0.5 < work.foreseen["shell"][0] / points < 2.0


@pytest.mark.parametrize("shape", ["pipe", "ball"])
def test_progress_never_falls_and_ends_at_one(shape: str) -> None:
    told: list[tuple[str, float]] = []
    meshes = mesh_of(SHAPES[shape]()), mesh_of(box(10.0))
    heard = bake_scene(*meshes, OPTIONS, lambda name, part: told.append((name, part)))
    parts = [part for _, part in told]
    assert parts == sorted(parts)
    assert parts[0] == 0.0
    assert parts[-1] == 1.0
    assert len(set(parts)) > 5
    # Looking ahead changes nothing of what is made.
    assert heard.image == bake_scene(*meshes, OPTIONS).image


def test_voxels_tried_again_are_foreseen_again() -> None:
    mesh, parts = mesh_of(SHAPES["pipe"]()), []
    room = len(bake_scene(mesh, mesh_of(box(10.0)), OPTIONS).image) // 2
    options = BakeOptions(voxel_m=2e-3, spacing_m=2e-3, image_max_bytes=room)
    bake_scene(mesh, mesh_of(box(10.0)), options, lambda _name, part: parts.append(part))
    assert parts == sorted(parts)
    assert parts[-1] == 1.0


def test_nobody_listening_costs_no_look_ahead() -> None:
    names: list[str] = []

    def tell(name: str, _part: float, _left_s: float) -> None:
        names.append(name)

    meshes = mesh_of(box(20.0)), mesh_of(box(10.0))
    bake_scene(*meshes, OPTIONS, Forecast(tell, heard=False))
    assert "surveying" not in names
    bake_scene(*meshes, OPTIONS, Forecast(tell))
    assert "surveying" in names


def test_a_machine_a_quarter_as_fast_is_found_out() -> None:
    # 10 s of work by the weights take 40 s: after the first stage what is left is told by that pace.
    now_s, told = 0.0, [math.inf]
    work = Forecast(lambda _name, _part, left_s: told.append(left_s), clock=lambda: now_s)
    work.prepare("reading", 1.0)
    assert told[-1] == math.inf
    for name, units in (("first", 2), ("second", 6), ("third", 2)):
        work.foresee(name, units, 1.0)
    work.complete()
    assert work.left_s() == pytest.approx(10.0)
    for name, units in (("first", 2), ("second", 6), ("third", 2)):
        work.begin(name)
        for done in range(1, 11):
            now_s += 4.0 * units / 10
            work.tick(done / 10)
            if now_s >= 8.0:
                assert told[-1] == pytest.approx(40.0 - now_s, rel=0.3)
    work.end()
    assert told[-1] == 0.0


def test_counts_that_prove_wrong_are_put_right() -> None:
    told: list[tuple[float, ...]] = []
    work = Forecast(lambda _name, part, left_s: told.append((part, left_s)), clock=lambda: 0.0)
    work.foresee("first", 1, 1.0)
    work.foresee("second", 1, 1.0)
    work.complete()
    work.begin("first")
    work.begin("second", 9)
    # Nothing took any time yet: the pace is that of the prior half second over it and the second done.
    assert told[-1] == pytest.approx((0.1, 9 * 0.5 / 1.5))
    work.tick(5 / 9)
    assert told[-1][0] == pytest.approx(0.6)
