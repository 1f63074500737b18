"""Words: pages lead somewhere, sections that sources name are there, and the one that argues stays short."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import words

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "bench")]

import pictures  # noqa: E402

DESIGN = ROOT / "firmware" / "contact" / "DESIGN.md"
WORDS_MAX = 2_500


def test_design_of_contact_is_read_in_a_quarter_of_an_hour() -> None:
    assert 1_500 < len(DESIGN.read_text(encoding="utf-8").split()) <= WORDS_MAX


def test_links_and_citations_of_the_repository_lead_somewhere() -> None:
    assert len(words.tracked(ROOT)) > 300
    assert words.breaches(ROOT) == []


def test_sections_are_cited_at_all() -> None:
    """What finds nothing wrong must have looked at something."""
    cited = [
        section
        for source in (ROOT / "firmware").rglob("*.[ch]")
        for _, section in words.CITED.findall(source.read_text(encoding="utf-8"))
    ]
    assert len(cited) > 20


@pytest.mark.parametrize(
    ("name", "text", "breach"),
    [
        ("room/a.c", '/* DESIGN.md "Detect". */', None),
        ("room/a.c", '/* DESIGN.md "Detect", "Late\n * answers" [1]. */', None),
        ("room/a.c", '/* (DESIGN.md, "Terms") */', None),
        ("a.py", '# room/DESIGN.md "Detect"', None),
        ("a.py", '# DESIGN.md "Terms"', None),
        ("room/a.c", '/* DESIGN.md "Reach". */', None),
        ("room/a.c", '/* DESIGN.md "Detektor". */', 'DESIGN.md "Detektor"'),
        ("room/a.c", '/* DESIGN.md "Detect", "Never". */', 'DESIGN.md "Never"'),
        ("a.py", '# DESIGN.md "Detect"', 'DESIGN.md "Detect"'),
        ("a.py", "# bytes in room/SPEC.md", "room/SPEC.md: no such page"),
        ("a.md", "[x](firmware/room/DESIGN.md#late-answers)", None),
        ("a.md", "[x](firmware/room/DESIGN.md#never)", "no such heading"),
        ("a.md", "[x](firmware/never.md)", "no such file"),
        ("a.md", "[x](#b)\n\n# B\n\n# B\n\n[x](#b-1)", None),
        ("a.md", "[DESIGN.md](firmware/DESIGN.md) \"Never\"", 'DESIGN.md "Never"'),
    ],
)  # fmt: skip
def test_lint_finds(name: str, text: str, breach: str | None, tmp_path: Path) -> None:
    room = tmp_path / "firmware" / "room"
    room.mkdir(parents=True)
    (room / "DESIGN.md").write_text(
        "# Room\n## Detect\n### Late answers\n\n**Reach.** Far.\n", "utf-8"
    )
    (tmp_path / "firmware" / "DESIGN.md").write_text("## Terms\n", encoding="utf-8")
    source = tmp_path / ("firmware/" * name.startswith("room") + name)
    source.write_text(text, encoding="utf-8")
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    found = words.breaches(tmp_path)
    assert len(found) == (breach is not None)
    assert breach is None or breach in found[0]


@pytest.mark.slow
def test_every_picture_of_the_design_has_its_command(tmp_path: Path) -> None:
    linked = re.findall(r"!\[[^]]+\]\(([^)]+)\)", DESIGN.read_text(encoding="utf-8"))
    drawn = pictures.write_pictures(tmp_path)
    assert linked == [file.name for file in drawn]
    for file in drawn:
        assert 20_000 < file.stat().st_size < 150_000
        assert (DESIGN.parent / file.name).stat().st_size < 150_000
