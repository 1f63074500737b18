"""Paths of the hand: positions (n, 3) in mm and attitudes, one pose a millisecond."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

Floats = NDArray[np.float64]
Path = tuple[Floats, Rotation]
Key = tuple[int, tuple[float, float, float], tuple[float, float, float]]
"""Ticks from the key before, position in mm, rotation vector in degrees."""

HANDS, HAND_TICKS = 50, 1600


def through(keys: Sequence[Key]) -> Path:
    """From key to key, at rest in each: positions on straight lines, attitudes the shorter way."""
    at = np.array([k[1] for k in keys], float)
    turns = Rotation.from_rotvec(np.radians([k[2] for k in keys]))
    ends = np.cumsum([k[0] for k in keys])
    ticks = np.arange(ends[0], ends[-1] + 1)
    leg = np.clip(np.searchsorted(ends, ticks, side="right") - 1, 0, len(keys) - 2)
    s = (ticks - ends[leg]) / (ends[leg + 1] - ends[leg])
    s = s * s * (3.0 - 2.0 * s)
    found = at[leg] + s[:, None] * (at[leg + 1] - at[leg])
    return found, Slerp(np.arange(len(keys)), turns)(leg + s)


def drawn(inset_mm: float) -> Path:
    """Of the middle of a cylinder R 10 mm round the cube: up its left side, over both edges and down, inset_mm deep."""
    side, r = 20.0, 10.0 - inset_mm
    quarter = np.linspace(0.0, 0.5 * np.pi, 400)[:, None]
    up = np.column_stack([np.full(400, -side - r), np.linspace(-20.0, 0.0, 400)])
    left = np.hstack([-side - r * np.cos(quarter), r * np.sin(quarter)])
    over = np.column_stack([np.linspace(-side, side, 500), np.full(500, r)])
    down = np.column_stack([np.full(400, side + r), np.linspace(0.0, -20.0, 400)])
    right = np.hstack([side + r * np.sin(quarter), r * np.cos(quarter)])
    begin = np.column_stack([np.linspace(-side - 11.0, -side - r, 200), np.full(200, -20.0)])
    xz = np.concatenate([begin, up, left, over, right, down])
    at = np.column_stack([xz[:, 0], np.zeros(len(xz)), xz[:, 1]])
    return at, Rotation.from_rotvec(np.zeros((len(xz), 3)))


def hands(seed: int = 14) -> tuple[Floats, Floats]:
    """Targets of hands that put the peg in: 50, off by 2 mm aside and 2 degrees, tilted by 5 at the start.

    Output  positions (50, n, 3) in mm, quaternions w x y z (50, n, 4).
    """
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, HAND_TICKS)
    down = np.clip(t / 0.8, 0.0, 1.0)
    z = 48.0 - 36.0 * down * down * (3.0 - 2.0 * down)
    fade = (1.0 - np.clip(t / 0.3, 0.0, 1.0))[:, None]
    place, quat = np.empty((HANDS, HAND_TICKS, 3)), np.empty((HANDS, HAND_TICKS, 4))
    for i in range(HANDS):
        aside, lean = unit(rng.normal(size=2)), unit(rng.normal(size=3))
        start = np.radians(5.0) * unit(rng.normal(size=2))
        phase, wave = rng.uniform(0.0, 2.0 * np.pi, 2), rng.uniform(0.5, 2.0, 2)
        sway = np.cos(2.0 * np.pi * wave * t[:, None] + phase)
        place[i, :, :2] = 2.0 * aside * sway[:, :1]
        place[i, :, 2] = z
        turn = np.radians(2.0) * lean * sway[:, 1:]
        turn[:, :2] += start * fade
        quat[i] = Rotation.from_rotvec(turn).as_quat()[:, [3, 0, 1, 2]]
    return place, quat


def unit(v: Floats) -> Floats:
    """Of length 1."""
    return np.asarray(v / np.linalg.norm(v))
