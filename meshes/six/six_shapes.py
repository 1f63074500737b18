"""Closed solids of the benchmark, in mm. A tool's origin is where it is gripped; a static solid's top is at z = 0."""

from __future__ import annotations

from collections.abc import Sequence

import manifold3d as mf
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SIDES = 96
"""Of round pegs and holes: a peg's flats lie 0.005 mm inside its circle, those of a hole touch it from outside."""
PEG_MM, GRIP_MM, LEAD_MM = 10.0, 40.0, 2.0
"""Radius of the peg, height of its grip above the tip, chamfers of peg and hole."""
KEY_MM, KEY_LEAD_MM = 5.0, 1.0
"""Half the side of the key, and its chamfers."""
RUNGS = 6
GEAR_TEETH, GEAR_MODULE_MM, GEAR_PRESSURE_DEG = 12, 4.0, 20.0


def box(lo: Sequence[float], hi: Sequence[float]) -> mf.Manifold:
    """Axis-aligned box."""
    return mf.Manifold.cube([float(b - a) for a, b in zip(lo, hi, strict=True)]).translate(list(lo))


def hull(*rings: Floats) -> mf.Manifold:
    """Convex hull of points (n, 3)."""
    return mf.Manifold.hull_points(np.concatenate(rings).tolist())


def ring(radius_mm: float, z: float, sides: int = SIDES) -> Floats:
    """Vertices of a regular polygon on a circle, (sides, 3)."""
    a = 2.0 * np.pi * np.arange(sides) / sides
    return np.column_stack([radius_mm * np.cos(a), radius_mm * np.sin(a), np.full(sides, z)])


def square(half_mm: float, z: float) -> Floats:
    """Corners of a square, (4, 3)."""
    return np.array([[x, y, z] for x in (-half_mm, half_mm) for y in (-half_mm, half_mm)])


def peg() -> mf.Manifold:
    """Vertices on circles of 10 mm radius; tip at z = -40, 50 mm long, a chamfer of 2 mm at its tip."""
    low = -GRIP_MM
    return hull(ring(PEG_MM - LEAD_MM, low), ring(PEG_MM, low + LEAD_MM), ring(PEG_MM, 10.0))


def hole(play_mm: float) -> mf.Manifold:
    """Block 50 x 50 x 30, a through hole whose flats touch a circle play_mm wider than the peg's; chamfered by 2 mm."""
    radius = (PEG_MM + 0.5 * play_mm) / np.cos(np.pi / SIDES)
    drill = hull(ring(radius, -40.0), ring(radius, 1.0))
    lead = hull(ring(radius, -LEAD_MM), ring(radius + LEAD_MM + 1.0, 1.0))
    return box((-25, -25, -30), (25, 25, 0)) - drill - lead


def key() -> mf.Manifold:
    """Square bar of 10 mm; tip at z = -30, 40 mm long, a chamfer of 1 mm at its tip."""
    return hull(
        square(KEY_MM - KEY_LEAD_MM, -30.0),
        square(KEY_MM, -30.0 + KEY_LEAD_MM),
        square(KEY_MM, 10.0),
    )


def slot(play_mm: float) -> mf.Manifold:
    """Block 40 x 40 x 30 with a square hole, 25 mm deep, play_mm wider than the key; chamfered by 1 mm."""
    half = KEY_MM + 0.5 * play_mm
    lead = hull(square(half, -KEY_LEAD_MM), square(half + KEY_LEAD_MM + 1.0, 1.0))
    return box((-20, -20, -30), (20, 20, 0)) - box((-half, -half, -25), (half, half, 1)) - lead


def hexagon() -> mf.Manifold:
    """19 mm across flats (y = +-9.5), 12 mm high about z = 0."""
    return hull(ring(19.0 / np.sqrt(3.0), -6.0, 6), ring(19.0 / np.sqrt(3.0), 6.0, 6))


def prism(outline: Sequence[tuple[float, float]], z0: float, z1: float) -> mf.Manifold:
    """An outline in x and y, from z0 to z1."""
    made = mf.CrossSection([np.array(outline)], mf.FillRule.NonZero)
    if made.area() <= 0.0:
        made = mf.CrossSection([np.array(outline)[::-1]])
    return made.extrude(z1 - z0).translate([0.0, 0.0, z0])


def spanner() -> mf.Manifold:
    """Gap of 19.4 mm about the origin, open towards +x, handle 60 mm towards -x, 6 mm thick."""
    half = [(-12.0, 9.7), (12.0, 9.7), (12.0, 17.0), (-18.0, 17.0), (-24.0, 6.0), (-60.0, 6.0)]
    return prism([*half, *((x, -y) for x, y in reversed(half))], -3.0, 3.0)


def cylinder() -> mf.Manifold:
    """R 10 mm, 60 mm long, about the y axis; chords of 2 degrees, at most 0.0015 mm inside."""
    return hull(ring(10.0, -30.0, 180), ring(10.0, 30.0, 180)).rotate([90.0, 0.0, 0.0])


def cube(half_mm: float = 10.0) -> mf.Manifold:
    """About the origin."""
    return box((-half_mm,) * 3, (half_mm,) * 3)


def plate(thick_mm: float) -> mf.Manifold:
    """60 x 60 mm, top at z = 0."""
    return box((-30, -30, -thick_mm), (30, 30, 0))


def needle() -> mf.Manifold:
    """Sixteen-sided cone, its tip at the origin, 30 mm high, R 4 mm at its end."""
    return hull(np.zeros((1, 3)), ring(4.0, 30.0, 16))


def stick() -> mf.Manifold:
    """From x = -40 to 20, 2 mm wide and high; its lowest edge is the x axis."""
    across = np.array([[0.0, 0.0, 0.0], [0.0, -1.0, 2.0], [0.0, 1.0, 2.0]])
    ahead = np.array([1.0, 0.0, 0.0])
    return hull(across - 40.0 * ahead, across + 20.0 * ahead)


def bar() -> mf.Manifold:
    """20 mm wide in x, 80 mm in y, top at z = 0, 40 mm high."""
    return box((-10, -40, -40), (10, 40, 0))


def jaw() -> mf.Manifold:
    """Fork open towards -z: gap 20.2 mm wide, up to z = 0, prongs 10 mm thick and 15 mm long, 20 mm wide in y."""
    return box((-20.1, -10, -15), (20.1, 10, 10)) - box((-10.1, -11, -16), (10.1, 11, 0))


def ball() -> mf.Manifold:
    """R 10 mm about the origin, on a stem R 3 mm up to z = 30."""
    return mf.Manifold.sphere(10.0, SIDES) + hull(ring(3.0, 5.0, 24), ring(3.0, 30.0, 24))


def socket() -> mf.Manifold:
    """Block with a hollow R 10.1 mm about the origin, open above z = 4: the ball does not come out."""
    return box((-15, -15, -15), (15, 15, 4)) - mf.Manifold.sphere(10.1, SIDES)


def gear_outline() -> list[tuple[float, float]]:
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
    out: list[tuple[float, float]] = []
    for k in range(GEAR_TEETH):
        angle = 2.0 * np.pi * k / GEAR_TEETH - psi
        out += list(zip((r * np.cos(angle)).tolist(), (r * np.sin(angle)).tolist(), strict=True))
    return out


def gear(turn_deg: float) -> mf.Manifold:
    """The gear, 10 mm wide about z = 0."""
    return prism(gear_outline(), -5.0, 5.0).rotate([0.0, 0.0, turn_deg])


def book() -> mf.Manifold:
    """60 x 40 x 12 mm about the origin."""
    return box((-30, -20, -6), (30, 20, 6))


def table(slope_deg: float = 0.0) -> mf.Manifold:
    """160 x 120 x 20 mm, top at z = 0, turned about the y axis by slope_deg."""
    return box((-80, -60, -20), (80, 60, 0)).rotate([0.0, slope_deg, 0.0])


def corner() -> mf.Manifold:
    """Three walls x = 0, y = 0, z = 0, 40 mm wide, 20 mm thick."""
    return box((-20,) * 3, (40,) * 3) - box((0,) * 3, (50,) * 3)


def ladder() -> mf.Manifold:
    """Six square pegs of 6 mm, 15 mm apart in x, their ends at z = -14, on a bar above z = 0."""
    made = box((-44, -5, 0), (44, 5, 8))
    for i in range(RUNGS):
        x = 15.0 * (i - 2.5)
        made += box((x - 3, -3, -14), (x + 3, 3, 1))
    return made


def rack() -> mf.Manifold:
    """Block with six square holes of 6.2 mm, 10 mm deep, chamfered by 0.5 mm."""
    made = box((-50, -12, -20), (50, 12, 0))
    for i in range(RUNGS):
        at = [15.0 * (i - 2.5), 0.0, 0.0]
        lead = hull(square(3.1, -0.5), square(4.1, 0.5)).translate(at)
        made -= box((-3.1, -3.1, -10), (3.1, 3.1, 1)).translate(at) + lead
    return made
