"""The project's own lints can fail: each is shown something that is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from structure import find_breaches


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
