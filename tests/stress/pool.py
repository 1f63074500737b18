"""Random scenes for the cases, each baked twice: as it is, and turned and shifted as a whole."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from crease.bake.bake import BakeOptions, bake_scene
from crease.base.attitude import to_matrix
from crease.base.errors import MeshError
from crease.base.scene import Scene, open_image
from crease.lab.exact import Solids
from crease.mesh.mesh import Mesh, make_mesh

from stress.solids import (
    CONVEX,
    STATIC_M,
    STATICS,
    TOOL_M,
    TOOLS,
    Rng,
    Solid,
    degenerate,
    make_solid,
    split_edges,
    surface_of,
)

F64 = npt.NDArray[np.float64]

SCALES = {"hand": 1.0, "0.1 mm": 0.1e-3 / 0.06, "100 m": 100.0 / 0.06}
"""Names and factors: the static object is about 60 mm, 0.1 mm and 100 m across."""

FLOAT_EPS = 2.0**-23


@dataclass(frozen=True)
class Frame:
    """Where a scene stands: x_world = scale (turn x + shift_m), x in hand size."""

    turn: F64
    quaternion: F64
    shift_m: F64
    scale: float


@dataclass(frozen=True)
class Placed:
    """A baked scene in its frame, and the meshes it was baked of."""

    scene: Scene
    frame: Frame
    static: Mesh
    tool: Mesh

    @property
    def resolution_m(self) -> float:
        """Hand size: what distances are worth here: measured error of the image, and rounding of float32."""
        meta = self.scene.meta
        reach_m = max(
            float(np.abs(list(meta.static_min_m)).max()),
            float(np.abs(list(meta.static_max_m)).max()),
        )
        rounding_m = 4 * FLOAT_EPS * (reach_m + float(meta.tool_radius_m))
        return (float(meta.error_max_m) + rounding_m) / self.frame.scale

    @property
    def rounding_m(self) -> float:
        """Hand size: one step of float32 at the far end of the static object, and a little for the sums."""
        meta = self.scene.meta
        reach_m = float(np.abs([list(meta.static_min_m), list(meta.static_max_m)]).max())
        return 4 * FLOAT_EPS * (reach_m + float(meta.tool_radius_m)) / self.frame.scale

    @property
    def spacing_m(self) -> float:
        """Spacing of the samples, in hand size."""
        return float(self.scene.meta.spacing_m) / self.frame.scale


@dataclass(frozen=True)
class Pair:
    """Two solids in hand size, and their scene in two frames."""

    name: str
    convex: bool
    solids: Solids
    here: Placed
    there: Placed


def quaternion_product(a: F64, b: F64) -> F64:
    """a b of quaternions (..., 4), scalar first."""
    w = a[..., 0] * b[..., 0] - (a[..., 1:] * b[..., 1:]).sum(axis=-1)
    v = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([w[..., None], v], axis=-1)


def rotations(rng: Rng, count: int) -> F64:
    """Unit quaternions (n, 4), evenly over all rotations."""
    q = rng.normal(size=(count, 4))
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def to_frame(frame: Frame, poses: F64) -> F64:
    """Poses (n, 7) of hand size in a scene's frame: what the tick gets. The tool is scaled, not moved."""
    at = frame.scale * (poses[:, :3] @ frame.turn.T + frame.shift_m)
    return np.hstack([at, quaternion_product(np.broadcast_to(frame.quaternion, (len(poses), 4)),
                                             poses[:, 3:])])  # fmt: skip


def random_frame(rng: Rng, scale: float, far: bool) -> Frame:
    """Any attitude; shifted by up to the object's size, or `far`: up to 3000 times that."""
    q = rotations(rng, 1)[0]
    reach_m = 0.06 * (10.0 ** rng.uniform(1.0, 3.5) if far else rng.uniform(0.0, 1.0))
    # The tick takes positions up to 1e4 m.
    reach_m = min(reach_m, 5e3 / scale)
    way = rng.normal(size=3)
    return Frame(to_matrix(q), q, reach_m * way / np.linalg.norm(way), scale)


def bake_placed(
    static: Mesh, tool: Mesh, frame: Frame, voxel_m: float, spacing_m: float, name: str
) -> Placed:
    """The scene of two meshes of hand size in a frame; lengths of hand size.   Errors: MeshError."""
    moved = frame.scale * (static.vertices_m @ frame.turn.T + frame.shift_m)
    static = replace(static, vertices_m=moved, source=name)
    tool = replace(tool, vertices_m=frame.scale * tool.vertices_m, source=name)
    options = BakeOptions(voxel_m=frame.scale * voxel_m, spacing_m=frame.scale * spacing_m)
    image = bake_scene(static, tool, options, lambda _label, _part: None).image
    return Placed(open_image(image, name), frame, static, tool)


def _mesh(rng: Rng, solid: Solid) -> Mesh:
    vertices, triangles = surface_of(solid)
    how = rng.integers(3)
    if how == 1:
        vertices, triangles = split_edges(rng, vertices, triangles, int(rng.integers(1, 12)))
    elif how == 2:
        vertices, triangles = degenerate(rng, vertices, triangles)
    return make_mesh(vertices, triangles)


def random_pair(seed: tuple[int, ...]) -> tuple[Pair, int]:
    """A scene of random solids in two frames, and how many solids were refused by the checks of meshes on the way.

    Cost: about 1 s of processor time.
    """
    rng = np.random.default_rng(seed)
    refused = 0
    while True:
        kinds = str(rng.choice(list(STATICS))), str(rng.choice(list(TOOLS)))
        size = str(rng.choice(list(SCALES), p=(0.7, 0.15, 0.15)))
        far = bool(rng.random() < 0.15) and size == "hand"
        solids = (
            make_solid(rng, STATICS, STATIC_M, kinds[0]),
            make_solid(rng, TOOLS, TOOL_M, kinds[1]),
        )
        voxel_m, spacing_m = float(rng.choice([2e-3, 3e-3])), float(rng.choice([1.5e-3, 2e-3]))
        frames = (
            Frame(np.eye(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), SCALES[size]),
            random_frame(rng, SCALES[size], far),
        )
        name = f"{kinds[1]} in {kinds[0]}, {'far' if far else size}"
        try:
            meshes = [_mesh(rng, s) for s in solids]
            placed = [
                bake_placed(meshes[0], meshes[1], frame, voxel_m, spacing_m, name)
                for frame in frames
            ]
        except MeshError:
            refused += 1
            continue
        return Pair(name, set(kinds) <= CONVEX, Solids(*solids), *placed), refused
