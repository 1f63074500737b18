"""`make docs`: the C headers, the Python package and the texts of the repository as pages to read offline.

    python host/backend/reference.py FOLDER

C by Doxygen (through header_filter.py), Python by pdoc, Markdown by markdown2. Every link of every page is followed
afterwards: one that leads nowhere, or asks the network for a picture or a script, fails the build.
"""

from __future__ import annotations

import inspect
import os
import re
import shutil
import subprocess
import sys
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

HOST = Path(__file__).resolve().parents[1]
ROOT = HOST.parent
HEADERS = ("crease.h", "servo.h", "couple.h", "config.h")
TEXTS = (".github", "firmware", "host/crease", "host/docs", "meshes", "sim", "tests")
PAGES = (
    *("README.md", "host/THIRD_PARTY.md"),
    *sorted(p.relative_to(ROOT).as_posix() for top in TEXTS for p in (ROOT / top).rglob("*.md")),
)
"""Texts that become pages, in folders like the repository's. What else they link to is copied beside them."""

DOXYFILE = {
    "PROJECT_NAME": "crease",
    "PROJECT_BRIEF": '"C interface"',
    "GENERATE_LATEX": "NO",
    "HTML_OUTPUT": "c",
    "OPTIMIZE_OUTPUT_FOR_C": "YES",
    "EXTRACT_ALL": "YES",
    "MARKDOWN_SUPPORT": "NO",
    "JAVADOC_AUTOBRIEF": "NO",
    "SEARCHENGINE": "NO",
    "HAVE_DOT": "NO",
    "QUIET": "YES",
    "SHOW_INCLUDE_FILES": "NO",
    "FULL_PATH_NAMES": "NO",
    "HTML_TIMESTAMP": "NO",
    "WARN_AS_ERROR": "YES",
}

STYLE = """
body { font: 16px/1.55 system-ui, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto; padding: 0 1.2rem; }
pre, code { background: #f3f5f7; font-size: .92em; } pre { padding: .7em; overflow-x: auto; } img { max-width: 100%; }
table { border-collapse: collapse; display: block; overflow-x: auto; }
td, th { border: 1px solid #ddd; padding: .2em .6em; }
nav { border-bottom: 1px solid #ddd; padding-bottom: .5em; } nav a { margin-right: 1.2em; }
"""
START = "host/docs/index.html"
NAVIGATION = {
    "Start": START,
    "README": "README.html",
    "C": "c/files.html",
    "Python": "python/crease.html",
    "Design": "firmware/DESIGN.html",
    "Bytes": "firmware/SPEC.html",
}

PART = re.compile(
    r"^(Units|Shapes|Output|Errors|Cost|Source|Frames)(?::\s+|\s{2,})(?=\S)", re.MULTILINE
)
WITHIN = re.compile(r"\s{3,}(Output|Errors|Cost|Source)(?::\s+|\s{2,})(?=\S)")


def version() -> str:
    """Of the header."""
    from crease.base.version import VERSION

    return VERSION


def c_pages(folder: Path) -> None:
    """FOLDER/c of the public headers.   Errors: CalledProcessError when Doxygen finds fault with a comment."""
    program = f"{sys.executable} {HOST / 'backend/header_filter.py'}"
    settings = {
        **DOXYFILE,
        "PROJECT_NUMBER": version(),
        "INPUT": " ".join(str(ROOT / "firmware" / name) for name in HEADERS),
        "INPUT_FILTER": f'"{program}"',
        "OUTPUT_DIRECTORY": str(folder),
        "STRIP_FROM_PATH": str(ROOT),
    }
    text = "".join(f"{name} = {value}\n" for name, value in settings.items())
    subprocess.run(["doxygen", "-"], input=text, text=True, check=True)


def as_markdown(doc: str) -> str:
    """A docstring of the house, whose parts become paragraphs."""
    plain = inspect.cleandoc(doc)
    return PART.sub(r"\n**\1** ", WITHIN.sub(r"\n\n**\1** ", plain))


def _documented(each: Any) -> bool:
    kinds = inspect.isclass(each), inspect.isfunction(each), isinstance(each, property)
    return any(kinds) and bool(each.__doc__)


def python_pages(folder: Path) -> None:
    """FOLDER/python of the public names of the package."""
    import crease
    import pdoc
    from crease.bake.call import bake

    crease.bake = bake  # the function itself; importing its room had put that there
    for value in [getattr(crease, name) for name in crease.__all__]:
        members = vars(value).values() if inspect.isclass(value) else ()
        for each in (value, *(getattr(member, "__func__", member) for member in members)):
            if _documented(each):
                each.__doc__ = as_markdown(each.__doc__)
    pdoc.render.configure(
        docformat="markdown", footer_text=f"crease {crease.__version__}", search=False
    )
    pdoc.pdoc("crease", r"!crease\..+", output_directory=folder / "python")


def text_pages(folder: Path) -> None:
    """FOLDER/... of the texts, with what they show and link to."""
    import markdown2

    kinds = ("tables", "fenced-code-blocks", "header-ids", "strike", "cuddled-lists")
    for name in PAGES:
        source = ROOT / name
        text = source.read_text("utf-8")
        made = str(markdown2.markdown(text, extras=dict.fromkeys(kinds)))
        made = re.sub(r'<h(\d) id="[^"]*">(.*?)</h\1>', _with_anchor, made)
        links = re.compile(r'(href|src)="([^"#:]+)(#[^"]*)?"')
        made = links.sub(partial(_link, source=source, folder=folder), made)
        page = folder / _html(name)
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(_framed(made, os.path.relpath(folder, page.parent)), encoding="utf-8")
    turn = f'<!doctype html><meta http-equiv="refresh" content="0; url={START}"><a href="{START}">crease</a>\n'
    (folder / "index.html").write_text(turn, encoding="utf-8")


def _framed(made: str, up: str) -> str:
    """A whole page. up: from its folder to the top."""
    nav = "".join(f'<a href="{up}/{to}">{word}</a>' for word, to in NAVIGATION.items())
    title = re.sub(r"<.*?>", "", made.split("</h1>", maxsplit=1)[0]).strip()
    head = f'<meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body><nav>{nav}</nav>\n{made}\n</body></html>\n'


def _html(name: str) -> str:
    return re.sub(r"\.md$", ".html", name.removeprefix(".github/"))


def _with_anchor(match: re.Match[str]) -> str:
    """A heading whose anchor is GitHub's, which the texts use."""
    words = re.sub(r"<.*?>", "", match[2]).lower()
    slug = re.sub(r"[^\w\- ]", "", words).strip().replace(" ", "-")
    return f'<h{match[1]} id="{slug}">{match[2]}</h{match[1]}>'


def _link(match: re.Match[str], source: Path, folder: Path) -> str:
    """A link to a text leads to its page; what else is in the repository is copied; a folder becomes its list."""
    target = (source.parent / unquote(match[2])).resolve()
    if target.is_dir() and (target / "README.md").exists():
        target /= "README.md"
    if not target.is_relative_to(ROOT):
        return match[0]
    inside = target.relative_to(ROOT).as_posix()
    if inside in PAGES:
        inside = _html(inside)
    elif target.is_file():
        (folder / inside).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(target, folder / inside)
    here = (folder / _html(source.relative_to(ROOT).as_posix())).parent
    return f'{match[1]}="{os.path.relpath(folder / inside, here)}{match[3] or ""}"'


class _Page(HTMLParser):
    """Links, pictures, scripts and anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value for name, value in attrs if value}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if "href" in given:
            (self.loads if tag == "link" else self.links).append(given["href"])
        if "src" in given:
            self.loads.append(given["src"])


def broken_links(folder: Path) -> list[str]:
    """One line for each link that leads nowhere, and each thing that a page would load from the network."""
    pages = {file: _Page(file.read_text("utf-8")) for file in sorted(folder.rglob("*.html"))}
    wrong = []
    for file, page in pages.items():
        here = file.relative_to(folder)
        wrong += [
            f"{here}: loads {to} from outside" for to in page.loads if re.match(r"(https?:)?//", to)
        ]
        for to in (*page.links, *page.loads):
            if re.match(r"([a-z]+:|//)", to):
                continue
            name, _, anchor = to.partition("#")
            target = (file.parent / unquote(name)).resolve() if name else file
            if not target.is_file():
                wrong.append(f"{here}: {to}: there is no such file")
            elif anchor and target in pages and unquote(anchor) not in pages[target].anchors:
                wrong.append(f"{here}: {to}: the page has no such place")
    return wrong


def main(arguments: list[str]) -> int:
    """Command line: see above."""
    folder = Path(arguments[0]).resolve()
    if folder.exists() and not (folder / "python/crease.html").exists() and any(folder.iterdir()):
        print(
            f"error: {folder}: holds other things than these pages; name another folder",
            file=sys.stderr,
        )
        return 1
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    c_pages(folder)
    python_pages(folder)
    text_pages(folder)
    wrong = broken_links(folder)
    print("\n".join(wrong) if wrong else f"docs: {folder}/index.html, no broken link")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
