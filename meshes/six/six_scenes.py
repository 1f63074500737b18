"""The scenes: which solids, which path, which springs, what is judged, and where the exact wrench comes from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import manifold3d as mf
import numpy as np
import six_exact
import six_paths
import six_shapes as shapes
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from six_exact import Walls
from six_paths import Path, through

Floats = NDArray[np.float64]

SPRINGS = (2000.0, 5.0)
"""N/m, N m/rad, tied at the tool's origin."""
GOALS: dict[str, float] = {
    "inside_max_mm": 0.02,
    "felt_before_touch_max_N": 0.0,
    "wrench_rms_max_mm": 0.02,
    "halved_change_max": 0.55,
    "energy_max": 1e-3,
}
"""What holds in every scene: see README.md "How to judge"."""
HAND: dict[str, float] = {
    "mass_kg": 0.8,
    "damping_Ns_m": 30.0,
    "stiffness_N_m": 300.0,
    "inertia_kgm2": 2e-3,
    "damping_Nms_rad": 0.1,
    "stiffness_Nm_rad": 3.0,
    "period_s": 1e-3,
}


@dataclass(frozen=True)
class Scene:
    """Solids in mm. image: voxel and spacing of a sampled image, mm. Exact rows at `ticks`: by walls or a formula."""

    about: str
    static: Callable[[], mf.Manifold]
    tool: Callable[[], mf.Manifold]
    path: Callable[[], Path]
    image: tuple[float, float]
    radius_mm: float
    walls: Callable[[], Walls] | None = None
    formula: Callable[[Path], Floats] | None = None
    """Wrenches of every pose (n, 6)."""
    image_more: dict[str, Any] = field(default_factory=dict)
    """What else is asked of an image: `tolerance_mm`, `even`."""
    how: str = ""
    ticks: tuple[int, ...] = ()
    friction: float = 0.0
    more: dict[str, Any] = field(default_factory=dict)


# ------------------------------------------------------------------------------------------------------ exact wrenches

FLOOR = (np.array([[0.0, 0.0, 1.0]]), np.zeros(1))
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def on_floor(points: Floats) -> Callable[[], Walls]:
    """Points of the tool above z = 0."""
    return lambda: Walls(*FLOOR, points)


def in_corner() -> Walls:
    """The cube before the three walls."""
    return Walls(np.eye(3), np.zeros(3), 10.0 * CORNERS)


def in_slot(play_mm: float) -> Walls:
    """The key in its slot, both below the chamfers."""
    half = shapes.KEY_MM + 0.5 * play_mm
    sides = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    low = shapes.square(shapes.KEY_MM, -29.0)
    edges = np.stack([low, shapes.square(shapes.KEY_MM, 10.0)], axis=1)
    return Walls(sides, np.full(4, -half), low, edges, -shapes.KEY_LEAD_MM)


def in_hole(play_mm: float) -> Walls:
    """The peg in its hole, both below the chamfers."""
    n = shapes.SIDES
    a = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    sides = -np.column_stack([np.cos(a), np.sin(a), np.zeros(n)])
    low = shapes.ring(shapes.PEG_MM, -shapes.GRIP_MM + shapes.LEAD_MM)
    edges = np.stack([low, shapes.ring(shapes.PEG_MM, 10.0)], axis=1)
    return Walls(sides, np.full(n, -shapes.PEG_MM - 0.5 * play_mm), low, edges, -shapes.LEAD_MM)


def drawn_over(path: Path) -> Floats:
    """The middle of the cylinder is led out of the square that is 10 mm larger and round at its corners."""
    x, z = path[0][:, 0], path[0][:, 2] + 20.0  # from the middle of the cube
    out = np.column_stack([np.abs(x) - 20.0, np.maximum(z, 0.0) - 20.0])
    beyond = np.maximum(out, 0.0)
    far = np.linalg.norm(beyond, axis=1)
    short = np.maximum(10.0 - far, 0.0)
    way = beyond / np.where(far > 0.0, far, 1.0)[:, None] * short[:, None]
    force = (
        1e-3 * SPRINGS[0] * np.column_stack([np.sign(x) * way[:, 0], np.zeros(len(x)), way[:, 1]])
    )
    return np.hstack([force, np.zeros((len(x), 3))])


def over_edge(path: Path) -> Floats:
    """The stick's lowest edge before that of the cube at x = 20, z = 0, both in double.

    With the lean held, the way out is along the normal of both edges; of the lean the least energy by Newton's method.
    """
    x, z, lean = path[0][:, 0] - 20.0, path[0][:, 2], path[1].as_rotvec()[:, 1]
    k_t, k_r = 1e-3 * SPRINGS[0], 1e3 * SPRINGS[1]  # N/mm, N mm/rad
    held = lean.copy()
    for _ in range(30):
        gap, arm = x * np.sin(held) + z * np.cos(held), x * np.cos(held) - z * np.sin(held)
        push = k_t * np.maximum(-gap, 0.0)
        slope = k_r + np.where(push > 0.0, k_t * arm * arm, 0.0) + push * gap
        held -= (k_r * (held - lean) - push * arm) / slope
    none = np.zeros(len(x))
    force = (push * np.sin(held), none, push * np.cos(held))
    return np.column_stack([*force, none, SPRINGS[1] * (held - lean), none])


def in_socket(path: Path) -> Floats:
    """The ball is led back to where it just touches: 0.1 mm from the middle."""
    far = np.linalg.norm(path[0], axis=1, keepdims=True)
    back = -path[0] / np.where(far > 0.0, far, 1.0) * np.maximum(far - 0.1, 0.0)
    return np.hstack([1e-3 * SPRINGS[0] * back, np.zeros_like(back)])


# --------------------------------------------------------------------------------------------------------------- paths


def pushed_peg(tip_mm: float, low_mm: float) -> Path:
    """In, then aside, leant and turned; a tilted start; tip_mm: height of the grip when the tip is at the top."""
    up, down = tip_mm + 4.0, low_mm
    return through(
        [
            (0, (0.3, -0.2, up), (2.0, 1.0, 0.0)),
            (300, (0.3, -0.2, tip_mm - 2.0), (1.0, 0.5, 0.0)),
            (500, (0.3, -0.2, down), (0.2, 0.1, 0.0)),
            (200, (1.0, 0.4, down), (0.2, 0.1, 0.0)),
            (200, (1.0, 0.4, down), (2.0, -1.0, 0.0)),
            (200, (-0.6, -0.8, down), (-1.0, 1.5, 3.0)),
            (200, (0.0, 0.0, down), (0.0, 0.0, 0.0)),
        ]
    )


def pressed(height_mm: float, lean: tuple[float, float, float]) -> Path:
    """Down to 10 mm below the top, aside a little, and up again; height_mm: of the lowest point above the origin."""
    top = -height_mm
    return through(
        [
            (0, (1.0, -2.0, top + 3.0), lean),
            (200, (1.0, -2.0, top - 1.0), lean),
            (300, (1.0, -2.0, top - 10.0), lean),
            (300, (3.0, 1.0, top - 10.0), (lean[0] + 3.0, lean[1] - 2.0, lean[2])),
            (400, (1.0, -2.0, top + 3.0), lean),
        ]
    )


def on_table(*keys: six_paths.Key) -> Callable[[], Path]:
    """Keys of a path."""
    return lambda: through(list(keys))


def dropped() -> Path:
    """Straight down at 0.5 m/s, a rest, and up again."""
    turn = (25.0, 20.0, 10.0)
    z = np.concatenate(
        [np.linspace(40.0, 18.0, 45), np.full(200, 18.0), np.linspace(18.0, 40.0, 220)]
    )
    at = np.column_stack([np.zeros((len(z), 2)), z])
    quat = Rotation.from_rotvec(np.tile(np.radians(turn), (len(z), 1)))
    return at, quat


def rested(slope_deg: float) -> Path:
    """Laid on the slope, and pulled straight down by 2 mm."""
    a = np.radians(slope_deg)
    up = 10.0 * np.array([np.sin(a), 0.0, np.cos(a)])
    s = np.concatenate([np.linspace(1.0, -0.02, 100), np.full(1, -0.02)])
    lay = up + s[:, None] * np.array([0.0, 0.0, 1.0])
    pull = lay[-1] + np.linspace(0.0, 1.0, 200)[1:, None] * np.array([0.0, 0.0, -2.0])
    at = np.concatenate([lay, pull, np.tile(pull[-1], (1000, 1))])
    return at, Rotation.from_rotvec(np.tile([0.0, a, 0.0], (len(at), 1)))


# -------------------------------------------------------------------------------------------------------------- scenes


def _peg(play_mm: float, voxel_mm: float, spacing_mm: float, **image: float | bool) -> Scene:
    return Scene(
        f"Peg of 20 mm in a hole that is {play_mm:g} mm wider; both chamfered by 2 mm.",
        lambda: shapes.hole(play_mm),
        shapes.peg,
        lambda: pushed_peg(40.0, 15.0),
        (voxel_mm, spacing_mm),
        26.9,
        lambda: in_hole(play_mm),
        image_more=image,
        how="least energy, double, points of the peg below the rim and where its edges pass it",
        ticks=tuple(range(820, 1600, 60)),
        more={
            "play_mm": play_mm,
            "hands": "peg_hands.npz",
            "goes_in": {"tip_below_mm": -20.0, "grip_mm": 40.0, "of": six_paths.HANDS},
        },
    )


def _plate(thick_mm: float) -> Scene:
    return Scene(
        f"Cube of 20 mm pressed 10 mm deep on a plate of {thick_mm:g} mm.",
        lambda: shapes.plate(thick_mm),
        shapes.cube,
        lambda: pressed(-15.0, (20.0, 10.0, 5.0)),
        (min(1.0, 2.0 * thick_mm), 2.0),
        17.3,
        on_floor(10.0 * CORNERS),
        how="least energy, double, corners of the cube above the plate's plane",
        ticks=tuple(range(100, 1200, 60)),
        more={"thick_mm": thick_mm, "never_beyond": {"held_origin_above_mm": 9.98}},
    )


SCENES: dict[str, Scene] = {
    "peg_04": _peg(0.4, 1.0, 2.0, tolerance_mm=0.1),
    "peg_01": _peg(0.1, 0.5, 1.0, tolerance_mm=0.005, even=True),
    "peg_002": _peg(0.02, 0.5, 1.0, tolerance_mm=0.005, even=True),
    "key": Scene(
        "Square key of 10 mm in a slot that is 0.1 mm wider; both chamfered by 1 mm.",
        lambda: shapes.slot(0.1),
        shapes.key,
        lambda: pushed_peg(30.0, 14.0),
        (0.5, 1.0),
        17.5,
        lambda: in_slot(0.1),
        how="least energy, double, corners of the key below the rim and where its edges pass it",
        ticks=tuple(range(820, 1600, 60)),
        more={"play_mm": 0.1, "ends": {"held_z_below_mm": 14.5}},
    ),
    "spanner": Scene(
        "Open spanner of 19.4 mm put on a hexagon of 19 mm, turned to and fro.",
        shapes.hexagon,
        shapes.spanner,
        on_table(
            (0, (-40.0, 0.4, 0.0), (0, 0, 2.0)),
            (500, (0.0, 0.4, 0.0), (0, 0, 1.0)),
            (300, (0.0, 0.0, 0.0), (0, 0, 12.0)),
            (400, (0.0, 0.0, 0.3), (0, 0, -12.0)),
            (200, (0.0, 0.0, 0.0), (1.0, 1.0, 0.0)),
        ),
        (1.0, 1.5),
        36.0,
        more={"play_mm": 0.4},
    ),
    "cylinder_edges": Scene(
        "Cylinder R 10 mm drawn over two edges of a cube, 2 mm deep (after Yu, Wang, Zhang, Xiao 2015).",
        lambda: shapes.box((-20, -20, -40), (20, 20, 0)),
        shapes.cylinder,
        lambda: six_paths.drawn(2.0),
        (1.0, 1.5),
        31.6,
        formula=drawn_over,
        how="closed form: the nearest place on a square with round corners; the mesh lies up to 0.0015 mm inside",
        ticks=tuple(range(150, 2300, 75)),
    ),
    "plate_3": _plate(3.0),
    "plate_1": _plate(1.0),
    "plate_03": _plate(0.3),
    "plate_needle": Scene(
        "A needle's tip pressed 10 mm deep on a plate of 1 mm.",
        lambda: shapes.plate(1.0),
        shapes.needle,
        lambda: pressed(0.0, (8.0, 5.0, 0.0)),
        (1.0, 1.0),
        30.3,
        on_floor(np.zeros((1, 3))),
        how="least energy, double, the tip above the plate's plane",
        ticks=tuple(range(100, 1200, 60)),
        more={
            "thick_mm": 1.0,
            "never_beyond": {"held_origin_above_mm": -0.02},
            "line_mm": [[0.0, 0.0, 0.0], [0.0, 0.0, 30.0]],
        },
    ),
    "stick_edge": Scene(
        "Stick with a sharp lower edge, 2 mm deep across the edge of a cube, drawn along itself and leant.",
        lambda: shapes.box((-20, -20, -40), (20, 20, 0)),
        shapes.stick,
        on_table(
            (0, (30.0, 0.0, -1.0), (0, 30.0, 0)),
            (300, (30.0, 0.0, -8.0), (0, 30.0, 0)),
            (400, (48.0, 3.0, -18.4), (0, 30.0, 0)),
            (300, (40.0, 0.0, -9.4), (0, 20.0, 0)),
            (300, (30.0, 0.0, -1.0), (0, 30.0, 0)),
        ),
        (1.0, 1.0),
        40.0,
        formula=over_edge,
        how="least energy, one lean by Newton's method: the cube's edge against the stick's lowest",
        ticks=tuple(range(60, 1300, 60)),
        more={"line_mm": [[-40.0, 0.0, 0.0], [20.0, 0.0, 0.0]]},
    ),
    "jaw": Scene(
        "Fork with a gap of 20.2 mm clamped on a bar of 20 mm, pushed aside, turned and leant.",
        shapes.bar,
        shapes.jaw,
        on_table(
            (0, (0.0, 0.0, 20.0), (0, 0, 0)),
            (400, (0.05, 0.0, -1.0), (0, 0, 0)),
            (200, (2.0, 0.0, -1.0), (0, 0, 0)),
            (300, (1.0, 3.0, -2.0), (0, 0, 5.0)),
            (300, (-1.0, 0.0, -1.0), (0, 6.0, -5.0)),
            (200, (0.0, 0.0, 0.0), (0, 0, 0)),
        ),
        (1.0, 1.5),
        24.6,
        more={"play_mm": 0.2},
    ),
    "ball_joint": Scene(
        "Ball R 10 mm held in a socket R 10.1 mm, pulled aside all round and turned.",
        shapes.socket,
        shapes.ball,
        on_table(
            (0, (0, 0, 0), (0, 0, 0)),
            (200, (2.0, 0.0, 0.0), (0, 0, 0)),
            (200, (1.0, 1.5, -1.0), (10.0, 5.0, 20.0)),
            (200, (-1.0, 1.0, -2.0), (5.0, -10.0, 40.0)),
            (200, (0.0, -2.0, 0.0), (0, 0, 0)),
            (200, (0, 0, 0), (0, 0, 0)),
        ),
        (0.5, 2.0),
        10.0,
        formula=in_socket,
        image_more={"tolerance_mm": 0.02},
        how="closed form: back to 0.1 mm from the middle; meshes lie up to 0.0055 mm off the spheres",
        ticks=tuple(range(40, 960, 40)),
        more={"play_mm": 0.2},
    ),
    "gears": Scene(
        "Two gears of module 4 mm, 0.2 mm apart from where they roll, pressed and turned.",
        lambda: shapes.gear(0.0),
        lambda: shapes.gear(15.0),
        on_table(
            (0, (54.0, 0.0, 0.0), (0, 0, 0)),
            (300, (48.2, 0.0, 0.0), (0, 0, 0)),
            (300, (48.2, 0.0, 0.0), (0, 0, 6.0)),
            (400, (48.2, 0.0, 0.0), (0, 0, -6.0)),
            (300, (47.2, 0.0, 0.0), (0, 0, 0)),
            (300, (48.0, 1.0, 0.5), (2.0, 1.0, 2.0)),
        ),
        (0.8, 1.2),
        28.4,
    ),
    "book_slide": Scene(
        "Book 60 x 40 x 12 mm pressed 2 mm into a table and slid by 60 mm.",
        shapes.table,
        shapes.book,
        on_table(
            (0, (-30, 0, 8), (0, 0, 0)),
            (200, (-30, 0, 4), (0, 0, 0)),
            (600, (30, 10, 4), (0, 0, 20.0)),
            (200, (30, 10, 8), (0, 0, 20.0)),
        ),
        (2.0, 3.0),
        36.6,
        on_floor(CORNERS * [30.0, 20.0, 6.0]),
        how="least energy, double, corners of the book above the table",
        ticks=tuple(range(100, 1000, 45)),
    ),
    "book_tip": Scene(
        "Book pressed on a table and tipped about its edge, then about its corner.",
        shapes.table,
        shapes.book,
        on_table(
            (0, (0, 0, 7), (0, 0, 0)),
            (200, (0, 0, 4), (0, 0, 0)),
            (400, (0, 0, 4), (0, 12.0, 0)),
            (300, (0, 0, 6), (6.0, 12.0, 0)),
            (300, (0, 0, 4), (0, 0, 0)),
        ),
        (2.0, 3.0),
        36.6,
        on_floor(CORNERS * [30.0, 20.0, 6.0]),
        how="least energy, double, corners of the book above the table",
        ticks=tuple(range(100, 1200, 50)),
    ),
    "book_drop": Scene(
        "Book dropped on a corner at 0.5 m/s, pressed, and lifted.",
        shapes.table,
        shapes.book,
        dropped,
        (2.0, 3.0),
        36.6,
        on_floor(CORNERS * [30.0, 20.0, 6.0]),
        how="least energy, double, corners of the book above the table",
        ticks=tuple(range(30, 460, 25)),
    ),
    "ladder": Scene(
        "Six square pegs of 6 mm in six holes of 6.2 mm, pressed on their floors, pushed and leant: 24 contacts.",
        shapes.rack,
        shapes.ladder,
        on_table(
            (0, (0.1, -0.1, 16), (0, 0, 0.2)),
            (500, (0.05, 0.0, 3.0), (0, 0, 0.1)),
            (200, (1.0, 0.5, 3.0), (0, 0, 0)),
            (200, (0.5, -0.5, 3.5), (1.0, 1.0, 1.0)),
            (200, (0.0, 0.0, 3.0), (0, 0, -1.0)),
            (200, (0.0, 0.0, 6.0), (0, 0, 0)),
        ),
        (0.8, 1.5),
        46.0,
        more={"play_mm": 0.2},
    ),
    "corner": Scene(
        "Cube of 20 mm pressed into the corner of three walls, leant and turned.",
        shapes.corner,
        shapes.cube,
        on_table(
            (0, (14, 14, 14), (0, 0, 0)),
            (300, (8, 9, 8.5), (0, 0, 0)),
            (300, (8, 9, 8.5), (5.0, -4.0, 3.0)),
            (300, (7, 8, 9.5), (-6.0, 4.0, 8.0)),
            (300, (14, 14, 14), (0, 0, 0)),
        ),
        (1.0, 2.0),
        17.3,
        in_corner,
        how="least energy, double, corners of the cube before three planes",
        ticks=tuple(range(150, 1150, 50)),
    ),
    "cube_plane": Scene(
        "Cube of 20 mm at rest on a plane with friction 0.3, pulled aside within what friction carries.",
        shapes.table,
        shapes.cube,
        on_table(
            (0, (0, 0, 11), (0, 0, 0)),
            (100, (0, 0, 8), (0, 0, 0)),
            (200, (0.4, 0.0, 8), (0, 0, 0)),
            (1000, (0.4, 0.0, 8), (0, 0, 0)),
        ),
        (2.0, 2.0),
        17.3,
        formula=lambda path: np.hstack(
            [
                -2.0 * path[0][:, :1] * (path[0][:, 2:] < 10.0),
                np.zeros((len(path[0]), 1)),
                2.0 * np.maximum(10.0 - path[0][:, 2:], 0.0),
                np.zeros((len(path[0]), 3)),
            ]
        ),
        how="closed form: what sticks is held where it was",
        ticks=tuple(range(60, 1300, 60)),
        friction=0.3,
        more={"rests": {"from_tick": 400, "moves_max_mm": 0.001}},
    ),
    "cube_slope": Scene(
        "Cube of 20 mm on a slope of 15 degrees, pulled straight down; friction 0.3, which carries 16.7 degrees.",
        lambda: shapes.table(15.0),
        shapes.cube,
        lambda: rested(15.0),
        (2.0, 2.0),
        17.3,
        friction=0.3,
        more={"rests": {"from_tick": 400, "moves_max_mm": 0.001}},
    ),
}


def exact(scene: Scene) -> list[list[float]]:
    """Rows [tick, fx .. tz], N and N m, on the hand, about the tool's origin."""
    path = scene.path()
    if scene.walls is not None:
        return six_exact.wrenches(scene.walls(), path, scene.ticks, SPRINGS)
    if scene.formula is None:
        return []
    found = scene.formula(path)
    return [[t, *(round(float(v), 9) + 0.0 for v in found[t])] for t in scene.ticks]
