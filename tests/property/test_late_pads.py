"""Contacts that push the same way, and faces that end, while answers come late: pads, rims, a slot, an edge."""

from __future__ import annotations

from functools import cache

import manifold3d
import numpy as np
import numpy.typing as npt
import pytest
from crease.bake.bake import bake_scene
from crease.base.scene import Scene, open_image
from crease.mesh.mesh import Mesh, make_mesh
from crease.replay.replay import ReplayOptions, run_path
from crease.replay.trajectory import Trajectory

F64 = npt.NDArray[np.float64]
WHOLE = 1 << 20
STIFFNESS_N_M = 1000.0
TICKS = np.arange(900)
DEEP_MM = 0.5


def box(
    x: float, y: float, z: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> manifold3d.Manifold:
    """A box, mm, its lower face about `at`."""
    return manifold3d.Manifold.cube((x, y, z)).translate((at[0] - x / 2, at[1] - y / 2, at[2]))


def mesh_of(solid: manifold3d.Manifold, name: str) -> Mesh:
    made = solid.to_mesh()
    return make_mesh(
        np.asarray(made.vert_properties, np.float64)[:, :3],
        np.asarray(made.tri_verts),
        1e-3,
        source=name,
    )


BASE = box(80, 60, 10)
STATIC = {
    "one pad": BASE + box(12, 12, 20),
    "two rims": BASE + box(5, 50, 20, (-10, 0, 0)) + box(5, 50, 20, (10, 0, 0)),
    "four pads": BASE
    + box(5, 5, 20, (-12, -12, 0))
    + box(5, 5, 20, (-12, 12, 0))
    + box(5, 5, 20, (12, -12, 0))
    + box(5, 5, 20, (12, 12, 0)),
    "slot": box(80, 60, 20) - box(8, 60, 15, (0, 0, 10)),
    "edge": box(40, 60, 20, (-20, 0, 0)),
}
"""Tops at 20 mm; the edge is at x = 0."""


@cache
def scene_of(static: str) -> Scene:
    tool = box(30, 20, 10) if static in ("slot", "edge") else box(60, 40, 10)
    made = bake_scene(mesh_of(STATIC[static], static), mesh_of(tool, "tool"))
    return open_image(made.image, static)


def path(x_mm: F64, depth_mm: F64) -> Trajectory:
    """Along x, so deep below 20 mm."""
    rows = np.zeros((len(x_mm), 8))
    rows[:, 0] = 1e-3 * np.arange(len(x_mm))
    rows[:, 1], rows[:, 3], rows[:, 4] = 1e-3 * x_mm, 1e-3 * (20.0 - depth_mm), 1.0
    return Trajectory(rows, "path")


def pressed() -> Trajectory:
    """Set down slowly, and then 2.5 mm deeper at 60 mm/s, and back."""
    deep = np.interp(
        TICKS, [0, 50, 300, 342, 600, 642], [-0.2, DEEP_MM, DEEP_MM, 3.0, 3.0, DEEP_MM]
    )
    return path(np.full(len(TICKS), 0.5), deep)


def off_mm(static: str, way: Trajectory, units: int) -> F64:
    """How far late answers are off those of ticks that have all they need, at each tick."""
    force = [
        run_path(
            scene_of(static), way, ReplayOptions(stiffness_N_m=STIFFNESS_N_M, lookups_max=work)
        )["force_N"].astype(np.float64)
        for work in (WHOLE, units)
    ]
    return np.asarray(1e3 / STIFFNESS_N_M * np.linalg.norm(force[1] - force[0], axis=1))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("static", "units", "bound_mm"),
    [
        ("two rims", 128, 0.26),
        ("four pads", 128, 0.15),
        ("four pads", 40, 0.6),
        ("slot", 128, 0.05),
        ("slot", 40, 0.15),
    ],
)
def test_contacts_that_push_the_same_way_are_as_stiff_together_as_one(
    static: str, units: int, bound_mm: float
) -> None:
    """Each held for itself, and grown by all of the way: 0.33, 0.53, 4.5, 0.30 and 0.63 mm RMS. Two rims are left
    sideways when they are deep, which no plane in hand knows."""
    off = off_mm(static, pressed(), units)
    assert np.sqrt((off[300:] ** 2).mean()) < bound_mm


@pytest.mark.parametrize("static", ["two rims", "slot"])
def test_a_tool_that_slides_over_two_faces_keeps_its_force(static: str) -> None:
    """The point at which they push together lies on neither."""
    deep = np.interp(TICKS, [0, 40], [-0.2, DEEP_MM])
    slid = np.interp(TICKS, [0, 250, 310], [-3.0, -3.0, 3.0])
    for units in (40, 128):
        off = off_mm(static, path(slid, deep), units)
        assert off[200:].max() < 0.06


def test_a_contact_ends_with_its_face() -> None:
    """A block that slides over an edge at 0.6 m/s is let go: as late as its answers are, and no later."""
    deep = np.interp(TICKS, [0, 60], [-0.2, 1.0])
    slid = np.interp(TICKS, [0, 250, 300], [-4.0, -4.0, 26.0])
    off = off_mm("edge", path(slid, deep), 40)
    assert off[250:].max() < 1.3
    assert off[310:].max() == 0.0


@pytest.mark.parametrize("static", ["two rims", "four pads"])
def test_contacts_that_push_the_same_way_are_damped_as_one(static: str) -> None:
    deep = np.interp(TICKS[:100], [0, 99], [-0.2, 0.79])
    way = path(np.full(100, 0.5), deep)
    force = {}
    for name in ("one pad", static):
        for damping in (0.0, 20.0):
            options = ReplayOptions(
                stiffness_N_m=STIFFNESS_N_M, damping_Ns_m=damping, lookups_max=WHOLE
            )
            force[name, damping] = run_path(scene_of(name), way, options)["force_N"][:, 2].astype(
                np.float64
            )
    more = {name: force[name, 20.0] - force[name, 0.0] for name in ("one pad", static)}
    pressed_in = slice(40, 100)
    np.testing.assert_allclose(more["one pad"][pressed_in], 20.0 * 0.01, rtol=1e-3)
    np.testing.assert_allclose(more[static][pressed_in], 20.0 * 0.01, rtol=1e-2)
