"""The measures of accuracy and smoothness: one definition each, used by benchmarks, tests and plots.

Conventions: force_N (n, 3) over consecutive ticks; exact values beside them in the same frame; stiffness in N/m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfiltfilt

from crease.base.attitude import to_matrix

F64 = npt.NDArray[np.float64]

DEEP_M = 0.2e-3
"""Directions are compared where the exact contact is deeper than this and its force larger than k times this: two
opposite areas may cancel."""
FREE_FALL_N = 1e-9
BUZZ_HZ = (20.0, 250.0)
"""What a hand feels as buzz: below is the motion that the hand itself makes, above what the handle's mass swallows."""
BUZZ_WINDOW_S = 0.1


def angle_deg(a: F64, b: F64) -> F64:
    """Angle between rows of a and b (n, 3), exact for small angles; 0 where a row is zero."""
    cross = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.degrees(np.arctan2(cross, np.einsum("nx,nx->n", a, b))))


def motion_m(position_m: F64, quaternion: F64, corners_m: F64) -> F64:
    """Largest displacement of any point of the tool from each tick to the next.

    Shapes: position_m (n, 3), quaternion (n, 4) scalar first, corners_m (m, 3) of a box round the tool;
    result (n - 1,).
    """
    points = np.einsum("nab,mb->nma", to_matrix(quaternion), corners_m) + position_m[:, None, :]
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1))


def amplification(force_N: F64, stiffness_N_m: float, moved_m: F64) -> float:
    """Largest |dF| / (k |dx|) over the ticks that move: the stiffness the loop really sees, as a share of k."""
    step = np.linalg.norm(np.diff(force_N, axis=0), axis=1)
    moving = moved_m > 1e-9
    return float((step[moving] / (stiffness_N_m * moved_m[moving])).max(initial=0.0))


def direction_steps_deg(force_N: F64, counts: npt.NDArray[np.bool_]) -> F64:
    """Turn of the force from each tick to the next, (n - 1,); 0 where either tick does not count."""
    turn = angle_deg(force_N[:-1], force_N[1:])
    return np.where(counts[:-1] & counts[1:], turn, 0.0)


def buzz_band_m_s2(acceleration: F64, period_s: float = 1e-3) -> F64:
    """The handle's acceleration in 20..250 Hz, (n, 3).

    A Butterworth band-pass of fourth order, forwards and backwards, so without delay. A filter, not a spectrum: what
    the hand does slowly does not leak into the band at the ends of the run.
    """
    if len(acceleration) < 64:
        return np.zeros_like(acceleration)
    sos = butter(4, BUZZ_HZ, "bandpass", fs=1.0 / period_s, output="sos")
    return np.asarray(sosfiltfilt(sos, acceleration, axis=0))


def buzz_m_s2(
    acceleration: F64, counts: npt.NDArray[np.bool_] | None = None, period_s: float = 1e-3
) -> float:
    """RMS of the handle's acceleration in 20..250 Hz over the ticks that count (n,), m/s^2; all three axes together."""
    square = (buzz_band_m_s2(acceleration, period_s) ** 2).sum(axis=1)
    chosen = square if counts is None else square[counts]
    return float(np.sqrt(chosen.mean())) if len(chosen) else 0.0


def buzz_worst_m_s2(
    acceleration: F64, counts: npt.NDArray[np.bool_] | None = None, period_s: float = 1e-3
) -> float:
    """The same over the worst 0.1 s whose middle counts: a kick shows, however long the rest is quiet."""
    square = (buzz_band_m_s2(acceleration, period_s) ** 2).sum(axis=1)
    width = round(BUZZ_WINDOW_S / period_s)
    mean = np.convolve(square, np.full(width, 1.0 / width), "same")
    return float(np.sqrt((mean if counts is None else mean[counts]).max(initial=0.0)))


def force_steps(force_N: F64, floor_N: float) -> F64:
    """|dF| from each tick to the next as a share of the force, (n - 1,); 0 where the larger one is below floor_N."""
    size = np.linalg.norm(force_N, axis=1)
    larger = np.maximum(size[1:], size[:-1])
    step = np.linalg.norm(np.diff(force_N, axis=0), axis=1)
    return np.where(larger > floor_N, step / np.maximum(larger, 1e-12), 0.0)


def loop_energy(force_N: F64, position_m: F64, stiffness_N_m: float) -> float:
    """Work of the contact on the operator over a closed path, as a share of the largest energy stored in it.

    Shapes: (n, 3), both at the same ticks; free of contact at both ends, where the path closes without force. Positive:
    the contact gives energy away; 0: a spring; a damper takes some. Stored energy: F^2 / 2k. 0 without contact.
    """
    work_J = float((0.5 * (force_N[1:] + force_N[:-1]) * np.diff(position_m, axis=0)).sum())
    stored_J = float((force_N**2).sum(axis=1).max(initial=0.0)) / (2.0 * stiffness_N_m)
    return work_J / stored_J if stored_J > 0.0 else 0.0


def torque_error_m(torque_Nm: F64, exact_Nm: F64, stiffness_N_m: float, radius_m: float) -> F64:
    """|torque - exact| / (k R), (n,), in m: the wrong force at the tool's rim that twists it as much, over k.

    Shapes: torques (n, 3) about the tool origin, in one frame. R: radius of the sphere about the tool origin that holds
    the tool; with it a long tool is not judged harder than a short one, and errors of torque and force compare.
    """
    return np.asarray(
        np.linalg.norm(torque_Nm - exact_Nm, axis=1) / (stiffness_N_m * radius_m), np.float64
    )


@dataclass(frozen=True)
class Felt:
    """What a tool feels along a path: force_N (n, 3), depth_m (n,), torque_Nm (n, 3) about its origin or None."""

    force_N: F64
    depth_m: F64
    torque_Nm: F64 | None = None


@dataclass(frozen=True)
class Accuracy:
    """A replay against the exact reference. Lengths in mm, angles in degrees; torque over stiffness and tool radius."""

    force_rms_mm: float
    force_max_mm: float
    direction_p99_deg: float
    direction_max_deg: float
    depth_rms_mm: float
    depth_max_mm: float
    torque_rms_mm: float
    torque_max_mm: float
    amplification: float
    amplification_exact: float
    step_max_deg: float
    step_exact_deg: float
    ticks: int


def compare(
    felt: Felt, exact: Felt, stiffness_N_m: float, radius_m: float, moved_m: F64
) -> Accuracy:
    """Every measure of one replay against its exact values at the same ticks.

    Shapes: moved_m (n - 1,). radius_m: of the tool, see `torque_error_m`. Torques are NaN where either side has none.
    """
    contact = (exact.depth_m > 0) | (felt.depth_m > 0)
    exact_N = exact.force_N
    deep = (exact.depth_m > DEEP_M) & (np.linalg.norm(exact_N, axis=1) > stiffness_N_m * DEEP_M)
    force_mm = np.linalg.norm(felt.force_N - exact_N, axis=1) / stiffness_N_m * 1e3
    depth_mm = np.abs(felt.depth_m - exact.depth_m) * 1e3
    torque_mm = np.full(len(force_mm), np.nan)
    if felt.torque_Nm is not None and exact.torque_Nm is not None:
        torque_mm = 1e3 * torque_error_m(felt.torque_Nm, exact.torque_Nm, stiffness_N_m, radius_m)
    turn = angle_deg(felt.force_N, exact_N)[deep]
    return Accuracy(
        _rms(force_mm[contact]),
        float(force_mm.max(initial=0.0)),
        float(np.percentile(turn, 99)) if len(turn) else 0.0,
        float(turn.max(initial=0.0)),
        _rms(depth_mm[contact]),
        float(depth_mm.max(initial=0.0)),
        _rms(torque_mm[contact]),
        float(torque_mm.max(initial=0.0)),
        amplification(felt.force_N, stiffness_N_m, moved_m),
        amplification(exact_N, stiffness_N_m, moved_m),
        float(direction_steps_deg(felt.force_N, deep).max(initial=0.0)),
        float(direction_steps_deg(exact_N, deep).max(initial=0.0)),
        int(contact.sum()),
    )


def _rms(values: F64) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) else 0.0
