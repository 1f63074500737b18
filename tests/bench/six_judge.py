"""The open benchmark of meshes/six: its files, and its exact judges. Nothing here knows how a contact is found."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import igl
import manifold3d as mf
import numpy as np
import numpy.typing as npt
from crease.bake.bake import bake_scene
from crease.bake.scene_list import is_newer
from crease.base.scene import Scene, open_scene
from crease.base.table import write_bytes
from crease.lab.setup import image_options
from crease.mesh.mesh import Mesh, load_mesh
from crease.replay.trajectory import Trajectory, check_rows, load_trajectory
from scipy.spatial.transform import Rotation, Slerp

F64 = npt.NDArray[np.float64]

MM = 1e-3
FELT_MIN_N = 1e-6
OVERLAP_MIN_MM3 = 1e-9
REFINE = 4
"""Parts of an edge of an overlap that are looked at: where edges cross, and where something is cut right through, all
its corners are on both surfaces."""
STILL_N = 1e-3
"""Changes below it are rounding."""


@dataclass(frozen=True)
class Case:
    """One scene of the benchmark as it is on disk."""

    name: str
    spec: dict[str, Any]
    folder: Path

    @classmethod
    def load(cls, folder: Path, name: str) -> Case:
        """From folder/name.json."""
        return cls(name, json.loads((folder / f"{name}.json").read_text(encoding="utf-8")), folder)

    @property
    def springs(self) -> tuple[float, float]:
        """N/m, N m/rad."""
        spring = self.spec["spring"]
        return float(spring["stiffness_N_m"]), float(spring["stiffness_Nm_rad"])

    @property
    def path(self) -> Trajectory:
        """The hand."""
        return load_trajectory(self.folder / self.spec["path"])

    def mesh(self, part: str) -> Mesh:
        """`static` or `tool`."""
        return load_mesh(self.folder / self.spec[part], MM)

    def image(self, images: Path) -> Scene:
        """Baked as the scene says, and kept."""
        asked = self.spec["image"]
        own = images / f"{self.name}-{'-'.join(f'{value:g}' for value in asked.values())}.crs"
        meshes = self.mesh("static"), self.mesh("tool")
        if own.exists() and is_newer(own):
            scene = open_scene(own)
            meta = scene.meta
            digests = (bytes(meta.static_sha256).hex(), bytes(meta.tool_sha256).hex())
            if digests == tuple(m.digest_sha256 for m in meshes):
                return scene
        images.mkdir(parents=True, exist_ok=True)
        write_bytes(
            own, bake_scene(*meshes, image_options(asked), lambda _label, _part: None).image
        )
        return open_scene(own)

    @property
    def exact(self) -> tuple[npt.NDArray[np.int64], F64]:
        """Ticks (n,), wrenches (n, 6)."""
        rows = np.array(self.spec["exact"]["rows"], np.float64).reshape(-1, 7)
        return rows[:, 0].astype(np.int64), rows[:, 1:]


def rotation(pose: F64) -> Rotation:
    """Of poses (..., 7): x y z, w x y z."""
    return Rotation.from_quat(pose[..., [4, 5, 6, 3]])


def poses(at_m: F64, turns: Rotation) -> F64:
    """(n, 7): x y z, w x y z."""
    return np.column_stack([at_m, turns.as_quat()[:, [3, 0, 1, 2]]])


def trajectory(pose: F64, period_s: float = 1e-3) -> Trajectory:
    """One pose each period."""
    return check_rows(np.column_stack([period_s * np.arange(len(pose)), pose]), "path")


def halved(path: Trajectory) -> Trajectory:
    """The same way in twice as many steps."""
    pose = path.rows[:, 1:]
    n = len(pose)
    at = np.arange(0.0, n - 0.75, 0.5)
    place = np.column_stack([np.interp(at, np.arange(n), pose[:, k]) for k in range(3)])
    return trajectory(poses(place, Slerp(np.arange(n), rotation(pose))(at)))


def hands_of(case: Case, count: int) -> list[tuple[F64, Rotation]]:
    """Targets of the first hands: places in m, attitudes."""
    with np.load(case.folder / case.spec["hands"]) as data:
        places, quats = (
            data["position_m"][:count].astype(float),
            data["quaternion"][:count].astype(float),
        )
    return [(p, Rotation.from_quat(q[:, [1, 2, 3, 0]])) for p, q in zip(places, quats, strict=True)]


class Solids:
    """Both meshes as solids: overlaps by booleans (manifold3d), depths by nearest triangles (libigl), mm."""

    def __init__(self, static: Mesh, tool: Mesh) -> None:
        self._parts = [self._welded(m) for m in (static, tool)]
        self._solids = [
            mf.Manifold(mf.Mesh(v.astype(np.float32), f.astype(np.uint32))) for v, f in self._parts
        ]
        assert all(s.status() == mf.Error.NoError and s.volume() > 0.0 for s in self._solids)

    @staticmethod
    def _welded(mesh: Mesh) -> tuple[F64, npt.NDArray[np.int64]]:
        corners = np.asarray(mesh.vertices_m[mesh.triangles].reshape(-1, 3) / MM, np.float32)
        vertices, index = np.unique(corners, axis=0, return_inverse=True)
        return vertices.astype(np.float64), index.reshape(-1, 3).astype(np.int64)

    def overlap(self, pose: F64) -> Any:
        """What both fill."""
        turn = rotation(pose).as_matrix()
        return self._solids[0] ^ self._solids[1].transform(np.column_stack([turn, pose[:3] / MM]))

    def touches(self, pose: F64) -> bool:
        """Whether they overlap at all."""
        return bool(self.overlap(pose).volume() > OVERLAP_MIN_MM3)

    def depth_mm(self, pose: F64) -> float:
        """How deep the overlap reaches below the surface of either: the deepest of points all over its own surface."""
        both = self.overlap(pose)
        if both.is_empty():
            return 0.0
        places = np.asarray(both.refine(REFINE).to_mesh().vert_properties[:, :3], np.float64)
        seen = rotation(pose).inv().apply(places - pose[:3] / MM)
        deep = [
            igl.point_mesh_squared_distance(np.ascontiguousarray(p), v, f)[0].max()
            for p, (v, f) in zip((places, seen), self._parts, strict=True)
        ]
        return float(np.sqrt(max(deep)))


@dataclass(frozen=True)
class Felt:
    """What a method answered along a path."""

    wrench: F64
    """(n, 6), N and N m, on the hand about the tool's origin."""
    held: F64
    """(n, 7)."""
    tick_ns: npt.NDArray[np.int64]

    def __post_init__(self) -> None:
        """Errors: ArithmeticError for what is no number, which no judge would see."""
        if not (np.isfinite(self.wrench).all() and np.isfinite(self.held).all()):
            raise ArithmeticError("a wrench or a held pose is not finite")


Run = Callable[[Trajectory], Felt]


def inside_mm(solids: Solids, held: F64, every: int) -> float:
    """The deepest overlap of the held tool; every: of so many ticks one is looked at, and the last."""
    return max(solids.depth_mm(pose) for pose in [*held[::every], held[-1]])


def felt_early_N(solids: Solids, path: Trajectory, wrench: F64) -> float:
    """The largest force before the hand's tool overlaps for the first time."""
    force = np.linalg.norm(wrench[:, :3], axis=1)
    most = 0.0
    for i in np.flatnonzero(force > FELT_MIN_N).tolist():
        if any(solids.touches(path.rows[k, 1:]) for k in (max(i - 1, 0), i)):
            break
        most = max(most, float(force[i]))
    return most


def wrench_rms_mm(case: Case, wrench: F64) -> tuple[float, float]:
    """Off the exact rows: force over k_t, torque over k_t and the tool's radius."""
    ticks, right = case.exact
    return off_rms_mm(case, wrench[ticks], right)


def off_rms_mm(case: Case, wrench: F64, right: F64) -> tuple[float, float]:
    """The same of other rows, (n, 6)."""
    off = wrench - right
    rms = np.sqrt(np.mean(np.sum(off.reshape(-1, 2, 3) ** 2, axis=2), axis=0))
    k_t, radius_m = case.springs[0], MM * case.spec["tool_radius_mm"]
    return float(rms[0] / k_t / MM), float(rms[1] / k_t / radius_m / MM)


def largest_change_N(case: Case, wrench: F64) -> float:
    """From one tick to the next: of the force, or of the torque over the tool's radius."""
    change = np.abs(np.diff(wrench, axis=0))
    change[:, 3:] /= MM * case.spec["tool_radius_mm"]
    return float(change.max())


def change_halves(case: Case, run: Run, felt: Felt) -> float:
    """Largest change at half the step over that at the whole step; 0 where nothing is felt."""
    whole = largest_change_N(case, felt.wrench)
    return largest_change_N(case, run(halved(case.path)).wrench) / whole if whole > STILL_N else 0.0


def loop_energy(case: Case, run: Run) -> float:
    """Energy given to the hand over the path and back, over the largest energy of the springs; above 0: it gains."""
    pose = case.path.rows[:, 1:]
    path = trajectory(np.vstack([pose, pose[-2::-1]]))
    felt = run(path)
    there = path.rows[:, 1:]
    turns = rotation(there)
    motion = np.hstack([np.diff(there[:, :3], axis=0), (turns[1:] * turns[:-1].inv()).as_rotvec()])
    given = float(np.sum(0.5 * (felt.wrench[1:] + felt.wrench[:-1]) * motion))
    k_t, k_r = case.springs
    stored = (
        np.sum(felt.wrench[:, :3] ** 2, axis=1) / k_t
        + np.sum(felt.wrench[:, 3:] ** 2, axis=1) / k_r
    )
    return given / float(max(0.5 * stored.max(), 1e-12))
