"""Doxygen's input filter: the comments of the C headers, as they are, in the form that Doxygen takes.

python header_filter.py HEADER.h
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

PARTS = (
    *(
        "Purpose",
        "Units",
        "Shapes",
        "Output",
        "Errors",
        "Cost",
        "Source",
        "Late",
        "Flow",
        "Memory",
        "Threads",
    ),
    *("Time", "Frames", "Numbers", "Trouble", "Bus"),
)
"""Words that begin a part of a contract: at the start of a line, or after three spaces and before two."""
COMMENT = re.compile(r"/\*(?!\*)(.*?)\*/", re.DOTALL)
AT_START = re.compile(rf"^({'|'.join(PARTS)})\s+(?=\S)", re.MULTILINE)
WITHIN = re.compile(rf"\s{{3,}}({'|'.join(PARTS)})\s{{2,}}(?=\S)")
SPECIAL = re.compile(r"([\\@#<>%&$])")


def contract(text: str) -> str:
    """The text of one comment with its parts as paragraphs of their own."""
    lines = [re.sub(r"^\s*\* ?", "", line) for line in text.strip().split("\n")]
    plain = SPECIAL.sub(r"\\\1", "\n".join(lines))
    plain = re.sub(r"^Purpose\s+", "", plain)  # the brief line of a list
    plain = AT_START.sub(r"\n@par \1\n", WITHIN.sub(r"\n@par \1\n", plain))
    return re.sub(r"^\*", "&nbsp;*", plain, flags=re.MULTILINE).strip()


def convert(source: str) -> str:
    """A header whose comments Doxygen reads: those behind code describe what stands before them."""

    def replace(match: re.Match[str]) -> str:
        line = source[source.rfind("\n", 0, match.start()) + 1 : match.start()]
        if set(match[1].strip()) <= {"-"} or match[1].strip().startswith("---"):
            return ""  # a rule between sections
        behind = line.strip() and not line.lstrip().startswith("#")
        return f"/**{'<' if behind else ''} {contract(match[1])} */"

    made = COMMENT.sub(replace, source)
    return (
        f"/** @file */\n{made}"
        if not source.startswith("/*")
        else made.replace("/**", "/** @file\n", 1)
    )


if __name__ == "__main__":
    sys.stdout.write(convert(Path(sys.argv[1]).read_text(encoding="utf-8")))
