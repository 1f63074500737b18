"""What the parts of a shell have in common: rows of vectors, and numbers on their way into an image."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


def unit(v: F64) -> F64:
    """Rows of length 1; a row of zeros stays.  Shapes: v, result (..., 3)."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(np.divide(v, length, out=np.zeros_like(v), where=length > 0))


def rounded_up(values: F64 | float) -> Any:
    """Rounded up to single precision with room for the rounding of positions."""
    return np.float32(np.asarray(values) * (1 + 1e-6) + 1e-9)


def nanometres(points: F64) -> npt.NDArray[Any]:
    """One comparable value per point, to a nanometre."""
    whole = np.ascontiguousarray(np.round(points * 1e9).astype(np.int64))
    return whole.view([("", np.int64)] * 3).reshape(-1)
