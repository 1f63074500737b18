"""crease: stable haptic contact between a rigid tool and a rigid mock-up.

    scene = crease.bake(crease.load_mesh("part.stl", "mm"), crease.load_mesh("tool.stl", "mm"))
    world = crease.World(scene, stiffness=1000.0)
    out = world.tick([0, 0, 0.008, 1, 0, 0, 0])      # out.force_N, out.torque_Nm, out.depth_m, out.areas
    felt = world.replay(poses)                       # felt.force_N, one row a tick
    felt = crease.Loop(scene).run(poses)             # the same with device and hand: they give way
    crease.Coupling(scene).tick(pose)                # a tool that stays outside, on a spring of six degrees of freedom

The names of `__all__` are public: what they promise is in their docstrings. Units are SI, frames are in the names,
errors are one tree, `CreaseError`, whose text says what, where and the mend.

The rest are rooms, each using only those before it: `base` (errors, units, tables, scene images), `mesh`, `bake` (two
meshes into a scene image), `replay` (the firmware's own C code along a path), `bus`, `loop` (the closed loop), `draw`,
`live` (the loop while it runs), `lab` (the paper's experiments), `verbs`. `cli` is the command `crease`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from crease.bake.call import bake
    from crease.base.errors import (
        CreaseError,
        LoopError,
        MeshError,
        SceneError,
        TableError,
        TrajectoryError,
        UnitError,
    )
    from crease.base.native import COVERAGES, RESPONSES
    from crease.base.scene import Scene
    from crease.base.version import VERSION as __version__  # noqa: N811
    from crease.loop.call import Felt, Loop
    from crease.loop.loop import Hand
    from crease.mesh.mesh import Mesh, load_mesh, make_mesh
    from crease.replay.coupling import Coupling, Held
    from crease.replay.trajectory import Trajectory
    from crease.replay.trajectory import load_trajectory as load_path
    from crease.replay.world import Output, Replay, World
    from crease.replay.worlds import Worlds

__all__ = [
    "COVERAGES",
    "RESPONSES",
    "Coupling",
    "CreaseError",
    "Felt",
    "Hand",
    "Held",
    "Loop",
    "LoopError",
    "Mesh",
    "MeshError",
    "Output",
    "Replay",
    "Scene",
    "SceneError",
    "TableError",
    "Trajectory",
    "TrajectoryError",
    "UnitError",
    "World",
    "Worlds",
    "__version__",
    "bake",
    "load_mesh",
    "load_path",
    "make_mesh",
]

_ROOMS = {
    "base.errors": (
        "CreaseError",
        "LoopError",
        "MeshError",
        "SceneError",
        "TableError",
        "TrajectoryError",
        "UnitError",
    ),
    "base.native": ("COVERAGES", "RESPONSES"),
    "base.scene": ("Scene",),
    "loop.call": ("Felt", "Loop"),
    "loop.loop": ("Hand",),
    "mesh.mesh": ("Mesh", "load_mesh", "make_mesh"),
    "replay.coupling": ("Coupling", "Held"),
    "replay.trajectory": ("Trajectory",),
    "replay.world": ("Output", "Replay", "World"),
    "replay.worlds": ("Worlds",),
}
_PLACES = {name: (room, name) for room, names in _ROOMS.items() for name in names}
_PLACES["__version__"] = ("base.version", "VERSION")
_PLACES["load_path"] = ("replay.trajectory", "load_trajectory")
"""Where each public name stands. It is imported when it is first asked for: `import crease` alone loads nothing."""


def __getattr__(name: str) -> Any:
    if name == "bake":  # the room, which can be called: importing it puts it here
        return import_module("crease.bake")
    if name not in _PLACES:
        raise AttributeError(f"module 'crease' has no attribute '{name}'")
    room, inside = _PLACES[name]
    value = getattr(import_module(f"crease.{room}"), inside)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
