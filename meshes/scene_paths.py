"""The tool path of every test scene by name: key poses and depths; paths.py makes the curves.

Key tables are text: points separated by '|', coordinates by spaces; mm and degrees.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import paths
import shapes
import spanner_path
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

HERE = Path(__file__).resolve().parent
Floats = NDArray[np.float64]


def _keys(text: str) -> list[list[float]]:
    """Key table from text."""
    return [[float(v) for v in point.split()] for point in text.split("|")]


def _corners(lo: tuple[float, ...], hi: tuple[float, ...]) -> Floats:
    """Corners of a box, (8, 3) mm."""
    return np.array(
        [[x, y, z] for x in (lo[0], hi[0]) for y in (lo[1], hi[1]) for z in (lo[2], hi[2])]
    )


CUBE60 = _corners((-30.0,) * 3, (30.0,) * 3)
CUBE20 = _corners((-10.0,) * 3, (10.0,) * 3)


def edge90_cube() -> paths.Path:
    """The cube over the 90-degree edge of the 45,000-triangle block, at most about 5 mm deep."""
    keys: dict[str, paths.Keys] = {
        "track": _keys(
            "-62 -20 -1 | -42 -14 -1 | -20 -7 -1 | -1 0 -1 | -1 7 -20 | -1 14 -42 | -1 20 -62"
        ),
        "up": _keys("0 0 1 | 0 0 1 | 0.25 0 1 | 1 0 1 | 1 0 0.25 | 1 0 0 | 1 0 0"),
        "depth": _keys("-4 | 2.8 | 3.9 | 4.5 | 4.2 | 3 | -4"),
        "turn": _keys("8 -12 5 | 20 10 25 | -10 35 50 | 5 60 70"),
    }
    return paths.dragged(_corners((-200, -100, -100), (0, 100, 0)), CUBE60, keys)


def corner3_cube() -> paths.Path:
    """The cube over the three-face corner with generic attitude."""
    keys: dict[str, paths.Keys] = {
        "track": _keys(
            "-28 -34 -1 | -20 -22 -1 | -8 -9 -1 | -1 -1 -1 | -8 -1 -9 | -22 -1 -20 | -34 -1 -30"
        ),
        "up": _keys("0 0 1 | 0.1 0 1 | 0.5 0.3 1 | 1 1 1 | 0.4 1 0.4 | 0 1 0.1 | 0 1 0"),
        "depth": _keys("-4 | 2.5 | 3.5 | 4 | 3.5 | 2.5 | -4"),
        "turn": _keys("15 -20 10 | 25 5 30 | 0 30 45 | -20 50 60"),
    }
    return paths.dragged(_corners((-120,) * 3, (0,) * 3), CUBE60, keys)


def wedge_cube(angle_deg: float) -> paths.Path:
    """The cube from one face of a wedge over its edge to the other."""
    half = np.radians(angle_deg / 2.0)
    c, s = float(np.cos(half)), float(np.sin(half))
    down = [-55.0, -36.0, -16.0, 0.0, 16.0, 36.0, 55.0]
    drift = np.linspace(-15.0, 15.0, 7)
    rise: paths.Keys = [
        [-c, 0, s],
        [-c, 0, s],
        [-0.5 * c, 0, 1],
        [0, 0, 1],
        [0.5 * c, 0, 1],
        [c, 0, s],
        [c, 0, s],
    ]
    keys: dict[str, paths.Keys] = {
        "track": [[t * s, y, -abs(t) * c - 1.0] for t, y in zip(down, drift, strict=True)],
        "up": rise,
        "depth": _keys("-4 | 2.5 | 3.5 | 4 | 3.2 | 2.2 | -4"),
        "turn": _keys("8 -32 25 | 15 -5 35 | 12 25 45 | 8 45 55"),
    }
    return paths.dragged(np.asarray(shapes.wedge(angle_deg)[0]), CUBE60, keys)


def wall_cube() -> paths.Path:
    """The cube on a flat wall: face-on, slid, tilted onto an edge, then a vertex, lifted off."""
    keys: dict[str, paths.Keys] = {
        "track": _keys(
            "-40 -20 -1 | -40 -20 -1 | -20 -10 -1 | 0 0 -1 | 20 10 -1 | 40 10 -1 | 45 10 -1"
        ),
        "up": [[0, 0, 1]] * 7,
        "depth": _keys("-4 | 1.5 | 1.5 | 3 | 3 | 2 | -4"),
        "turn": _keys("0 0 0 | 0 0 0 | 0 0 0 | 0 20 0 | 15 25 0 | 25 20 10 | 25 20 15"),
    }
    return paths.dragged(_corners((-150, -150, -50), (150, 150, 0)), CUBE60, keys)


def bar_u() -> paths.Path:
    """The fork pushed along the bar over its lead-in; shifted, yawed, rocked, drawn back."""
    positions = _keys(
        "0 -100 0 | 0 -55 0 | 0 -20 0 | 0 5 0.5 | 0.7 20 1 | -0.6 35 0 | 0.4 25 -1 | 0.3 0 0"
        "| -0.3 -30 0.5 | 0 -60 0 | 0 -100 0"
    )
    turns = _keys(
        "0 0 0 | 0 0 0 | 0 0 0.3 | 0.5 0.4 0.9 | 0 -0.5 -0.8 | -0.5 0.6 1.0 | 0.5 0 -0.6 | 0 0.5 0"
        "| 0 0 0.3 | 0 0 0 | 0 0 0"
    )
    return paths.posed(positions, turns)


def groove_block() -> paths.Path:
    """A small block in the groove: onto the floor, along it, against a wall, both, up the wall."""
    positions = _keys(
        "-3 -30 22 | -3 -30 14.2 | -2 -15 14.2 | 6 0 14.2 | 9.3 8 14.2 | 9.7 20 14.0 | 9.5 30 15"
        "| 9.6 30 22 | 9.2 20 19 | 6 15 19 | 1 10 24"
    )
    turns = _keys(
        "0 0 0 | 2 1 5 | 1 2 8 | 2 2 5 | 1.5 2 3 | 1.5 2.5 3 | 2 2 4 | 1 2 6 | 0 3 8"
        "| 0 0 10 | 0 0 10"
    )
    return paths.posed(positions, turns)


def groove_stylus() -> paths.Path:
    """The stylus in the groove, leaning 45 degrees away from floor and wall: floor, corner, wall.

    The tip is the deepest point behind both planes and enters the corner through its bisector: the contact of a point.
    """
    tip = _keys(
        "10 -30 3 | 10 -30 -1.8 | 6 -20 -2 | 14 -10 -1.5 | 16 -4 4 | 18 -1 2 | 20 1 0 | 21.4 4 -1.4"
        "| 21.6 8 -1.2 | 21.2 12 -1.5 | 20 15 0 | 18 17 2 | 19 20 6 | 21.5 24 8 | 21.2 30 13 | 16 34 16"
    )
    return paths.posed(tip, [[0, -45, 0]] * len(tip))


def vgroove_ball() -> paths.Path:
    """Ball R 15 mm in the V groove: onto one wall, into the bottom (both), out along the other.

    The first two numbers of a key are the distances of its centre from the two walls.
    """
    root = float(np.sqrt(0.5))
    reach = _keys(
        "18 40 -20 | 14 35 -18 | 13.5 26 -10 | 13.4 13.8 0 | 13.6 13.3 8 | 24 13.4 16 | 33 14 22"
        "| 38 18 24"
    )
    positions = [[root * (a - b), y, root * (a + b)] for a, b, y in reach]
    return paths.posed(positions, [[0, 0, 0]] * len(positions))


def step_cube() -> paths.Path:
    """A 20 mm cube over the stairs: tread, concave corner, riser, convex edge, next tread.

    Dragged over the upper step; the height of the track gives the depth in the lower tread.
    """
    lean = "5 7 9"
    turn = Rotation.from_rotvec(np.radians(_keys(lean)[0])).as_matrix()
    foot = -float((CUBE20 @ turn.T)[:, 2].min())
    low, mid = foot - 1.0, foot - 0.9
    keys: dict[str, paths.Keys] = {
        "track": _keys(
            f"1 -12 {foot + 4} | 1 -11 {low} | 1 -8 {low} | 1 -4 {low} | 1 -1 {mid}"
            f"| 1 2 {foot + 1} | 1 5 18 | 1 7 23 | 6 8 23 | 14 9 23 | 24 10 23"
        ),
        "up": _keys("-1 0 0 |" * 7 + "-1 0 1 | 0 0 1 | 0 0 1 | 0 0 1"),
        "depth": _keys("-26 | -25 | -14 | -2 | 0.9 | 1.1 | 1.1 | 1.2 | 1.1 | 1 | -4"),
        "turn": _keys(f"{lean} |" * 6 + "4 9 9 | 4 12 10 | 5 12 12 | 5 9 14 | 5 8 15"),
    }
    return paths.dragged(_corners((0, -60, -30), (120, 60, 24)), CUBE20, keys)


def part_spanner() -> paths.Path:
    """The spanner over the machined part: slot, counterbore, boss pocket, boss wall, end pocket."""
    part = shapes.feature_part(HERE / "featuretype.STL")
    return spanner_path.part_spanner_path(part, shapes.spanner(HERE / "wrench.dxf"))


PATHS: dict[str, Callable[[], paths.Path]] = {
    "edge90_sphere": lambda: paths.edge_sphere(50.0, 10.0),
    "edge90_cube": edge90_cube,
    "corner3_sphere": lambda: paths.corner_ball(15.0, 3.0),
    "corner3_cube": corner3_cube,
    "edge60_cube": lambda: wedge_cube(60.0),
    "edge120_cube": lambda: wedge_cube(120.0),
    "cylinder_ball": lambda: paths.cylinder_ball(20.0, 15.0, 2.0),
    "bar_u": bar_u,
    "groove_block": groove_block,
    "groove_stylus": groove_stylus,
    "vgroove_ball": vgroove_ball,
    "step_cube": step_cube,
    "wall_cube": wall_cube,
    "part_spanner": part_spanner,
}
