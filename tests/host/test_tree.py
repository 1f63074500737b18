"""Verbs that live with the tests: a line where the source tree is not, and no import of it by the rest."""

from __future__ import annotations

import ast
from pathlib import Path

import crease
import pytest
from crease.base import tree
from crease.cli import main


@pytest.mark.parametrize(
    "words", [("bench", "ablation", "-o", "out"), ("stress", "-o", "out", "--cases", "1")]
)
def test_without_the_source_tree_a_verb_says_so_in_one_line(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tree, "FOLDERS", dict.fromkeys(tree.FOLDERS, tmp_path / "none"))
    assert main(words) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"error: crease {words[0]}: needs the source tree")
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_module_of_the_tree_is_found() -> None:
    assert tree.from_tree("stress", "stress.campaign").Settings
    assert tree.call_in_tree("stress.campaign", "chunk_file", Path("a"), 7).name.endswith("7.json")


def test_an_unknown_package_is_our_mistake() -> None:
    with pytest.raises(KeyError):
        tree.from_tree("bench", "host.conftest")


def test_the_package_imports_nothing_of_the_tests() -> None:
    package = Path(crease.__file__).parent
    inside = {path.stem for path in package.parents[1].joinpath("tests").rglob("*.py")}
    inside |= {"stress", "study"}
    imported = {
        name.split(".")[0]
        for file in package.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        for name in (
            [node.module or ""] if isinstance(node, ast.ImportFrom)
            else [a.name for a in node.names] if isinstance(node, ast.Import) else []
        )
    }  # fmt: skip
    assert "crease" in imported
    assert not imported & inside
