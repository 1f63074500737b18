"""Tables of ticks as they are read back: what a replay or a loop wrote, checked once for all who show or pass it on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from crease.base.errors import TableError
from crease.base.table import Column, check_columns, read_table
from crease.replay.recording import RECORD
from crease.replay.recording import to_columns as loop_columns
from crease.replay.replay import COLUMNS, COUPLE_COLUMNS, RUNS
from crease.replay.trajectory import place_of_row

_COUNTS = ("areas", "zones", "contacts", "nodes", "points", "tick_ns", "mode", "limits", "faults")
_NAMES = {*COLUMNS, *COUPLE_COLUMNS, *_COUNTS, RUNS, *loop_columns(np.zeros(1, RECORD))}
_PREFIXES = ("contact_", "couple_", "hand_", "motor_", "wrist_")
"""Of further columns of the loop."""

NUMBER_MAX = float(np.finfo(np.float32).max)
"""The core counts in float32: what is larger, no tick answered."""
COUNT_MAX = 2**32 - 1


def read_ticks(path: Path, wanted: tuple[str, ...] = ()) -> dict[str, Column]:
    """Columns of a table of ticks by name, as read_table.

    Errors: TableError with file, line and column, also for a number in a column of `crease` that no tick can have
    written. Columns of other names may hold anything.
    """
    columns = read_table(path, wanted)
    own = {name: columns[name] for name in columns if name in _NAMES or name.startswith(_PREFIXES)}
    check_columns(path, own)
    _check_numbers(path, own)
    return columns


def _check_numbers(path: Path, columns: Mapping[str, Column]) -> None:
    """Errors: TableError for the first row with a number that is not finite, too large, or no count in a column of
    counts.
    """
    faults: list[tuple[int, str]] = []
    for name, column in columns.items():
        if not np.issubdtype(column.dtype, np.number):
            raise TableError(f"{path}: array {name} does not hold numbers; replay it again")
        values = column.astype(np.float64)
        bad = ~(np.abs(values) <= NUMBER_MAX)
        what = "not a finite number of 32 bits"
        if name in _COUNTS and not bad.any():
            bad = (values < 0.0) | (values > COUNT_MAX) | (values % 1.0 != 0.0)
            what = "not a count"
        if bad.any():
            row = int(np.argmax(bad))
            faults.append((row, f"{name} is {values[row]:.9g}, {what}; mend or replay the table"))
    if faults:
        row, what = min(faults, key=lambda fault: fault[0])
        raise TableError(f"{place_of_row(path, row)}: {what}")
