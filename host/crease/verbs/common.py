"""What several verbs share: options of the command line, and how results are told."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from crease.base.errors import CreaseError, UnitError, UsageError
from crease.base.units import format_length, parse_length, parse_place, parse_size, parse_unit

if TYPE_CHECKING:
    from crease.base.scene import Scene
    from crease.replay.replay import CoupleOptions

SubParsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def length(text: str) -> Callable[[float], float]:
    """Type of an option that is a length: gives metres when it is told the metres of a bare number."""
    try:
        parse_length(text)
    except UnitError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return lambda bare_m: parse_length(text, bare_m)


def place(text: str) -> tuple[float, float, float]:
    """Type of an option that is a place: x, y and z in m."""
    try:
        return parse_place(text)
    except UnitError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def size(text: str) -> int:
    """Type of an option that is a size in memory or on disk: bytes."""
    try:
        return parse_size(text)
    except UnitError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def unit(text: str) -> float:
    """Type of an option that is a unit of length: metres of one."""
    try:
        return parse_unit(text)
    except UnitError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def number(low: float, high: float) -> Any:
    """Type of an option that is a number in low..high."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(f"'{text}' is not a number") from error
        if not (math.isfinite(value) and low <= value <= high):
            raise argparse.ArgumentTypeError(f"{text} is not in {low:g}..{high:g}")
        return value

    return parse


def whole_in(low: int, high: int) -> Any:
    """Type of an option that is a whole number in low..high."""

    def parse(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"'{text}' is not a whole number in {low}..{high}")
        return int(text)

    return parse


def whole(text: str) -> int:
    """Type of an option that is a whole number of 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of 1 or more")
    return int(text)


def add_scene(parser: argparse.ArgumentParser) -> None:
    """SCENE.crs: the image of the scene."""
    parser.add_argument(
        "scene", metavar="SCENE.crs", type=Path, help="the image, from `crease bake`"
    )


def add_unit(parser: argparse.ArgumentParser) -> None:
    """--unit: what bare numbers and the coordinates in mesh files are in."""
    parser.add_argument(
        "--unit", metavar="UNIT", type=unit, required=True,
        help="of the files: nm, um, mm, cm, dm, m, in, ft",
    )  # fmt: skip


def add_mesh_options(parser: argparse.ArgumentParser, sheet_default: str = "") -> None:
    """--crease-angle, --sheet: how a mesh is read."""
    parser.add_argument(
        "--crease-angle", metavar="DEG", type=number(0.1, 179.0), default=30.0,
        help="sharper edges are creases (default: 30)",
    )  # fmt: skip
    parser.add_argument(
        "--sheet", metavar="LENGTH", type=length, help=f"make open sheets this thick{sheet_default}"
    )


def metres(option: Callable[[float], float] | None, bare_m: float) -> float | None:
    """The value of an option of type `length`, None when it is not given. bare_m: of a bare number."""
    return option(bare_m) if option else None


STIFFNESS = 1000.0
"""Of the contact, N/m, when it is not given."""


COUPLED_STIFFNESS_LEAST = 1.0
"""Of the spring to a held tool, N/m: as of cr_couple_config."""


def add_stiffness(parser: argparse._ActionsContainer, *, couple: bool = False) -> None:
    """--stiffness: of the contact.   couple: or of the spring to a held tool, for a verb with --couple."""
    held = f"; with --couple {COUPLED_STIFFNESS_LEAST:g} to 1e6" if couple else ""
    parser.add_argument(
        "--stiffness",
        metavar="N/m",
        type=number(0.0, 1e6),
        default=STIFFNESS,
        help=f"0 to 1e6{held} (default: {STIFFNESS:g})",
    )


def add_couple(parser: argparse._ActionsContainer, what: str) -> None:
    """--couple and the settings of a held tool.   what: help of --couple."""
    parser.add_argument("--couple", action="store_true", help=what)
    parser.add_argument(
        "--friction",
        metavar="MU",
        type=number(0.0, 1.0),
        help="of the held tool, with --couple: 0 to 1 (default: 0)",
    )
    parser.add_argument(
        "--stiffness-turn",
        metavar="Nm/rad",
        type=number(1e-3, 1e4),
        help="of the spring against turns, with --couple: 1e-3 to 1e4 (default: 5)",
    )
    parser.add_argument(
        "--damping-turn",
        metavar="Nms/rad",
        type=number(0.0, 1e2),
        help="of the spring against turns, with --couple: 0 to 100 (default: 0)",
    )
    parser.add_argument(
        "--centre",
        metavar="X,Y,Z",
        type=place,
        help="where the springs are tied, frame of the tool, with --couple: such as 0,0,40mm, or --centre=-5mm,0,0; "
        "bare numbers are m (default: the tool's origin)",
    )


def couple_options(args: argparse.Namespace) -> CoupleOptions | None:
    """Settings of the held tool; None without --couple.   Errors: UsageError for a setting without --couple, and for
    a --stiffness that a spring cannot have.
    """
    from crease.replay.replay import CoupleOptions

    names = {
        "stiffness_turn": "stiffness_Nm_rad",
        "damping_turn": "damping_Nms_rad",
        "friction": "friction",
        "centre": "centre_tool_m",
    }
    given = {name: getattr(args, name) for name in names if getattr(args, name) is not None}
    if args.couple:
        if args.stiffness < COUPLED_STIFFNESS_LEAST:
            raise UsageError(
                f"--stiffness {args.stiffness:g}: with --couple it is of the spring to the hand, "
                f"{COUPLED_STIFFNESS_LEAST:g} to 1e6"
            )
        return CoupleOptions(**{names[name]: value for name, value in given.items()})
    for name in given:
        raise UsageError(f"--{name.replace('_', '-')} is of a held tool; give --couple too")
    return None


_FAR = 10.0
"""Diagonals of the tool from its middle: nobody ties springs so far off on purpose."""


def far_centre(scene: Scene, couple: CoupleOptions | None) -> list[str]:
    """A warning when springs are tied far away from the tool: most likely the numbers are in mm."""
    if couple is None:
        return []
    low_m, high_m = (list(box) for box in (scene.meta.tool_min_m, scene.meta.tool_max_m))
    middle_m = [0.5 * (low + high) for low, high in zip(low_m, high_m, strict=True)]
    away_m, size_m = math.dist(couple.centre_tool_m, middle_m), math.dist(low_m, high_m)
    if away_m <= _FAR * size_m:
        return []
    return [
        f"--centre ties the springs {format_length(away_m)} away from a tool of {format_length(size_m)}: is it in "
        "metres? write lengths like 40mm"
    ]


def add_inputs(parser: argparse.ArgumentParser) -> None:
    """--meshes, --images: what `make meshes` and `make scenes` make."""
    parser.add_argument(
        "--meshes", metavar="DIR", type=Path, default=Path("build/meshes"),
        help="meshes and paths as `make meshes` makes them (build/meshes)",
    )  # fmt: skip
    parser.add_argument(
        "--images", metavar="DIR", type=Path, default=Path("build/scenes"),
        help="images of these meshes that are there already (build/scenes)",
    )  # fmt: skip


def check_inputs(args: argparse.Namespace) -> None:
    """Errors: CreaseError when the folder of meshes is missing."""
    if not args.meshes.is_dir():
        raise CreaseError(
            f"{args.meshes}: is missing; run `make meshes`, or name the folder with --meshes"
        )


def check_folder(out: Path) -> None:
    """Errors: CreaseError when the folder for outputs is a file."""
    if out.exists() and not out.is_dir():
        raise CreaseError(f"{out}: is a file; name a folder")


@contextmanager
def made_folder(out: Path) -> Iterator[None]:
    """The folder for outputs. What is made for it and still empty at an error goes again.

    Errors: CreaseError when it cannot be made.
    """
    missing = [path for path in (out, *out.parents) if not path.exists()]
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CreaseError(f"{out}: cannot be made: {error.strerror}") from error
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for path in missing:
                path.rmdir()
        raise


def add_json(parser: argparse.ArgumentParser) -> None:
    """--json: the report on stdout as one JSON object."""
    parser.add_argument("--json", action="store_true", help="print the report as one JSON object")


def add_force(parser: argparse.ArgumentParser) -> None:
    """--force: an output that exists is replaced."""
    parser.add_argument("--force", action="store_true", help="replace the output when it exists")


def warn(lines: Sequence[str]) -> None:
    """Warnings on stderr, one line each."""
    for line in lines:
        print(f"warning: {line}", file=sys.stderr)


def print_json(report: Mapping[str, object]) -> None:
    """A report for a program."""
    print(json.dumps(report, indent=2, allow_nan=False))


def print_either(
    as_json: bool, report: Mapping[str, object], rows: Sequence[tuple[str, str]]
) -> None:
    """The same report for a program or for a person."""
    if as_json:
        print_json(report)
    else:
        print_lines(rows)


def print_lines(rows: Sequence[tuple[str, str]]) -> None:
    """A report for a person: names and values in two columns."""
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:<{width}s}  {value}")
