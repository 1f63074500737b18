"""Closed meshes of the scenes that `crease bench properties` judges, in mm; conventions as in shapes.py."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import manifold3d as mf
import numpy as np
import shapes
from numpy.typing import NDArray
from shapely.geometry import Polygon

Floats = NDArray[np.float64]
Mesh = shapes.Mesh
Outline = list[tuple[float, float]]

ROUND = 64
"""Sides of pegs and holes: chords of 10 mm radius lie 0.012 mm inside."""
SEAT_MM = 26.4575
"""Height of a ball R 30 mm that just touches the torus R 30 mm, r 10 mm from above: sqrt(40^2 - 30^2)."""
GEAR_TEETH, GEAR_MODULE_MM, GEAR_PRESSURE_DEG = 12, 4.0, 20.0


def _solid(lo: Sequence[float], hi: Sequence[float]) -> mf.Manifold:
    """Axis-aligned box."""
    return mf.Manifold.cube([float(b - a) for a, b in zip(lo, hi, strict=True)]).translate(list(lo))


def box(lo: Sequence[float], hi: Sequence[float]) -> Mesh:
    """Axis-aligned box of twelve triangles."""
    return shapes.from_manifold(_solid(lo, hi))


def pads(lift_mm: Sequence[float], span_mm: float = 16.0) -> Mesh:
    """Plate 44 x 44 x 6 mm with 8 mm square pads below, the first at z = 0, pad i ending lift_mm[i] higher.

    One pad stands in the middle, two on a diagonal, four at the corners.
    """
    places = {
        1: [(0, 0)],
        2: [(-1, -1), (1, 1)],
        4: [(-1, -1), (1, -1), (1, 1), (-1, 1)],
    }[len(lift_mm)]
    plate = _solid((-22, -22, 8), (22, 22, 14))
    for (x, y), lift in zip(places, lift_mm, strict=True):
        centre = span_mm * x, span_mm * y
        plate += _solid((centre[0] - 4, centre[1] - 4, lift), (centre[0] + 4, centre[1] + 4, 10))
    return shapes.from_manifold(plate)


def jaw() -> Mesh:
    """Fork open towards -z with a gap of 37.8 mm; otherwise as shapes.u_tool."""
    outline = [(-29.0, -20.0), (-18.9, -20.0), (-18.9, 25.0), (18.9, 25.0), (18.9, -20.0)]
    outline += [(29.0, -20.0), (29.0, 35.0), (-29.0, 35.0)]
    return shapes.prism_y(outline, -15.0, 15.0)


def legs(length_mm: float) -> Mesh:
    """Two legs 8 mm wide, 24 mm apart, this long, below a bridge whose underside is z = 0."""
    low = -length_mm
    outline = [(-20.0, low), (-12.0, low), (-12.0, 0.0), (12.0, 0.0), (12.0, low), (20.0, low)]
    return shapes.prism_y([*outline, (20.0, 10.0), (-20.0, 10.0)], -10.0, 10.0)


def ell() -> Mesh:
    """L-shaped tool: arm with its underside at z = -10 mm, leg with its inner face at x = 10 mm."""
    outline = [
        (-30.0, -10.0),
        (10.0, -10.0),
        (10.0, -30.0),
        (30.0, -30.0),
        (30.0, 10.0),
        (-30.0, 10.0),
    ]
    return shapes.prism_y(outline, -15.0, 15.0)


def pocket() -> Mesh:
    """Block with a pocket 20.6 x 20.6 mm, 12 mm deep, its bottom at z = 0."""
    return shapes.from_manifold(
        _solid((-30, -30, -15), (30, 30, 12)) - _solid((-10.3, -10.3, 0), (10.3, 10.3, 20))
    )


def inside_corner() -> Mesh:
    """Three walls x = 0, y = 0, z = 0, each 40 mm wide and 20 mm thick."""
    return shapes.from_manifold(_solid((-20,) * 3, (40,) * 3) - _solid((0,) * 3, (50,) * 3))


def chamfered_hole() -> Mesh:
    """Block, top at z = 0, with a through hole of 20.4 mm diameter and a chamfer of 1 mm at 45 degrees."""
    drill = mf.Manifold.cylinder(40.0, 10.2, 10.2, ROUND).translate([0.0, 0.0, -35.0])
    chamfer = mf.Manifold.cylinder(2.0, 9.2, 11.2 + 0.0, ROUND).translate([0.0, 0.0, -2.0])
    return shapes.from_manifold(_solid((-25, -25, -30), (25, 25, 0)) - drill - chamfer)


def rod(radius_mm: float, z0: float, z1: float) -> Mesh:
    """Cylinder about the z axis."""
    made = mf.Manifold.cylinder(z1 - z0, radius_mm, radius_mm, ROUND).translate([0.0, 0.0, z0])
    return shapes.from_manifold(made)


def hexagon() -> Mesh:
    """Hexagon, 19 mm across flats (y = +-9.5), 12 mm high."""
    angle = np.radians(60.0 * np.arange(6))
    ring = 19.0 / np.sqrt(3.0) * np.column_stack([np.cos(angle), np.sin(angle)])
    return shapes.from_manifold(mf.CrossSection([ring]).extrude(12.0).translate([0.0, 0.0, -6.0]))


def open_spanner() -> Mesh:
    """Open spanner of 19.4 mm gap about the origin, open towards +x, handle 50 mm towards -x, 6 mm thick."""
    outline = [(12.0, 9.7), (12.0, 17.0), (-18.0, 17.0), (-24.0, 6.0), (-60.0, 6.0), (-60.0, -6.0)]
    outline += [
        (-24.0, -6.0),
        (-18.0, -17.0),
        (12.0, -17.0),
        (12.0, -9.7),
        (-12.0, -9.7),
        (-12.0, 9.7),
    ]
    made = mf.CrossSection([np.array(outline)], mf.FillRule.NonZero)
    if made.area() <= 0.0:
        made = mf.CrossSection([np.array(outline)[::-1]])
    return shapes.from_manifold(made.extrude(6.0).translate([0.0, 0.0, -3.0]))


def torus() -> Mesh:
    """Torus about the z axis, R 30 mm, r 10 mm."""
    angle = 2.0 * np.pi * np.arange(40) / 40
    ring = np.column_stack([30.0 + 10.0 * np.cos(angle), 10.0 * np.sin(angle)])
    return shapes.from_manifold(mf.CrossSection([ring]).revolve(80))


def saddle(n: int = 41) -> Mesh:
    """z = (x^2 - y^2) / 80 mm over a square of 60 mm, n by n points, on a base at z = -20 mm."""
    at = np.linspace(-30.0, 30.0, n)
    x, y = (v.ravel() for v in np.meshgrid(at, at, indexing="ij"))
    top = np.column_stack([x, y, (x * x - y * y) / 80.0])
    bottom = np.column_stack([x, y, np.full(n * n, -20.0)])
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = (
        v.ravel() for v in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    up = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    rim = np.concatenate([index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]])
    after = np.roll(rim, -1)
    sides = np.concatenate(
        [
            np.column_stack([rim, rim + n * n, after]),
            np.column_stack([after, rim + n * n, after + n * n]),
        ]
    )
    return np.concatenate([top, bottom]), np.concatenate([up, up[:, ::-1] + n * n, sides])


def bowl() -> Mesh:
    """Block with a spherical hollow R 40 mm, 8 mm deep, its bottom at z = 0."""
    ball = mf.Manifold.sphere(40.0, 128).translate([0.0, 0.0, 40.0])
    return shapes.from_manifold(_solid((-35, -35, -10), (35, 35, 8)) - ball)


def countersink() -> Mesh:
    """Block, top at z = 0, with a 90-degree countersink of 18 mm and a through hole of 6 mm."""
    cone = mf.Manifold.cylinder(10.0, 0.0, 10.0, ROUND).translate([0.0, 0.0, -9.0])
    drill = mf.Manifold.cylinder(40.0, 3.0, 3.0, ROUND).translate([0.0, 0.0, -30.0])
    return shapes.from_manifold(_solid((-25, -25, -20), (25, 25, 0)) - cone - drill)


def gear_outline() -> Outline:
    """Involute gear, counter-clockwise: module 4 mm, 12 teeth, 20 degrees; radial flanks below the base circle."""
    pressure = np.radians(GEAR_PRESSURE_DEG)
    pitch = 0.5 * GEAR_MODULE_MM * GEAR_TEETH
    base, tip, root = (
        pitch * np.cos(pressure),
        pitch + GEAR_MODULE_MM,
        pitch - 1.25 * GEAR_MODULE_MM,
    )
    radius = np.linspace(base, tip, 12)
    spread = np.sqrt((radius / base) ** 2 - 1.0)
    half = np.pi / (2 * GEAR_TEETH) + np.tan(pressure) - pressure - (spread - np.arctan(spread))
    r = np.concatenate([[root], radius, radius[::-1], [root]])
    psi = np.concatenate([[half[0]], half, -half[::-1], [-half[0]]])
    out: Outline = []
    for k in range(GEAR_TEETH):
        angle = 2.0 * np.pi * k / GEAR_TEETH - psi
        out += list(zip((r * np.cos(angle)).tolist(), (r * np.sin(angle)).tolist(), strict=True))
    return out


def gear() -> Mesh:
    """The gear, 10 mm wide about z = 0."""
    outline = np.array(gear_outline())
    assert Polygon(outline).exterior.is_ccw
    return shapes.from_manifold(
        mf.CrossSection([outline]).extrude(10.0).translate([0.0, 0.0, -5.0])
    )


def boss() -> Mesh:
    """Plate with its top at z = 0 and a boss R 10 mm, 12 mm high, on it."""
    post = mf.Manifold.cylinder(13.0, 10.0, 10.0, ROUND).translate([0.0, 0.0, -1.0])
    return shapes.from_manifold(_solid((-25, -25, -10), (25, 25, 0)) + post)


def ring() -> Mesh:
    """Ring R 10.2 to 16 mm, 8 mm high, its underside at z = 0."""
    outer = mf.Manifold.cylinder(8.0, 16.0, 16.0, ROUND)
    inner = mf.Manifold.cylinder(12.0, 10.2, 10.2, ROUND).translate([0.0, 0.0, -2.0])
    return shapes.from_manifold(outer - inner)


def fork() -> Mesh:
    """Fork open towards +x with a gap of 20.4 mm, its bottom at x = -10.2 mm, 8 mm thick."""
    outline = [
        (15.0, 10.2),
        (15.0, 18.0),
        (-20.0, 18.0),
        (-20.0, -18.0),
        (15.0, -18.0),
        (15.0, -10.2),
    ]
    outline += [(-10.2, -10.2), (-10.2, 10.2)]
    made = mf.CrossSection([np.array(outline)]).extrude(8.0).translate([0.0, 0.0, -4.0])
    return shapes.from_manifold(made)


def spike() -> Mesh:
    """Corner of a cube, pointing up, its tip at the origin."""
    reach, high = 15.0 * np.sqrt(2.0), 15.0
    angle = np.radians([20.0, 140.0, 260.0])
    foot = np.column_stack([reach * np.cos(angle), reach * np.sin(angle), np.full(3, -high)])
    return shapes.from_manifold(
        mf.Manifold.hull_points(np.vstack([[0.0, 0.0, 0.0], foot]).tolist())
    )


STEP: Outline = [
    (-60.0, -10.0),
    (60.0, -10.0),
    (60.0, 0.0),
    (10.0, 0.0),
    (10.0, 12.5),
    (-10.0, 12.5),
]
STEP += [(-10.0, 0.0), (-60.0, 0.0)]
RISER: Outline = [
    (-60.0, -20.0),
    (40.0, -20.0),
    (40.0, 15.0),
    (0.0, 15.0),
    (0.0, 0.0),
    (-60.0, 0.0),
]

MESHES: dict[str, Callable[[], Mesh]] = {
    "table": lambda: box((-85, -44, -25), (0, 44, 0)),
    "floor": lambda: box((-32, -32, -12), (32, 32, 0)),
    "floor_fine": lambda: shapes.tessellated_box(
        (-32.0, -32.0, -12.0), (32.0, 32.0, 0.0), 2000, 11
    ),
    "block60": lambda: box((-30, -20, -10), (30, 20, 10)),
    "block60_fine": lambda: shapes.tessellated_box(
        (-30.0, -20.0, -10.0), (30.0, 20.0, 10.0), 2000, 12
    ),
    "cube20_12": lambda: box((-10,) * 3, (10,) * 3),
    "pads1": lambda: pads([0.0]),
    "pads2": lambda: pads([0.0, 0.0]),
    "pads4": lambda: pads([0.0] * 4),
    "pads4_uneven": lambda: pads([0.0, 0.3, 0.6, 0.9]),
    "jaw": jaw,
    "legs1": lambda: legs(1.0),
    "legs13": lambda: legs(13.0),
    "legs20": lambda: legs(20.0),
    "ridge": lambda: shapes.wedge(90.0, 60.0),
    "step": lambda: shapes.prism_y(STEP, -20.0, 20.0),
    "riser": lambda: shapes.prism_y(RISER, -30.0, 30.0),
    "pocket": pocket,
    "pocket_tool": lambda: box((-10, -10, 0), (10, 10, 30)),
    "inside_corner": inside_corner,
    "chamfered_hole": chamfered_hole,
    "peg20": lambda: rod(10.0, 0.0, 40.0),
    "hexagon": hexagon,
    "open_spanner": open_spanner,
    "plate3": lambda: box((-60, -30, -3), (0, 30, 0)),
    "torus": torus,
    "ball15_coarse": lambda: shapes.ball(15.0, 3),
    "ball30": lambda: shapes.ball(30.0, 4),
    "ball8": lambda: shapes.ball(8.0, 3),
    "ball2_5": lambda: shapes.ball(2.5, 3),
    "saddle": saddle,
    "bowl": bowl,
    "countersink": countersink,
    "gear": gear,
    "boss": boss,
    "ring": ring,
    "post": lambda: rod(10.0, -20.0, 20.0),
    "fork": fork,
    "ell": ell,
    "pin4": lambda: box((-2, -2, -25), (2, 2, 0)),
    "stump20": lambda: box((-10, -10, -30), (10, 10, 0)),
    "spike": spike,
    "slab": lambda: box((-20, -20, 0), (20, 20, 10)),
}
