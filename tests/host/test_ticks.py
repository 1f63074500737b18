"""Tables of ticks read back: a number that no tick can have written is refused alike by all who read them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crease.base.table import read_table, write_table
from host_tools import Run


@pytest.mark.parametrize(
    ("column", "value", "reason"),
    [
        ("fx_N", np.nan, "fx_N is nan, not a finite number"),
        ("depth_m", np.inf, "depth_m is inf, not a finite number"),
        ("ty_Nm", 1e300, "ty_Nm is 1e+300, not a finite number"),
        ("areas", -1.0, "areas is -1, not a count"),
        ("contacts", 0.5, "contacts is 0.5, not a count"),
    ],
)
def test_a_number_that_no_tick_wrote_is_refused_by_all_alike(
    column: str, value: float, reason: str, press_out: Path, scene_crs: Path, tmp_path: Path, crease: Run
) -> None:  # fmt: skip
    columns = {name: np.array(values, np.float64) for name, values in read_table(press_out).items()}
    columns[column][7] = value
    for bad, place in ((tmp_path / "bad.csv", ":9"), (tmp_path / "bad.npz", ": row 7")):
        write_table(bad, columns)
        for words in (
            ("plot", bad, "-o", tmp_path / "out.png"),
            ("view", bad, "--scene", scene_crs, "-o", tmp_path / "out.html"),
            ("export", bad, "-o", tmp_path / "out.mcap"),
        ):
            said = crease(*words)
            assert (said.status, said.out, said.err.count("\n")) == (1, "", 1), words
            assert said.err.startswith(f"error: {bad}{place}: {reason}"), words
    assert {path.name for path in tmp_path.iterdir()} == {"bad.csv", "bad.npz"}


def test_columns_of_other_names_may_hold_anything(
    press_out: Path, tmp_path: Path, crease: Run
) -> None:
    columns = read_table(press_out)
    write_table(tmp_path / "more.csv", {**columns, "mine": np.full(len(columns["t_s"]), np.nan)})
    assert crease("plot", tmp_path / "more.csv", "-o", tmp_path / "out.png").status == 0
    assert crease("export", tmp_path / "more.csv", "-o", tmp_path / "out.npz").status == 0
