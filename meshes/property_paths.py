"""Tool paths of the scenes that `crease bench properties` judges: slow, through keys joined by straight lines.

Key tables are text: points separated by '|', each `x y z` or `x y z rx ry rz` (rotation vector), mm and degrees.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import paths
import property_shapes
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from shapely.geometry import LinearRing, Polygon

Floats = NDArray[np.float64]

STEP_MM = 0.1
"""Largest way of a tick, of any point of the tool."""
FINE_MM = 0.02


def line(text: str, step_mm: float = STEP_MM, reach_mm: float = 30.0) -> paths.Path:
    """Through the keys at constant speed; a turn counts as the way of a point `reach_mm` from the origin."""
    rows = [[float(v) for v in point.split()] for point in text.split("|")]
    keys = np.array([row + [0.0] * (6 - len(row)) for row in rows])
    return through(keys[:, :3], keys[:, 3:], step_mm, reach_mm)


def through(
    position_mm: Floats, turn_deg: Floats, step_mm: float = STEP_MM, reach_mm: float = 30.0
) -> paths.Path:
    """The same for arrays (n, 3): positions and rotation vectors."""
    moved = np.linalg.norm(np.diff(position_mm, axis=0), axis=1)
    swung = reach_mm * np.radians(np.linalg.norm(np.diff(turn_deg, axis=0), axis=1))
    spent = np.concatenate([[0.0], np.cumsum(np.maximum(moved + swung, 1e-9))])
    at = np.linspace(0.0, spent[-1], int(np.ceil(spent[-1] / step_mm)) + 1)
    position, turn = (
        np.column_stack([np.interp(at, spent, v[:, k]) for k in range(3)])
        for v in (position_mm, turn_deg)
    )
    return position, Rotation.from_rotvec(np.radians(turn))


def inverse(path: paths.Path) -> paths.Path:
    """The same motion seen from the tool: obstacle and tool have changed places."""
    position, attitude = path
    back = attitude.inv()
    return -back.apply(position), back


def over_edge(turn_deg: float, depth_mm: float) -> paths.Path:
    """The 60 x 40 x 20 mm block over the table's edge, its lowest corner `depth_mm` below the table's top."""
    turn = turn_deg * np.array([0.3, 1.0, 0.2]) / np.linalg.norm([0.3, 1.0, 0.2])
    vertices = property_shapes.MESHES["block60"]()[0]
    low = float(Rotation.from_rotvec(np.radians(turn)).apply(vertices)[:, 2].min())
    z, free = -low - depth_mm, -low + 0.5
    way = np.array([[-45, 0, free], [-45, 0, z], [35, 0, z], [35, 0, free]], float)
    return through(way, np.tile(turn, (4, 1)))


def gear_tip() -> paths.Path:
    """Ball R 2.5 mm round two teeth, 0.6 mm deep: along the offset of the outline."""
    outline = Polygon(property_shapes.gear_outline()).buffer(2.5 - 0.6, quad_segs=32).exterior
    ring = np.asarray(LinearRing(outline).coords)
    angle = np.degrees(np.arctan2(ring[:, 1], ring[:, 0]))
    order = np.argsort(angle)
    # The offset is a function of the angle but at the roots, where it doubles back by little.
    start = int(order[np.searchsorted(angle[order], -32.0)])
    ring = np.roll(ring[:-1], -start, axis=0)
    if np.arctan2(ring[5, 1], ring[5, 0]) < np.arctan2(ring[0, 1], ring[0, 0]):
        ring = np.roll(ring[::-1], 1, axis=0)
    swept = np.unwrap(np.arctan2(ring[:, 1], ring[:, 0]))
    ring = ring[: int(np.argmax(swept > np.radians(32.0)))]
    free = [ring[0] * 1.08, *ring, ring[-1] * 1.08]
    way = np.column_stack([np.array(free), np.zeros(len(free))])
    return through(way, np.zeros_like(way), 0.05)


def rocking(
    radius_deg: float, axis: tuple[float, float, float], z_mm: float, free_mm: float
) -> paths.Path:
    """Down, rocked to both sides about the tool's origin, up again."""
    turns = np.outer([0, 0, 1, -1, 1, 0, 0], radius_deg * np.array(axis))
    way = np.zeros((7, 3))
    way[:, 2] = [free_mm, z_mm, z_mm, z_mm, z_mm, z_mm, free_mm]
    return through(way, turns)


RISER = "-30 0 12 | -30 0 9 | -9 0 9 | -9 0 24 | 5 0 24 | 5 0 27"
LEGS = "0 0 {top} | 0 0 {low} | {side} 0 {low} | 0 0 {low} | 0 0 {top}"
POCKET = (
    "0 0 2 {t} | 0 0 -1 {t} | 1.3 0 -1 {t} | 1.3 0.8 -1 {t} | 1.3 0.8 3 {t} | 0 0.8 3 {t} | 0 0 3 {t}"
    "| 0 0 14 {t}"
)
CORNER = "14 14 14 {t} | 13 13 9 {t} | 13 9.4 9 {t} | 9.7 9.4 9 {t} | 9.7 9.4 13 {t} | 14 14 14 {t}"
PEG = (
    "0.6 0 1 0.5 0 0 | 0.6 0 -0.5 0.5 0 0 | 0.4 0.2 -3 0.5 0 0 | 0 0.5 -8 0.5 0 0 | -0.5 0 -12 0.5 0 0"
    "| 0 -0.5 -12 0.5 0 0 | 0 0 -12 0.5 0 0 | 0 0 1 0.5 0 0"
)
SPANNER = (
    "-26 0 0 | 0 0 0 | 0 0 0 0 0 4.5 | 0 0 0 0 0 -4.5 | 0 0.5 0 0 0 -2 | 0 0.5 0 0 0 3 | 0 -0.4 0 0 0 0"
    "| 0 0 0 | -26 0 0"
)
RING = (
    "0.1 0 13 | 0.1 0 9 | 0.5 0 5 | 0 0.6 5 | 0 0 2 | 0 0 -0.6 | 0.6 0 -0.6 | 0.6 0 1 0 0.8 0"
    "| 0 0 4 0 0.8 0 | 0 0 13"
)
FORK = "-26 0 0 | 0 0 0 | 0.8 0 0 | 0.8 0.7 0 | 0 0.7 0 | 0 -0.6 0 | 0.7 -0.6 0 0 0 1 | 1 0 0 | -26 0 0"
ELL = "0 0 10.5 | 0 0 9.6 | -10.4 0 9.6 | -10.2 0 10.2 | -10.8 0 9.4 | -8 0 9.4 | -8 0 10.5"
TORUS = "30 -12 27 | 30 -12 23.6 | 30 0 23.6 | 36 8 22.3 | 30 14 23.3 | 20 18 23.8 | 20 18 27"
SEAT = property_shapes.SEAT_MM
SEATED = "0 0 {free} | 0 0 {down} | 1 0 {down} | 1 1 {aside} | 0 0 {down} | 0 0 {free}"

PATHS: dict[str, Callable[[], paths.Path]] = {
    "over_edge_1": lambda: over_edge(0.0, 1.0),
    "over_edge_10": lambda: over_edge(0.0, 10.0),
    "over_edge_1_01": lambda: over_edge(0.1, 1.0),
    "over_edge_10_01": lambda: over_edge(0.1, 10.0),
    "over_edge_1_1": lambda: over_edge(1.0, 1.0),
    "over_edge_10_1": lambda: over_edge(1.0, 10.0),
    "over_edge_1_5": lambda: over_edge(5.0, 1.0),
    "over_edge_10_5": lambda: over_edge(5.0, 10.0),
    "pads_press": lambda: line("0 0 0.3 | 0 0 -1.5 | 5 3 -1.5 | 5 3 0.3", 0.05),
    "pads_tilt": lambda: line("0 0 2 2 1 0 | 0 0 -1 2 1 0 | 0 0 -1 -1 2 0 | 0 0 2 -1 2 0", 0.05),
    "pads_off": lambda: line("-35 0 0.5 | -35 0 -1 | 25 0 -1 | 25 0 0.5"),
    "jaw": lambda: line(
        "0.1 -97 0 | 0.1 10 0 | 0.5 10 0 | -0.5 10 0 | 0.1 10 0 0.5 0 0.2 | 0.1 30 0 | 0.1 -97 0"
    ),
    "legs_ridge": lambda: line(LEGS.format(top=1.5, low=-1.0, side=2.0), 0.05),
    "legs_ridge_deep": lambda: line("0 0 8.5 | 0 0 -2 | 6 0 -2 | -6 0 0 | -6 0 15"),
    "legs_step": lambda: line(
        "0 0 13.5 | 0 0 12 | 2.8 0 12 | -2.6 0 12.2 | 0 0 12.8 | 0 0 13.5", 0.05
    ),
    "legs_floor": lambda: line(
        "0 0 1.2 | 0 0 -0.24 | 3 0 -0.24 | 3 0 -0.24 0 1 0 | 3 0 1.5 0 1 0", FINE_MM, 20.0
    ),
    "riser": lambda: line(RISER, 0.05),
    "riser_turned": lambda: line("|".join(f"{key} 2 1.5 3" for key in RISER.split("|")), 0.05),
    "pocket": lambda: line(POCKET.format(t="0 0 0"), 0.05),
    "pocket_turned": lambda: line(POCKET.format(t="0.2 0.1 0.5"), 0.05),
    "corner": lambda: line(CORNER.format(t="0 0 0"), 0.05),
    "corner_turned": lambda: line(CORNER.format(t="3 2 4"), 0.05),
    "peg": lambda: line(PEG, 0.05),
    "spanner_hexagon": lambda: line(SPANNER, 0.1),
    "plate_press": lambda: line("-30 0 10.5 | -30 0 8.6 | -10 3 8.8 | -10 3 10.5", 0.05),
    "plate_rim": lambda: line(
        "-30 0 12 2 3 5 | -30 0 9.6 2 3 5 | 8 0 9.4 2 3 5 | 12 0 8 2 3 5 | 12 0 14 2 3 5"
    ),
    "ball_torus": lambda: line(TORUS, 0.05),
    "ball_saddle": lambda: line(
        "-18 -8 24 | -18 -8 17 | 0 0 14.2 | 14 5 15.6 | 6 16 12.2 | 6 16 20", 0.05
    ),
    "ball_bowl": lambda: line("-8 0 18 | -8 0 14.6 | 0 0 14 | 6 5 14.4 | 3 9 15 | 3 9 18", 0.05),
    "ball_seat": lambda: line(
        SEATED.format(free=SEAT + 0.5, down=SEAT - 1.7, aside=SEAT - 1.0), 0.05
    ),
    "ball_countersink": lambda: line(
        "0 0 2.8 | 0 0 0.51 | 0.8 0 0.51 | 0.8 0.8 1 | 0 0 0.51 | 0 0 2.8", FINE_MM
    ),
    "gear_tip": gear_tip,
    "rock_wall": lambda: rocking(6.0, (0.3, 1.0, 0.0), 9.0, 10.5),
    "rock_edge": lambda: rocking(12.0, (0.2, 1.0, 0.1), 9.0, 10.5),
    "rock_loop": lambda: line(
        "0 0 10.5 | 0 0 9.2 | 0 0 9.2 0 4 0 | 0 0 11.5 0 4 0 | 0 0 11.5 0 -3 0 | 0 0 9.4 0 -3 0 | 0 0 9.4 | 0 0 10.5",
        0.05,
    ),
    "ring_boss": lambda: line(RING, 0.05),
    "boss_ring": lambda: inverse(line(RING, 0.05)),
    "fork_post": lambda: line(FORK, 0.05),
    "post_fork": lambda: inverse(line(FORK, 0.05)),
    "ell_edge": lambda: line(ELL, 0.05),
    "edge_ell": lambda: inverse(line(ELL, 0.05)),
    "ball_pin": lambda: line("0.4 0.3 15.3 | 0.4 0.3 9 | 0.4 0.3 15.3", 0.05),
    "ball_stump": lambda: line("0.4 0.3 15.3 | 0.4 0.3 2 | 0.4 0.3 15.3", 0.05),
    "spike": lambda: line("1.3 0.6 0.05 | 1.3 0.6 -0.4 | 4.1 2.2 -0.3 | 4.1 2.2 0.05", 0.01),
}
