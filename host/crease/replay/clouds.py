"""Contact points and contact areas as point clouds of ROS 2, tick by tick."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.attitude import to_matrix
from crease.base.native import COVERAGES, RESPONSES
from crease.base.scene import Scene
from crease.replay.cdr import Message
from crease.replay.contacts import NO_PATCH, find_areas, find_contacts, tool_samples_m
from crease.replay.recording import Recording
from crease.replay.replay import ReplayOptions
from crease.replay.trajectory import Trajectory, check_rows

CLOUD = "sensor_msgs/msg/PointCloud2"
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("area", "<u4"), ("patch", "<i4")])
"""A sample of the tool in contact: where, m; number of its area, the same while it lasts; patch, -1: none."""
AREA = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "fx", "fy", "fz", "nx", "ny", "nz", "depth")]
)
"""A contact area: where its force acts, m; the force, N; its normal; depth, m."""

_TYPES = {"<f4": 7, "<u4": 6, "<i4": 5}
"""FLOAT32, UINT32, INT32 of sensor_msgs/PointField."""

Encode = Callable[[int, int], bytes]


def cloud(points: npt.NDArray[Any], time_ns: int, frame: str) -> bytes:
    """A structured array as sensor_msgs/PointCloud2."""
    kind = points.dtype
    message = Message().header(time_ns, frame).uint32(1, len(points), len(kind.names or ()))
    for name in kind.names or ():
        field, offset = kind.fields[name][:2]  # type: ignore[index]
        message.string(name).uint32(offset).uint8(_TYPES[field.str]).uint32(1)
    message.uint8(0).uint32(kind.itemsize, kind.itemsize * len(points))
    return message.octets(points.tobytes()).uint8(1).done()


def contact_topics(
    scene: Scene, path: Trajectory, options: ReplayOptions, counts: npt.NDArray[Any] | None = None
) -> dict[str, tuple[str, Encode]]:
    """What a path touches: `/contact/points`, the samples inside, and `/contact/areas`, with their forces.

    counts: areas of each tick as they were answered, (n,); a tick of none stays empty.   Errors: SceneError.
    Cost: that of the ticks, twice.
    """
    world = "world"
    areas = find_areas(scene, path, options)
    contacts = find_contacts(scene, path, options)
    samples_m, turns = tool_samples_m(scene), to_matrix(path.rows[:, 4:])
    starts = np.concatenate([[0], np.cumsum(contacts.ticks["changes"], dtype=np.int64)])
    state = np.zeros(len(samples_m), [("area", "<u4"), ("patch", "<i4")])
    at = -1

    def points(i: int, time_ns: int) -> bytes:
        nonlocal at
        if i < at:
            raise ValueError("ticks come in order")
        while at < i:
            at += 1
            for change in contacts.changes[starts[at] : starts[at + 1]]:
                patch = -1 if change["patch"] == NO_PATCH else int(change["patch"])
                state[int(change["sample"])] = (change["area"], patch)
        touching = np.flatnonzero(state["area"])
        touching = touching[:0] if counts is not None and not counts[i] else touching
        out = np.zeros(len(touching), POINT)
        place_m = samples_m[touching] @ turns[i].T + path.position_m[i]
        (out["x"], out["y"], out["z"]) = place_m.T
        out["area"], out["patch"] = state["area"][touching], state["patch"][touching]
        return cloud(out, time_ns, world)

    def touched(i: int, time_ns: int) -> bytes:
        found = areas.of(i)
        found = found[:0] if counts is not None and not counts[i] else found
        out = np.zeros(len(found), AREA)
        for names, field in (
            (("x", "y", "z"), "point_m"),
            (("fx", "fy", "fz"), "force_N"),
            (("nx", "ny", "nz"), "normal"),
        ):
            for k, name in enumerate(names):
                out[name] = found[field][:, k]
        out["depth"] = found["depth_m"]
        return cloud(out, time_ns, world)

    return {"/contact/points": (CLOUD, points), "/contact/areas": (CLOUD, touched)}


def path_of_recording(recording: Recording) -> Trajectory:
    """The poses of a recording; before the first and where none came, the last one known.   Errors: TrajectoryError."""
    rows = recording.rows
    quaternion = rows["quaternion"].astype(np.float64)
    known = np.flatnonzero(np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) < 1e-3)
    which = (
        known[np.maximum(np.searchsorted(known, np.arange(len(rows)), "right") - 1, 0)]
        if len(known)
        else None
    )
    pose = np.zeros((len(rows), 8))
    pose[:, 0] = 1e-9 * (rows["sync_ns"] - rows["sync_ns"][0]).astype(np.float64)
    pose[:, 4] = 1.0
    if which is not None:
        pose[:, 1:4], pose[:, 4:] = rows["position_m"][which], quaternion[which]
    return check_rows(pose, recording.source)


def options_of_recording(recording: Recording) -> ReplayOptions:
    """The settings of the world that a recording was made with."""
    config = recording.config.world
    responses = {number: name for name, number in RESPONSES.items()}
    coverages = {number: name for name, number in COVERAGES.items()}
    return ReplayOptions(
        float(config.stiffness_N_m),
        float(config.damping_Ns_m),
        responses[int(config.response)],
        coverages[int(config.coverage)],
        float(config.force_max_N),
    )
