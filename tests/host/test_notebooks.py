"""The notebooks run from the first cell to the last, as in a fresh clone, and are kept without outputs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "host/notebooks").glob("*.ipynb"))

pytestmark = pytest.mark.slow


def read(path: Path) -> Any:
    """A notebook."""
    return nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]


def code(book: Any) -> list[str]:
    """Texts of the cells that are run."""
    return [cell.source for cell in book.cells if cell.cell_type == "code"]


def run(path: Path, folder: Path) -> Any:
    """The notebook with its outputs.   Errors: nbclient's, for a cell that fails."""
    book = read(path)
    (folder / "build").mkdir()
    (folder / "build/meshes").symlink_to(ROOT / "build/meshes")
    NotebookClient(
        book, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    ).execute()
    return book


def pictures(book: Any) -> int:
    return sum(
        "image/png" in output.get("data", {})
        for cell in book.cells
        for output in cell.get("outputs", [])
    )


def test_there_are_two() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["compare", "ten_lines"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_outputs(path: Path) -> None:
    book = read(path)
    nbformat.validate(book)
    for cell in book.cells:
        if cell.cell_type == "code":
            assert (cell.outputs, cell.execution_count) == ([], None)
    links = re.findall(
        r"\]\(([^)#]+)\)", "\n".join(c.source for c in book.cells if c.cell_type == "markdown")
    )
    assert all((path.parent / link).exists() for link in links)


def test_ten_lines_are_ten_lines_and_draw_the_force(tmp_path: Path) -> None:
    path = next(path for path in NOTEBOOKS if path.stem == "ten_lines")
    book = run(path, tmp_path)
    assert (
        sum(bool(line.strip()) for line in "\n".join(code(book)).splitlines()) <= 10 + 1
    )  # and the files
    assert pictures(book) == 1


def test_responses_are_compared_by_their_numbers(tmp_path: Path) -> None:
    path = next(path for path in NOTEBOOKS if path.stem == "compare")
    book = run(path, tmp_path)
    assert pictures(book) == 1
    said = "".join(
        o.text
        for c in book.cells
        for o in c.get("outputs", [])
        if "text" in o and o.name == "stdout"
    )
    rows = {line.split()[0]: [float(v) for v in line.split()[1:]] for line in said.splitlines()[1:]}
    assert set(rows) == {"way_out", "fixed45"}
    (_, turn, amplification), (_, other_turn, other_amplification) = (
        rows["way_out"],
        rows["fixed45"],
    )
    assert turn < 2.0
    assert other_turn > 40.0
    assert amplification < 2.0 < other_amplification
