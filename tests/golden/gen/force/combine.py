"""Half-spaces n_j.t >= depth_j into one translation t = F / k, and the multipliers."""

from __future__ import annotations

import numpy as np
from bodies import Floats
from scipy.optimize import lsq_linear, nnls
from zones import Contact

STIFF = 1000.0


def combine(found: list[Contact], cap: float = np.inf, stiff: float = STIFF) -> tuple[Floats, Floats]:
    """Soft least translation: min |t|^2/2 + stiff/2 sum max(0, depth - n.t)^2, multipliers at most cap x depth."""
    if not found:
        return np.zeros(3), np.zeros(0)
    n = np.array([c.normal for c in found])
    d = np.array([c.depth for c in found]) * (1.0 + 1.0 / stiff)
    left = np.vstack([n.T, np.eye(len(d)) / np.sqrt(stiff)])
    right = np.concatenate([np.zeros(3), np.sqrt(stiff) * d])
    lam = nnls(left, right)[0]
    if np.isfinite(cap) and (lam > cap * d).any():
        lam = lsq_linear(left, right, (0.0, cap * d), method="bvls").x
    return n.T @ lam, lam


def torque(found: list[Contact], lam: Floats) -> Floats:
    return np.asarray(sum((x * c.moment for x, c in zip(lam, found, strict=True)), np.zeros(3)))
