"""What a case does: poses of one kind in one scene, settings, and the checks that apply to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from crease.base.attitude import to_matrix
from crease.base.native import RESPONSES, lib
from crease.mesh.mesh import Mesh
from crease.replay.replay import DEFAULT_RESPONSE, ReplayOptions, World

from stress import checks
from stress.checks import Violation
from stress.pool import Pair, Placed, rotations, to_frame
from stress.solids import Rng

F64 = npt.NDArray[np.float64]

POSES = 24
"""Poses of a case."""

EXACT_POSES = 1
"""Of these, how many are compared with exact booleans, a millisecond each, by each check that needs them."""

WHOLE = ReplayOptions(lookups_max=1 << 20)
"""Each pose is answered in its own tick: what is compared from pose to pose, or with exact solids, is that pose's."""

FEW = 128
"""Work of a tick that is not enough for an answer deep inside."""

POINT_TOOLS = ("god_object", "sphere_proxy")
"""Responses for a point or a ball; they answer other tools, but promise less."""


@dataclass
class Found:
    """What a case found: a violation or none, and numbers for the statistics in hand-size m."""

    violation: Violation | None = None
    numbers: dict[str, float] = field(default_factory=dict)
    ticks: int = 0
    contacts: int = 0


@dataclass(frozen=True)
class Place:
    """A scene in the frame a case looks at it."""

    pair: Pair
    placed: Placed
    response: str = DEFAULT_RESPONSE
    """That slow paths are asked of."""


def _surface(rng: Rng, mesh: Mesh, count: int) -> tuple[F64, F64]:
    """Random points on a surface and the outward normals there, (n, 3) each."""
    sides = mesh.vertices_m[mesh.triangles]
    cross = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    size = np.linalg.norm(cross, axis=1)
    which = rng.choice(len(sides), count, p=size / size.sum())
    points = np.einsum("nk,nkx->nx", rng.dirichlet((1, 1, 1), count), sides[which])
    return points, cross[which] / size[which, None]


def _turning(start: F64, end: F64) -> F64:
    """Quaternions (n, 4) that turn directions start to directions end, (n, 3)."""
    a = start / np.linalg.norm(start, axis=1, keepdims=True)
    b = end / np.linalg.norm(end, axis=1, keepdims=True)
    q = np.hstack([1 + np.einsum("nx,nx->n", a, b)[:, None], np.cross(a, b)])
    q[q[:, 0] < 1e-6] = (0.0, 0.6, 0.8, 0.0)
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def touching(rng: Rng, pair: Pair, count: int, low_m: float, high_m: float) -> F64:
    """Poses (n, 7) that bring a place of the tool's surface low..high metres above a place of the static one.

    The surfaces face each other there within some 50 degrees. Half of the places are corners.
    """
    frame = pair.here.frame
    mesh, tool = pair.here.static, pair.here.tool
    at, outward = _surface(rng, mesh, count)
    on_tool, normal = _surface(rng, tool, count)
    corner = rng.random(count) < 0.5
    on_tool[corner] = tool.vertices_m[rng.integers(len(tool.vertices_m), size=corner.sum())]
    middle = 0.5 * (tool.vertices_m.min(axis=0) + tool.vertices_m.max(axis=0))
    normal[corner] = on_tool[corner] - middle + 1e-9
    at, on_tool = at / frame.scale, on_tool / frame.scale
    q = _turning(normal, 0.4 * rng.normal(size=(count, 3)) - outward)
    height = rng.uniform(low_m, high_m, (count, 1))
    turned = np.einsum("nab,nb->na", to_matrix(q), on_tool)
    return np.hstack([at + height * outward - turned, q])


def _walk(rng: Rng, pair: Pair, count: int, step_m: float, high_m: float) -> F64:
    """A smooth path (n, 7) through a place of contact, about step_m a tick, turning as it goes."""
    start = touching(rng, pair, 1, -2e-3, high_m)[0]
    way, turn = rng.normal(size=3), rng.normal(size=3)
    s = np.arange(count)[:, None] - count // 2
    at = start[:3] + s * step_m * way / np.linalg.norm(way)
    small = np.hstack([np.ones((count, 1)), s * 20.0 * step_m * turn])
    q = np.tile(start[3:], (count, 1))
    w = small[:, :1] * q[:, :1] - (small[:, 1:] * q[:, 1:]).sum(axis=1, keepdims=True)
    v = small[:, :1] * q[:, 1:] + q[:, :1] * small[:, 1:] + np.cross(small[:, 1:], q[:, 1:])
    q = np.hstack([w, v])
    return np.hstack([at, q / np.linalg.norm(q, axis=1, keepdims=True)])


def _run(place: Place, poses: F64, options: ReplayOptions, found: Found) -> checks.Rows:
    rows = checks.answer(place.placed, poses, options)
    found.ticks += len(rows)
    found.contacts += int(np.count_nonzero(rows["areas"]))
    found.violation = checks.bounded(place.placed, rows, poses, options)
    return rows


def _against_exact(
    place: Place, rows: checks.Rows, poses: F64, options: ReplayOptions
) -> Violation | None:
    """Free space; and for convex solids, pull and contacts that are missed."""
    pair, placed = place.pair, place.placed
    bad = checks.free(pair, placed, rows, poses, options, EXACT_POSES)
    if pair.convex and options.response in checks.CONVEX:
        bad = bad or checks.missed(pair, placed, rows, poses, options, EXACT_POSES)
        bad = bad or checks.no_pull_exact(pair, placed, rows, poses, options, EXACT_POSES)
    return bad


def near(rng: Rng, place: Place, found: Found) -> Violation | None:
    """Any pose near the surface, with any response: sound, no pull, free space."""
    poses = touching(rng, place.pair, POSES, -3e-3, 3e-3)
    # Half of the cases are of the library's own response, which has no coverage to choose.
    response = DEFAULT_RESPONSE if rng.random() < 0.5 else str(rng.choice(list(RESPONSES)))
    options = replace(
        WHOLE,
        response=response,
        damping_Ns_m=float(rng.choice([0.0, 50.0])),
        coverage=str(rng.choice(["soft", "soft", "hard"])),
    )
    if response == DEFAULT_RESPONSE:
        options = replace(options, coverage="soft")
    rows = _run(place, poses, options, found)
    bad = checks.sound(rows, poses, options) or checks.no_pull(place.placed, poses[:4], options)
    if bad or response in POINT_TOOLS or options.damping_Ns_m or options.coverage == "hard":
        return bad
    return _against_exact(place, rows, poses, options)


def deep(rng: Rng, place: Place, found: Found) -> Violation | None:
    """The tool's origin anywhere in the static object's box: sound, no pull; convex solids push towards a way out.

    Sound too when answers are late, and carried along to poses far from their own.
    """
    solid = place.pair.solids.static.bounding_box()
    at = rng.uniform(solid[:3], solid[3:], (POSES, 3))
    poses = np.hstack([at, rotations(rng, POSES)])
    options = replace(WHOLE, force_max_N=float(rng.choice([5.0, checks.NO_LIMIT_N])))
    rows = _run(place, poses, options, found)
    few = replace(options, lookups_max=FEW)
    late = checks.answer(place.placed, poses, few)
    found.ticks += len(late)
    bad = checks.sound(rows, poses, options) or checks.sound(late, poses, few)
    bad = bad or checks.no_pull(place.placed, poses[:4], options)
    return bad or _against_exact(place, rows, poses, options)


def graze(rng: Rng, place: Place, found: Found) -> Violation | None:
    """Surfaces within micrometres of each other, a corner of the tool on a face: sound, free space."""
    size_m = 10.0 ** rng.uniform(-9, -4)
    poses = touching(rng, place.pair, POSES, -size_m, size_m)
    rows = _run(place, poses, WHOLE, found)
    return checks.sound(rows, poses, WHOLE) or _against_exact(place, rows, poses, WHOLE)


def step(rng: Rng, place: Place, found: Found) -> Violation | None:
    """A slow path through contact: halve the step, halve the change."""
    poses = _walk(rng, place.pair, POSES, 0.1e-3, 0.5e-3)
    options = replace(WHOLE, response=place.response)
    bad, jump_m = checks.continuity(place.pair, place.placed, poses, options)
    found.numbers["jump, spacings"] = jump_m / place.placed.spacing_m
    found.ticks += POSES + 5 * (checks.BISECTIONS // 2) + 2
    return bad


def skips(rng: Rng, place: Place, found: Found) -> Violation | None:
    """A path with slow and fast stretches: the same bits with each skip of detection switched off."""
    slow = _walk(rng, place.pair, POSES, 10.0 ** rng.uniform(-6, -3.5), 1e-3)
    poses = np.concatenate([slow, touching(rng, place.pair, 4, -1e-3, 5e-3), slow[::-1]])
    options = WHOLE
    rows = _run(place, poses, options, found)
    skip = int(rng.choice([0, lib.CR_SKIP_TOP | lib.CR_SKIP_TREE]))
    return checks.sound(rows, poses, options) or checks.same_without_skips(
        place.placed, rows, poses, options, skip
    )


def extreme(rng: Rng, place: Place, found: Found) -> Violation | None:
    """Stiffness from 1e-30 to 1e6 N/m, damping up to 1e4 N s/m, periods from 1e-40 to 1 s, limits from 1e-6 N."""
    poses = touching(rng, place.pair, POSES, -3e-3, 1e-3)
    options = ReplayOptions(
        stiffness_N_m=float(rng.choice([0.0, 1e-40, 1e-30, 1e-3, 1e3, 1e6])),
        damping_Ns_m=float(rng.choice([0.0, 1e-30, 1e2, 1e4])),
        force_max_N=float(rng.choice([1e-6, 1.0, checks.NO_LIMIT_N])),
    )
    world = World(place.placed.scene, options)
    found.ticks += POSES
    limit_N = float(options.force_max_N or 0.0)
    for i, pose in enumerate(to_frame(place.placed.frame, poses)):
        period_s = float(rng.choice([1e-40, 1e-12, 1e-3, 1.0]))
        out = world.tick(pose, period_s)
        force = np.array([out.force_world_N.x, out.force_world_N.y, out.force_world_N.z])
        torque = np.array([out.torque_world_Nm.x, out.torque_world_Nm.y, out.torque_world_Nm.z])
        size = float(np.linalg.norm(force))
        found.contacts += int(out.area_count > 0)
        if not (np.isfinite(force).all() and np.isfinite(torque).all() and out.faults == 0):
            text = f"fault {out.faults:#x} or not finite, period {period_s:g} s"
            return Violation("sound", text, size, limit_N, poses[: i + 1], options)
        if size > limit_N * (1 + 1e-5):
            return Violation("sound", "force above its limit", size, limit_N, poses[: i + 1], options)  # fmt: skip
    stiff = float(rng.choice([1e-3, 1e5, 1e6]))
    return checks.same_stiffness(place.placed, poses[:8], WHOLE, stiff)


def denormal(rng: Rng, place: Place, found: Found) -> Violation | None:
    """Poses with denormal numbers, signed zeros and tiny turns in them: sound, and no other answer than with zeros."""
    poses = touching(rng, place.pair, POSES, -2e-3, 1e-3)
    poses[:, 3:] = (1.0, 0.0, 0.0, 0.0)
    small = 10.0 ** rng.uniform(-45, -37, poses.shape) * rng.choice([-1.0, 1.0], poses.shape)
    world = to_frame(place.placed.frame, poses)
    world[:, 3:] = (1.0, 0.0, 0.0, 0.0)
    world[:, : int(rng.integers(4))] = 0.0
    world = np.where(world == 0.0, 0.0, world)
    options = ReplayOptions()
    found.ticks += 2 * POSES
    runs = [
        World(place.placed.scene, options).run(checks.path_of(np.where(world == 0.0, s, world)))
        for s in (np.zeros_like(small), small)
    ]
    found.contacts += int(np.count_nonzero(runs[0]["areas"]))
    bad = checks.sound(runs[1], poses, options)
    gone = np.abs(runs[0]["force_N"].astype(np.float64) - runs[1]["force_N"]).max(axis=1)
    if bad is None and gone.max() > 1e-30:
        i = int(np.argmax(gone))
        bad = Violation("denormal", "another force than with zeros", float(gone[i]), 1e-30,
                        poses[i : i + 1], options)  # fmt: skip
    return bad


BAD_POSES: tuple[tuple[int, float], ...] = (
    (0, np.nan), (1, np.inf), (2, -np.inf), (0, 2e4), (3, np.nan), (4, np.inf), (5, 1e30), (3, 0.0),
)  # fmt: skip


def invalid(rng: Rng, place: Place, found: Found) -> Violation | None:
    """A pose that is none among good ones: zero force, a latched fault, and the old answers once it is cleared."""
    poses = touching(rng, place.pair, POSES, -2e-3, 0.0)
    good = to_frame(place.placed.frame, poses)
    world = World(place.placed.scene, ReplayOptions())
    column, value = BAD_POSES[int(rng.integers(len(BAD_POSES)))]
    broken = good.copy()
    # A quaternion is broken for good when its largest number is.
    column = column if column < 3 else 3 + int(np.argmax(np.abs(good[POSES // 2, 3:])))
    broken[POSES // 2, column] = value
    rows = world.run(checks.path_of(broken))
    found.ticks += 2 * POSES
    found.contacts += int(np.count_nonzero(rows["areas"]))
    late = rows[POSES // 2 :]
    quiet = bool((late["faults"] != 0).all()) and not late["force_N"].any()
    lib.cr_world_clear_fault(world.handle)
    again = world.run(checks.path_of(good))
    fresh = checks.answer(place.placed, poses, ReplayOptions())
    if quiet and (again["force_N"] == fresh["force_N"]).all():
        return None
    text = "a bad pose is answered" if not quiet else "another answer after a fault was cleared"
    return Violation("fault", text, 0.0, 0.0, poses, ReplayOptions())


def frame(rng: Rng, place: Place, found: Found) -> Violation | None:
    """The same poses in the scene turned and shifted as a whole: the same force, turned."""
    poses = touching(rng, place.pair, POSES, -3e-3, 0.5e-3)
    bad, errors = checks.same_in_frames(place.pair, poses, WHOLE)
    found.ticks += 2 * POSES
    found.numbers["frame, mm"] = 1e3 * float(np.median(errors))
    found.numbers["frame max, mm"] = 1e3 * float(errors.max())
    return bad


KINDS: dict[str, tuple[Callable[[Rng, Place, Found], Violation | None], float]] = {
    "near": (near, 0.22),
    "deep": (deep, 0.12),
    "graze": (graze, 0.14),
    "step": (step, 0.16),
    "skips": (skips, 0.12),
    "extreme": (extreme, 0.08),
    "denormal": (denormal, 0.05),
    "invalid": (invalid, 0.03),
    "frame": (frame, 0.08),
}
"""Kinds of cases and how often each is drawn."""


def run_case(
    seed: tuple[int, ...], pairs: list[Pair], response: str = DEFAULT_RESPONSE
) -> tuple[str, Place, Found]:
    """One case: its kind, where it looked, and what it found.   Cost: about 5 ms.

    response: of the slow paths.
    """
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(list(KINDS), p=[share for _, share in KINDS.values()]))
    pair = pairs[int(rng.integers(len(pairs)))]
    place = Place(pair, pair.here if rng.random() < 0.5 else pair.there, response)
    found = Found()
    found.violation = KINDS[kind][0](rng, place, found) or found.violation
    if found.violation:
        found.violation = replace(found.violation, poses=np.array(found.violation.poses))
    return kind, place, found
