"""The HTML report: one self-contained page of all experiments, figures embedded."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from types import MappingProxyType

from crease.base.version import VERSION
from crease.lab.setup import Result, Table, machine

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; margin: 2rem auto; max-width: 70rem; padding: 0 1.2rem; }
h1 { font-size: 1.7rem; } h2 { font-size: 1.3rem; margin-top: 3rem; border-top: 1px solid #ddd; padding-top: 1.2rem; }
nav a { margin-right: 1.2em; } p { max-width: 52rem; } .found { font-weight: 600; }
figure { margin: 1.4rem 0; } img { max-width: 100%; height: auto; } figcaption { color: #555; font-size: .92rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: .9rem; margin: .4rem 0 1.4rem; }
caption { text-align: left; color: #555; padding-bottom: .3rem; }
th, td { padding: .22rem .8rem; border-bottom: 1px solid #e4e4e4; text-align: right; white-space: nowrap; }
th { font-weight: 600; white-space: normal; vertical-align: bottom; }
.text { text-align: left; }
.files { color: #555; font-size: .85rem; } code { background: #f3f5f7; padding: 0 .25em; }
"""


def _is_text(cells: Sequence[str]) -> bool:
    """Whether a column holds words, not numbers."""
    return any(cell and not any(c.isdigit() for c in cell) for cell in cells)


def _table(table: Table) -> str:
    kinds = [
        ' class="text"' if _is_text(column) else "" for column in zip(*table.rows, strict=True)
    ]
    head = "".join(
        f"<th{kind}>{escape(h)}</th>" for kind, h in zip(kinds, table.heads, strict=True)
    )
    rows = (
        "".join(f"<td{kind}>{escape(c)}</td>" for kind, c in zip(kinds, row, strict=True))
        for row in table.rows
    )
    body = "".join(f"<tr>{row}</tr>\n" for row in rows)
    return (
        f'<div class="scroll"><table><caption>{escape(table.caption)}</caption>'
        f"<thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table></div>\n"
    )


def _figure(folder: Path, name: str, caption: str) -> str:
    data = base64.b64encode((folder / name).read_bytes()).decode("ascii")
    source = f"data:image/png;base64,{data}"
    return f'<figure><img src="{source}" alt="{escape(caption)}"><figcaption>{escape(caption)}</figcaption></figure>\n'


def _section(result: Result, folder: Path) -> str:
    parts = [f'<h2 id="{result.name}">{escape(result.title)}</h2>\n<p>{escape(result.about)}</p>\n']
    parts += [f'<p class="found">{escape(line)}</p>\n' for line in result.found]
    parts += [_figure(folder, name, caption) for name, caption in result.figures]
    parts += [_table(table) for table in result.tables]
    files = ", ".join(f"<code>{escape(name)}</code>" for name in result.files)
    command = f"crease experiment {result.name} -o DIR"
    parts.append(f'<p class="files">Made by <code>{command}</code>. Numbers: {files}.</p>\n')
    return "".join(parts)


_ABOUT = (
    "The contact experiments of Hernantes, Borro and Garcia-Alonso (2007), Stable haptic response for complex "
    "interactions, run again with crease. A rigid tool is led along given poses through a rigid mock-up; each pose "
    "gives a force. Way out: crease, the shortest translation that leads the tool out. Extent: the paper's "
    "contact-zone method, a sample counts by the part of it that is inside; as published: by in or out. Exact: from "
    "mesh booleans and planes, computed by other code. A tick is one pose, 1 ms."
)


def _how(every: int, repeat: int) -> str:
    """What the figures of the page hold, when it is not everything."""
    if every == 1:
        return ""
    return (
        f'<p class="found">A quick look: only every {every}th pose, so that a step from tick to tick is {every} '
        f"times as long; timings are the least of {repeat}. Run it without --every for the figures.</p>\n"
    )


def _without(missing: Mapping[str, str]) -> str:
    """What is not on the page, and why."""
    if not missing:
        return ""
    rows = "".join(f"<li>{escape(name)}: {escape(why)}</li>" for name, why in missing.items())
    return f'<p class="found">Not all of it. Missing:</p>\n<ul>{rows}</ul>\n'


def make_report(
    results: Sequence[Result],
    folder: Path,
    every: int = 1,
    repeat: int = 20,
    missing: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """The page as text; figures are read from `folder`, made with these options of the command.

    missing: experiments that are not among the results, and why.
    """
    links = "".join(f'<a href="#{r.name}">{escape(r.name)}</a>' for r in results)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>crease: experiments</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>Experiments</h1>\n<p>crease {VERSION}, measured on {escape(machine())}.</p>\n"
        f"<p>{escape(_ABOUT)}</p>\n{_how(every, repeat)}{_without(missing)}<nav>{links}</nav>\n"
        + "".join(_section(result, folder) for result in results)
        + "</body></html>\n"
    )


def text_table(table: Table) -> str:
    """A table for the terminal."""
    cells = [table.heads, *table.rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(table.heads))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    ]
    return "\n".join(
        [table.caption, lines[0], "  ".join("-" * width for width in widths), *lines[1:]]
    )
