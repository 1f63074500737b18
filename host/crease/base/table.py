"""Tables of ticks: columns by name, kept as CSV or NPZ by the suffix of the file."""

from __future__ import annotations

import contextlib
import csv
import fcntl
import os
import tempfile
import threading
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from crease.base.ending import steady, undone_by
from crease.base.errors import CreaseError, TableError
from crease.base.native import ffi, lib
from crease.base.settings import setting

Column = npt.NDArray[Any]

_ROWS_PER_BLOCK = 4096

_NAMED_MAX = 8
"""Columns that a message names."""
_CELL_MAX = 40
"""Letters of a cell that a message repeats."""
_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
"""What others write between columns."""

NPZ_BYTES_MAX = 2 << 30
"""Arrays of an NPZ file, unpacked: two hours of ticks. A small file can unpack to any size."""


def check_target(
    path: Path, force: bool, inputs: Sequence[Path] = (), stream: bool = False
) -> None:
    """Whether `path` can be written, with `inputs` read before. A symbolic link stays: what it leads to is written.

    Errors: CreaseError when an input is missing (said first) or is `path` itself, whatever `force`; when `path` exists,
    be it as a link that leads nowhere, and `force` is not given; when it is no file; when its folder is missing.
    stream: it is written bit by bit as it is, so that it may be a device or a pipe.
    """
    for source in inputs:
        if not source.exists():
            raise CreaseError(f"{source}: there is no such file")
        if path.exists() and path.samefile(source):
            raise CreaseError(f"{path}: is an input; name another file for the output")
    if path.is_dir():
        raise CreaseError(f"{path}: is a folder; name a file")
    if path.exists() and not path.is_file() and not stream:
        raise CreaseError(f"{path}: is a device or a pipe; name a file")
    if os.path.lexists(path) and not force:
        raise CreaseError(f"{path}: exists already; give {setting('force', True)} to replace it")
    _check_parent(path)


def _check_parent(path: Path) -> None:
    """Errors: CreaseError when the folder that `path` lies in is missing, or a link leads to none."""
    if not path.absolute().parent.is_dir():
        raise CreaseError(f"{path}: there is no folder {path.parent}; make it first")
    place = _place(path)
    if place.is_symlink() or not place.parent.is_dir():
        raise CreaseError(
            f"{path}: is a link that leads nowhere; take it away, or name another file"
        )


def _place(path: Path) -> Path:
    """Where what is written to `path` lies: at the end of a symbolic link."""
    return Path(os.path.realpath(path))


@contextlib.contextmanager
def claim(path: Path) -> Iterator[None]:
    """Hold an output for this process until the work is done.   Errors: CreaseError when another one holds it."""
    _check_parent(path)
    place = _place(path)
    lock = place.with_name(f".{place.name}.lock")
    with contextlib.ExitStack() as held:
        with steady():
            _hold(path, lock, held)
        try:
            yield
        finally:
            with steady():
                held.close()


def _hold(path: Path, lock: Path, held: contextlib.ExitStack) -> None:
    """Lock the file `lock`, which goes away with `held`."""
    try:
        handle = os.open(lock, os.O_CREAT | os.O_RDWR, 0o666)
    except OSError as error:
        raise CreaseError(f"{path}: cannot be written: {error.strerror}") from error
    held.callback(os.close, handle)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        here = lock.exists() and os.path.samestat(os.fstat(handle), lock.stat())
    except OSError:
        here = False
    if not here:
        raise CreaseError(
            f"{path}: is being written by another `crease`; wait for it, or name another output"
        )
    held.callback(lock.unlink, missing_ok=True)
    held.enter_context(undone_by(lock.unlink))


def write_atomic(path: Path, write: Callable[[BinaryIO], None]) -> None:
    """Let `write` fill a temporary file beside `path`, then move it there: the whole file or none.

    Where `path` is a symbolic link, beside what it leads to, and there: the link stays.
    Errors: CreaseError when the disk refuses. Whatever `write` raises passes through, and nothing is left behind.
    """
    write_together({path: write})


def write_together(files: Mapping[Path, Callable[[BinaryIO], None]]) -> None:
    """write_atomic of files that belong together: all of them or none."""
    if not _groups.open:
        with together():
            write_together(files)
        return
    begun, moves = _groups.open[-1]
    for path, write in files.items():
        moves.append((_temporary(path, write, begun), path))


class _Groups(threading.local):
    """Of the calling thread: what takes temporary files away, and the moves to their places, of each `together`."""

    def __init__(self) -> None:
        self.open: list[tuple[contextlib.ExitStack, list[tuple[Path, Path]]]] = []


_groups = _Groups()


@contextlib.contextmanager
def together() -> Iterator[None]:
    """What this thread writes within this is moved to its place at its end: all of the files or none."""
    with contextlib.ExitStack() as begun:
        moves: list[tuple[Path, Path]] = []
        _groups.open.append((begun, moves))
        try:
            yield
        finally:
            _groups.open.pop()
        with steady():
            for made, path in moves:
                with refusals(path):
                    made.replace(_place(path))


@contextlib.contextmanager
def refusals(path: Path) -> Iterator[None]:
    """What the disk refuses within this is told of `path`, as a CreaseError."""
    try:
        yield
    except OSError as error:
        raise CreaseError(f"{path}: cannot be written: {error.strerror}") from error


def _temporary(path: Path, write: Callable[[BinaryIO], None], begun: contextlib.ExitStack) -> Path:
    """A file beside the place of `path` with what `write` puts into it, taken away with `begun` where it still is."""
    with refusals(path):
        with steady():
            place = _place(path)
            handle, name = tempfile.mkstemp(prefix=f".{place.name}.", dir=place.parent)
            made = Path(name)
            begun.enter_context(undone_by(made.unlink))
            begun.callback(made.unlink, missing_ok=True)
        with os.fdopen(handle, "wb") as file:
            write(file)
        umask = os.umask(0)
        os.umask(umask)
        made.chmod(0o666 & ~umask)
    return made


def write_bytes(path: Path, data: bytes) -> None:
    """write_atomic of bytes that are there already."""
    write_atomic(path, bytes_writer(data))


def bytes_writer(data: bytes) -> Callable[[BinaryIO], None]:
    """For write_atomic: of bytes that are there already."""

    def write(file: BinaryIO) -> None:
        file.write(data)

    return write


def _kind(column: Column) -> int:
    if np.issubdtype(column.dtype, np.integer):
        return int(lib.CR_CSV_INT)
    return int(lib.CR_CSV_FLOAT32 if column.dtype == np.float32 else lib.CR_CSV_FLOAT64)


def _write_csv(file: BinaryIO, columns: Mapping[str, Column]) -> None:
    file.write((",".join(columns) + "\n").encode("ascii"))
    values = np.stack([np.asarray(c, dtype=np.float64) for c in columns.values()], axis=1)
    kinds = ffi.new("uint8_t[]", [_kind(column) for column in columns.values()])
    text = ffi.new("char[]", _ROWS_PER_BLOCK * len(columns) * int(lib.CR_CSV_CELL_MAX))
    for start in range(0, len(values), _ROWS_PER_BLOCK):
        block = np.ascontiguousarray(values[start : start + _ROWS_PER_BLOCK])
        used = lib.cr_csv_format(
            ffi.from_buffer("double[]", block), *block.shape, kinds, text, len(text)
        )
        file.write(ffi.buffer(text, used))


def _write_npz(file: BinaryIO, columns: Mapping[str, Column]) -> None:
    arrays: dict[str, Any] = dict(columns)
    np.savez_compressed(file, **arrays)


def write_table(path: Path, columns: Mapping[str, Column]) -> None:
    """Write columns of equal length to `path`: CSV or NPZ by suffix, whole or not at all.

    Numbers in CSV have the fewest digits that read back the same.
    Errors: TableError for another suffix; CreaseError when the disk refuses.
    """
    match path.suffix.lower():
        case ".csv":
            write_atomic(path, lambda file: _write_csv(file, columns))
        case ".npz":
            write_atomic(path, lambda file: _write_npz(file, columns))
        case _:
            raise TableError(f"{path}: the suffix is neither .csv nor .npz; name the file so")


def check_suffix(path: Path, suffixes: tuple[str, ...]) -> None:
    """Errors: CreaseError when `path` has none of the suffixes."""
    if path.suffix.lower() not in suffixes:
        raise CreaseError(f"{path}: the suffix is not one of {', '.join(suffixes)}; name it so")


def load_npz(path: Path) -> dict[str, Column]:
    """The arrays of an NPZ file.   Errors: TableError when it is not one, or unpacks to more than NPZ_BYTES_MAX."""
    try:
        with zipfile.ZipFile(path) as packed:
            unpacked = sum(entry.file_size for entry in packed.infolist())
        if unpacked > NPZ_BYTES_MAX:
            raise TableError(
                f"{path}: unpacks to {unpacked / 1e9:.3g} GB, more than the {NPZ_BYTES_MAX / 1e9:.3g} GB that are read"
            )
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except TableError:
        raise
    except Exception as error:  # zipfile and numpy raise their own kinds for damaged archives
        raise TableError(f"{path}: cannot be read as NPZ: {describe(error)}") from error


def describe(error: BaseException) -> str:
    """The reason inside an exception, on one line."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split()) or type(error).__name__


def read_header(path: Path) -> tuple[list[str], int]:
    """Column names of a CSV file, and how many lines stand above the first row.

    Errors: TableError when it cannot be read or is empty.
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            for number, line in enumerate(file, start=1):
                if line.strip():
                    return [name.strip() for name in _cells(line)], number
    except UnicodeDecodeError as error:
        raise TableError(f"{path}: is no text in UTF-8; save it as CSV in UTF-8") from error
    except OSError as error:
        raise TableError(f"{path}: cannot be read: {describe(error)}") from error
    raise TableError(f"{path}: is empty; it must begin with a line of column names")


def _cells(line: str) -> list[str]:
    """The cells of a line of CSV, without the quotes round them."""
    try:
        return next(csv.reader([line.rstrip("\r\n")], skipinitialspace=True), [])
    except csv.Error:  # a cell without end
        return line.split(",")


def _shown(cell: str) -> str:
    """A cell for a message: its first letters, without what a terminal would obey."""
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in cell.strip()[:_CELL_MAX])


def data_lines(path: Path, skip: int) -> list[tuple[int, str]]:
    """Line number and text of every non-blank line below the first `skip` lines. Slow: for error reports."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return [
            (number, line)
            for number, line in enumerate(file, start=1)
            if number > skip and line.strip()
        ]


def _is_number(cell: str) -> bool:
    """Whether the reader takes it: Python's `float` takes 1_0 and digits of other scripts too."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell and cell.strip().isascii()


def _bad_line(
    path: Path, skip: int, names: list[str], texts: Sequence[int] = ()
) -> tuple[str, int | None]:
    """Where and why a CSV file does not parse, `file:line: reason`, and in which column if it is in one.

    texts: columns that may hold anything.
    """
    for number, line in data_lines(path, skip):
        cells = _cells(line)
        if len(cells) != len(names):
            return f"{path}:{number}: {len(cells)} columns where the header has {len(names)}", None
        for column in (i for i in range(len(names)) if i not in texts):
            if not _is_number(cells[column]):
                what = f"{_shown(names[column])} is '{_shown(cells[column])}', not a number"
                return f"{path}:{number}: {what}", column
    return f"{path}: cannot be read as CSV", None


def _some(names: list[str]) -> str:
    """The names, the first few of many."""
    more = f" and {len(names) - _NAMED_MAX} more" if len(names) > _NAMED_MAX else ""
    return ", ".join(names[:_NAMED_MAX]) + more


def _header_hint(names: list[str], wanted: tuple[str, ...]) -> str:
    """What to do about a header without the columns `wanted`."""
    if names[0].startswith("#"):
        return "the header begins with #; in numpy write savetxt(..., comments='')"
    if len(wanted) <= _NAMED_MAX:
        return f"the header must be {','.join(wanted)}"
    return "is it a table that `crease replay` wrote?"


def read_csv(path: Path, wanted: tuple[str, ...] = ()) -> dict[str, Column]:
    """Columns of a CSV file with a header, as float64 by name.

    `wanted` must be there; further columns come along, those of text are left out. Without `wanted` none may be text.
    Errors: TableError with file, line and reason.
    """
    names, skip = read_header(path)
    if len(names) == 1 and (between := next((s for s in _SEPARATORS if s in names[0]), "")):
        raise TableError(
            f"{path}:{skip}: the columns are separated by {_SEPARATORS[between]}; separate them by commas, and write "
            "numbers with points"
        )
    if missing := [name for name in wanted if name not in names]:
        raise TableError(
            f"{path}:{skip}: no column {_some(missing)}; {_header_hint(names, wanted)}"
        )
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise TableError(f"{path}:{skip}: column {_shown(', '.join(twice))} stands twice; keep one")
    values, texts = _parse_numbers(path, skip, names, wanted)
    if values.size == 0:
        raise TableError(f"{path}: has a header but no rows; give at least one")
    if values.shape[1] != len(names):
        raise TableError(_bad_line(path, skip, names, texts)[0])
    return {name: values[:, i] for i, name in enumerate(names) if i not in texts}


def _parse_numbers(
    path: Path, skip: int, names: list[str], wanted: tuple[str, ...]
) -> tuple[npt.NDArray[np.float64], list[int]]:
    """All rows, and which columns hold text: of these no numbers come.   Errors: TableError."""
    texts: list[int] = []
    while True:
        try:
            return _parse_rows(path, skip, texts), texts
        except (OSError, UnicodeDecodeError, ValueError) as error:
            reason, column = _bad_line(path, skip, names, texts)
            if column is None or not wanted or names[column] in wanted:
                raise TableError(reason) from error
            texts.append(column)


def _parse_rows(path: Path, skip: int, texts: Sequence[int]) -> npt.NDArray[np.float64]:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", UserWarning
        )  # "input contained no data": reported by the caller
        values: npt.NDArray[np.float64] = np.loadtxt(
            path,
            delimiter=",",
            skiprows=skip,
            comments=None,
            quotechar='"',
            ndmin=2,
            encoding="utf-8-sig",
            converters={column: lambda _: np.nan for column in texts},
        )
    return values


def check_columns(path: Path, columns: Mapping[str, Column]) -> None:
    """Errors: TableError for arrays that are not one real number a tick."""
    lengths: dict[int, str] = {}
    for name, column in columns.items():
        if np.iscomplexobj(column):
            raise TableError(f"{path}: array {name} holds complex numbers; give real ones")
        if np.ndim(column) != 1:
            raise TableError(
                f"{path}: array {name} has the shape {np.shape(column)}; give it the shape ({np.size(column)},), one "
                "number a tick"
            )
        lengths.setdefault(len(column), name)
    if len(lengths) > 1:
        (one, first), (two, second) = list(lengths.items())[:2]
        raise TableError(
            f"{path}: the arrays are not of one length, {first} has {one:,} and {second} {two:,}; each needs one "
            "number a tick"
        )


def column_names(path: Path) -> list[str]:
    """Names of the columns of a CSV or NPZ file.   Errors: TableError."""
    csv_file = path.exists() and path.suffix.lower() == ".csv"
    return read_header(path)[0] if csv_file else list(read_table(path))


def read_table(path: Path, wanted: tuple[str, ...] = ()) -> dict[str, Column]:
    """Columns of a CSV or NPZ file by name.   Errors: TableError."""
    if not path.exists():
        raise TableError(f"{path}: there is no such file")
    match path.suffix.lower():
        case ".csv":
            return read_csv(path, wanted)
        case ".npz":
            columns = load_npz(path)
        case ".crr":
            raise TableError(
                f"{path}: is a recording of the loop, no path and no table; `crease replay SCENE.crs {path.name} -o "
                "TABLE.csv` makes a table of it, `crease plot` draws it"
            )
        case _:
            raise TableError(
                f"{path}: is no path and no table: the suffix is neither .csv nor .npz; give one of these"
            )
    if missing := [name for name in wanted if name not in columns]:
        raise TableError(
            f"{path}: no array {_some(missing)}; it must have {','.join(wanted[:_NAMED_MAX])}"
        )
    check_columns(path, {name: columns[name] for name in wanted})
    return columns
