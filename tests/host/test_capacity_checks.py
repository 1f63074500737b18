"""Every capacity of config.h is checked by the compiler: a value out of range does not build."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
NAMES = re.findall(
    r"^#ifndef (CR_(?!CONFIG_H)\w+)$", (FIRMWARE / "config.h").read_text(), re.MULTILINE
)


def compiles(*defines: str) -> tuple[bool, str]:
    """Whether the public header builds with these macros, and what the compiler said."""
    command = ["gcc", "-std=c11", "-fsyntax-only", *defines, "-x", "c", str(FIRMWARE / "crease.h")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode == 0, done.stderr


def test_the_defaults_build() -> None:
    assert compiles() == (True, "")
    assert len(NAMES) >= 7


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", ["-1", "100000000"])
def test_a_value_out_of_range_does_not_build(name: str, value: str) -> None:
    built, said = compiles(f"-D{name}={value}")
    assert not built
    assert f'#error "{name}: ' in said, "it names the macro and its range"
