"""Tables of accuracy on every scene in REPORT.md and README.md, from accuracy.csv beside this file.

    python tests/bench/bench.py --csv tests/bench/accuracy.csv
    python tests/bench/scene_tables.py

Only what lies between `<!-- NAME: begin -->` and `<!-- NAME: end -->` is written; the words round it are a person's.
"""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from crease.base.errors import CreaseError

HERE = Path(__file__).resolve().parent
REPORT, README = HERE / "REPORT.md", HERE.parents[1] / "README.md"
ACCURACY = HERE / "accuracy.csv"
METHODS = {
    "way_out": "way out",
    "extent": "extent",
    "published": "published",
    "fixed45": "fixed 45",
}
"""As the CSV has them, and as the tables name them. The first is the default."""
DEFAULT = next(iter(METHODS))
TESSELLATIONS = ("edge90_cube_", "wall_cube_")
"""Scenes that differ from another in the tool's triangles only: not in the tables."""
SHORT = ("edge90_sphere", "edge90_cube", "corner3_sphere", "corner3_cube", "cylinder_ball", "bar_u", "groove_block",
         "step_cube", "part_spanner")  # fmt: skip
"""Scenes of the short table."""
FIRST = (
    ("edge90_sphere", "ball R 50 mm, 10 mm deep round a 90-degree edge"),
    ("edge90_cube", "60 mm cube over the edge of a 45,000-triangle block"),
)
"""Scenes of the README's first table, and what they are."""
HEADS = (
    "force, mm RMS / max",
    "torque, mm RMS / max",
    "direction p99 / max, deg",
    "depth, mm",
    "amplification (exact)",
    "step (exact), deg",
)

Row = dict[str, str]


def read_accuracy(file: Path = ACCURACY) -> list[Row]:
    """A row for each scene and method, as `bench.py --csv` writes them.   Errors: OSError."""
    with file.open(encoding="utf-8", newline="") as source:
        return [row for row in csv.DictReader(source) if not row["scene"].startswith(TESSELLATIONS)]


def _cells(row: Row) -> tuple[str, ...]:
    """The figures of a row, under HEADS."""

    def number(key: str) -> str:
        value = float(row[key])
        if math.isnan(value):
            return ""
        return f"{value:.2f}" if "deg" in key else f"{value:.{4 if value < 1.0 else 3}f}"

    def pair(*keys: str) -> str:
        return " / ".join(text for key in keys if (text := number(key)))

    def beside(key: str, exact: str) -> str:
        value, true = float(row[key]), float(row[exact])
        return (
            ""
            if math.isnan(value)
            else f"{value:.2f}" + ("" if math.isnan(true) else f" ({true:.2f})")
        )

    return (
        pair("force_rms_mm", "force_max_mm"),
        pair("torque_rms_mm", "torque_max_mm"),
        pair("direction_p99_deg", "direction_max_deg"),
        pair("depth_max_mm"),
        beside("amplification", "amplification_exact"),
        beside("step_max_deg", "step_exact_deg"),
    )


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def whole_table(rows: Iterable[Row]) -> str:
    """Every scene and method."""
    cells = (
        (r["scene"] * (r["method"] == DEFAULT), METHODS[r["method"]], *_cells(r)) for r in rows
    )
    return _table(("scene", "method", *HEADS), list(cells))


def short_table(rows: Iterable[Row]) -> str:
    """Some scenes with the default settings, and the force beside that of fixed 45."""
    found = {(row["scene"], row["method"]): _cells(row) for row in rows}
    heads = ("scene", HEADS[0], "the same, fixed 45", HEADS[1], HEADS[2], HEADS[4])
    cells = []
    for scene in SHORT:
        force, torque, direction, _, amplification, _ = found[scene, DEFAULT]
        cells.append((scene, force, found[scene, "fixed45"][0], torque, direction, amplification))
    return _table(heads, cells)


def first_table(rows: Iterable[Row]) -> str:
    """What a reader sees first: two scenes, each beside the fixed 45 degrees."""
    found = {(row["scene"], row["method"]): (row, _cells(row)) for row in rows}
    heads = (
        "",
        "direction error, max",
        "turn in one tick (exact)",
        HEADS[4],
        "force error / k, RMS / max",
    )
    cells = []
    for scene, words in FIRST:
        for method, what in ((DEFAULT, words), ("fixed45", "the same, fixed 45 degrees")):
            row, (force, _, _, _, amplification, turn) = found[scene, method]
            degrees = f"{float(row['direction_max_deg']):.2f} deg"
            cells.append((what, degrees, f"{turn} deg", amplification, f"{force} mm"))
    return _table(heads, cells)


def with_table(text: str, name: str, table: str) -> str:
    """A page with what stands between the two marks of a name replaced.   Errors: CreaseError without the marks."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    if text.count(begin) != 1 or text.count(end) != 1:
        raise CreaseError(f"'{begin}' and '{end}' must stand there once")
    head, rest = text.split(begin)
    return f"{head}{begin}\n{table}\n{end}{rest.split(end)[1]}"


def filled() -> dict[Path, str]:
    """The pages as they must be.   Errors: OSError, CreaseError."""
    rows = read_accuracy()
    pages = {page: page.read_text(encoding="utf-8") for page in (REPORT, README)}
    pages[REPORT] = with_table(pages[REPORT], "accuracy", whole_table(rows))
    for name, table in (("first", first_table(rows)), ("table", short_table(rows))):
        pages[README] = with_table(pages[README], name, table)
    return pages


def main() -> int:
    """Command line: see the top of the file."""
    try:
        for page, text in filled().items():
            page.write_text(text, encoding="utf-8")
            print(page)
    except (OSError, CreaseError) as error:
        print(f"error: {error}; run bench.py with --csv {ACCURACY} first", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
