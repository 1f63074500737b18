"""No target of the Makefile rots: continuous integration runs each, as it is or in its quick form."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DEVICE_MK = Path("firmware/port/cortex-m7/device.mk")
INSTALL_MK = Path("firmware/package/install.mk")
QUICK_AS_THEY_ARE = {
    "help", "setup", "setup-develop", "build", "meshes", "scenes", "demo", "creased", "sanitize",
    "coverage-firmware", "hil-kernel", "format", "licences", "manuals", "firmware-m7", "firmware-m4f", "firmware-m55",
}  # fmt: skip
"""Seconds of work, or work that another target needs anyway: QUICK changes nothing."""


def run_make(folder: Path, *words: str) -> str:
    """What make prints."""
    return subprocess.run(
        ["make", "-s", *words], cwd=folder, capture_output=True, text=True, check=True
    ).stdout


def shown(folder: Path, name: str) -> list[str]:
    """Words of a variable of the Makefile."""
    return run_make(folder, "--eval", f"show: ; @echo $({name})", "show").split()


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The files that say what there is to run, to be changed."""
    for path in (Path("Makefile"), DEVICE_MK, INSTALL_MK, Path(".ci/run")):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / path, tmp_path / path)
    return tmp_path


def test_every_target_of_help_is_run() -> None:
    helped = set(re.findall(r"^make (\S+)", run_make(ROOT, "help"), re.MULTILINE))
    run = (ROOT / ".ci/run").read_text(encoding="utf-8")
    by_ci = set(re.findall(r"^make (\S+)", run, re.MULTILINE))
    assert len(helped) > 30
    assert "all-targets" in by_ci
    assert helped - by_ci == set(shown(ROOT, "QUICK_TARGETS"))


@pytest.mark.parametrize("path", ["Makefile", str(DEVICE_MK), str(INSTALL_MK)])
def test_a_new_target_is_run(path: str, copy: Path) -> None:
    with (copy / path).open("a", encoding="utf-8") as file:
        file.write("\ndusty: ## nobody thinks of it\n\techo\n")
    assert "dusty" in shown(copy, "QUICK_TARGETS")


def test_what_leaves_continuous_integration_is_run_in_its_quick_form(copy: Path) -> None:
    text = (copy / ".ci/run").read_text(encoding="utf-8")
    (copy / ".ci/run").write_text(text.replace("make hil-m7 ", "# make hil-m7 "), encoding="utf-8")
    assert "hil-m7" not in shown(ROOT, "QUICK_TARGETS")
    assert "hil-m7" in shown(copy, "QUICK_TARGETS")


@pytest.mark.slow
def test_every_long_target_has_a_quick_form() -> None:
    for target in {*shown(ROOT, "QUICK_TARGETS"), "fuzz"} - QUICK_AS_THEY_ARE:
        whole, quick = (
            run_make(ROOT, "-n", "-o", "build/.host", target, word)
            for word in ("QUICK=", "QUICK=1")
        )
        assert whole != quick, f"make {target} QUICK=1 is what make {target} is"


@pytest.mark.slow
def test_quick_forms_write_into_a_folder_of_their_own() -> None:
    """Nothing that is checked in, and nothing that figures are taken from."""
    outputs = re.compile(r"(?:-o|--figures?|--output) (\S+)|rm -rf (\S+)")
    for target in shown(ROOT, "QUICK_TARGETS"):
        for line in run_make(ROOT, "-n", "-o", "build/.host", target, "QUICK=1").splitlines():
            if line.startswith((".venv/bin/python tests/bench", ".venv/bin/crease", "rm -rf")):
                for found in outputs.findall(line):
                    assert "".join(found).strip("'").startswith("build/quick"), f"{target}: {line}"
