"""Attitudes as the project writes them: unit quaternions, scalar first."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def to_matrix(quaternion: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Rotation matrices.   Shapes: quaternion (4,) or (n, 4), w x y z of length 1; result (3, 3) or (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    turn: Any = Rotation.from_quat(np.asarray(quaternion, dtype=np.float64), scalar_first=True)
    return np.asarray(turn.as_matrix())
