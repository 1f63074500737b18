"""Tables of REPORT.md, and one of README.md, from the CSV beside it.

Given a folder of results, CSV and pictures come from there:

    python tests/bench/report.py [build/bench]          # of make bench-peers
    python tests/bench/report.py build/properties       # of make bench-properties

Only what lies between `<!-- NAME: begin -->` and `<!-- NAME: end -->` is written; the words round it are a person's.
"""

from __future__ import annotations

import csv
import math
import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from crease.base.errors import CreaseError
from study.points import OURS, Point, read_points, verdict
from study.properties.tables import markdown, read_csv, scene_table, summary_table

HERE = Path(__file__).resolve().parent
REPORT = HERE / "REPORT.md"
README = HERE.parents[1] / "README.md"
PEERS_FILES = ("pareto.csv", "precision.csv", "pareto.png", "pareto_more.png", "precision.png")
PROPERTIES_FILES = (
    "properties.csv",
    "properties.png",
    "properties_zones.png",
    "properties_paths.png",
)


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join([_row(heads), "|" + "---|" * len(heads), *map(_row, rows)])


def _number(value: float) -> str:
    if math.isnan(value):
        return ""
    return f"{value:,.0f}" if value >= 100 else f"{value:.2g}"


def _angles(p: Point) -> str:
    if math.isnan(p.direction_p99_deg):
        return "silent"
    return f"{_number(p.direction_p50_deg)} / {_number(p.direction_p99_deg)}"


def _settings(points: list[Point]) -> str:
    heads = ("path", "setting", "p50 / p99.99, us", "instructions", "image, MB", "force RMS / max, mm",
             "direction p50 / p99, deg", "amplification (exact)")  # fmt: skip
    chosen = [p for p in points if not p.group.startswith("rival")]
    rows = []
    for p in chosen:
        name = (
            f"**{p.label}**, {p.voxel_mm:g} mm voxel, {p.spacing_mm:g} mm samples"
            if p.group == OURS
            else p.label
        )
        exact = p.group == "exact boolean"
        rows.append((
            p.scene, name, f"{_number(p.p50_us)} / {_number(p.p9999_us)}",
            "" if math.isnan(p.instructions) else f"{round(p.instructions, -3):,.0f}",
            "" if exact else f"{1e-6 * p.image_bytes:.1f}",
            "0" if exact else f"{_number(p.force_rms_mm)} / {_number(p.force_max_mm)}",
            "0" if exact else _angles(p),
            "" if exact else f"{_number(p.amplification)} ({_number(p.amplification_exact)})",
        ))  # fmt: skip
    return _table(heads, rows)


def _rivals(points: list[Point]) -> str:
    """A row for each way to answer, a column for each path: time, force error, direction error."""
    scenes = list(dict.fromkeys(p.scene for p in points))
    chosen = [p for p in points if p.group == OURS or p.group.startswith("rival")]
    labels = list(dict.fromkeys(p.label for p in chosen))

    def cell(label: str, scene: str) -> str:
        found = [p for p in chosen if (p.label, p.scene) == (label, scene)]
        if not found:
            return ""
        p = found[0]
        turn = "silent" if math.isnan(p.direction_p99_deg) else _number(p.direction_p99_deg)
        return f"{_number(p.p50_us)} / {_number(p.force_rms_mm)} / {turn}"

    names = {p.label: f"**{p.label}**" if p.group == OURS else p.label for p in chosen}
    rows = [(names[label], *(cell(label, scene) for scene in scenes)) for label in labels]
    return _table(("us / mm / deg", *scenes), rows)


def _verdict(points: list[Point]) -> str:
    return "\n".join(f"  - {t[2:]}" if t.startswith("  ") else f"- {t}" for t in verdict(points))


def _precision(folder: Path) -> str:
    heads = ("path", "coverage", "ticks in contact", "decide otherwise", "differ by over 0.1 um",
             "force RMS / p99 / max, um", "direction p99 / max, deg", "error float32 / double, mm",
             "tick float32 / double, us")  # fmt: skip
    with (folder / "precision.csv").open(encoding="utf-8", newline="") as file:
        rows = [
            (
                row["path"], row["coverage"], f"{int(row['ticks']):,}", row["flips"], row["choices"],
                " / ".join(_number(float(row[f"force_{k}_um"])) for k in ("rms", "p99", "max")),
                " / ".join(_number(float(row[f"direction_{k}_deg"])) for k in ("p99", "max")),
                f"{float(row['error_single_mm']):.4g} / {float(row['error_double_mm']):.4g}",
                f"{_number(float(row['single_us']))} / {_number(float(row['double_us']))}",
            )
            for row in csv.DictReader(file)
        ]  # fmt: skip
    return _table(heads, rows)


METHODS = {"soft": "zones, soft", "hard": "zones, hard", "fixed45": "fixed 45"}
"""As accuracy.csv has them, and as tables name them."""
TESSELLATIONS = ("edge90_cube_", "wall_cube_")
"""Scenes that differ from another in the tool's triangles only: not in the tables."""


def _accuracy_rows() -> list[dict[str, str]]:
    """Rows of accuracy.csv, which `bench.py --csv` writes."""
    with (HERE / "accuracy.csv").open(encoding="utf-8", newline="") as file:
        return [row for row in csv.DictReader(file) if not row["scene"].startswith(TESSELLATIONS)]


def _errors(row: dict[str, str]) -> tuple[str, ...]:
    def pair(*keys: str) -> str:
        return " / ".join(f"{float(row[key]):.{2 if 'deg' in key else 4}f}" for key in keys)

    def beside(key: str, exact: str) -> str:
        return f"{float(row[key]):.2f} ({float(row[exact]):.2f})"

    return (
        pair("force_rms_mm", "force_max_mm"),
        pair("torque_rms_mm", "torque_max_mm"),
        pair("direction_p99_deg", "direction_max_deg"),
        f"{float(row['depth_max_mm']):.4f}",
        beside("amplification", "amplification_exact"),
        beside("step_max_deg", "step_exact_deg"),
    )


ERROR_HEADS = ("force, mm RMS / max", "torque, mm RMS / max", "direction p99 / max, deg", "depth, mm",
               "amplification (exact)", "step (exact), deg")  # fmt: skip


def _accuracy() -> str:
    """Every scene and method."""
    rows = [
        (row["scene"] if row["method"] == "soft" else "", METHODS[row["method"]], *_errors(row))
        for row in _accuracy_rows()
    ]
    return _table(("scene", "method", *ERROR_HEADS), rows)


def _accuracy_short() -> str:
    """Every scene, default settings."""
    rows = [(r["scene"], *_errors(r)) for r in _accuracy_rows() if r["method"] == "soft"]
    return _table(("scene", *ERROR_HEADS), rows)


def _properties(folder: Path) -> dict[str, str]:
    """Tables of the judge: every response, the zone method now, and as it was before its force was defined anew."""
    now, before = (
        read_csv((folder / name).read_text(encoding="utf-8"))
        for name in ("properties.csv", "properties_before.csv")
    )
    return {
        "properties": markdown(summary_table(now)),
        "properties_zones": markdown(scene_table(now, "zones")),
        "properties_before": markdown(scene_table(before, "zones")),
    }


def filled(text: str, folder: Path) -> str:
    """The report with the tables of the CSV in a folder.   Errors: CreaseError when a mark or a file is missing."""
    points = read_points(folder / "pareto.csv")
    tables = {
        "settings": _settings(points),
        "accuracy": _accuracy(),
        "rivals": _rivals(points),
        "verdict": _verdict(points),
        "precision": _precision(folder),
        **_properties(folder),
    }
    return _between_marks(text, tables, REPORT.name)


def filled_readme(text: str) -> str:
    """README.md with its table of scenes.   Errors: CreaseError when a mark or a file is missing."""
    return _between_marks(text, {"table": _accuracy_short()}, README.name)


def _between_marks(text: str, tables: dict[str, str], file: str) -> str:
    for name, table in tables.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        if text.count(begin) != 1 or text.count(end) != 1:
            raise CreaseError(f"{file}: '{begin}' and '{end}' must stand there once")
        head, rest = text.split(begin)
        text = f"{head}{begin}\n{table}\n{end}{rest.split(end)[1]}"
    return text


def main() -> int:
    """Command line: see the top of the file."""
    try:
        if len(sys.argv) == 2:
            folder = Path(sys.argv[1])
            for name in PROPERTIES_FILES if (folder / "properties.csv").exists() else PEERS_FILES:
                shutil.copyfile(folder / name, HERE / name)
        REPORT.write_text(filled(REPORT.read_text(encoding="utf-8"), HERE), encoding="utf-8")
        README.write_text(filled_readme(README.read_text(encoding="utf-8")), encoding="utf-8")
    except (OSError, CreaseError) as error:
        print(
            f"error: {error}; run `make bench-peers` or `make bench-properties` first",
            file=sys.stderr,
        )
        return 1
    print(REPORT)
    return 0


if __name__ == "__main__":
    sys.exit(main())
