"""Points of run time against error: what one is, their file, and whether a rival beats the default."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

from crease.base.errors import CreaseError

OURS = "way out, default"
"""Group of the point that all others are judged by, one for each scene."""

ZONES = "contact zones"
"""Group of the contact-zone method: by the extent of the overlap, and as published."""

RIVALS = ("rival response", "rival library")
"""Groups that are other people's methods. The others are settings of ours, and the exact boolean."""

MEASURES = {
    "force_rms_mm": ("force RMS", "mm"),
    "force_max_mm": ("largest force error", "mm"),
    "direction_p50_deg": ("median direction error", "deg"),
    "direction_p99_deg": ("direction p99", "deg"),
    "depth_rms_mm": ("depth RMS", "mm"),
}
"""Errors that the verdict compares: name and unit of each."""

CLEAR = 0.98
"""Faster or more accurate: below this share of ours. Less is noise of the clock, or rounding."""

FLOOR = 1e-6
"""Errors below this, in mm or degrees, are no difference: the exact tables are rounded to it."""


@dataclass(frozen=True)
class Point:
    """One way to answer one path. Times in us, errors in mm and degrees; NaN where it has none."""

    scene: str
    group: str
    label: str
    voxel_mm: float
    spacing_mm: float
    tool_triangles: int
    p50_us: float
    p9999_us: float
    instructions: float
    state_bytes: int
    image_bytes: int
    force_rms_mm: float
    force_max_mm: float
    direction_p50_deg: float
    direction_p99_deg: float
    depth_rms_mm: float
    amplification: float
    amplification_exact: float


def read_points(file: Path) -> list[Point]:
    """Points as `write_records` writes them.   Errors: CreaseError."""
    try:
        with file.open(encoding="utf-8", newline="") as source:
            return [
                Point(**{f.name: _parse(f.type, row[f.name]) for f in fields(Point)})
                for row in csv.DictReader(source)
            ]
    except OSError as error:
        raise CreaseError(
            f"{file}: cannot be read: {error.strerror}; `make bench-peers` writes it"
        ) from error
    except (KeyError, ValueError) as error:
        raise CreaseError(
            f"{file}: cannot be read as points: {error}; make it again with `make bench-peers`"
        ) from error


def _parse(kind: Any, text: str) -> Any:
    parsers: dict[str, Any] = {"str": str, "int": int, "float": float}
    return parsers[str(kind)](text)


def write_records(file: Path, records: Sequence[Any]) -> None:
    """Data classes of one kind as CSV, a column for each field.   Errors: CreaseError."""
    from crease.base.table import write_bytes

    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(f.name for f in fields(records[0]))
    for record in records:
        out.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in astuple(record)])
    write_bytes(file, text.getvalue().encode())


def less_error(rival: Point, ours: Point) -> list[str]:
    """The measures in which a rival is clearly more accurate. One that it does not have (NaN) is none of them."""
    return [
        key
        for key in MEASURES
        if getattr(rival, key) < CLEAR * getattr(ours, key)
        and getattr(ours, key) - getattr(rival, key) > FLOOR
    ]


def verdict(points: list[Point]) -> list[str]:
    """For each scene: how many rivals are faster, which of them are more accurate too, which others are more accurate.

    Lines of rivals begin with two blanks.   Errors: CreaseError when a scene has no point of ours.
    """
    lines = []
    for scene in dict.fromkeys(p.scene for p in points):
        here = [p for p in points if p.scene == scene]
        ours = next((p for p in here if p.group == OURS), None)
        if ours is None:
            raise CreaseError(
                f"{scene}: points of rivals, but none of ours; is it a scene of `crease bench pareto`?"
            )
        rivals = [p for p in here if p.group in RIVALS]
        faster = [p for p in rivals if p.p50_us < CLEAR * ours.p50_us]
        better = [(p, keys) for p in rivals if (keys := less_error(p, ours))]
        beaten = [(p, keys) for p, keys in better if p in faster]
        lines.append(
            f"{scene}: {len(faster)} of {len(rivals)} rivals faster, {len(beaten)} of them more accurate too"
        )
        lines += [f"  {_better(p, keys, ours)}{_worse(p, keys, ours)}" for p, keys in beaten]
        lines += [
            f"  not faster: {_better(p, keys, ours)}" for p, keys in better if p not in faster
        ]
    return lines


def _number(value: float) -> str:
    return "silent" if math.isnan(value) else f"{value:,.0f}" if value >= 100 else f"{value:.2g}"


def _pair(key: str, rival: Point, ours: Point) -> str:
    name, unit = MEASURES[key]
    return f"{name} {_number(getattr(rival, key))} against {_number(getattr(ours, key))} {unit}"


def _better(rival: Point, keys: list[str], ours: Point) -> str:
    said = ", ".join(_pair(key, rival, ours) for key in keys)
    return f"{rival.label}, {_number(rival.p50_us)} us against {_number(ours.p50_us)}: better in {said}"


def _worse(rival: Point, better: list[str], ours: Point) -> str:
    keys = [k for k in MEASURES if k not in better and not getattr(rival, k) <= getattr(ours, k)]
    said = ", ".join(_pair(key, rival, ours) for key in keys)
    return f"; worse in {said}" if said else "; worse in nothing: it dominates"
