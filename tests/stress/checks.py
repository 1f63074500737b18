"""The truths: each function gives what is wrong with an answer, or None. Bounds are stated beside each.

Poses are those of hand size (`pool`), lengths compared are in hand size too: forces are divided by stiffness and by
the scale of the scene. What the tick gets are the poses of the scene's own frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from crease.lab.exact import Solids, exact_contact, exact_joined, overlap, world_from_tool
from crease.replay.replay import DEFAULT_RESPONSE, ReplayOptions, World, run_path
from crease.replay.trajectory import Trajectory

from stress.pool import Pair, Placed, to_frame

F64 = npt.NDArray[np.float64]
Rows = npt.NDArray[Any]

PERIOD_S = 1e-3
UNIT_ERROR = 1e-4
"""Normals and turns are of unit length to this."""

NO_LIMIT_N = 1e6
"""Largest force limit that the settings allow."""

LEAST_PIECE_M3 = 1e-12
"""Overlaps below a tenth of a millimetre cubed are left to rounding."""

JUMP_SPACINGS = 0.1
"""A force may change by this share of the spacing (times stiffness) over a motion that is next to nothing."""

LIPSCHITZ = 64.0
"""Above this many times stiffness times motion a change counts as a jump."""

BISECTIONS = 12

ROUNDED = 4.0 * 2.0**-24
"""Of a sum of 32 bits, over its largest part."""
CONVEX = ("way_out", "extent")
"""Responses of which more is known where both solids are convex."""

JOINED_SPACINGS = 2.5
"""Samples cannot tell contacts nearer than this apart: each reaches one of two samples beside each other,
whose pieces are up to 1.4 spacings across."""


@dataclass(frozen=True)
class Violation:
    """A truth that did not hold: which, what was seen, and what to replay.

    Shapes: poses (n, 7) in hand size, the fewest that show it; value and bound in the unit named in the text.
    """

    check: str
    text: str
    value: float
    bound: float
    poses: F64
    options: ReplayOptions


def path_of(poses: F64, period_s: float = PERIOD_S) -> Trajectory:
    """Poses (n, 7) in a scene's frame, a period apart."""
    times = period_s * np.arange(len(poses))
    return Trajectory(np.ascontiguousarray(np.column_stack([times, poses])), "stress")


def answer(placed: Placed, poses: F64, options: ReplayOptions, period_s: float = PERIOD_S) -> Rows:
    """Replay of hand-size poses from a fresh world."""
    return run_path(placed.scene, path_of(to_frame(placed.frame, poses), period_s), options)


def depth_vectors(placed: Placed, rows: Rows, options: ReplayOptions) -> F64:
    """Force over stiffness in hand size (n, 3), turned back to the frame of the solids."""
    world = rows["force_N"].astype(np.float64) / (options.stiffness_N_m * placed.frame.scale)
    return np.asarray(world @ placed.frame.turn)


def sound(rows: Rows, poses: F64, options: ReplayOptions) -> Violation | None:
    """Finite in every number, depth >= 0, |force| within its limit to 1e-5, unit turns, no fault."""
    limit_N = 100.0 if options.force_max_N is None else options.force_max_N
    columns = ("force_N", "torque_Nm", "depth_m", "normal", "display_pos_m", "display_rot")
    finite = np.all([np.isfinite(rows[c]).reshape(len(rows), -1).all(axis=1) for c in columns], 0)
    force_N = np.linalg.norm(rows["force_N"].astype(np.float64), axis=1)
    turn = np.linalg.norm(rows["display_rot"].astype(np.float64), axis=1)
    found = {
        "not finite": ~finite,
        "a fault at a good pose": rows["faults"] != 0,
        "negative depth": rows["depth_m"] < 0,
        "force above its limit": force_N > limit_N * (1 + 1e-5),
        "display pose not a turn": np.abs(turn - 1) > UNIT_ERROR,
        "normal not of unit length": (rows["areas"] > 0)
        & (np.abs(np.linalg.norm(rows["normal"].astype(np.float64), axis=1) - 1) > UNIT_ERROR),
    }
    for text, bad in found.items():
        if bad.any():
            i = int(np.argmax(bad))
            return Violation("sound", text, float(force_N[i]), limit_N, poses[: i + 1], options)
    return None


def bounded(placed: Placed, rows: Rows, poses: F64, options: ReplayOptions) -> Violation | None:
    """No extent is more than the tool's diameter, and no way out more than that and the static object's.

    A tool that is swallowed goes as far as there is matter, and as far again as it is long itself.
    """
    if options.response not in CONVEX or options.coverage != "soft":
        return None
    meta = placed.scene.meta
    bound_m = 2.0 * float(meta.tool_radius_m)
    if options.response == DEFAULT_RESPONSE:
        bound_m += float(
            np.linalg.norm(np.subtract(list(meta.static_max_m), list(meta.static_min_m)))
        )
    i = int(np.argmax(rows["depth_m"]))
    depth_m = float(rows["depth_m"][i])
    if depth_m <= bound_m * (1 + 1e-3):
        return None
    scale = placed.frame.scale
    text = f"depth of {1e3 * depth_m / scale:.4g} mm, at most {1e3 * bound_m / scale:.4g} mm is possible"
    return Violation("depth", text, depth_m / scale, bound_m / scale, poses[i : i + 1], options)


def _overlap_m3(solids: Solids, pose: F64) -> float:
    moved = solids.tool.transform(world_from_tool(pose))
    return float((solids.static ^ moved).volume())


def free(pair: Pair, placed: Placed, rows: Rows, poses: F64, options: ReplayOptions,
         most: int) -> Violation | None:  # fmt: skip
    """No force when the solids are apart by more than the image's measured distance error.

    The exact gap is manifold3d's; looked at for the `most` answers of least depth, where it may be.
    """
    force_N = np.linalg.norm(rows["force_N"], axis=1)
    touching = np.flatnonzero(force_N > 0)
    bound_m = 2 * placed.resolution_m + placed.rounding_m
    for i in touching[np.argsort(rows["depth_m"][touching])][:most]:
        if _overlap_m3(pair.solids, poses[i]) > 0:
            continue
        moved = pair.solids.tool.transform(world_from_tool(poses[i]))
        gap_m = float(pair.solids.static.min_gap(moved, 0.02))
        if gap_m > bound_m:
            size = float(force_N[i]) / options.stiffness_N_m / placed.frame.scale
            text = f"force of {1e3 * size:.4g} mm where the gap is {1e3 * gap_m:.4g} mm"
            return Violation("free space", text, gap_m, bound_m, poses[i : i + 1], options)
    return None


def missed(pair: Pair, placed: Placed, rows: Rows, poses: F64, options: ReplayOptions,
           most: int) -> Violation | None:  # fmt: skip
    """A force where convex solids overlap deeper than the spacing and more than half of the tool sticks out."""
    silent = np.flatnonzero(~rows["force_N"].any(axis=1))
    bound_m = placed.spacing_m + 2 * placed.resolution_m
    for i in silent[:most]:
        if _overlap_m3(pair.solids, poses[i]) > 0.5 * float(pair.solids.tool.volume()):
            continue
        depth_m = exact_contact(pair.solids, poses[i])[1]
        if depth_m > bound_m:
            text = f"no force where the overlap is {1e3 * depth_m:.4g} mm deep"
            return Violation("missed contact", text, depth_m, bound_m, poses[i : i + 1], options)
    return None


def _vector(v: Any) -> F64:
    return np.array([v.x, v.y, v.z])


def no_pull(placed: Placed, poses: F64, options: ReplayOptions) -> Violation | None:
    """Every area pushes along its own normal, out of the static object; |force x normal| < 1e-4 |force|."""
    world = World(placed.scene, options)
    for i, pose in enumerate(to_frame(placed.frame, poses)):
        out = world.tick(pose, PERIOD_S)
        for k in range(out.area_count):
            force, normal = _vector(out.areas[k].force_world_N), _vector(out.areas[k].normal_world)
            along, across = float(force @ normal), float(np.linalg.norm(np.cross(force, normal)))
            if along < 0 or across > 1e-4 * max(along, 1e-9):
                return Violation("pull", "an area does not push along its normal", along, 0.0,
                                 poses[: i + 1], options)  # fmt: skip
    return None


def no_pull_exact(
    pair: Pair, placed: Placed, rows: Rows, poses: F64, options: ReplayOptions, most: int
) -> Violation | None:
    """Convex solids: the force does not increase the overlap, F . (-grad V) >= 0, from an exact boolean.

    Only where the overlap has a way out (more than a fifth of its surface is left) and is deeper than the spacing.
    """
    force = depth_vectors(placed, rows, options)
    for i in np.flatnonzero(np.linalg.norm(force, axis=1) > 0)[:most]:
        pieces = overlap(pair.solids, poses[i])
        if len(pieces) != 1:
            continue
        a, b, c = pieces[0].corners_m.transpose(1, 0, 2)
        area = 0.5 * np.cross(b - a, c - a)
        pull = area[pieces[0].from_static].sum(axis=0)
        closed = 0.5 * float(np.linalg.norm(area, axis=1).sum())
        depth_m = exact_contact(pair.solids, poses[i])[1]
        if np.linalg.norm(pull) < 0.2 * closed or depth_m < placed.spacing_m:
            continue
        cosine = float(force[i] @ pull / (np.linalg.norm(force[i]) * np.linalg.norm(pull)))
        if cosine < 0:
            return Violation("pull", f"force {np.degrees(np.arccos(cosine)):.0f} deg from the way out",
                             cosine, 0.0, poses[i : i + 1], options)  # fmt: skip
    return None


def same_without_skips(
    placed: Placed, rows: Rows, poses: F64, options: ReplayOptions, skip: int
) -> Violation | None:
    """The same bits with other skips of detection."""
    other = answer(placed, poses, replace(options, skip=skip))
    for column in ("force_N", "torque_Nm", "depth_m", "normal", "contacts"):
        bad = (rows[column] != other[column]).reshape(len(rows), -1).any(axis=1)
        bad &= (rows["overflow"] == 0) & (other["overflow"] == 0)
        if bad.any():
            i = int(np.argmax(bad))
            gone = depth_vectors(placed, rows[i : i + 1], options)
            gone = gone - depth_vectors(placed, other[i : i + 1], options)
            return Violation("skipping", f"{column} is not the same with skip {skip}",
                             float(np.linalg.norm(gone)), 0.0, poses[: i + 1], replace(options, skip=skip))  # fmt: skip
    return None


def same_stiffness(
    placed: Placed, poses: F64, options: ReplayOptions, stiffness_N_m: float
) -> Violation | None:
    """Force is stiffness times a length that does not depend on it, to 1e-5.

    Where contacts oppose each other what is left of them has their rounding: so much of the deepest's push.
    """
    unlimited = replace(options, force_max_N=NO_LIMIT_N, damping_Ns_m=0.0)
    one = depth_vectors(placed, answer(placed, poses, unlimited), unlimited)
    stiff = replace(unlimited, stiffness_N_m=stiffness_N_m)
    rows = answer(placed, poses, stiff)
    other = depth_vectors(placed, rows, stiff)
    size = np.linalg.norm(one, axis=1)
    rounding = ROUNDED * rows["depth_m"].astype(np.float64) / placed.frame.scale
    bad = (np.linalg.norm(one - other, axis=1) > 1e-5 * size + rounding) & (
        size * stiffness_N_m * placed.frame.scale < 0.99 * NO_LIMIT_N
    )
    if bad.any():
        i = int(np.argmax(bad))
        return Violation("stiffness", f"another length at {stiffness_N_m:g} N/m",
                         float(np.linalg.norm(other[i])), float(size[i]), poses[i : i + 1], stiff)  # fmt: skip
    return None


def _between(a: F64, b: F64, count: int) -> F64:
    """Poses from a to b (7,), count of them; turns are small."""
    s = np.linspace(0.0, 1.0, count)[:, None]
    poses = a + s * (b - a)
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return np.asarray(poses)


def _of_joining(pair: Pair, placed: Placed, pose: F64) -> float:
    """How far the exact force jumps when the pieces of overlap that samples cannot tell apart meet, m."""
    apart = exact_contact(pair.solids, pose)[0]
    joined = exact_joined(pair.solids, pose, JOINED_SPACINGS * placed.spacing_m)
    return float(np.linalg.norm(joined - apart))


def continuity(
    pair: Pair, placed: Placed, poses: F64, options: ReplayOptions
) -> tuple[Violation | None, float]:
    """No jump along a path: halve the step where the force changes most, again and again, and the change must go.

    The larger half of a step holds at least half of the change, so a force with |dF| <= L k |dx| ends at L k dx / 2^n,
    and a jump of J ends at J however often. Violated when the change over the last step (BISECTIONS halvings)
    exceeds the sum of: JUMP_SPACINGS of the spacing; twice the largest distance error that the bake measured
    (neighbouring cells of the voxmap may disagree by that); LIPSCHITZ times motion and rounding; twice the change
    of the exact force over the same step; and where the number of answers changes, how far the exact force jumps when
    pieces of overlap that are JOINED_SPACINGS apart or less become one: samples join them that much earlier.
    Output: the violation, and the jump over k in m, for the statistics.
    """
    unlimited = replace(options, force_max_N=NO_LIMIT_N, damping_Ns_m=0.0)
    force = depth_vectors(placed, answer(placed, poses, unlimited), unlimited)
    i = int(np.argmax(np.linalg.norm(np.diff(force, axis=0), axis=1)))
    a, b = poses[i], poses[i + 1]
    for _ in range(BISECTIONS // 2):
        step = _between(a, b, 5)
        force = depth_vectors(placed, answer(placed, step, unlimited), unlimited)
        i = int(np.argmax(np.linalg.norm(np.diff(force, axis=0), axis=1)))
        a, b = step[i], step[i + 1]
    ends = np.array([a, b])
    rows = answer(placed, ends, unlimited)
    force = depth_vectors(placed, rows, unlimited)
    jump_m = float(np.linalg.norm(force[1] - force[0]))
    reach_m = float(placed.scene.meta.tool_radius_m) / placed.frame.scale
    motion_m = float(np.linalg.norm(b[:3] - a[:3]) + 2 * np.linalg.norm(b[3:] - a[3:]) * reach_m)
    bound_m = JUMP_SPACINGS * placed.spacing_m + 2 * placed.resolution_m
    bound_m += LIPSCHITZ * (motion_m + placed.rounding_m)
    if jump_m <= bound_m:
        return None, jump_m
    exact = [exact_contact(pair.solids, pose)[0] for pose in ends]
    exact_m = float(np.linalg.norm(exact[1] - exact[0]))
    bound_m += 2 * exact_m
    parted = rows["areas"][0] != rows["areas"][1]
    if parted and jump_m > bound_m:
        bound_m += max(_of_joining(pair, placed, pose) for pose in ends)
    if jump_m <= bound_m:
        return None, jump_m
    text = (
        f"jump of {1e3 * jump_m:.4g} mm over a motion of {1e6 * motion_m:.3g} um, "
        f"{100 * jump_m / np.linalg.norm(force, axis=1).max():.2g} % of the force, "
        f"areas {rows['areas'][0]} and {rows['areas'][1]}"
    )
    name = "continuity where areas merge or part" if parted else "continuity"
    return Violation(name, text, jump_m, bound_m, ends, unlimited), jump_m


def same_in_frames(pair: Pair, poses: F64, options: ReplayOptions) -> tuple[Violation | None, F64]:
    """The same force in a scene that is turned and shifted as a whole.

    Voxels and samples lie elsewhere there, so the two differ by what the images are worth. Violated when the
    median over the poses exceeds the sum of both images' measured distance errors and rounding (times LIPSCHITZ), or
    one pose the spacing, eight times that error and what pieces of overlap that samples cannot tell apart make of it.
    Output: the violation; the difference of each pose over stiffness, (n,), hand size.
    """
    unlimited = replace(options, force_max_N=NO_LIMIT_N, damping_Ns_m=0.0)
    both = [
        depth_vectors(p, answer(p, poses, unlimited), unlimited) for p in (pair.here, pair.there)
    ]
    errors = np.asarray(np.linalg.norm(both[0] - both[1], axis=1))
    worth_m = pair.here.resolution_m + pair.there.resolution_m
    middle_m = worth_m + LIPSCHITZ * (pair.here.rounding_m + pair.there.rounding_m)
    if float(np.median(errors)) > middle_m:
        text = f"median difference of {1e3 * float(np.median(errors)):.4g} mm between two frames"
        return Violation(
            "frame", text, float(np.median(errors)), middle_m, poses, unlimited
        ), errors
    bound_m = pair.here.spacing_m + 8 * middle_m
    for i in np.argsort(errors)[::-1][: np.count_nonzero(errors > bound_m)]:
        own_m = bound_m + _of_joining(pair, pair.here, poses[i])
        if errors[i] > own_m:
            text = f"difference of {1e3 * errors[i]:.4g} mm between two frames"
            text += f" at a force of {1e3 * float(np.linalg.norm(both[0][i])):.4g} mm"
            bad = Violation("frame", text, float(errors[i]), own_m, poses[i : i + 1], unlimited)
            return bad, errors
    return None, errors
