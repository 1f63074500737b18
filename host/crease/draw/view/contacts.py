"""Contact areas and zones of every tick of a path: the ticks run again, and what each sample touches is read out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.bake.layout import CLUSTER, LANES
from crease.base.errors import SceneError
from crease.base.native import ffi, lib
from crease.base.records import record
from crease.base.scene import Scene
from crease.replay.replay import ReplayOptions, World
from crease.replay.trajectory import Trajectory

CHANGE, ZONE, TICK = record("crv_change"), record("crv_zone"), record("crv_tick")
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


def tool_samples_m(scene: Scene) -> npt.NDArray[np.float64]:
    """Samples of the tool, tool frame, (n, 3), without the unused lanes."""
    clusters = _clusters(scene)
    used = np.arange(LANES) < clusters["count"][:, None]
    return np.stack([clusters[axis][used] for axis in "xyz"], axis=1).astype(np.float64)


def _clusters(scene: Scene) -> npt.NDArray[Any]:
    size = int(scene.handle.cluster_count) * CLUSTER.itemsize
    return np.frombuffer(ffi.buffer(scene.handle.clusters, size), CLUSTER)


METHODS = (
    ReplayOptions(),
    ReplayOptions(response="extent"),
    ReplayOptions(response="extent", coverage="hard"),
)
"""Responses that part contact into areas and zones in their own way: the way out, contact zones soft and hard."""


def find_contacts(scene: Scene, path: Trajectory, options: ReplayOptions) -> Contacts:
    """Areas and zones along a path, as one of METHODS has them. They do not depend on stiffness or damping.

    Errors: SceneError when memory runs out.   Cost: that of the ticks, about 10 us each.
    """
    world = World(scene, options)
    watch = ffi.gc(lib.crv_watch_new(world.handle, scene.handle), lib.crv_watch_free)
    if watch == ffi.NULL:
        raise SceneError(f"{scene.source}: no memory for the contacts of its tool")
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


def _renumber(scene: Scene, changes: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Samples counted without the unused lanes of the clusters."""
    used = (np.arange(LANES) < _clusters(scene)["count"][:, None]).reshape(-1)
    changes["sample"] = (np.cumsum(used) - 1)[changes["sample"]]
    return changes
