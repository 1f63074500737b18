"""What the host tests share: how a command line answered, and path files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Said:
    """What a command line gave back."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Run = Callable[..., Said]


def write_path(path: Path, position_m: np.ndarray[Any, Any]) -> Path:
    """A path file at 1 kHz without rotation, for positions (n, 3)."""
    rows = np.zeros((len(position_m), 8))
    rows[:, 0] = np.arange(len(position_m)) * 1e-3
    rows[:, 1:4] = position_m
    rows[:, 4] = 1.0
    np.savetxt(
        path,
        rows,
        delimiter=",",
        fmt="%.9g",
        header="t_s,x_m,y_m,z_m,qw,qx,qy,qz",
        comments="",
    )
    return path
