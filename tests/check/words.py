"""Pages and what cites them: links, anchors, sections in quotes, names of pages in comments.

A page's name with a section in quotes, as in contact/DESIGN.md "Detect", names a heading of it or a paragraph that
begins so in bold. Which page: one in the folder of the source or above it, else below firmware/.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

SOURCES = {
    ".c", ".h", ".cpp", ".py", ".md", ".toml", ".csv", ".js", ".html", ".mk", ".ld", ".S", ".txt", ""
}  # fmt: skip
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#+ +(.*?) *$", re.MULTILINE)
BOLD = re.compile(r"^(?:- |\d+\. )?\*\*([^*]+?)[.:]?\*\*", re.MULTILINE)
LINK = re.compile(r"\]\(([^()\s]+)\)")
LINKED = re.compile(r"\[[^]]*\]\(([^()\s]+)\)")
PAGE = re.compile(r"(?<![\w./-])((?:[\w.-]+/)*[A-Z][A-Z_]+\.md)\b")
CITED = re.compile(
    r'(?<![\w./-])((?:[\w.-]+/)*[A-Z][A-Z_]+\.md)(?:#[\w-]+)?[),]* ("[^"]+"(?:,? (?:and )?"[^"]+")*)'
)
BAIT = "test_words.py"
"""What this is tried with leads nowhere on purpose."""
WRAPPED = re.compile(r"[ \t]*\n[ \t]*(?:\*|#|//)?[ \t]*")


def tracked(root: Path) -> list[Path]:
    """Text files that git knows or would add."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout
    files = [root / name for name in names.splitlines()]
    return [f for f in files if f.suffix in SOURCES and f.is_file() and f.name != BAIT]


@cache
def headings(page: Path) -> tuple[str, ...]:
    """Headings of a page, without the marks of links."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    return tuple(re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", h) for h in HEADING.findall(text))


@cache
def sections(page: Path) -> frozenset[str]:
    """What a citation may name: headings, and words in bold that a paragraph or an item of a list begins with."""
    bold = BOLD.findall(page.read_text(encoding="utf-8"))
    return frozenset((*headings(page), *bold))


def anchors(page: Path) -> set[str]:
    """What can stand after # in a link to the page, as GitHub makes it: a heading that comes again is numbered."""
    found: set[str] = set()
    for heading in headings(page):
        slug = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        number = 0
        while (name := f"{slug}-{number}" if number else slug) in found:
            number += 1
        found.add(name)
    return found


def broken_links(page: Path) -> Iterator[str]:
    """Relative links of a page that lead to no file, or to no heading of it."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    for link in LINK.findall(text):
        if "://" in link or link.startswith("mailto:"):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name) if name else page
        if not target.exists():
            yield f"{page}: link to {link}: no such file"
        elif anchor and target.suffix == ".md" and anchor not in anchors(target):
            yield f"{page}: link to {link}: no such heading"


def candidates(root: Path, source: Path, name: str) -> list[Path]:
    """Pages that `name` may mean in a source, nearest first."""
    above = [folder for folder in source.parents if folder == root or root in folder.parents]
    pages = [folder / name for folder in above]
    if not any(page.exists() for page in pages):
        pages.append(root / "firmware" / name)
    return [page for page in pages if page.exists()]


def broken_citations(root: Path, source: Path, pages: tuple[str, ...]) -> Iterator[str]:
    """Pages that a source names and that are not there, and sections in quotes that the page named does not have."""
    text = WRAPPED.sub(" ", source.read_text(encoding="utf-8", errors="replace"))
    if source.suffix == ".md":
        text = LINKED.sub(r"\1", text)
    for name in dict.fromkeys(PAGE.findall(text)):
        if not candidates(root, source, name) and not any(p.endswith("/" + name) for p in pages):
            yield f"{source}: {name}: no such page"
    for name, quoted in CITED.findall(text):
        known = {h for page in candidates(root, source, name) for h in sections(page)}
        for section in re.findall(r'"([^"]+)"', quoted):
            if section not in known:
                yield f'{source}: {name} "{section}": no such section'


def breaches(root: Path) -> list[str]:
    """Everything that leads nowhere in what git knows."""
    found: list[str] = []
    files = tracked(root)
    pages = tuple(f"/{file.relative_to(root)}" for file in files if file.suffix == ".md")
    for file in files:
        if file.suffix == ".md":
            found += broken_links(file)
        found += broken_citations(root, file, pages)
    return found
