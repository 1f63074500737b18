"""The pages of the house are there, lead somewhere and agree with the code: licence, changes, contributing, version."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import third_party
from crease.base.native import lib
from crease.base.version import VERSION

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / ".github/CONTRIBUTING.md",
    ROOT / ".github/SECURITY.md",
    ROOT / "firmware/CHANGELOG.md",
    third_party.OUT,
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_of_the_page_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text("utf-8"))
    assert all((page.parent / link).exists() for link in links if "://" not in link)


def test_paths_that_contributing_names_exist() -> None:
    text = PAGES[0].read_text("utf-8")
    named = re.findall(r"`((?:firmware|tests|meshes)/[\w./-]+)`", text)
    assert len(named) > 8
    known = [name for name in named if "name.c" not in name and name != "tests/golden/exact/NAME.csv.gz"]  # fmt: skip
    assert [name for name in known if not (ROOT / name).exists()] == []


def test_licences_are_collected() -> None:
    run = [sys.executable, third_party.__file__, "--check"]
    said = subprocess.run(run, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout + said.stderr


def test_a_licence_that_changed_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    libraries = third_party.page_libraries()
    other = [(libraries[0][0], "other", libraries[0][2]), *libraries[1:]]
    monkeypatch.setattr(third_party, "page_libraries", lambda: other)
    assert third_party.main(["--check"]) == 1


def test_changes_begin_with_the_version_of_the_header() -> None:
    first = re.search(r"^## (\d+\.\d+\.\d+)", PAGES[2].read_text("utf-8"), re.MULTILINE)
    assert first is not None
    assert first[1] == VERSION


def test_the_library_says_the_version_of_its_header() -> None:
    major, minor, patch = lib.CR_VERSION_MAJOR, lib.CR_VERSION_MINOR, lib.CR_VERSION_PATCH
    assert lib.cr_version() == major * 1_000_000 + minor * 1_000 + patch


def test_the_version_stands_nowhere_else() -> None:
    """In what is built or packed: a second place would be forgotten."""
    places = ["Makefile", "host/pyproject.toml", "host/CMakeLists.txt", "host/crease/__init__.py"]
    assert [name for name in places if VERSION in (ROOT / name).read_text("utf-8")] == []


def test_the_readme_names_the_minor_version_that_is_installed() -> None:
    text, minor = (ROOT / "README.md").read_text("utf-8"), ".".join(VERSION.split(".")[:2])
    assert f"`libcrease.so.{minor}`" in text
    assert f"find_package(crease {minor})" in text
