"""Path files, CSV and NPZ: a checked path, or one line that says what is wrong. Run by libFuzzer, through atheris."""

from __future__ import annotations

import sys
import tempfile
from inspect import isfunction
from pathlib import Path

import atheris
import numpy as np
from crease.base import table
from crease.base.errors import TrajectoryError
from crease.base.table import write_table
from crease.replay import trajectory
from crease.replay.trajectory import COLUMNS, PERIOD_MAX_S, Trajectory, load_trajectory

FOLDER = Path(tempfile.mkdtemp(prefix="crease-fuzz-"))
HEADER = ",".join(COLUMNS).encode("ascii") + b"\n"


def check_path(path: Trajectory) -> None:
    """What the replay takes for granted of a path."""
    steps = np.diff(path.t_s)
    assert path.rows.dtype == np.float64
    assert path.rows.shape == (len(path), len(COLUMNS))
    assert len(path) > 0
    assert bool(np.isfinite(path.rows).all())
    assert bool((steps > 0.0).all())
    assert bool((steps <= PERIOD_MAX_S).all())
    assert bool((np.abs(np.linalg.norm(path.rows[:, 4:], axis=1) - 1.0) < 1e-12).all())
    assert path.first_period_s > 0.0


def load(name: Path) -> None:
    """Load, and let only the one error through that the command line turns into a line."""
    try:
        path = load_trajectory(name)
    except TrajectoryError as error:
        text = str(error)
        assert text.startswith(str(name)), text
        assert "\n" not in text, repr(text)
        return
    check_path(path)
    copy = FOLDER / "copy.csv"
    write_table(copy, {column: path.rows[:, i] for i, column in enumerate(COLUMNS)})
    again = load_trajectory(copy)
    assert bool((again.rows[:, :4] == path.rows[:, :4]).all())


def try_file(data: bytes) -> None:
    """The first byte says what the rest is: CSV as a whole, rows under a good header, NPZ."""
    kind, body = data[:1], data[1:]
    name = FOLDER / ("path.npz" if kind == b"N" else "path.csv")
    name.write_bytes(HEADER + body if kind == b"R" else body)
    load(name)


def main() -> None:
    """The command line is libFuzzer's."""
    # Function by function: the editable install has a loader of its own, which atheris does not see through.
    for module in (table, trajectory):
        for function in vars(module).values():
            if isfunction(function) and function.__module__ == module.__name__:
                atheris.instrument_func(function)
    atheris.Setup(sys.argv, try_file)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
