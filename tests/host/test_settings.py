"""A refusal names the setting as its user gave it: an argument of Python, or an option of the command line."""

from __future__ import annotations

import argparse
import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import crease as api
import pytest
from crease.base.settings import OPTIONS, command_line, setting
from crease.cli import make_parser
from host_tools import Run

HOST = Path(__file__).resolve().parents[2] / "host/crease"
OPTION = re.compile(r"(?<![\w-])--[a-z]")


def test_a_setting_is_an_argument_or_an_option() -> None:
    assert setting("voxel_m", 2e-3) == "voxel_m=0.002"
    assert setting("memory_max_bytes", 2 << 30) == "memory_max_bytes=2147483648"
    assert (setting("spacing_m"), setting("force", True)) == ("spacing_m", "force=True")
    with command_line():
        assert setting("voxel_m", 2e-3) == "--voxel 2mm"
        assert setting("memory_max_bytes", 2 << 30) == "--memory-max 2GiB"
        assert setting("crease_angle_deg", 45.0) == "--crease-angle 45"
        assert (setting("spacing_m"), setting("force", True)) == ("--spacing", "--force")
    assert setting("spacing_m") == "spacing_m"


def test_every_name_is_an_argument_and_every_option_is_one_of_bake() -> None:
    called = (api.bake, api.load_mesh, api.make_mesh, api.Scene.save)
    assert set(OPTIONS) <= {name for one in called for name in inspect.signature(one).parameters}
    subs = (a for a in make_parser()._actions if isinstance(a, argparse._SubParsersAction))
    assert set(OPTIONS.values()) <= set(next(subs).choices["bake"]._option_string_actions)


def spoken(file: Path) -> Iterator[str]:
    """Texts of a file that are not there to tell a reader of the source what it does."""
    tree = ast.parse(file.read_text("utf-8"))
    told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in told:
            yield node.value


@pytest.mark.parametrize("room", ["base", "mesh", "bake", "replay"])
def test_no_text_below_the_command_line_names_an_option(room: str) -> None:
    found = [
        f"{file.name}: {text}"
        for file in sorted((HOST / room).glob("*.py"))
        if file.name not in ("settings.py", "export.py")  # `export` is the command's alone
        for text in spoken(file)
        if OPTION.search(text)
    ]
    assert found == []


@pytest.mark.slow
def test_the_same_refusal_in_both_tongues(
    block_stl: Path, ball_stl: Path, tmp_path: Path, crease: Run
) -> None:
    static, tool = api.load_mesh(block_stl, "mm"), api.load_mesh(ball_stl, "mm")
    words = ("bake", block_stl, ball_stl, "-o", tmp_path / "x.crs", "--unit", "mm")
    for given, options, argument, option in (
        (
            {"spacing_m": 1.0},
            ("--spacing", "1m"),
            "spacing_m=1 is larger than the tool",
            "--spacing 1m is larger than the tool",
        ),
        (
            {"voxel_m": 1e-6, "memory_max_bytes": 2 << 30},
            ("--voxel", "1um", "--memory-max", "2GiB"),
            "more than memory_max_bytes=2147483648; use",
            "more than --memory-max 2GiB; use",
        ),
        (
            {"image_max_bytes": 61440},
            ("--image-max", "60KiB"),
            "use a larger spacing_m",
            "use a larger --spacing",
        ),
        (
            {"image_max_bytes": 1024},
            ("--image-max", "1KiB"),
            "allow a larger image: no spacing_m fits that is smaller than the tool (20 mm)",
            "allow a larger image: no --spacing fits that is smaller than the tool (20 mm)",
        ),
    ):
        said = crease(*words, *options)
        assert (said.status, option in said.err) == (1, True), said.err
        with pytest.raises(api.MeshError) as refused:  # after the command line, in one process
            api.bake(static, tool, **given)
        assert argument in str(refused.value)
        assert "--" not in str(refused.value)


def test_a_warning_of_a_mesh_names_the_argument() -> None:
    far = api.make_mesh(
        [[0, 0, 0], [52, 0, 0], [0, 52, 0], [0, 0, 52]],
        [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    )
    assert "try unit mm" in far.warnings[0]
