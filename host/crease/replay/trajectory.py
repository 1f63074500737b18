"""Paths of the tool: time and world_from_tool for each tick, from CSV or NPZ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from crease.base.errors import CreaseError, TrajectoryError
from crease.base.table import Column, data_lines, read_header, read_table

COLUMNS = ("t_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
"""Columns of a path file: time, position of the tool origin, unit quaternion, scalar first."""

UNIT_TOLERANCE = 0.01
"""How far |q| may be from 1 before the row is refused; nearer it is normalised."""

PERIOD_MAX_S = 1.0
"""Longest time between two rows: what the firmware takes as a period."""

POSITION_MAX_M = 1e4
"""Farthest coordinate of a row: what the firmware takes as a position."""

POSE_NUMBERS = 7
"""Of one pose: position in m and a unit quaternion, scalar first."""

FIRST_PERIOD_S = 1e-3
"""Period of the tick of a path that has only one row."""


@dataclass(frozen=True)
class Trajectory:
    """A checked path. rows: float64 (n, 8), columns as COLUMNS, quaternions of unit length, time increasing."""

    rows: npt.NDArray[np.float64]
    source: str

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def t_s(self) -> npt.NDArray[np.float64]:
        """Times, (n,)."""
        return self.rows[:, 0]

    @property
    def position_m(self) -> npt.NDArray[np.float64]:
        """Tool origin in the world, (n, 3)."""
        return self.rows[:, 1:4]

    @property
    def first_period_s(self) -> float:
        """Period of the first tick: that of the second."""
        return float(self.rows[1, 0] - self.rows[0, 0]) if len(self) > 1 else FIRST_PERIOD_S


def _first(bad: npt.NDArray[np.bool_]) -> int | None:
    """Index of the first true element."""
    return int(np.argmax(bad)) if bad.any() else None


def _find_fault(rows: npt.NDArray[np.float64]) -> tuple[int, str] | None:
    """The first bad row and what is wrong with it."""
    faults: list[tuple[int, str]] = []
    finite = np.isfinite(rows)
    if (i := _first(np.atleast_1d(~finite.all(axis=1)))) is not None:
        name = COLUMNS[int(np.argmin(finite[i]))]
        faults.append((i, f"{name} is {rows[i, COLUMNS.index(name)]}, not a finite number"))
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(rows[:, 4:], axis=1)
        far: npt.NDArray[np.bool_] = np.abs(length - 1.0) > UNIT_TOLERANCE
        if (i := _first(far)) is not None:
            faults.append((i, f"the quaternion has length {length[i]:.6g}, not 1 within 1 %"))
        beyond = np.abs(rows[:, 1:4]) > POSITION_MAX_M
        if (i := _first(np.atleast_1d(beyond.any(axis=1)))) is not None:
            axis = 1 + int(np.argmax(beyond[i]))
            faults.append(
                (
                    i,
                    f"{COLUMNS[axis]} is {rows[i, axis]:.9g}, more than 10 km off: positions are in metres",
                )
            )
        step_s = np.diff(rows[:, 0])
        if (i := _first(step_s <= 0.0)) is not None:
            now, before = rows[i + 1, 0], rows[i, 0]
            faults.append((i + 1, f"time does not increase: {now:.9g} s after {before:.9g} s"))
        if (i := _first(step_s > PERIOD_MAX_S)) is not None:
            faults.append(
                (i + 1, f"{step_s[i]:.6g} s after the row before; at most 1 s is allowed")
            )
    return min(faults, key=lambda fault: fault[0]) if faults else None


def place_of_row(path: Path, row: int) -> str:
    """`file:line` of a data row of a CSV file, `file: row` of an NPZ file."""
    if path.suffix.lower() != ".csv":
        return f"{path}: row {row}"
    _, skip = read_header(path)
    return f"{path}:{data_lines(path, skip)[row][0]}"


def stack_columns(
    path: Path, columns: dict[str, Column], names: Sequence[str] = COLUMNS
) -> npt.NDArray[np.float64]:
    """The columns of a path side by side, (n, 8) or (n, names).   Errors: TrajectoryError."""
    arrays = []
    for name in names:
        try:
            arrays.append(np.asarray(columns[name], dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise TrajectoryError(f"{path}: array {name} does not hold numbers") from error
    if len(arrays[0]) == 0:
        raise TrajectoryError(f"{path}: has no rows; give at least one")
    return np.ascontiguousarray(np.stack(arrays, axis=1))


def check_rows(rows: npt.NDArray[np.float64], source: str) -> Trajectory:
    """A path from an (n, 8) array.   Errors: TrajectoryError naming the row (from 0)."""
    if rows.ndim != 2 or rows.shape[1] != len(COLUMNS) or len(rows) == 0:
        raise TrajectoryError(
            f"{source}: a path is an array of n >= 1 rows and {len(COLUMNS)} columns"
        )
    if (fault := _find_fault(rows)) is not None:
        raise TrajectoryError(f"{source}: row {fault[0]}: {fault[1]}")
    rows = np.array(rows, dtype=np.float64)
    rows[:, 4:] /= np.linalg.norm(rows[:, 4:], axis=1, keepdims=True)
    return Trajectory(rows, source)


def put_pose(pose: npt.ArrayLike, into: npt.NDArray[np.float32]) -> None:
    """A pose into the memory of a tick, (7,): x y z in m, unit quaternion w x y z.

    Errors: TrajectoryError when it is not 7 numbers.
    """
    try:
        if len(pose) != POSE_NUMBERS:  # type: ignore[arg-type]
            raise ValueError
        into[:] = pose
    except (TypeError, ValueError) as error:
        raise TrajectoryError(
            "a pose is 7 numbers: x y z in m and a unit quaternion w x y z"
        ) from error


def refuse_file(poses: object) -> None:
    """Errors: TrajectoryError for the name of a file where poses are asked for."""
    if isinstance(poses, (str, Path)):
        raise TrajectoryError(
            f"poses is the name of a file, {poses!s:.80}; give what crease.load_path reads from it"
        )


def load_trajectory(path: str | Path) -> Trajectory:
    """A path from a CSV or NPZ file with the columns t_s,x_m,y_m,z_m,qw,qx,qy,qz.

    Errors: TrajectoryError with file, line and reason for the first bad row.
    Cost: 0.2 s for 100,000 rows of CSV.
    """
    path = Path(path)
    try:
        rows = stack_columns(path, read_table(path, COLUMNS))
    except TrajectoryError:
        raise
    except CreaseError as error:
        raise TrajectoryError(str(error)) from error
    if (fault := _find_fault(rows)) is not None:
        raise TrajectoryError(f"{place_of_row(path, fault[0])}: {fault[1]}")
    return check_rows(rows, str(path))
