"""Contact areas and zones of every tick of a path: the ticks run again, and what each touches is read out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.bake.layout import CLUSTER, LANES
from crease.base.errors import SceneError
from crease.base.native import ffi, lib
from crease.base.records import record
from crease.base.scene import Scene
from crease.replay.replay import DEFAULT_RESPONSE, ReplayOptions, World, refuse_coupled
from crease.replay.trajectory import Trajectory

CHANGE, ZONE, TICK = record("crv_change"), record("crv_zone"), record("crv_tick")
AREA = record("crv_area")
"""Of host/native/contacts.h."""

NO_PATCH = int(lib.CRV_PATCH_NONE)

_CHUNK = 1024


@dataclass(frozen=True)
class Contacts:
    """What a path touches.

    Shapes: ticks TICK (n,); changes CHANGE (sum of ticks["changes"],) and zones ZONE (sum of ticks["zones_stored"],),
    tick after tick. The sample of a change is an index into `samples_m`.
    """

    ticks: npt.NDArray[Any]
    changes: npt.NDArray[Any]
    zones: npt.NDArray[Any]


@dataclass(frozen=True)
class Areas:
    """The contact areas along a path.   Shapes: counts (n,); areas AREA (sum of counts,), tick after tick."""

    counts: npt.NDArray[np.uint32]
    areas: npt.NDArray[Any]

    def of(self, tick: int) -> npt.NDArray[Any]:
        """The areas of one tick."""
        view: npt.NDArray[Any] = self.areas[self.starts[tick] : self.starts[tick + 1]]
        return view

    @cached_property
    def starts(self) -> npt.NDArray[np.int64]:
        """Where the areas of each tick begin, (n + 1,)."""
        return np.concatenate([[0], np.cumsum(self.counts, dtype=np.int64)])


def find_areas(scene: Scene, path: Trajectory, options: ReplayOptions) -> Areas:
    """Where a path touches, and the force that each area gives.   Errors: SceneError.   Cost: that of the ticks."""
    refuse_coupled(options, "a list of areas")
    world = World(scene, options)
    ffi, lib = world.native.ffi, world.native.lib
    counts = np.zeros(len(path), np.uint32)
    areas = np.zeros(int(lib.CR_AREAS_MAX) + 64 * _CHUNK, AREA)
    count_rows = ffi.from_buffer("uint32_t[]", counts, require_writable=True)
    area_rows = ffi.from_buffer("crv_area[]", areas, require_writable=True)
    poses = ffi.from_buffer("cr_path_row[]", path.rows)
    found: list[npt.NDArray[Any]] = [areas[:0].copy()]
    at = 0
    while at < len(path):
        before_s = path.t_s[at] - path.t_s[at - 1] if at else path.first_period_s
        left = min(_CHUNK, len(path) - at)
        done = int(
            lib.crv_areas_run(
                *(world.handle, poses + at, left, float(before_s), count_rows + at),
                *(area_rows, len(areas)),
            )
        )
        found.append(areas[: int(counts[at : at + done].sum())].copy())
        at += done
    return Areas(counts, np.concatenate(found))


def find_held(scene: Scene, path: Trajectory, options: ReplayOptions) -> tuple[Contacts, Areas]:
    """What holds a held tool along a path: each point that presses as an area of its own; no samples, no zones.

    Errors: SceneError.   Cost: that of the ticks.
    """
    world = World(scene, options)
    ticks, counts = np.zeros(len(path), TICK), np.zeros(len(path), np.uint32)
    points = np.zeros(int(lib.CRV_HELD_MAX) + 16 * _CHUNK, AREA)
    rows = [
        ffi.from_buffer(f"{kind}[]", array, require_writable=True)
        for kind, array in (("crv_tick", ticks), ("uint32_t", counts), ("crv_area", points))
    ]
    poses = ffi.from_buffer("cr_path_row[]", path.rows)
    found: list[npt.NDArray[Any]] = [points[:0].copy()]
    at = 0
    while at < len(path):
        before_s = path.t_s[at] - path.t_s[at - 1] if at else path.first_period_s
        done = int(
            lib.crv_held_run(
                *(world.coupled, world.handle, poses + at, min(_CHUNK, len(path) - at)),
                *(float(before_s), rows[0] + at, rows[1] + at, rows[2], len(points)),
            )
        )
        found.append(points[: int(counts[at : at + done].sum())].copy())
        at += done
    nothing = Contacts(ticks, np.zeros(0, CHANGE), np.zeros(0, ZONE))
    return nothing, Areas(counts, np.concatenate(found))


def tool_samples_m(scene: Scene) -> npt.NDArray[np.float64]:
    """Samples of the tool, tool frame, (n, 3), without the unused lanes."""
    clusters = _clusters(scene)
    used = np.arange(LANES) < clusters["count"][:, None]
    return np.stack([clusters[axis][used] for axis in "xyz"], axis=1).astype(np.float64)


def tool_normals(scene: Scene) -> npt.NDArray[np.float64]:
    """Outward normals of the samples of `tool_samples_m`, unit, tool frame, (n, 3); zero at corners and creases."""
    clusters = _clusters(scene)
    used = np.arange(LANES) < clusters["count"][:, None]
    features = (clusters["vertex_mask"] | clusters["crease_mask"])[:, None] >> np.arange(LANES) & 1
    areas = np.stack([clusters[axis][used] for axis in ("ax", "ay", "az")], axis=1)
    length = np.linalg.norm(areas, axis=1, keepdims=True)
    face = (features[used] == 0)[:, None] & (length > 0.0)
    return np.where(face, areas / np.where(face, length, 1.0), 0.0).astype(np.float64)


def _clusters(scene: Scene) -> npt.NDArray[Any]:
    size = int(scene.handle.cluster_count) * CLUSTER.itemsize
    return np.frombuffer(ffi.buffer(scene.handle.clusters, size), CLUSTER)


def parted_as(options: ReplayOptions) -> ReplayOptions:
    """Whose areas and zones a response is shown with: the way out has its own, rivals those of extent."""
    refuse_coupled(options, "a list of areas and zones")
    if options.response == DEFAULT_RESPONSE:
        return ReplayOptions()
    return ReplayOptions(response="extent", coverage=options.coverage)


def _watch(world: World) -> Any:
    """A `crv_watch *` of what a world touches, which has to live as long.   Errors: SceneError."""
    native = world.native
    made = native.lib.crv_watch_new(world.handle, world.own_scene)
    if made == native.ffi.NULL:
        raise SceneError(f"{world.scene.source}: no memory for the contacts of its tool")
    return native.ffi.gc(made, native.lib.crv_watch_free)


def find_contacts(scene: Scene, path: Trajectory, options: ReplayOptions) -> Contacts:
    """Areas and zones along a path, parted as `parted_as` says. They do not depend on stiffness or damping.

    Errors: SceneError when memory runs out.   Cost: that of the ticks, about 10 us each.
    """
    world = World(scene, parted_as(options))
    ffi, lib = world.native.ffi, world.native.lib
    watch = _watch(world)
    count = int(scene.handle.cluster_count)
    changes = np.zeros(2 * LANES * count + 64 * _CHUNK, CHANGE)
    zones = np.zeros(int(lib.CR_AREAS_MAX * lib.CR_ZONES_MAX) + 64 * _CHUNK, ZONE)
    ticks = np.zeros(len(path), TICK)
    tick_rows = ffi.from_buffer("crv_tick[]", ticks, require_writable=True)
    change_rows = ffi.from_buffer("crv_change[]", changes, require_writable=True)
    zone_rows = ffi.from_buffer("crv_zone[]", zones, require_writable=True)
    poses = ffi.from_buffer("cr_path_row[]", path.rows)
    found: tuple[list[npt.NDArray[Any]], list[npt.NDArray[Any]]] = ([], [])
    at = 0
    while at < len(path):
        before_s = path.t_s[at] - path.t_s[at - 1] if at else path.first_period_s
        done = int(
            lib.crv_watch_run(
                *(watch, poses + at, min(_CHUNK, len(path) - at), float(before_s), tick_rows + at),
                *(change_rows, len(changes), zone_rows, len(zones)),
            )
        )
        rows = ticks[at : at + done]
        found[0].append(changes[: int(rows["changes"].sum())].copy())
        found[1].append(zones[: int(rows["zones_stored"].sum())].copy())
        at += done
    return Contacts(ticks, _renumber(scene, np.concatenate(found[0])), np.concatenate(found[1]))


@dataclass(frozen=True)
class Seen:
    """What one pose touches.   Shapes: areas AREA (a,); zones ZONE (z,); samples (n, 2) index and patch, -1: none."""

    areas: npt.NDArray[Any]
    zones: npt.NDArray[Any]
    samples: npt.NDArray[np.int64]
    point_m: npt.NDArray[np.float32]


class Watcher:
    """What a tool touches, pose by pose, for a picture of a loop that runs elsewhere.   Errors: SceneError."""

    def __init__(self, scene: Scene, options: ReplayOptions) -> None:
        refuse_coupled(options, "a picture of what is touched")
        self._scene = scene
        self._worlds = World(scene, options), World(scene, options)
        self._watch = _watch(self._worlds[0])
        count = int(scene.handle.cluster_count)
        self._patch = np.full(LANES * count, -2, np.int64)  # -2: touches nothing
        self._number = (
            np.cumsum((np.arange(LANES) < _clusters(scene)["count"][:, None]).reshape(-1)) - 1
        )
        self._changes = np.zeros(2 * LANES * count, CHANGE)
        self._zones = np.zeros(int(lib.CR_AREAS_MAX * lib.CR_ZONES_MAX), ZONE)
        self._areas = np.zeros(int(lib.CR_AREAS_MAX), AREA)

    def see(self, pose: npt.NDArray[np.float64]) -> Seen:
        """pose: (7,).   Output: copies.   Cost: two ticks."""
        row, tick, count = np.zeros(8), np.zeros(1, TICK), np.zeros(1, np.uint32)
        row[1:] = pose
        ffi, lib = self._worlds[0].native.ffi, self._worlds[0].native.lib
        given = ffi.from_buffer("cr_path_row[]", row)

        def room(kind: str, array: npt.NDArray[Any]) -> Any:
            return ffi.from_buffer(f"{kind}[]", array, require_writable=True)

        lib.crv_watch_run(
            *(self._watch, given, 1, 1e-3, room("crv_tick", tick)),
            *(room("crv_change", self._changes), len(self._changes)),
            *(room("crv_zone", self._zones), len(self._zones)),
        )
        lib.crv_areas_run(
            *(self._worlds[1].handle, given, 1, 1e-3, room("uint32_t", count)),
            *(room("crv_area", self._areas), len(self._areas)),
        )
        changed = self._changes[: int(tick["changes"][0])]
        patch = changed["patch"].astype(np.int64)
        patch[changed["patch"] == NO_PATCH] = -1
        self._patch[changed["sample"]] = np.where(changed["area"] > 0, patch, -2)
        touching = np.flatnonzero(self._patch > -2)
        return Seen(
            self._areas[: int(count[0])].copy(),
            self._zones[: int(tick["zones_stored"][0])].copy(),
            np.column_stack([self._number[touching], self._patch[touching]]),
            tick["point_m"][0].copy(),
        )


def _renumber(scene: Scene, changes: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Samples counted without the unused lanes of the clusters."""
    used = (np.arange(LANES) < _clusters(scene)["count"][:, None]).reshape(-1)
    changes["sample"] = (np.cumsum(used) - 1)[changes["sample"]]
    return changes
