"""Where the loop is tried: one block, one tool, and a flat wall, an edge and a three-face corner of it.

The tool is a pad: the cap of a ball of 80 mm radius, 20 mm wide. Round, so that the force turns where it meets an edge
or a corner; large in radius, so that a light hand can hold it there (the contact pushes sideways with a stiffness of
F / R, and the hand has to hold more); finely sampled, since at the largest stiffness the depth F / k is below 1 mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.scene import Scene, open_scene
from crease.loop.loop import LIGHT_GRIP, NORMAL_GRIP, Hand, Place, Quaternion, turn_between

F64 = npt.NDArray[np.float64]

PAD_RADIUS_M = 0.08
BLOCK_M = 0.16
BALL_RADIUS_M = 0.015
PRESS_N = {LIGHT_GRIP: 2.0, NORMAL_GRIP: 3.0}
"""Half of what the hand can hold sideways on a corner, and no more than a hand presses for long."""


@dataclass(frozen=True)
class Case:
    """A place, how the device stands there, and the direction of the force in the device.

    flat: the name of the flat wall with the same direction, that a crease is compared with. groove: it is in
    groove_scene, not in pad_scene.
    """

    place: Place
    base_from_world: Quaternion
    direction: tuple[float, float, float]
    flat: str
    groove: bool = False


def _unit(*vector: float) -> F64:
    return np.asarray(np.asarray(vector) / np.linalg.norm(vector), dtype=np.float64)


def _place(name: str, corner_m: tuple[float, float, float], normal: F64, across: F64) -> Place:
    touch_m = np.asarray(corner_m) + PAD_RADIUS_M * normal
    touch, out, along = ((float(v[0]), float(v[1]), float(v[2])) for v in (touch_m, normal, across))
    return Place(name, touch, out, along)


def cases() -> list[Case]:
    """The flat wall in three directions of the device, the 90-degree edge, the three-face corner."""
    up, edge, corner = (0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 1.0)
    middle = (-0.5 * BLOCK_M, -0.5 * BLOCK_M, 0.0)
    flat = [
        Case(
            _place(f"flat {name}", middle, _unit(*up), _unit(1, 0, 0)),
            turn_between(up, direction),
            direction,
            f"flat {name}",
        )
        for name, direction in (("along Z", up), ("as the edge", edge), ("as the corner", corner))
    ]
    straight = (1.0, 0.0, 0.0, 0.0)
    return [
        *flat,
        Case(
            _place("edge", (0.0, middle[1], 0.0), _unit(*edge), _unit(1, 0, -1)),
            straight,
            edge,
            "flat as the edge",
        ),
        Case(
            _place("corner", (0.0, 0.0, 0.0), _unit(*corner), _unit(1, 0, -1)),
            straight,
            corner,
            "flat as the corner",
        ),
    ]


def pad_scene(folder: Path, spacing_m: float = 0.4e-3) -> Scene:
    """Bake the block and the pad into `folder`, unless the image there is newer than what makes it.

    Cost: 5 s, once.   Errors: CreaseError.
    """
    import trimesh

    radius_mm, half_mm, back_mm = 1e3 * PAD_RADIUS_M, 10.0, 4.0
    angle = np.linspace(0.0, np.arcsin(half_mm / radius_mm), 24)
    cap = radius_mm * np.column_stack([np.sin(angle), -np.cos(angle)])
    top = cap[-1, 1] + back_mm
    profile = np.vstack([cap, [half_mm, top], [0.0, top]])
    pad = trimesh.creation.revolve(profile, sections=72)
    block = trimesh.creation.box(bounds=[[-1e3 * BLOCK_M] * 3, [0.0] * 3])
    return _bake(folder, f"pad_{1e6 * spacing_m:.0f}um", {"block": block, "pad": pad}, spacing_m)


def _bake(folder: Path, name: str, meshes_mm: dict[str, Any], spacing_m: float) -> Scene:
    """The image of two meshes, static first; kept while it is newer than what makes it.

    Several may make it at once: each file is there whole or not at all.
    """
    from crease.bake.bake import BakeOptions, bake_scene
    from crease.bake.scene_list import is_newer
    from crease.base.table import write_bytes
    from crease.mesh.mesh import load_mesh

    image = folder / f"{name}.crs"
    if not is_newer(image, Path(__file__)):
        folder.mkdir(parents=True, exist_ok=True)
        for part, mesh in meshes_mm.items():
            write_bytes(folder / f"{part}.stl", mesh.export(file_type="stl"))
        static, tool = (load_mesh(folder / f"{part}.stl", 1e-3) for part in meshes_mm)
        options = BakeOptions(voxel_m=2e-3, spacing_m=spacing_m)
        write_bytes(image, bake_scene(static, tool, options, lambda _label, _part: None).image)
    return open_scene(image)


def groove_case() -> Case:
    """A ball at the bottom of a groove with walls at 45 degrees, that it touches both."""
    touch_m = (0.0, 0.0, float(np.sqrt(2.0)) * BALL_RADIUS_M)
    place = Place("groove", touch_m, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    return Case(place, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0), "flat along Z", groove=True)


def groove_scene(folder: Path, spacing_m: float = 0.4e-3) -> Scene:
    """Bake the groove and the ball into `folder`, unless the image is there.   Cost: 10 s, once."""
    import trimesh

    profile_mm = np.array([[0, 0], [-40, 40], [-40, -40], [40, -40], [40, 40]], dtype=np.float64)
    count = len(profile_mm)
    ends = [
        np.column_stack([profile_mm[:, 0], np.full(count, y), profile_mm[:, 1]])
        for y in (-40.0, 40.0)
    ]
    fan = np.array([[0, i, i + 1] for i in range(1, count - 1)])
    ring = np.arange(count)
    after = np.roll(ring, -1)
    sides = np.vstack(
        [
            np.column_stack([ring, after, after + count]),
            np.column_stack([ring, after + count, ring + count]),
        ]
    )
    groove = trimesh.Trimesh(
        np.vstack(ends), np.vstack([fan, fan[:, ::-1] + count, sides[:, ::-1]])
    )
    trimesh.repair.fix_normals(groove)
    ball = trimesh.creation.icosphere(subdivisions=4, radius=1e3 * BALL_RADIUS_M)
    return _bake(
        folder, f"groove_{1e6 * spacing_m:.0f}um", {"groove": groove, "ball": ball}, spacing_m
    )


FEET = {1: (1, 1), 4: (2, 2), 24: (6, 4)}
"""Feet of a plate, along X and Y, by how many there are: each touches a plane in one point."""
FEET_HALF_M = (0.025, 0.015)
"""Of the outermost feet from the middle."""


def feet_m(feet: int) -> F64:
    """Where the feet of a plate touch, (n, 3), frame of the tool.   Errors: KeyError for a number not in FEET."""
    across, deep = FEET[feet]
    half_x, half_y = FEET_HALF_M
    xs = np.linspace(-half_x, half_x, across) if across > 1 else np.zeros(1)
    ys = np.linspace(-half_y, half_y, deep) if deep > 1 else np.zeros(1)
    return np.array([[x, y, 0.0] for x in xs for y in ys])


def feet_scene(folder: Path, feet: int) -> Scene:
    """Bake a block, and a plate on so many pyramids whose tips are in the plane of the tool's origin, into `folder`.

    Cost: 5 s, once.   Errors: as feet_m.
    """
    import trimesh

    half_x, half_y = (1e3 * half for half in FEET_HALF_M)
    corners = np.array([[0, 0, 0], *([x, y, 4.5] for x in (-3, 3) for y in (-3, 3))], np.float64)
    tips = [trimesh.convex.convex_hull(corners + 1e3 * at_m) for at_m in feet_m(feet)]
    plate = trimesh.creation.box(
        bounds=[[-half_x - 5, -half_y - 5, 4], [half_x + 5, half_y + 5, 9]]
    )
    tool = trimesh.util.concatenate([plate, *tips])
    block = trimesh.creation.box(bounds=[[-60.0, -50.0, -20.0], [60.0, 50.0, 0.0]])
    return _bake(folder, f"feet_{feet}", {"block": block, f"feet_{feet}": tool}, 2e-3)


def press_N(hand: Hand) -> float:
    """How hard a hand presses here."""
    return PRESS_N.get(hand, 2.0)
