"""A flat tool on many things that stand on one floor: pads, ribs, uneven ones. It pushes as deep as it is."""

from __future__ import annotations

from itertools import product

import crease
import manifold3d
import numpy as np
import pytest
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
