"""CR_ASSERT is checked where tests are built, and not there at all in what ships."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [
    p for room in ("contact", "servo") for p in sorted((ROOT / "firmware" / room).glob("*.c"))
]
ON = "-DCR_ASSERTS=1"
HOOK = "cr_assert_failed"


def undefined(folder: Path, *options: str) -> str:
    """Symbols that the objects of the library want from others."""
    command = [
        "gcc",
        "-std=c11",
        "-O0",
        f"-I{ROOT / 'firmware'}",
        *options,
        "-c",
        *map(str, SOURCES),
    ]
    subprocess.run(command, check=True, cwd=folder)
    objects = sorted(folder.glob("*.o"))
    assert len(objects) == len(SOURCES)
    return subprocess.run(["nm", "-u", *objects], check=True, capture_output=True, text=True).stdout


def test_what_ships_has_none(tmp_path: Path) -> None:
    """Not even without optimisation."""
    assert HOOK not in undefined(tmp_path)


def test_where_it_is_on_most_files_have_some(tmp_path: Path) -> None:
    assert undefined(tmp_path, ON).count(HOOK) >= len(SOURCES) // 2


@pytest.mark.parametrize(
    ("options", "checked"),
    [(f"CFLAGS_{v}", True) for v in ("gcc", "clang", "san", "fuzz", "scalar")]
    + [("CFLAGS_cov", False), ("CFLAGS_install", False), ("CORTEX_FLAGS", False)],
)
def test_builds_that_check(options: str, checked: bool) -> None:
    command = ["make", "-s", "--no-print-directory", f"--eval=said: ; @echo '$({options})'", "said"]
    said = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout
    assert "-O" in said or options == "CORTEX_FLAGS"
    assert (ON in said.split()) == checked
