"""The project's own lints can fail: each is shown something that is wrong."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import rooms
from structure import LINES_MAX, ROOMS, find_breaches, find_long


@pytest.mark.parametrize(
    ("text", "breach"),
    [
        ("int one(int n) { return n; }", None),
        ("int (*hook)(int); int one(int n) { return n; }", "function pointer hook"),
        ("typedef int hook_fn(int); int poke(hook_fn *f) { return f(1) + 1; }", "poke: calls through a pointer"),
        ("int one(int n) { return n ? one(n - 1) + 1 : 0; }", "recursion: one -> one"),
    ],
)  # fmt: skip
def test_structure_finds(text: str, breach: str | None, tmp_path: Path) -> None:
    room = tmp_path / "contact"
    room.mkdir()
    source = room / "one.c"
    source.write_text(text, encoding="ascii")
    found = find_breaches(["gcc", "-std=c11"], [source])
    assert len(found) == (breach is not None)
    assert breach is None or breach in found[0]


def test_structure_reads_the_headers_above_a_room(tmp_path: Path) -> None:
    (tmp_path / "contact").mkdir()
    (tmp_path / "public.h").write_text("typedef void (*callback)(void);\n", encoding="ascii")
    source = tmp_path / "contact/one.c"
    source.write_text("int one(int n) { return n; }", encoding="ascii")
    assert find_breaches(["gcc"], [source]) == [f"{tmp_path}/public.h: function pointer callback"]


@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize("name", ["one.c", "one.h", "one.py", "page/one.js"])
def test_a_file_over_its_length_is_found_in_every_room(
    room: str, name: str, tmp_path: Path
) -> None:
    file = tmp_path / room / "part" / name
    file.parent.mkdir(parents=True)
    file.write_text("\n" * LINES_MAX, encoding="ascii")
    assert find_long(tmp_path) == []
    file.write_text("\n" * (LINES_MAX + 1), encoding="ascii")
    assert find_long(tmp_path) == [f"{file}: 601 lines, more than 600: split it by subject"]


ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of all that has rooms."""
    for part in ("firmware", "sim", "host/crease", "host/native"):
        shutil.copytree(
            ROOT / part, tmp_path / part, ignore=shutil.ignore_patterns("__pycache__", "*.png")
        )
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "line", "breach"),
    [
        ("firmware/contact/tick.c", None, None),
        ("firmware/contact/tick.c", '#include "servo/servo_stages.h"', "firmware/contact -> firmware/servo runs back"),
        ("firmware/contact/field.c", '#include "rivals/rivals.h"', "firmware/contact -> firmware/rivals runs back"),
        ("firmware/crease.h", '#include "contact/image.h"', "firmware -> firmware/contact runs back"),
        ("sim/drive.c", '#include "servo.h"', "sim -> firmware runs back"),
        ("firmware/servo/bus.c", '#include "sim.h"', "firmware/servo -> sim runs out of the table"),
        ("firmware/cellar/new.c", '#include "crease.h"', "firmware/cellar -> firmware runs out of the table"),
        ("host/crease/base/units.py", "from crease.bake.layout import pack", "base -> bake runs back"),
        ("host/crease/bake/bake.py", "def f():\n    import crease.draw.view.page", "bake -> draw runs back"),
        ("host/crease/draw/plot.py", "from crease import cli", "draw -> cli runs back"),
        ("host/crease/bus/eds.py", "from crease.mesh import mesh", "bus -> mesh runs out of the table"),
    ],
)  # fmt: skip
def test_an_arrow_that_runs_back_is_found(
    file: str, line: str | None, breach: str | None, tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if line is not None:
        at = tree / file
        at.parent.mkdir(exist_ok=True)
        at.write_text(f"{at.read_text('utf-8') if at.exists() else ''}\n{line}\n", "utf-8")
    assert rooms.main([str(tree)]) == (breach is not None)
    assert breach is None or f"{file}: the arrow {breach}" in capsys.readouterr().out


def test_an_arrow_that_nothing_uses_is_found() -> None:
    table = {"low": (), "high": ("low",)}
    assert rooms.find_breaches(table, iter([(Path("a"), "high", "low")]))[0] == []
    assert rooms.find_breaches(table, iter([]))[0] == ["table: no file of high uses low any more"]
    upside_down = {"high": ("low",), "low": ()}
    found = rooms.find_breaches(upside_down, iter([(Path("a"), "high", "low")]))[0]
    assert found == ["table: high uses low, which does not stand above it"]
