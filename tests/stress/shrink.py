"""A violation with less in it: fewer poses, and simpler solids, as long as the same check is violated."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import manifold3d
import numpy as np
import numpy.typing as npt
from crease.base.errors import MeshError
from crease.lab.exact import Solids, overlap, world_from_tool
from crease.mesh.mesh import make_mesh
from crease.replay.replay import ReplayOptions

from stress import checks
from stress.cases import Place
from stress.checks import Violation
from stress.pool import Pair, Placed, bake_placed
from stress.solids import Solid, surface_of

F64 = npt.NDArray[np.float64]


def check_again(place: Place, poses: F64, options: ReplayOptions, check: str) -> Violation | None:
    """The violation of a check in these poses, or None."""
    pair, placed = place.pair, place.placed
    if check.startswith("continuity"):
        return checks.continuity(pair, placed, poses, options)[0] if len(poses) > 1 else None
    if check == "frame":
        return checks.same_in_frames(pair, poses, options)[0]
    rows = checks.answer(placed, poses, options)
    if check == "skipping":
        plain = replace(options, skip=None)
        return checks.same_without_skips(placed, rows, poses, plain, options.skip or 0)
    if check == "free space":
        return checks.free(pair, placed, rows, poses, options, len(poses))
    if check == "missed contact":
        return checks.missed(pair, placed, rows, poses, options, len(poses))
    bad = checks.sound(rows, poses, options) or checks.no_pull(placed, poses, options)
    if pair.convex and options.response in checks.CONVEX:
        bad = bad or checks.no_pull_exact(pair, placed, rows, poses, options, len(poses))
    return bad if bad and bad.check == check else None


def shrink_poses(place: Place, bad: Violation) -> Violation:
    """The violation with its last pose alone, where that shows it too.

    The checks already name the first pose that fails; what came before matters only if the answer has a memory.
    """
    if len(bad.poses) < 3 or bad.check not in ("sound", "pull", "skipping"):
        return bad
    return check_again(place, bad.poses[-1:], bad.options, bad.check) or bad


def _place_of_contact(pair: Pair, pose: F64) -> F64:
    """Middle of the overlap, world frame; the tool's origin when there is none."""
    pieces = overlap(pair.solids, pose)
    return np.asarray(pieces[0].corners_m.mean(axis=(0, 1)) if pieces else pose[:3])


def _smaller(solid: Solid, at_m: F64) -> Iterator[Solid]:
    """The solid cut off half-way between the contact and each side of its box; a convex one also without a corner."""
    box = np.array(solid.bounding_box()).reshape(2, 3)
    for axis in range(3):
        for end, sign in zip(box, (1.0, -1.0), strict=True):
            normal = sign * np.eye(3)[axis]
            yield solid.trim_by_plane(tuple(normal), sign * 0.5 * float(end[axis] + at_m[axis]))
    points = surface_of(solid)[0]
    if solid.hull().volume() < solid.volume() * (1 + 1e-6):
        for i in range(len(points)):
            yield manifold3d.Manifold.hull_points(np.delete(points, i, axis=0))


def _rebuilt(place: Place, solids: Solids, both_frames: bool) -> Place:
    """The same place with other solids.   Errors: MeshError."""
    pair = place.pair

    def bake(placed: Placed) -> Placed:
        meshes = [make_mesh(*surface_of(s)) for s in (solids.static, solids.tool)]
        meta = placed.scene.meta
        scale = placed.frame.scale
        return bake_placed(
            meshes[0], meshes[1], placed.frame, float(meta.voxel_m) / scale,
            float(meta.spacing_m) / scale, pair.name,
        )  # fmt: skip

    placed = bake(place.placed)
    here, there = placed, placed
    if both_frames:
        other = bake(pair.there if place.placed is pair.here else pair.here)
        here, there = (placed, other) if place.placed is pair.here else (other, placed)
    return Place(Pair(pair.name, pair.convex, solids, here, there), placed)


def shrink_solids(place: Place, bad: Violation, seconds: float) -> tuple[Place, Violation]:
    """Simpler solids that show the violation too, as far as the time goes.

    Each cut or corner left out is kept when it leaves fewer triangles and the check, in a scene baked anew, is
    violated as before.   Cost: `seconds` of processor time and at most one bake more.
    """
    end_s = time.process_time() + seconds
    found = True
    while found:
        found = False
        contact = _place_of_contact(place.pair, bad.poses[-1])
        turn = world_from_tool(bad.poses[-1])
        for name, at_m in (("static", contact), ("tool", (contact - turn[:, 3]) @ turn[:, :3])):
            solid = getattr(place.pair.solids, name)
            for less in _smaller(solid, at_m):
                if time.process_time() > end_s:
                    return place, bad
                if not 0 < less.num_tri() < solid.num_tri():
                    continue
                solids = replace(place.pair.solids, **{name: less.as_original()})
                try:
                    tried = _rebuilt(place, solids, bad.check == "frame")
                except MeshError:
                    continue
                again = check_again(tried, bad.poses, bad.options, bad.check)
                if again:
                    # The poses stay: the check of a path halves its step again, to less than a table holds.
                    place, bad, found = tried, replace(again, poses=bad.poses), True
                    break
    return place, bad
