"""A flat tool on many things that stand on one floor: pads, ribs, uneven ones. It pushes as deep as it is."""

from __future__ import annotations

from itertools import product

import crease
import manifold3d
import numpy as np
import pytest
from crease.mesh.mesh import make_mesh
from test_late_pads import BASE, box, mesh_of

DEPTHS_MM = (0.01, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0)
HIGH_MM = 20.0


def pads(side: int, wide_mm: float, pitch_mm: float) -> manifold3d.Manifold:
    """A square of so many a side."""
    places = pitch_mm * (np.arange(side) - (side - 1) / 2)
    made = BASE
    for x, y in product(places, places):
        made += box(wide_mm, wide_mm, HIGH_MM, (x, y, 0.0))
    return made


def ribs(count: int, wide_mm: float, pitch_mm: float) -> manifold3d.Manifold:
    made = BASE
    for x in pitch_mm * (np.arange(count) - (count - 1) / 2):
        made += box(wide_mm, 50.0, HIGH_MM, (x, 0.0, 0.0))
    return made


STANDS = {
    "4 pads": pads(2, 5.0, 24.0),
    "9 pads": pads(3, 8.0, 14.0),
    "16 pads": pads(4, 5.0, 9.0),
    "25 pins": pads(5, 3.0, 7.0),
    "3 ribs": ribs(3, 4.0, 12.0),
    "6 ribs": ribs(6, 2.0, 8.0),
    "10 ribs": ribs(10, 2.0, 5.0),
    "uneven": BASE
    + box(8, 8, HIGH_MM, (-20, 0, 0))
    + box(8, 8, HIGH_MM - 0.5)
    + box(8, 8, HIGH_MM - 0.2, (20, 0, 0)),
}


@pytest.mark.parametrize("name", STANDS)
def test_a_flat_tool_pushes_as_deep_as_it_is(name: str) -> None:
    """As one half-space with all that stood beyond its end it pushed 0.63 of that on 16 pads, 0.35 on uneven ones, and
    nothing on ribs that it was 2 mm deep in, as deep as they are wide. Of 25 pins and their sides not all have room:
    where their tops are the smaller part they are pushed less, 13 % at 2 mm.
    """
    world = crease.World(
        crease.bake(mesh_of(STANDS[name], name), mesh_of(box(60, 40, 10), "plate")),
        stiffness=1000.0,
    )
    for deep_mm in DEPTHS_MM if name != "25 pins" else DEPTHS_MM[:-2]:
        world.reset()
        out = world.tick([4e-4, 4e-4, 1e-3 * (HIGH_MM - deep_mm), 1.0, 0.0, 0.0, 0.0])
        pushed_mm = out.force_N.astype(np.float64)
        assert abs(pushed_mm[2] - deep_mm) < 0.01 * deep_mm
        assert np.hypot(pushed_mm[0], pushed_mm[1]) < 0.005 * deep_mm


@pytest.mark.parametrize("wide_mm", [4.0, 7.0, 14.0])
def test_a_post_is_felt_deeper_than_half_its_width(wide_mm: float) -> None:
    """All samples are nearest to its sides then, and no plane that they are below leads up: only a march tells the way.

    Where no plane led out of them there was no force: 2.4 mm deep in a post of 4 it ended at once.
    """
    post = BASE + box(wide_mm, wide_mm, HIGH_MM)
    world = crease.World(
        crease.bake(mesh_of(post, "post"), mesh_of(box(60, 40, 30), "block")), stiffness=1000.0
    )
    for deep_mm in min(wide_mm, 9.0) * np.arange(
        0.05, 1.0, 0.05
    ):  # above the floor that it stands on
        world.reset()
        out = world.tick([4e-4, 4e-4, 1e-3 * (HIGH_MM - deep_mm), 1.0, 0.0, 0.0, 0.0])
        pushed_mm = out.force_N.astype(np.float64)
        assert abs(pushed_mm[2] - deep_mm) < 0.01 * deep_mm
        assert np.hypot(pushed_mm[0], pushed_mm[1]) < 0.005 * deep_mm


PROFILE_MM = [
    [-9.2, -5.5],
    [-5.9, 0.2],
    [-5.6, 1.0],
    [-5.5, 1.0],
    [-5.5, 8.0],
    [9.2, -5.5],
    [5.5, 1.0],
    [5.6, 1.0],
    [5.9, 0.2],
    [5.5, 8.0],
]
"""Across a bar with a block on it, both 20 mm long: corners at one end, then those at the other."""
BAR_TRIANGLES = (
    "2 3 1 0 1 7 1 3 6 0 11 1 1 12 2 2 12 3 0 5 10 0 8 5 0 7 8 1 6 7 5 8 15 7 6 16 7 18 8 0 10 11 1 11 12 "
    "12 13 3 11 13 12 10 17 11 11 16 13 5 15 10 7 17 18 7 16 17 8 18 15 10 15 18 10 18 17 11 17 16 4 6 3 "
    "4 3 14 4 9 6 4 19 9 9 16 6 14 3 13 4 14 19 14 13 19 9 19 16 19 13 16"
)
"""How it is cut into pieces depends on these: with others no piece of it is open to one side."""


@pytest.mark.parametrize("thick_mm", [4.0, 6.0, 10.0])
def test_a_tool_of_two_pieces_is_not_thrown_aside_in_the_middle_of_a_floor(thick_mm: float) -> None:
    """As its first samples are nearer to the other side of the floor it was pushed aside by up to 19 mm.

    What one of them was nearest to was beside nothing, and so the sum of a piece of the tool was trusted that is open
    to one side.
    """
    corners_mm = np.array([[x, *place] for x in (-10.0, 10.0) for place in PROFILE_MM])
    triangles = np.array(BAR_TRIANGLES.split(), int).reshape(-1, 3)
    tool = make_mesh(corners_mm, triangles, 1e-3, source="bar and block")
    world = crease.World(
        crease.bake(
            mesh_of(box(60, 40, thick_mm), "floor"),
            tool,
            spacing_m=0.7e-3,
            voxel_m=0.7e-3,
        ),
        stiffness=1000.0,
        force_max=1e4,
    )
    turn = (0.999982168, -0.00373420425, -0.00264034506, 0.00384024815)
    pose = np.array([0.833779e-3, 0.695939e-3, 0.0, *turn])
    for deep_mm in np.arange(0.4 * thick_mm, 0.5 * thick_mm, 0.005):
        pose[2] = 1e-3 * (thick_mm + 5.6 - deep_mm)
        world.reset()
        pushed_mm = world.tick(pose).force_N.astype(np.float64)
        assert np.hypot(pushed_mm[0], pushed_mm[1]) < 0.05 * pushed_mm[2]
