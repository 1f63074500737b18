"""Rival libraries asked for the contact of two meshes, pose by pose. Runs in the environment of `make bench-peers`.

    python query.py TABLE MESHES OUT [--every N] [--repeat N] --library LIBPEERS.so [SCENE...]

Writes OUT/LIBRARY-PATH.npz: normal (n, 3), out of the static object; depth_m (n,); time_us (n,), least of `repeat`;
which rows of the path. A library with several contacts answers with the deepest depth, along the mean of the normals
weighted by depth. A library that is missing, refuses or takes convex bodies only is said, with its reason, in
OUT/missing.json.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

QUERY_MAX_US = 3e5
"""A library that needs longer for a query is left out, and said so."""

Answer = tuple[np.ndarray, float, float]
"""Normal, depth in m, time in us."""


CONVEX_SHARE = 0.999
"""A mesh that fills this share of its hull is convex, but for rounding."""


class Body:
    """A mesh in metres: vertices, triangles, and the corners of its hull."""

    def __init__(self, file: Path) -> None:
        loaded = trimesh.load_mesh(file)
        loaded.merge_vertices()
        self.file = file
        self.vertices = np.ascontiguousarray(loaded.vertices * 1e-3, dtype=np.float64)
        self.triangles = np.ascontiguousarray(loaded.faces, dtype=np.int32)
        hull = ConvexHull(self.vertices)
        self.hull = np.ascontiguousarray(self.vertices[hull.vertices])
        self.is_convex = bool(loaded.volume * 1e-9 > CONVEX_SHARE * hull.volume)

    def must_be_convex(self) -> None:
        """For libraries that take hulls.   Errors: ValueError."""
        if not self.is_convex:
            raise ValueError(f"takes convex bodies only, and {self.file.name} is not")


def reduce_contacts(normals: np.ndarray, depths: np.ndarray) -> tuple[np.ndarray, float]:
    """One normal and one depth."""
    if not len(depths):
        return np.zeros(3), 0.0
    total = (normals * np.maximum(depths, 0.0)[:, None]).sum(axis=0)
    length = float(np.linalg.norm(total))
    return (total / length if length > 0 else np.zeros(3)), float(depths.max())


def timed(repeat: int, query: Callable[[], Any]) -> tuple[Any, float]:
    """The last answer and the least time in us."""
    least = np.inf
    for _ in range(repeat):
        start = time.perf_counter()
        found = query()
        least = min(least, 1e6 * (time.perf_counter() - start))
        if least > QUERY_MAX_US:
            raise TimeoutError(f"a query takes {1e-6 * least:.1f} s")
    return found, least


def matrix(pose: np.ndarray) -> np.ndarray:
    """Rotation of a pose."""
    return np.asarray(Rotation.from_quat(pose[3:], scalar_first=True).as_matrix())


def run_fcl(fixed: Body, tool: Body, poses: np.ndarray, repeat: int) -> list[Answer]:
    """FCL, mesh against mesh."""
    import fcl

    def model(body: Body) -> Any:
        made = fcl.BVHModel()
        made.beginModel(len(body.vertices), len(body.triangles))
        made.addSubModel(body.vertices, body.triangles)
        made.endModel()
        return made

    a, b = fcl.CollisionObject(model(fixed)), fcl.CollisionObject(model(tool))
    out = []
    for pose in poses:
        b.setTransform(fcl.Transform(matrix(pose), pose[:3]))

        def query() -> Any:
            result = fcl.CollisionResult()
            fcl.collide(
                a, b, fcl.CollisionRequest(num_max_contacts=1000, enable_contact=True), result
            )
            return result

        result, us = timed(repeat, query)
        normals = np.array([c.normal for c in result.contacts]).reshape(-1, 3)
        depths = np.array([c.penetration_depth for c in result.contacts])
        out.append((*reduce_contacts(normals, depths), us))
    return out


def run_coal(fixed: Body, tool: Body, poses: np.ndarray, repeat: int) -> list[Answer]:
    """Coal, mesh against mesh."""
    import coal

    def model(body: Body) -> Any:
        made = coal.BVHModelOBBRSS()
        made.beginModel(len(body.triangles), len(body.vertices))
        made.addVertices(body.vertices)
        made.addTriangles(body.triangles.astype(np.int64))
        made.endModel()
        return made

    a, b = model(fixed), model(tool)
    still = coal.Transform3s.Identity()
    out = []
    for pose in poses:
        moved = coal.Transform3s(matrix(pose), pose[:3])
        request = coal.CollisionRequest()
        request.num_max_contacts = 1000
        request.enable_contact = True

        def query(moved: Any = moved, request: Any = request) -> Any:
            result = coal.CollisionResult()
            coal.collide(a, still, b, moved, request, result)
            return result

        result, us = timed(repeat, query)
        contacts = [result.getContact(i) for i in range(result.numContacts())]
        normals = np.array([c.normal for c in contacts]).reshape(-1, 3)
        depths = -np.array([c.penetration_depth for c in contacts])
        out.append((*reduce_contacts(normals, depths), us))
    return out


def run_mujoco(fixed: Body, tool: Body, poses: np.ndarray, repeat: int) -> list[Answer]:
    """MuJoCo, signed distance field against signed distance field of the two meshes."""
    import mujoco

    files = {f"{name}.stl": body for name, body in (("fixed", fixed), ("tool", tool))}
    assets = {}
    for name, body in files.items():
        made = trimesh.Trimesh(body.vertices, body.triangles, process=False)
        assets[name] = made.export(file_type="stl")
    xml = """<mujoco><option sdf_iterations="10" sdf_initpoints="40"/><asset>
      <mesh name="fixed" file="fixed.stl"/><mesh name="tool" file="tool.stl"/></asset><worldbody>
      <geom type="sdf" mesh="fixed"/>
      <body name="tool"><freejoint/><geom type="sdf" mesh="tool"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml, assets)
    data = mujoco.MjData(model)
    out = []
    for pose in poses:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        _, us = timed(repeat, lambda: mujoco.mj_collision(model, data))
        normals = np.array([c.frame[:3] * (1 if c.geom1 == 0 else -1) for c in data.contact])
        depths = -np.array([c.dist for c in data.contact])
        out.append((*reduce_contacts(normals.reshape(-1, 3), depths), us))
    return out


def run_bullet_hull(fixed: Body, tool: Body, poses: np.ndarray, repeat: int) -> list[Answer]:
    """Bullet through pybullet: the static triangle mesh against the tool's convex hull."""
    import pybullet

    tool.must_be_convex()
    client = pybullet.connect(pybullet.DIRECT)
    shapes = [
        pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=fixed.vertices.tolist(),
            indices=fixed.triangles.reshape(-1).tolist(), physicsClientId=client,
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
        ),
        pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=tool.hull.tolist(), physicsClientId=client
        ),
    ]  # fmt: skip
    if min(shapes) < 0:
        raise RuntimeError("the meshes are refused")
    a = pybullet.createMultiBody(0.0, shapes[0], physicsClientId=client)
    b = pybullet.createMultiBody(1.0, shapes[1], physicsClientId=client)
    out = []
    for pose in poses:
        pybullet.resetBasePositionAndOrientation(b, pose[:3], [*pose[4:], pose[3]])
        found, us = timed(repeat, lambda: pybullet.getClosestPoints(b, a, 0.0))
        normals = np.array([c[7] for c in found]).reshape(-1, 3)
        out.append((*reduce_contacts(normals, -np.array([c[8] for c in found])), us))
    pybullet.disconnect(client)
    return out


class MeshStruct(ctypes.Structure):
    """`mesh` of peers.c."""

    _fields_ = (
        ("vertices", ctypes.c_void_p),
        ("vertex_count", ctypes.c_int),
        ("triangles", ctypes.c_void_p),
        ("triangle_count", ctypes.c_int),
    )


def from_c(function: Any, hulls: bool) -> Callable[..., list[Answer]]:
    """A function of peers.c."""

    def run(fixed: Body, tool: Body, poses: np.ndarray, repeat: int) -> list[Answer]:
        structs = []
        for body in (fixed, tool):
            if hulls:
                body.must_be_convex()
            v = body.hull if hulls else body.vertices
            structs.append(
                MeshStruct(v.ctypes.data, len(v), body.triangles.ctypes.data, len(body.triangles))
            )
        poses = np.ascontiguousarray(poses)
        out = np.zeros((len(poses), 7))
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (poses, out)]
        function(
            ctypes.byref(structs[0]),
            ctypes.byref(structs[1]),
            pointers[0],
            len(poses),
            repeat,
            pointers[1],
        )
        return [(row[:3], float(row[3]), float(row[5])) for row in out]

    return run


def main() -> None:
    """Command line: see the top of the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=Path, help="meshes/scenes.toml")
    parser.add_argument("meshes", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="all of the table")
    parser.add_argument("--every", type=int, default=40)
    parser.add_argument("--repeat", type=int, default=10)
    parser.add_argument("--library", type=Path, required=True, help="peers.c as a shared library")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    table = tomllib.loads(args.table.read_text(encoding="utf-8"))
    native = ctypes.CDLL(str(args.library.resolve()))
    libraries: dict[str, Callable[..., list[Answer]]] = {
        "ODE": from_c(native.peers_ode, False), "libccd": from_c(native.peers_ccd, True),
        "Bullet GImpact": from_c(native.peers_gimpact, False), "Bullet hull": run_bullet_hull,
        "MuJoCo SDF": run_mujoco, "FCL": run_fcl, "Coal": run_coal,
    }  # fmt: skip
    missing = {}
    for path in args.scenes or table:
        file = args.meshes / table[path]["path"]
        rows = np.loadtxt(file, delimiter=",", skiprows=1)[:: args.every]
        bodies = [Body(args.meshes / table[path][name]) for name in ("static", "tool")]
        for name, library in libraries.items():
            try:
                found = library(*bodies, rows[:, 1:8], args.repeat)
            except Exception as error:  # whatever a library that does not fit raises
                missing[f"{name}, {path}"] = f"{type(error).__name__}: {error}"
                print(f"{name}, {path}: {missing[f'{name}, {path}']}", flush=True)
                continue
            np.savez(
                args.out / f"{name}-{path}.npz",
                normal=np.array([f[0] for f in found]),
                depth_m=np.array([f[1] for f in found]),
                time_us=np.array([f[2] for f in found]),
                every=args.every,
                triangles=len(bodies[1].triangles),
            )
            print(f"{name}, {path}: {np.median([f[2] for f in found]):.1f} us", flush=True)
    (args.out / "missing.json").write_text(json.dumps(missing, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
