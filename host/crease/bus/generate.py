"""Rewrites what is committed and comes from dictionary.toml: sim/dictionary.h and the tables of firmware/servo/SPEC.md.

    python -m crease.bus.generate [--check]

With --check nothing is written; status 1 tells that a file is out of date.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from crease.base.errors import BusError
from crease.base.table import bytes_writer, check_target, write_together
from crease.bus.dictionary import load
from crease.bus.eds import to_eds
from crease.bus.header import to_c_header, to_markdown

SIM = Path(__file__).resolve().parents[3] / "sim"
BEGIN, END = "<!-- generated: begin -->\n", "<!-- generated: end -->\n"


def with_tables(text: str, tables: str) -> str:
    """A Markdown text with what stands between the two marks replaced.   Errors: ValueError without the marks."""
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    return before + BEGIN + tables + END + after


def committed() -> dict[Path, str]:
    """Every committed file that is generated, with the text it must have."""
    dictionary = load()
    page = SIM.parent / "firmware" / "servo" / "SPEC.md"
    return {
        SIM / "dictionary.h": to_c_header(dictionary),
        page: with_tables(page.read_text(encoding="utf-8"), to_markdown(dictionary)),
    }


def export(folder: Path, force: bool = False) -> list[Path]:
    """Write the EDS of every axis and the DBC into `folder`, all or none; gives the files.

    Errors: CreaseError when one exists and `force` is not given, or the disk refuses.
    """
    from crease.bus.dbc import to_dbc

    dictionary = load()
    files = {
        f"crease_{axis.name.lower()}.eds": to_eds(dictionary, axis) for axis in dictionary.axes
    }
    files["crease.dbc"] = to_dbc(dictionary)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BusError(f"{folder}: cannot be made: {error.strerror}") from error
    for name in files:
        check_target(folder / name, force)
    write_together(
        {folder / name: bytes_writer(text.encode("ascii")) for name, text in files.items()}
    )
    return [folder / name for name in files]


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    stale = [
        p
        for p, text in committed().items()
        if not p.exists() or p.read_text(encoding="utf-8") != text
    ]
    for path in stale:
        if not check:
            path.write_text(committed()[path], encoding="utf-8")
        print(f"{path}: {'is out of date' if check else 'written'}")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
