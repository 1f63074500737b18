"""The loop in real time, in a thread of its own: one tick a millisecond, whatever the page does."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from crease.base.errors import CreaseError, LoopError
from crease.base.scene import Scene
from crease.loop.call import Felt, Loop
from crease.loop.loop import NORMAL_GRIP, Hand
from crease.replay.contacts import Watcher
from crease.replay.recording import mode_names
from crease.replay.replay import DEFAULT_RESPONSE, ReplayOptions
from crease.replay.trajectory import Trajectory

F64 = npt.NDArray[np.float64]

PERIOD_S = 1e-3
NAP_S = 1e-3
LATE_TICKS = 250
"""Later than this and the ticks are given up and counted: the machine stood still, and a hand would have noticed."""
HAND_STEP_M = 0.3e-3
"""How far the hand's wish moves in a tick at most, 0.3 m/s: a mouse leaps, a hand does not."""
TRACE_TICKS = 4000
"""Kept for a page that comes late."""


@dataclass
class Counts:
    """Of a session.   late_max_ms: how far the ticks were behind the clock at the worst."""

    ticks: int = 0
    lost: int = 0
    late_max_ms: float = 0.0
    restarts: int = 0
    refused: int = 0
    """Wishes of the hand that the device does not reach."""
    why: list[str] = field(default_factory=list)
    """The faults that made the last restart."""


def rest_position_m(scene: Scene) -> F64:
    """Where a tool begins that no path leads: above the middle of the mock-up, clear of it by half the tool, (3,)."""
    meta = scene.meta
    low, high = (np.array(list(v), np.float64) for v in (meta.static_min_m, meta.static_max_m))
    reach_m = float(meta.root_radius_m) + float(np.linalg.norm(list(meta.root_centre_m)))
    return np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), high[2] + 1.5 * reach_m])


class Session:
    """A loop, its clock, and what it did last. `hand_m` and `view` may be called from another thread.

    path: the hand follows it, round and round, until somebody leads it; None: the hand waits above the mock-up.
    """

    def __init__(
        self,
        scene: Scene,
        path: Trajectory | None = None,
        *,
        stiffness: float = 1000.0,
        response: str = DEFAULT_RESPONSE,
        hand: Hand = NORMAL_GRIP,
    ) -> None:
        """Errors: CreaseError when the device refuses a setting or does not come up."""
        self.scene = scene
        self.counts = Counts()
        self._path = path
        start_m = rest_position_m(scene) if path is None else path.position_m[0]
        attitude = np.array([1.0, 0.0, 0.0, 0.0]) if path is None else path.rows[0, 4:]
        self._home = np.concatenate([start_m, attitude])
        self._pose = self._home.copy()
        self._wish_m: F64 | None = None
        self._led = path is None
        self._at = 0
        self.loop = Loop(
            scene,
            stiffness=stiffness,
            response=response,
            hand=hand,
            at=start_m if path is None else None,
            keep=False,
        )
        self.loop.start(self._home)
        self._watcher = Watcher(scene, ReplayOptions(stiffness_N_m=stiffness, response=response))
        self._lock = threading.Lock()
        self._last = self.loop.hold(1)
        self._trace: deque[tuple[float, float, float, float]] = deque(maxlen=TRACE_TICKS)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="loop", daemon=True)
        self.trouble: CreaseError | None = None

    @property
    def home_m(self) -> F64:
        """Where the tool began, (3,)."""
        return self._home[:3]

    def start(self) -> None:
        """Begin to tick."""
        self._thread.start()

    def stop(self) -> None:
        """Let the running ticks end.   Errors: the CreaseError that ended the loop before."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        if self.trouble is not None:
            raise self.trouble

    def hand_m(self, position_m: F64 | None) -> None:
        """Where the hand wants the tool's origin from now on, (3,) m; None: back to the start, or on the path."""
        with self._lock:
            self._led = position_m is not None or self._path is None
            self._wish_m = self._home[:3].copy() if position_m is None else position_m

    def view(self) -> dict[str, Any]:
        """The last tick for a page: SI units, world frame. `trace`: what came since the last view."""
        with self._lock:
            last, counts = self._last, self.counts
            trace, wish = list(self._trace), self._pose[:3].tolist()
            self._trace.clear()
        row = last.rows[-1]
        pose = np.concatenate([row["position_m"], row["quaternion"]]).astype(np.float64)
        seen = self._watcher.see(pose)
        return {
            "ticks": counts.ticks,
            "lost": counts.lost,
            "late_max_ms": round(counts.late_max_ms, 2),
            "restarts": counts.restarts,
            "why": counts.why,
            "refused": counts.refused,
            "mode": mode_names()[int(row["mode"])],
            "position_m": _short(row["position_m"], 7),
            "quaternion": _short(row["quaternion"], 7),
            "hand_m": _short(wish, 7),
            "force_N": _short(row["force_N"], 4),
            "contact_N": _short(row["contact_force_N"], 4),
            "torque_Nm": _short(row["contact_torque_Nm"], 6),
            "depth_m": round(float(row["depth_m"]), 7),
            "areas": [_short([area[n] for n in _AREA], 5) for area in seen.areas],
            "zones": [[int(z["patch"]), *_short([z[n] for n in _ZONE], 5)] for z in seen.zones],
            "samples": seen.samples.tolist(),
            "point_m": _short(seen.point_m, 6),
            "trace": [_short(part, 5) for part in trace],
        }

    def _run(self) -> None:
        try:
            start_s = time.perf_counter()
            while not self._stop.is_set():
                late = int((time.perf_counter() - start_s) / PERIOD_S) - self.counts.ticks
                late -= self.counts.lost
                if late <= 0:
                    time.sleep(NAP_S)
                    continue
                self.counts.late_max_ms = max(self.counts.late_max_ms, 1e3 * PERIOD_S * (late - 1))
                if late > LATE_TICKS:
                    self.counts.lost += late - 1
                    late = 1
                self._tick(late)
                if self.loop.faults:
                    self._restart()
                    start_s = time.perf_counter() - PERIOD_S * (
                        self.counts.ticks + self.counts.lost
                    )
        except CreaseError as error:
            self.trouble = error

    def _tick(self, count: int) -> None:
        with self._lock:
            poses = self._poses(count)
        try:
            felt = self.loop.run(poses)
        except LoopError:
            self.counts.refused += 1
            felt = self.loop.hold(count)
        else:
            self._pose = poses[-1]
        with self._lock:
            self._last = felt
            self.counts.ticks += len(felt)
            self._trace.extend(_trace(felt))

    def _poses(self, count: int) -> F64:
        """What the hand wants in the next ticks, (count, 7)."""
        if not self._led and self._path is not None:
            rows = (self._at + np.arange(count)) % len(self._path)
            self._at = int(rows[-1]) + 1
            wished = self._path.rows[rows, 1:]
            if np.linalg.norm(wished[0, :3] - self._pose[:3]) <= 2.0 * HAND_STEP_M:
                return wished
            self._at -= count  # first back to where the path goes on
            return self._towards(wished[0, :3], count)
        return self._towards(self._pose[:3] if self._wish_m is None else self._wish_m, count)

    def _towards(self, wish_m: F64, count: int) -> F64:
        poses = np.tile(self._pose, (count, 1))
        way = wish_m - self._pose[:3]
        far_m = float(np.linalg.norm(way))
        if far_m > 0.0:
            steps = np.minimum(HAND_STEP_M * np.arange(1, count + 1), far_m)
            poses[:, :3] += (steps / far_m)[:, None] * way
        return poses

    def _restart(self) -> None:
        """After a fault: off, on, and the hand at the start."""
        self.counts.why = self.loop.faults
        self.counts.restarts += 1
        self.loop.reset()
        self.loop.start(self._home)
        felt = self.loop.hold(1)
        with self._lock:
            self._last = felt
            self._pose, self._at = self._home.copy(), 0
            self._wish_m = None


_AREA = ("point_m", "force_N", "normal", "depth_m")
_ZONE = ("centre_m", "normal", "area_m2", "share")


def _trace(felt: Felt) -> list[tuple[float, float, float, float]]:
    """Force of the contact, force at the hand, N, depth, mm, and time, s, of every tick."""
    sizes = (np.linalg.norm(v, axis=1) for v in (felt.contact_force_N, felt.force_N))
    return list(
        zip(
            felt.t_s.tolist(),
            *(s.tolist() for s in sizes),
            (1e3 * felt.depth_m).tolist(),
            strict=True,
        )
    )


def _short(values: Any, digits: int) -> list[float]:
    """Numbers, flat, with as many digits as a picture shows."""
    return [round(float(v), digits) for part in values for v in np.ravel(part)]
