"""What was found, as CSV and as tables of text."""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Iterable, Sequence

from crease.lab.setup import Table

from study.properties.checks import CHECKS
from study.properties.judge import SILENT_MAX, Row

COLUMNS: tuple[tuple[str, str, str, float, int], ...] = (
    ("P1", "flat, %", "flat_error", 100.0, 1),
    ("", "half on, mm", "half_on_mm", 1.0, 2),
    ("P2", "outside, %", "clear_outside", 100.0, 0),
    ("P3", "jump, mm", "jump_mm", 1.0, 3),
    ("P3", "of torque", "torque_jump_mm", 1.0, 3),
    ("P4", "twin, %", "twin_error", 100.0, 1),
    ("P5", "wall, %", "wall_error", 100.0, 1),
    ("P6", "energy, %", "energy_share", 100.0, 1),
    ("P7", "ghost, mm", "ghost_mm", 1.0, 3),
    ("P7", "silent, mm", "silent_mm", 1.0, 3),
    ("P7", "balance, mm", "balance_mm", 1.0, 2),
    ("P7", "jam: F/k over depth", "jam_largest", 1.0, 2),
    ("", "jammed poses", "jam_poses", 1.0, 0),
    ("P8", "torque, mm RMS", "torque_rms_mm", 1.0, 3),
    ("P9", "amplification", "amplification", 1.0, 2),
    ("", "p99", "amplification_p99", 1.0, 2),
    ("", "of torque", "torque_amplification", 1.0, 2),
    ("", "largest F/k, mm", "force_largest_mm", 1.0, 2),
)
"""Property, head, key, factor and decimals of each column but the clearing factor."""


Record = dict[str, str]
"""A line of the CSV: scene, response, numbers by key, `kept` or `broken` by property, `breaks`: keys over bounds."""


def to_csv(rows: Sequence[Row]) -> str:
    """One line for each scene and response; empty where the scene does not ask."""
    keys = list(dict.fromkeys(key for row in rows for key in row.values()))
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        ["scene", "response", *keys, *CHECKS, "breaks", "silent", "tick_p50_us", "tick_p99_us"]
    )
    for row in rows:
        values, verdicts = row.values(), row.verdicts()
        numbers = [f"{values[k]:.6g}" if k in values else "" for k in keys]
        kept = [
            {True: "kept", False: "broken"}[verdicts[p]] if p in verdicts else "" for p in CHECKS
        ]
        breaks = [f.key for group in row.findings.values() for f in group if f.rated and not f.kept]
        times = [f"{t:.4g}" for t in (row.tick_p50_us, row.tick_p99_us)]
        writer.writerow(
            [
                row.scene.name,
                row.response,
                *numbers,
                *kept,
                " ".join(breaks),
                f"{row.silent:.3g}",
                *times,
            ]
        )
    return out.getvalue()


def read_csv(text: str) -> list[Record]:
    """The lines of what `to_csv` wrote."""
    return list(csv.DictReader(io.StringIO(text)))


def _number(value: float, digits: int) -> str:
    """Few digits, however large."""
    if math.isnan(value):
        return ""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.{digits}f}"


def _cell(record: Record, key: str, factor: float, digits: int) -> str:
    if not record.get(key):
        return ""
    text = _number(factor * float(record[key]), digits)
    return f"**{text}**" if key in record["breaks"].split() else text


def scene_table(records: Iterable[Record], response: str) -> Table:
    """A row for each scene; what breaks its bound stands in asterisks. Columns that no scene fills are left out."""
    records = [r for r in records if r["response"] == response]
    columns = [c for c in COLUMNS if any(r.get(c[2]) for r in records)]
    lines = []
    for record in records:
        clear = " / ".join(
            f"{float(record[f'clear_p{p}']):.2f}" for p in (5, 50, 95) if record.get(f"clear_p{p}")
        )
        cells = [_cell(record, key, factor, digits) for _, _, key, factor, digits in columns]
        time = " / ".join(_number(float(record[f"tick_{p}_us"]), 1) for p in ("p50", "p99"))
        broken = " ".join(name for name in CHECKS if record[name] == "broken") or "none"
        lines.append((record["scene"], clear, *cells, time, broken))
    heads = [f"{name} {head}".strip() for name, head, *_ in columns]
    return Table(
        f"{response}: every scene",
        ("scene", "P2 clear 5 / 50 / 95 %", *heads, "tick p50 / p99, us", "broken"),
        tuple(lines),
    )


def summary_table(records: Sequence[Record]) -> Table:
    """A row for each response: scenes that keep each property of those that rate it; time of a tick, median scene."""
    lines = []
    for response in dict.fromkeys(r["response"] for r in records):
        mine = [r for r in records if r["response"] == response]
        cells = []
        for name in CHECKS:
            kept = [r[name] == "kept" for r in mine if r[name]]
            cells.append(f"{sum(kept)}/{len(kept)}" if kept else "")
        silent = sum(float(r["silent"]) > SILENT_MAX for r in mine)
        lines.append(
            (
                response,
                *cells,
                f"{100 * kept_share(mine):.0f} %",
                str(silent),
                _number(median_us(mine), 1),
            )
        )
    return Table(
        "Scenes that keep a property, of those that ask for it",
        ("response", *CHECKS, "all", "scenes it is silent in", "p50, us"),
        tuple(lines),
    )


def kept_share(records: Iterable[Record]) -> float:
    """Share of all ratings that are kept."""
    kept = [r[name] == "kept" for r in records for name in CHECKS if r[name]]
    return sum(kept) / len(kept) if kept else math.nan


def median_us(records: Iterable[Record]) -> float:
    """Median over the scenes of the median time in contact; NaN of none."""
    times = [t for r in records if not math.isnan(t := float(r["tick_p50_us"]))]
    return float(statistics.median(times)) if times else math.nan


def markdown(table: Table) -> str:
    """The table for a page."""

    def line(cells: Sequence[str]) -> str:
        return f"| {' | '.join(cells)} |"

    rule = "|" + "---|" * len(table.heads)
    return "\n".join([line(table.heads), rule, *map(line, table.rows)])
