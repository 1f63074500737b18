"""Lengths and sizes as a person writes them: `2mm`, `0.1 mm`, `1in`, `0.5` (of a unit said elsewhere), `1.9MiB`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from crease.base.errors import UnitError

METRES: dict[str, float] = {
    "nm": 1e-9,
    "um": 1e-6,
    "mm": 1e-3,
    "cm": 1e-2,
    "dm": 1e-1,
    "m": 1.0,
    "in": 0.0254,
    "ft": 0.3048,
}
"""Metres of one unit, by the name of the unit."""

_LENGTH = re.compile(
    r"^\s*(?P<number>[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)\s*(?P<unit>[A-Za-zµμ]*)\s*$"
)


def parse_unit(text: str) -> float:
    """Metres of one unit named `text`.

    Errors: UnitError when there is no such unit.
    """
    name = text.strip().lower().replace("µ", "u").replace("μ", "u")
    if name not in METRES:
        raise UnitError(f"unit '{text}' is not known; use one of {', '.join(METRES)}")
    return METRES[name]


def unit_name(unit_m: float) -> str:
    """The name of a unit of so many metres, `units` for one that has none."""
    return next((name for name, metres in METRES.items() if metres == unit_m), "units")


def _any_length(text: str, bare_m: float) -> float:
    """A length of any sign, in m.   Errors: UnitError when it is not a number or has an unknown unit."""
    match = _LENGTH.match(text)
    if match is None:
        raise UnitError(f"length '{text}' is not a number with a unit; write it like 2mm")
    return float(match["number"]) * (parse_unit(match["unit"]) if match["unit"] else bare_m)


def parse_place(text: str) -> tuple[float, float, float]:
    """x, y and z in m from three lengths with commas between them, such as 0,0,-40mm; a bare number is in m.

    Errors: UnitError when they are not three, or one is no finite length.
    """
    lengths_m = [_any_length(part, 1.0) for part in text.split(",")]
    if len(lengths_m) != 3 or not all(math.isfinite(length_m) for length_m in lengths_m):
        raise UnitError(f"place '{text}' is not three lengths; write it like 0,0,40mm")
    x, y, z = lengths_m
    return (x, y, z)


def parse_length(text: str, bare_m: float = 1.0) -> float:
    """A positive length in m from a number with a unit; a bare number counts units of `bare_m` metres.

    Errors: UnitError when it is not a number, has an unknown unit, or is not positive and finite.
    """
    length_m = _any_length(text, bare_m)
    if not math.isfinite(length_m) or length_m <= 0.0:
        raise UnitError(f"length '{text}' is not positive; write it like 2mm")
    return length_m


BYTES: dict[str, int] = {
    "b": 1,
    "kb": 10**3,
    "mb": 10**6,
    "gb": 10**9,
    "kib": 2**10,
    "mib": 2**20,
    "gib": 2**30,
}
"""Bytes of one unit of size, by its name in lower case."""


def parse_size(text: str) -> int:
    """Bytes from a number with a unit such as 4GiB or 500MB.

    Errors: UnitError when it is not a number with a unit, or not positive and finite.
    """
    match = _LENGTH.match(text)
    if match is None or match["unit"].lower() not in BYTES:
        raise UnitError(f"size '{text}' is not a number with a unit; write it like 4GiB or 500MB")
    size = float(match["number"]) * BYTES[match["unit"].lower()]
    if not math.isfinite(size) or size < 1.0:
        raise UnitError(f"size '{text}' is not positive; write it like 4GiB or 500MB")
    return int(size)


def format_size(size_bytes: float) -> str:
    """A size for a person: three digits and a unit that suits it."""
    for name, unit in (("GiB", 2**30), ("MiB", 2**20), ("KiB", 2**10)):
        if size_bytes >= unit:
            return f"{size_bytes / unit:.3g} {name}"
    return f"{size_bytes:.0f} B"


def format_length(length_m: float) -> str:
    """A length for a person: three digits and a unit that suits its size."""
    if length_m == 0.0:
        return "0 mm"
    size_m = abs(length_m)
    if 1e3 <= size_m < 1e6:
        return f"{length_m:.0f} m"
    if size_m >= 1.0:
        return f"{length_m:.3g} m"
    if size_m >= 1e-3:
        return f"{length_m * 1e3:.3g} mm"
    if size_m >= 1e-9:
        return f"{length_m * 1e6:.3g} um"
    return f"{length_m * 1e9:.3g} nm"


def format_place(place: Iterable[float], size: float) -> str:
    """A place for a person, in one unit: to a thousandth of the size of what it lies on, however far away that is."""
    return f"({', '.join(format_coordinates(place, size))})"


def format_coordinates(values: Iterable[float], size: float) -> list[str]:
    """The numbers of a place, or of a box, as format_place has them."""
    if size >= 1e9:
        return [f"{x:.4g}" for x in values]
    digits = max(0, 3 - math.floor(math.log10(size))) if size > 0.0 else 3
    texts = [f"{round(float(x), digits) + 0.0:.{digits}f}" for x in values]
    return [text.rstrip("0").rstrip(".") if digits else text for text in texts]
