"""Paths: every bad row is named with its file, line and reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crease.base.errors import TrajectoryError
from crease.replay.trajectory import COLUMNS, check_rows, load_trajectory
from crease.replay.world import World
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

HEADER = ",".join(COLUMNS)
GOOD = "0.001,0,0,0,1,0,0,0"


def write(folder: Path, *rows: str, header: str = HEADER, end: str = "\n") -> Path:
    path = folder / "path.csv"
    path.write_bytes((end.join([header, *rows]) + end).encode())
    return path


def test_good_path_is_read(tmp_path: Path) -> None:
    path = load_trajectory(
        write(tmp_path, "0,0.1,0.2,0.3,1,0,0,0", "0.002,0,0,0,0,0.5,0.5,0.70710678")
    )
    assert len(path) == 2
    assert path.first_period_s == pytest.approx(0.002)
    assert path.position_m[0] == pytest.approx([0.1, 0.2, 0.3])
    assert np.linalg.norm(path.rows[:, 4:], axis=1) == pytest.approx([1.0, 1.0], abs=1e-15)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_line_ends_blank_lines_and_byte_order_mark_do_not_matter(tmp_path: Path, end: str) -> None:
    path = write(tmp_path, "", "0,0,0,0,1,0,0,0", "", GOOD, header="\ufeff" + HEADER, end=end)
    assert len(load_trajectory(path)) == 2


def test_columns_go_by_name(tmp_path: Path) -> None:
    header = "qw,qx,qy,qz,note,x_m,y_m,z_m,t_s"
    path = load_trajectory(write(tmp_path, "1,0,0,0,7,0.1,0.2,0.3,0.5", header=header))
    assert path.rows[0] == pytest.approx([0.5, 0.1, 0.2, 0.3, 1, 0, 0, 0])


def test_a_column_of_text_that_nobody_needs_does_not_matter(tmp_path: Path) -> None:
    rows = ["0,a,0,0,0,1,0,0,0,", f"0.001,,0.1,0,0,1,0,0,0,{'b' * 300}"]
    header = f"t_s,note,{HEADER.removeprefix('t_s,')},more"
    path = load_trajectory(write(tmp_path, *rows, header=header))
    assert path.rows[1] == pytest.approx([0.001, 0.1, 0, 0, 1, 0, 0, 0])
    with pytest.raises(TrajectoryError, match=r"path\.csv:3: y_m is 'b', not a number"):
        load_trajectory(
            write(tmp_path, "0,a,0,0,0,1,0,0,0,", "0.001,,0,b,0,1,0,0,0,", header=header)
        )
    with pytest.raises(TrajectoryError, match=r"path\.csv:3: 9 columns where the header has 10"):
        load_trajectory(
            write(tmp_path, "0,a,0,0,0,1,0,0,0,", "0.001,,0,0,0,1,0,0,0", header=header)
        )


def test_quotes_round_names_and_numbers_are_read(tmp_path: Path) -> None:
    def quoted(line: str) -> str:
        return ",".join(f'"{cell}"' for cell in line.split(","))

    path = write(tmp_path, quoted("0,0.1,0,0,1,0,0,0"), GOOD, header=quoted(HEADER))
    assert np.array_equal(load_trajectory(path).rows[:, :2], [[0, 0.1], [0.001, 0]])
    with pytest.raises(TrajectoryError, match=r"path\.csv:2: x_m is 'a', not a number"):
        load_trajectory(write(tmp_path, quoted("0,a,0,0,1,0,0,0"), header=quoted(HEADER)))


@pytest.mark.parametrize(("between", "name"), [(";", "semicolons"), ("\t", "tabs")])
def test_another_separator_is_named(tmp_path: Path, between: str, name: str) -> None:
    path = write(tmp_path, GOOD.replace(",", between), header=HEADER.replace(",", between))
    with pytest.raises(TrajectoryError, match=f"the columns are separated by {name}; .* commas"):
        load_trajectory(path)


def test_bytes_that_a_terminal_obeys_are_not_repeated(tmp_path: Path) -> None:
    path = write(tmp_path, "0,\0\x1b[2J,0,0,1,0,0,0")
    with pytest.raises(TrajectoryError) as caught:
        load_trajectory(path)
    assert str(caught.value) == rf"{path}:2: x_m is '\x00\x1b[2J', not a number"
    path.write_bytes(f"{HEADER}\n{GOOD}\n".encode("utf-16"))
    with pytest.raises(TrajectoryError, match=r"path\.csv: is no text in UTF-8; save it as CSV"):
        load_trajectory(path)


def test_one_row_is_a_path(tmp_path: Path) -> None:
    path = load_trajectory(write(tmp_path, GOOD))
    assert path.first_period_s == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("0.002,0,0,0,1,0,0", "7 columns where the header has 8"),
        ("0.002,0,0,0,1,0,0,0,0", "9 columns where the header has 8"),
        ("0.002,0,zero,0,1,0,0,0", "y_m is 'zero', not a number"),
        ("0.002,0,,0,1,0,0,0", "y_m is '', not a number"),
        ("0.002,0,1_0,0,1,0,0,0", "y_m is '1_0', not a number"),
        ("0.002,0,\u0661,0,1,0,0,0", "y_m is '\u0661', not a number"),
        ("0.002,0,0,nan,1,0,0,0", "z_m is nan, not a finite number"),
        ("0.002,inf,0,0,1,0,0,0", "x_m is inf, not a finite number"),
        ("0.002,0,-10001,0,1,0,0,0", "y_m is -10001, more than 10 km off: positions are in metres"),
        ("0.002,0,0,0,1.1,0,0,0", "the quaternion has length 1.1, not 1 within 1 %"),
        ("0.002,0,0,0,0,0,0,0", "the quaternion has length 0, not 1 within 1 %"),
        ("0.001,0,0,0,1,0,0,0", "time does not increase: 0.001 s after 0.001 s"),
        ("-5,0,0,0,1,0,0,0", "time does not increase: -5 s after 0.001 s"),
        ("9,0,0,0,1,0,0,0", "8.999 s after the row before; at most 1 s is allowed"),
    ],
)
def test_bad_row_is_named_by_file_line_and_reason(tmp_path: Path, row: str, reason: str) -> None:
    path = write(tmp_path, "0,0,0,0,1,0,0,0", "", GOOD, row, "10,0,0,0,1,0,0,0")
    with pytest.raises(TrajectoryError) as caught:
        load_trajectory(path)
    assert str(caught.value) == f"{path}:5: {reason}"


def test_a_path_goes_as_far_as_the_tick_takes_a_pose_and_no_further(
    scene_crs: Path,
) -> None:
    """A row that the tick refuses would latch a fault: no force from there on."""
    for away_m, taken in ((1e4, True), (np.nextafter(np.float32(1e4), np.float32(2e4)), False)):
        rows = np.array([[0.001, 0.0, away_m, 0.0, 1.0, 0.0, 0.0, 0.0]])
        world = World(scene_crs)
        world.tick(rows[0, 1:])
        assert (world.tick(rows[0, 1:]).faults == 0) == taken
        if taken:
            assert len(check_rows(rows, "path")) == 1
        else:
            with pytest.raises(TrajectoryError, match=r"row 0: y_m is 10000\.001, more than 10 km"):
                check_rows(rows, "path")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        (f"{HEADER}\n", "has a header but no rows"),
        ("t_s,x_m,y_m,z_m,qw,qx,qy\n0,0,0,0,1,0,0\n", ":1: no column qz"),
        ("0,0,0,0,1,0,0,0\n", ":1: no column t_s"),
        (f"# {HEADER}\n0,0,0,0,1,0,0,0\n", "comments=''"),
        (f"{HEADER},t_s\n0,0,0,0,1,0,0,0,0\n", "t_s stands twice"),
    ],
)
def test_bad_file_is_refused_on_one_line(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "path.csv"
    path.write_text(text)
    with pytest.raises(TrajectoryError) as caught:
        load_trajectory(path)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_binary_rubbish_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(TrajectoryError, match=r"path\.csv"):
        load_trajectory(path)


def test_missing_file_and_other_suffix_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match="no such file"):
        load_trajectory(tmp_path / "none.csv")
    other = tmp_path / "path.txt"
    other.write_text(HEADER)
    with pytest.raises(TrajectoryError, match="suffix"):
        load_trajectory(other)


def test_npz_holds_the_same_path(tmp_path: Path) -> None:
    csv = load_trajectory(write(tmp_path, "0,0.1,0.2,0.3,1,0,0,0", GOOD))
    npz = tmp_path / "path.npz"
    np.savez(npz, **dict(zip(COLUMNS, csv.rows.T, strict=True)))
    assert np.array_equal(load_trajectory(npz).rows, csv.rows)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"qz": None}, "no array qz"),
        ({"x_m": np.zeros(3)}, "not of one length, t_s has 2 and x_m 3"),
        ({"x_m": np.zeros((2, 1))}, r"array x_m has the shape \(2, 1\); give it the shape \(2,\)"),
        ({"x_m": np.zeros(2, complex)}, "array x_m holds complex numbers"),
        ({"x_m": np.array(["a", "b"])}, "x_m does not hold numbers"),
        ({"t_s": np.array([1.0, 0.5])}, "row 1: time does not increase"),
        (dict.fromkeys(COLUMNS, np.zeros(0)), "has no rows"),
    ],
)
def test_bad_npz_is_refused(tmp_path: Path, change: dict[str, object], reason: str) -> None:
    arrays: dict[str, object] = dict.fromkeys(COLUMNS, np.zeros(2))
    arrays |= {"t_s": np.array([0.0, 0.1]), "qw": np.ones(2), **change}
    path = tmp_path / "path.npz"
    np.savez(path, **{k: v for k, v in arrays.items() if v is not None})  # type: ignore[arg-type]
    with pytest.raises(TrajectoryError, match=reason):
        load_trajectory(path)


def test_file_that_is_no_archive_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "path.npz"
    for content in (b"", b"PK\x03\x04 not a zip", b"text"):
        path.write_bytes(content)
        with pytest.raises(TrajectoryError, match="cannot be read as NPZ"):
            load_trajectory(path)


@given(hnp.arrays(np.float64, (5, 8), elements=st.floats(-2.0, 2.0, width=32)))
def test_a_path_is_either_unit_and_increasing_or_refused(rows: np.ndarray) -> None:
    length = np.linalg.norm(rows[:, 4:], axis=1)
    step_s = np.diff(rows[:, 0])
    if (np.abs(length - 1.0) > 0.01).any() or (step_s <= 0.0).any() or (step_s > 1.0).any():
        with pytest.raises(TrajectoryError, match=r"^random: row \d: "):
            check_rows(rows, "random")
    else:
        path = check_rows(rows, "random")
        assert np.linalg.norm(path.rows[:, 4:], axis=1) == pytest.approx(np.ones(5))


@given(hnp.arrays(np.float64, st.tuples(st.integers(1, 40)), elements=st.floats(-1e3, 1e3)))
def test_any_position_survives_the_file(values: np.ndarray) -> None:
    import tempfile

    rows = np.zeros((len(values), 8))
    rows[:, 0] = np.arange(len(values)) * 1e-3
    rows[:, 1], rows[:, 4] = values, 1.0
    with tempfile.TemporaryDirectory() as folder:
        lines = [",".join(repr(float(v)) for v in row) for row in rows]
        path = load_trajectory(write(Path(folder), *lines))
    assert np.array_equal(path.rows, rows)
