"""Columns of `make bench-meshes`: force along a path over every ridge and pocket, with three tools.

For each tool and response: share of the deep poses that the force does not clear (of booleans, P2), amplification,
largest and at the 99th percentile (P9), and for the tool of the image how far the force is from that of a finer bake.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from crease.bake.bake import BakeOptions, bake_scene
from crease.bake.bodies import read_bodies
from crease.bake.surface import make_surface
from crease.base.scene import Scene, open_image, open_scene
from crease.mesh.mesh import Mesh, load_mesh, make_mesh
from crease.replay.replay import ReplayOptions
from mesh_paths import strokes
from numpy.typing import NDArray
from study.properties.answers import Answer, asker
from study.properties.checks import CLEAR_BAND, DEEP_MM
from study.properties.geometry import Overlap, Pair

ROOT = Path(__file__).resolve().parents[2]
TOOLS = {"ball": "ball15", "box": "cube20", "stylus": "stylus"}
RESPONSES = ("way_out", "extent")
POSES = 60
"""Poses in contact that booleans are made at."""
FINER = 3.0
"""Voxels of the finer bake are so many times smaller."""
Floats = NDArray[np.float64]


def judge(image: Path, _folder: Path) -> dict[str, str]:
    """All columns of a scene image and the meshes beside it.   Errors: CreaseError."""
    scene = open_scene(image)
    body, ball = read_bodies(scene)
    static = _mesh(body.vertices_m, body.triangles, image.stem)
    out: dict[str, str] = {}
    for name, file in TOOLS.items():
        tool = _mesh(ball.vertices_m, ball.triangles, name)
        mine = scene
        if name != "ball":
            tool = load_mesh(ROOT / "build" / "meshes" / f"{file}.stl", 1e-3)
            mine = open_image(bake_scene(static, tool).image, f"{image.stem} with {name}")
        out |= _columns(name, static, tool, mine)
    return out


def _mesh(vertices_m: Floats, triangles: NDArray[np.int64], source: str) -> Mesh:
    digest = hashlib.sha256(vertices_m.tobytes() + triangles.tobytes()).hexdigest()
    return make_mesh(vertices_m, triangles, 1.0, source=source, digest_sha256=digest)


@dataclass(frozen=True)
class Look:
    """A pose in contact: stroke, tick, and the overlap there."""

    stroke: int
    tick: int
    overlap: Overlap


def _columns(name: str, static: Mesh, tool: Mesh, scene: Scene) -> dict[str, str]:
    surface = make_surface(static, float(np.degrees(scene.meta.crease_angle_rad)))
    made = strokes(surface, 1e3 * tool.vertices_m, tool.triangles)
    out = {f"{name}_strokes": str(len(made))}
    if not made:
        return out
    pair = Pair(static, tool)
    looks, jams = contacts(pair, made), dict[int, bool]()
    for response in RESPONSES:
        answers = answers_of(scene, made, response)
        key = f"{name}_{response}"
        out[f"{key}_clear_outside"] = f"{clear_outside(pair, made, looks, jams, answers):.2f}"
        largest, p99 = amplification(made, answers)
        out |= {f"{key}_amplification": f"{largest:.2f}", f"{key}_amplification_p99": f"{p99:.2f}"}
        if name == "ball" and response == RESPONSES[0]:
            out |= force_error(answers, answers_of(finer(static, tool, scene), made, response))
    return out


def answers_of(scene: Scene, made: list[Floats], response: str) -> list[Answer]:
    """Each stroke from rest."""
    ask = asker(scene, ReplayOptions(response=response))
    return [ask(poses) for poses in made]


def finer(static: Mesh, tool: Mesh, scene: Scene) -> Scene:
    """The same shell over a voxmap of smaller voxels."""
    voxel_m, spacing_m = float(scene.meta.voxel_m) / FINER, float(scene.meta.spacing_m)
    options = BakeOptions(voxel_m=voxel_m, spacing_m=spacing_m)
    return open_image(bake_scene(static, tool, options).image, "finer")


def force_error(answers: list[Answer], fine: list[Answer]) -> dict[str, str]:
    """Force over stiffness against that of the finer bake, over ticks in contact, mm."""
    away = np.concatenate(
        [
            np.linalg.norm(mine.way_mm - other.way_mm, axis=1)[mine.touches | other.touches]
            for mine, other in zip(answers, fine, strict=True)
        ]
    )
    values = {
        "rms": np.sqrt((away**2).mean()),
        "p99": np.percentile(away, 99),
        "max": away.max(),
    }
    return {f"force_error_{key}_mm": f"{value:.3f}" for key, value in values.items()}


def contacts(pair: Pair, made: list[Floats]) -> list[Look]:
    """Overlaps thicker than DEEP_MM, at up to POSES poses spread over all strokes."""
    each = max(1, POSES // len(made))
    found = []
    for stroke, poses in enumerate(made):
        for tick in np.linspace(0, len(poses) - 1, each + 2).astype(int)[1:-1].tolist():
            overlap = pair.overlap(poses[tick])
            if overlap.thickness_mm > DEEP_MM:
                found.append(Look(stroke, tick, overlap))
    return found


def clear_outside(
    pair: Pair, made: list[Floats], looks: list[Look], jams: dict[int, bool], answers: list[Answer]
) -> float:
    """Share of the poses whose force, as a shift, is not 0.9 to 1.05 of what clears; jammed poses do not count."""
    factors = []
    for i, look in enumerate(looks):
        pose = made[look.stroke][look.tick]
        way = answers[look.stroke].way_mm[look.tick]
        s = pair.clearing(pose, look.overlap.volume_mm3, way)
        if s > CLEAR_BAND[1] and i not in jams:
            jams[i] = pair.is_jammed(pose, look.overlap)
        if s <= CLEAR_BAND[1] or not jams[i]:
            factors.append(s)
    spread = np.array(factors)
    if len(spread) == 0:
        return float("nan")
    return float(((spread <= CLEAR_BAND[0]) | (spread > CLEAR_BAND[1])).mean())


def amplification(made: list[Floats], answers: list[Answer]) -> tuple[float, float]:
    """Change of force over stiffness and way of the tool in a tick: largest, 99th percentile in contact."""
    rates = []
    for poses, answer in zip(made, answers, strict=True):
        change = np.linalg.norm(np.diff(answer.way_mm, axis=0), axis=1)
        step = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
        rates.append((change / np.maximum(step, 1e-9))[change > 0.0])
    rate = np.concatenate(rates)
    return (float(rate.max()), float(np.percentile(rate, 99))) if len(rate) else (0.0, 0.0)
