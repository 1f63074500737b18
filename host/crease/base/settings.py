"""What a setting is called: an argument of a function, or an option of the command line. Texts name what was given."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from crease.base.units import format_length, format_size

OPTIONS = {
    "crease_angle_deg": "--crease-angle",
    "depth_max_m": "--depth-max",
    "even": "--even",
    "force": "--force",
    "image_max_bytes": "--image-max",
    "memory_max_bytes": "--memory-max",
    "sheet_m": "--sheet",
    "spacing_m": "--spacing",
    "strict": "--strict",
    "tolerance_m": "--tolerance",
    "unit": "--unit",
    "voxel_m": "--voxel",
}
"""Argument of `bake`, `load_mesh`, `make_mesh` or `save` -> option of `crease`. The one place that knows both."""

_COMMAND: ContextVar[bool] = ContextVar("crease_command_line", default=False)


@contextmanager
def command_line() -> Iterator[None]:
    """Within this, `setting` gives the option: the user wrote a command line."""
    token = _COMMAND.set(True)
    try:
        yield
    finally:
        _COMMAND.reset(token)


def setting(name: str, value: float | bool | None = None) -> str:
    """A setting by the name that its user knows, with a value if there is one.

    name: a key of OPTIONS. Output: `voxel_m=0.002`, or for a command line `--voxel 2mm`.   Errors: KeyError.
    """
    option = OPTIONS[name]
    if not _COMMAND.get():
        return name if value is None else f"{name}={_number(name, value)}"
    if value is None or isinstance(value, bool):
        return option
    return f"{option} {_with_unit(name, value)}"


def _with_unit(name: str, value: float) -> str:
    """As the command line reads it."""
    if name.endswith("_m"):
        return format_length(value).replace(" ", "")
    return format_size(value).replace(" ", "") if name.endswith("_bytes") else f"{value:g}"


def _number(name: str, value: float | bool) -> str:
    if isinstance(value, bool) or name.endswith("_bytes"):
        return f"{value}"
    return f"{value:.4g}"
