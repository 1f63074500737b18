"""Tables of REPORT.md from the CSV beside it; given a folder of results, CSV and pictures come from there.

    python tests/bench/report.py [build/bench]          # of make bench-peers
    python tests/bench/report.py build/properties       # of make bench-properties
    python tests/bench/report.py build/bench -o DIR     # a copy of the report in DIR, this one stays as it is

Only what lies between `<!-- NAME: begin -->` and `<!-- NAME: end -->` is written; the words round it are a person's.
"""

from __future__ import annotations

import argparse
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
PEERS_FILES = ("pareto.csv", "precision.csv", "pareto.png", "pareto_more.png", "precision.png")
PROPERTIES_FILES = (
    "properties.csv",
    "properties.png",
    "properties_way_out.png",
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
        return _unseen(p)
    return f"{_number(p.direction_p50_deg)} / {_number(p.direction_p99_deg)}"


def _unseen(p: Point) -> str:
    """Of a point without a direction: it was silent, or its path has no exact table."""
    return "" if math.isnan(p.force_rms_mm) else "silent"


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
            "0" if exact else _both(p.force_rms_mm, p.force_max_mm),
            "0" if exact else _angles(p),
            "" if exact else _beside(p.amplification, p.amplification_exact),
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
        turn = _unseen(p) if math.isnan(p.direction_p99_deg) else _number(p.direction_p99_deg)
        cells = (_number(p.p50_us), _number(p.force_rms_mm), turn)
        return " / ".join(c for c in cells if c)

    names = {p.label: f"**{p.label}**" if p.group == OURS else p.label for p in chosen}
    rows = [(names[label], *(cell(label, scene) for scene in scenes)) for label in labels]
    return _table(("us / mm / deg", *scenes), rows)


def _verdict(points: list[Point]) -> str:
    return "\n".join(f"  - {t[2:]}" if t.startswith("  ") else f"- {t}" for t in verdict(points))


def _precision(folder: Path) -> str:
    heads = ("path", "response", "ticks in contact", "decide otherwise", "differ by over 0.1 um",
             "force RMS / p99 / max, um", "direction p99 / max, deg", "error float32 / double, mm",
             "tick float32 / double, us")  # fmt: skip
    with (folder / "precision.csv").open(encoding="utf-8", newline="") as file:
        rows = [
            (
                row["path"], row["response"], f"{int(row['ticks']):,}", row["flips"], row["choices"],
                " / ".join(_number(float(row[f"force_{k}_um"])) for k in ("rms", "p99", "max")),
                " / ".join(_number(float(row[f"direction_{k}_deg"])) for k in ("p99", "max")),
                _pair(row["error_single_mm"], row["error_double_mm"]),
                f"{_number(float(row['single_us']))} / {_number(float(row['double_us']))}",
            )
            for row in csv.DictReader(file)
        ]  # fmt: skip
    return _table(heads, rows)


def _both(one: float, other: float) -> str:
    """Two errors in few digits; nothing where no exact table is known."""
    return "" if math.isnan(one) else f"{_number(one)} / {_number(other)}"


def _beside(found: float, exact: float) -> str:
    """A figure, and that of the exact contact where one is known."""
    return _number(found) if math.isnan(exact) else f"{_number(found)} ({_number(exact)})"


def _pair(one: str, other: str) -> str:
    """Two errors; nothing where no exact table is known."""
    return "" if math.isnan(float(one)) else f"{float(one):.4g} / {float(other):.4g}"


def _properties(folder: Path) -> dict[str, str]:
    """Tables of the judge: every response, the way out, and what was the library's response before it."""
    now, before = (
        read_csv((folder / name).read_text(encoding="utf-8"))
        for name in ("properties.csv", "properties_before.csv")
    )
    return {
        "properties": markdown(summary_table(now)),
        "properties_way_out": markdown(scene_table(now, "way_out")),
        "properties_before": markdown(scene_table(before, "extent")),
    }


def filled(text: str, folder: Path) -> str:
    """The report with the tables of the CSV in a folder.   Errors: CreaseError when a mark or a file is missing."""
    points = read_points(folder / "pareto.csv")
    tables = {
        "settings": _settings(points),
        "rivals": _rivals(points),
        "verdict": _verdict(points),
        "precision": _precision(folder),
        **_properties(folder),
    }
    for name, table in tables.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        if text.count(begin) != 1 or text.count(end) != 1:
            raise CreaseError(f"{REPORT.name}: '{begin}' and '{end}' must stand there once")
        head, rest = text.split(begin)
        text = f"{head}{begin}\n{table}\n{end}{rest.split(end)[1]}"
    return text


def write_report(results: Path | None, out: Path) -> Path:
    """The report in `out`, with the files of `results` in place of those that are there.   Errors: CreaseError."""
    if out.resolve() != HERE:
        out.mkdir(parents=True, exist_ok=True)
        for name in (REPORT.name, *PEERS_FILES, *PROPERTIES_FILES, "properties_before.csv"):
            shutil.copyfile(HERE / name, out / name)
    if results is not None:
        for name in PROPERTIES_FILES if (results / "properties.csv").exists() else PEERS_FILES:
            shutil.copyfile(results / name, out / name)
    report = out / REPORT.name
    report.write_text(filled(report.read_text(encoding="utf-8"), out), encoding="utf-8")
    return report


def main() -> int:
    """Command line: see the top of the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("results", nargs="?", type=Path, help="folder of results")
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, default=HERE)
    args = parser.parse_args()
    try:
        print(write_report(args.results, args.output))
    except (OSError, CreaseError) as error:
        print(
            f"error: {error}; run `make bench-peers` or `make bench-properties` first",
            file=sys.stderr,
        )
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
