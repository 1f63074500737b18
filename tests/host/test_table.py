"""Tables: what is written reads back the same, and never half."""

from __future__ import annotations

import os
import tempfile
import threading
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from crease.base import table
from crease.base.errors import CreaseError, TableError
from crease.base.settings import command_line
from crease.base.table import (
    check_target,
    claim,
    load_npz,
    read_table,
    together,
    write_atomic,
    write_bytes,
    write_table,
)
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp


@given(
    hnp.arrays(np.float64, 20, elements=st.floats(allow_nan=False)),
    hnp.arrays(np.float32, 20, elements=st.floats(width=32, allow_nan=False)),
    hnp.arrays(np.uint32, 20),
)
def test_csv_reads_back_to_the_bit(wide: np.ndarray, narrow: np.ndarray, count: np.ndarray) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        write_table(path, {"wide": wide, "narrow": narrow, "count": count})
        back = read_table(path)
    assert np.array_equal(back["wide"], wide)
    assert np.array_equal(back["narrow"].astype(np.float32), narrow)
    assert np.array_equal(back["count"], count)


def test_numbers_have_no_needless_digits(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    write_table(
        path,
        {"a": np.array([0.1, 0.25]), "b": np.array([0.1, -0.0], np.float32), "n": np.array([3, 0])},
    )
    assert path.read_text() == "a,b,n\n0.1,0.1,3\n0.25,0,0\n"


def test_long_table_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    values = np.arange(20_000, dtype=np.float64) / 7.0
    write_table(path, {"v": values})
    assert np.array_equal(read_table(path)["v"], values)


def test_npz_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "table.npz"
    write_table(path, {"a": np.arange(3)})
    assert np.array_equal(read_table(path)["a"], np.arange(3))


def test_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("old")

    def fail(file: BinaryIO) -> None:
        file.write(b"half")
        raise RuntimeError

    with pytest.raises(RuntimeError):
        write_atomic(path, fail)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_other_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TableError, match=r"neither \.csv nor \.npz"):
        write_table(tmp_path / "table.xlsx", {"a": np.zeros(1)})


def test_target_that_exists_needs_force(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.touch()
    with pytest.raises(CreaseError, match="give force=True to replace"):
        check_target(path, force=False)
    with command_line(), pytest.raises(CreaseError, match="give --force to replace"):
        check_target(path, force=False)
    check_target(path, force=True)


def test_target_in_a_missing_folder_or_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CreaseError, match="no folder"):
        check_target(tmp_path / "none" / "out.csv", force=False)
    with pytest.raises(CreaseError, match="is a folder"):
        check_target(tmp_path, force=True)


def test_missing_column_is_named(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(TableError, match="no column c"):
        read_table(path, ("a", "c"))


def test_npz_that_unpacks_to_more_than_the_limit_is_refused_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, t_s=np.zeros(1_000_000))
    assert path.stat().st_size < 20_000
    assert len(load_npz(path)["t_s"]) == 1_000_000
    monkeypatch.setattr(table, "NPZ_BYTES_MAX", 1_000_000)
    monkeypatch.setattr(np, "load", None)
    with pytest.raises(
        TableError, match=r"bomb\.npz: unpacks to 0\.008 GB, more than the 0\.001 GB"
    ):
        load_npz(path)


def test_what_another_thread_writes_does_not_wait_for_a_group(tmp_path: Path) -> None:
    """The group is of the thread that opened it: what another one wrote would be left out when that group failed."""
    own, other = tmp_path / "own", tmp_path / "other"
    with together():
        write_bytes(own, b"own")
        thread = threading.Thread(target=write_bytes, args=(other, b"other"))
        thread.start()
        thread.join()
        assert other.read_bytes() == b"other"
        assert not own.exists()
    assert own.read_bytes() == b"own"
    assert sorted(tmp_path.iterdir()) == [other, own]


def test_a_link_stays_and_what_it_leads_to_is_written(tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    for name in ("old.csv", "new.csv"):  # the second link leads to what is not there yet
        link = tmp_path / name
        link.symlink_to(there / name)
    (there / "old.csv").write_text("old")
    for name in ("old.csv", "new.csv"):
        link = tmp_path / name
        with pytest.raises(CreaseError, match="exists already"):
            check_target(link, force=False)
        check_target(link, force=True)
        write_bytes(link, b"new")
        assert link.is_symlink()
        assert (there / name).read_bytes() == b"new"
    assert {path.name for path in there.iterdir()} == {"old.csv", "new.csv"}


def test_a_link_that_leads_nowhere_and_what_is_no_file_are_refused(tmp_path: Path) -> None:
    away, ring, pipe = tmp_path / "away.csv", tmp_path / "ring.csv", tmp_path / "pipe.csv"
    away.symlink_to(tmp_path / "none" / "out.csv")
    ring.symlink_to(ring)
    os.mkfifo(pipe)
    for path, reason in ((away, "leads nowhere"), (ring, "leads nowhere"), (pipe, "a pipe")):
        with pytest.raises(CreaseError, match=reason):
            check_target(path, force=True)


def test_a_file_is_claimed_by_whatever_name(tmp_path: Path) -> None:
    link = tmp_path / "link.crs"
    link.symlink_to(tmp_path / "scene.crs")
    with (
        claim(link),
        pytest.raises(CreaseError, match="is being written"),
        claim(tmp_path / "scene.crs"),
    ):
        pass
