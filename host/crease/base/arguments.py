"""What a caller gave: checked before anything is made of it, and refused in one line that names it."""

from __future__ import annotations

import math
import operator
import os

from crease.base.errors import CreaseError
from crease.base.units import format_size


def check_whole(
    name: str, value: object, least: int, error: type[CreaseError] = CreaseError
) -> int:
    """`value` when it is a whole number of `least` or more.   Errors: `error` with the name and the value."""
    try:
        whole = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        whole = least - 1
    if whole < least:
        raise error(f"{name} is {value!r:.80}; give a whole number of {least} or more")
    return whole


def check_number(
    name: str,
    value: object,
    low: float,
    high: float,
    unit: str,
    error: type[CreaseError] = CreaseError,
) -> float:
    """`value` when it is a number from low to high.   Errors: `error` with the name, the value and the range."""
    number = _number(value)
    if not low <= number <= high:
        raise error(
            f"{name} is {value!r:.80}; give a number from {low:g} to {high:g} {unit}".rstrip()
        )
    return number


def check_positive(name: str, value: object, unit: str, error: type[CreaseError]) -> None:
    """Errors: `error` with the name and the value, when it is no finite number above 0."""
    if not 0.0 < _number(value) < math.inf:
        raise error(f"{name} is {value!r:.80}; give {unit} above 0")


def _number(value: object) -> float:
    """As a float; NaN for what is none: a text, though `float` reads it, and an array of several."""
    try:
        return math.nan if isinstance(value, str | bytes) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return math.nan


def default_memory_max() -> int:
    """Half the memory of the machine, in bytes."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2


def check_memory(what: str, count: int, each_bytes: int, error: type[CreaseError]) -> None:
    """Errors: `error` when `count` things of `each_bytes` take more than half the memory of the machine."""
    memory_max = default_memory_max()
    if count * each_bytes > memory_max:
        raise error(
            f"{count:,} {what} take {format_size(count * each_bytes)}, more than half of this machine's memory "
            f"({format_size(memory_max)}); give {memory_max // each_bytes:,} or fewer"
        )
