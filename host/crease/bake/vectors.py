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


def without_dust(values: F64, whole: F64 | float) -> F64:
    """What rounding left of zeros as zeros: what is less than 1e-9 of the whole, less than single precision tells.

    Products of two or three such are denormal numbers, of which an x86 processor multiplies one in some 150 cycles.
    Shapes: values (...), whole: any that it broadcasts with.
    """
    return np.where(np.abs(values) < 1e-9 * np.abs(whole), 0.0, values)


def nanometres(points: F64) -> npt.NDArray[Any]:
    """One comparable value per point, to a nanometre."""
    whole = np.ascontiguousarray(np.round(points * 1e9).astype(np.int64))
    return whole.view([("", np.int64)] * 3).reshape(-1)
