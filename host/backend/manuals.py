"""Writes the manual pages of the two commands, from what they say of themselves.

    python host/backend/manuals.py CREASED FOLDER

FOLDER gets crease.1.in and creased.8.in; `make install` fills in the version. The library's page is written by hand.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from crease.cli import make_parser


def plain(text: str) -> str:
    """Text as roff takes it."""
    text = " ".join(text.split()).replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{text}" if text.startswith((".", "'")) else text


def head(name: str, section: int, about: str) -> list[str]:
    """Title and name."""
    title = f'.TH {name.upper()} {section} "" "crease @VERSION@" "Commands"'
    return [title, ".SH NAME", f"{name} \\- {plain(about)}"]


def wording(action: argparse.Action) -> str:
    """An option as it is written."""
    names = ", ".join(f"\\fB{plain(name)}\\fR" for name in action.option_strings)
    if action.nargs == 0:
        return names
    said = action.metavar or action.dest.upper()
    values = said if isinstance(said, str) else " ".join(said)
    return f"{names} \\fI{plain(values)}\\fR".strip()


def options(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Each argument of a parser with its help."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
            continue
        yield from (".TP", wording(action), plain(str(action.help or "")))


def verbs(
    parser: argparse.ArgumentParser, before: str = ""
) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    """Name, line and parser of every verb, those inside others too."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            lines = {choice.dest: str(choice.help or "") for choice in action._choices_actions}
            for name, inner in action.choices.items():
                yield f"{before}{name}", lines.get(name, ""), inner
                yield from verbs(inner, f"{before}{name} ")


def crease_page() -> str:
    """crease(1)."""
    parser = make_parser()
    lines = head(
        "crease", 1, "haptic contact between a rigid tool and a rigid mock-up: bake, replay, plot"
    )
    lines += [".SH SYNOPSIS", ".B crease", "\\fIVERB\\fR [\\fIargument\\fR ...]"]
    lines += [".SH DESCRIPTION", plain(str(parser.description))]
    for name, about, inner in verbs(parser):
        lines += [
            f".SH {plain(name).upper()}",
            plain(str(inner.description or about)),
            *options(inner),
        ]
    lines += [
        ".SH EXIT STATUS",
        "0 done; 1 with one line that says what, where and the mend; 2 with such a line for a wrong command line; "
        "130 after an interrupt, which leaves nothing half done.",
        ".SH SEE ALSO", ".BR crease (3),", ".BR creased (8)",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def creased_page(creased: Path) -> str:
    """creased(8).   Errors: CalledProcessError when the program does not run."""
    said = subprocess.run([creased, "--help"], capture_output=True, text=True, check=True).stdout
    usage, about, listed, rest = said.strip().split("\n\n")
    lines = head("creased", 8, "the servo of a haptic device on SocketCAN")
    lines += [".SH SYNOPSIS", plain(usage.splitlines()[0].removeprefix("usage: "))]
    lines += [plain(line) for line in usage.splitlines()[1:-1]]
    lines += [
        ".SH DESCRIPTION",
        plain(about),
        plain(usage.splitlines()[-1].capitalize()) + ".",
        ".SH OPTIONS",
    ]
    for line in listed.splitlines():
        found = re.fullmatch(r"\s+(--\S+)(?: (\S+))?\s\s+(\S.*)", line)
        assert found is not None, line
        lines += [
            ".TP",
            f"\\fB{plain(found[1])}\\fR \\fI{plain(found[2] or '')}\\fR",
            plain(found[3]),
        ]
    ends, status = rest.split("Exit status: ")
    lines += [".SH NOTES", plain(ends), ".SH EXIT STATUS", plain(status)]
    lines += [
        ".SH FILES",
        ".I @DATADIR@/device.toml",
        "has every key of \\fB\\-\\-config\\fR with its default.",
    ]
    lines += [".SH SEE ALSO", ".BR crease (1),", ".BR crease (3)"]
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> int:
    """Command line: see above."""
    creased, folder = (Path(a) for a in arguments)
    (folder / "crease.1.in").write_text(crease_page(), encoding="utf-8")
    (folder / "creased.8.in").write_text(creased_page(creased), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
