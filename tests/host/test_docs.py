"""`make docs`: every public name of C and Python has a place, every link leads somewhere, nothing asks the network."""

from __future__ import annotations

import html
import re
import subprocess
import sys
from pathlib import Path

import crease
import header_filter
import pytest
import reference

ROOT = Path(__file__).resolve().parents[2]
FUNCTION = re.compile(r"^\w[\w *]*?\b(cr_\w+)\(", re.MULTILINE)


@pytest.fixture(scope="module")
def docs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages, made in a process of its own, since that changes docstrings."""
    folder = tmp_path_factory.mktemp("docs")
    command = [sys.executable, reference.__file__, str(folder)]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout + said.stderr
    return folder


def text_of(page: Path) -> str:
    """What a reader sees, on one line."""
    bare = re.sub(r"<(style|script).*?</\1>|<[^>]+>", " ", page.read_text("utf-8"), flags=re.DOTALL)
    return " ".join(html.unescape(bare).replace("\xa0", " ").split())


@pytest.mark.slow
def test_every_public_name_of_python_has_a_place(docs: Path) -> None:
    page = (docs / "python/crease.html").read_text("utf-8")
    names = [
        *crease.__all__,
        "World.tick",
        "World.replay",
        "Scene.open",
        "Scene.save",
        "Output.force_N",
    ]
    assert [name for name in names if f'id="{name}"' not in page] == []
    assert "<strong>Errors</strong> TrajectoryError when pose is not 7 numbers" in page
    assert "<strong>Errors</strong> SceneError: cannot be read" in page
    assert (
        "Two meshes" not in text_of(docs / "python/crease.html").split("Stable haptic contact")[0]
    )


def test_every_function_of_the_headers_has_a_place(docs: Path) -> None:
    seen = text_of(docs / "c/crease_8h.html") + text_of(docs / "c/servo_8h.html")
    seen += text_of(docs / "c/couple_8h.html")
    declared = [
        name
        for header in ("crease.h", "servo.h", "couple.h")
        for name in FUNCTION.findall((ROOT / "firmware" / header).read_text("utf-8"))
    ]
    assert len(declared) > 25
    assert [name for name in declared if f"{name} (" not in seen] == []
    assert "validate an image once and find its sections" in seen
    assert "Errors every cr_err but CONFIG: hostile bytes give a code" in seen
    assert "Output *scene." in seen


@pytest.mark.parametrize("name", ["cr_tick", "cr_search", "cr_feel"])
def test_the_tick_and_its_parts_say_what_a_null_pointer_does(name: str) -> None:
    header = (ROOT / "firmware/crease.h").read_text("utf-8")
    before, _, _ = header.partition(f" {name}(")
    contract = header_filter.contract(header_filter.COMMENT.findall(before)[-1])
    errors = contract.partition("@par Errors\n")[2].partition("@par")[0]
    assert "null" in errors


def test_contracts_become_paragraphs() -> None:
    made = header_filter.convert(
        "int f(int *a); /* behind */\n/* Purpose  one & all.   Output  *a.\n * Cost  little. */\nint g;\n"
    )
    assert "int f(int *a); /**< behind */" in made
    assert "/** one \\& all.\n@par Output\n&nbsp;*a.\n\n@par Cost\nlittle. */" in made


def test_links_that_lead_nowhere_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<a id="x" href="#x">.</a><a href="b.html#y">.</a><a href="https://example.org">.</a>'
    )
    (tmp_path / "b.html").write_text('<a id="y" href="a.html">.</a><img src="c.png">')
    (tmp_path / "c.png").write_bytes(b"")
    assert reference.broken_links(tmp_path) == []
    (tmp_path / "b.html").write_text(
        '<a href="d.html">.</a><img src="https://example.org/c.png"><a href="a.html#z">.</a>'
    )
    assert reference.broken_links(tmp_path) == [
        "a.html: b.html#y: the page has no such place",
        "b.html: loads https://example.org/c.png from outside",
        "b.html: d.html: there is no such file",
        "b.html: a.html#z: the page has no such place",
    ]


def test_a_folder_of_other_things_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine").write_text("mine")
    assert reference.main([str(tmp_path)]) == 1
    assert "holds other things than these pages" in capsys.readouterr().err
    assert (tmp_path / "mine").exists()


def test_the_texts_of_the_repository_are_pages_with_their_pictures(docs: Path) -> None:
    assert (docs / "firmware/corner.png").exists()
    assert "Stable haptic contact" in text_of(docs / "README.html")
    assert 'id="late-answers"' in (docs / "firmware/contact/DESIGN.html").read_text("utf-8")
    assert "index.html" in (docs / "index.html").read_text("utf-8")
