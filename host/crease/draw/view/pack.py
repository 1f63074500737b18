"""Numbers for the page: quantised, as differences along the first axis, bytes of equal weight together, deflated.

Neighbouring ticks hardly differ, so most high bytes are zero. decode.js has the other half.
"""

from __future__ import annotations

import base64
import gzip
from typing import Any

import numpy as np
import numpy.typing as npt

LIMIT = 1 << 29
"""Largest magnitude of a packed number: differences then fit into 31 bits."""


class Packer:
    """Collects arrays by name; `header` tells the page where each lies and how it is read back."""

    def __init__(self) -> None:
        self._blocks: list[bytes] = []
        self._size = 0
        self.header: dict[str, dict[str, Any]] = {}

    def add_integers(self, name: str, values: npt.ArrayLike, step: float = 1.0) -> None:
        """values: integers (n,) or (n, c), |v| <= LIMIT. The page sees value * step."""
        rows = np.asarray(values, dtype=np.int64)
        rows = rows.reshape(len(rows), 1 if rows.ndim == 1 else rows.shape[1])
        assert not rows.size or np.abs(rows).max() <= LIMIT
        change = np.diff(rows, axis=0, prepend=np.zeros((1, rows.shape[1]), np.int64))
        folded = ((change << 1) ^ (change >> 63)).T.reshape(-1)
        width = max(1, (int(folded.max(initial=0)).bit_length() + 7) // 8)
        block = b"".join(
            ((folded >> 8 * k) & 0xFF).astype(np.uint8).tobytes() for k in range(width)
        )
        self.header[name] = {
            "start": self._size,
            "rows": len(rows),
            "columns": rows.shape[1],
            "width": width,
            "step": step,
        }
        self._blocks.append(block)
        self._size += len(block)

    def add_numbers(self, name: str, values: npt.ArrayLike, resolution: float) -> None:
        """values: numbers (n,) or (n, c); kept to `resolution`, coarser only where they would not fit."""
        numbers = np.asarray(values, dtype=np.float64)
        largest = float(np.abs(numbers).max(initial=0.0))
        step = max(resolution, largest / LIMIT)
        self.add_integers(name, np.rint(numbers / step).astype(np.int64), step)

    def encode(self) -> str:
        """All blocks, deflated, as base64."""
        return base64.b64encode(gzip.compress(b"".join(self._blocks), 9, mtime=0)).decode("ascii")
