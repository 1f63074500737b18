"""README.md and the how-to pages tell the truth: marked commands run as written, make targets and files exist.

A block of commands or of Python that follows the line `<!-- run -->` is run, as one script, in a folder that has the
repository's meshes under the same names. All run there one after the other.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
TEXT = (ROOT / "README.md").read_text(encoding="utf-8") if (ROOT / "README.md").exists() else ""
PAGES = [ROOT / "README.md", *sorted((ROOT / "host/docs").glob("*.md"))]


def marked(page: Path) -> list[tuple[str, str]]:
    """Language and text of each marked block."""
    pattern = r"<!-- run -->\s*\n```(sh|python)\n(.*?)```"
    return re.findall(pattern, page.read_text("utf-8"), re.DOTALL)


RUN = {"sh": ["bash", "-euo", "pipefail", "-c"], "python": [sys.executable, "-c"]}
BLOCKS = re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL)


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A folder like a fresh clone with its meshes made, where outputs do not disturb anything."""
    (tmp_path / "build").mkdir()
    for name in ("meshes", "build/meshes"):
        assert (ROOT / name).exists(), f"{name} is missing: run `make meshes`"
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def test_readme_marks_commands_to_run() -> None:
    assert {language for language, _ in marked(PAGES[0])} == set(RUN)


RUNNABLE = [
    pytest.param(page, id=page.stem, marks=() if page == PAGES[0] else pytest.mark.slow)
    for page in PAGES
    if marked(page)
]


@pytest.mark.slow
@pytest.mark.parametrize("page", RUNNABLE)
def test_marked_commands_run_as_written(page: Path, work: Path) -> None:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    for language, script in marked(page):
        result = subprocess.run(
            [*RUN[language], script],
            cwd=work,
            env={**os.environ, "PATH": path, "MPLBACKEND": "Agg"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert result.returncode == 0, f"{script}\n{result.stderr}"
        assert "[0. 0. 0.]" not in result.stdout, f"{script}\nshows no force"
        for warning in re.findall(r"\d+ of \d+ ticks left out contact", result.stderr):
            told = page.read_text("utf-8")
            assert warning in told or "| ticks left out contact |" in told, (
                f"{script}\nwarns, and the page does not say so: {warning}"
            )


def test_every_make_target_in_the_readme_exists() -> None:
    files = ("Makefile", "firmware/port/cortex-m7/device.mk", "firmware/package/install.mk")
    makefile = "\n".join((ROOT / name).read_text(encoding="utf-8") for name in files)
    named = set(
        re.findall(
            r"\bmake ([a-z][a-z0-9-]*)", "\n".join([*BLOCKS, *re.findall(r"`([^`\n]+)`", TEXT)])
        )
    )
    assert named
    assert named <= set(re.findall(r"^([a-z0-9-]+):", makefile, re.MULTILINE))


def test_every_link_in_the_readme_leads_somewhere() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", TEXT)
    assert all((ROOT / link).exists() for link in links if "://" not in link)


def test_tables_of_the_readme_are_short() -> None:
    """What is longer belongs into tests/bench/REPORT.md."""
    tables = re.findall(r"(?:^\|.*\n)+", TEXT, re.MULTILINE)
    assert len(tables) > 5
    assert max(table.count("\n") for table in tables) <= 18
