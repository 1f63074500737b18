"""The kernel of `make hil` in its cache: its name follows all that goes into it, and it counts only when it boots."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

LAB = Path(__file__).resolve().parents[1] / "hil" / "lab"


def build_kernel(cache: Path, *args: str, lab: Path = LAB) -> subprocess.CompletedProcess[str]:
    """`build-kernel` of `lab` over the cache in `cache`."""
    environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
    return subprocess.run(
        [lab / "build-kernel", *args], capture_output=True, text=True, check=False, env=environment
    )


def test_a_cached_kernel_that_does_not_boot_is_refused(tmp_path: Path) -> None:
    named = build_kernel(tmp_path, "--path")
    assert named.returncode == 1, "there is none in an empty cache"
    kernel = Path(named.stdout.strip())
    kernel.parent.mkdir(parents=True)
    # What a build that was cut short, or another machine's, may have left.
    kernel.write_text("#!/bin/sh\necho not a kernel\n")
    kernel.chmod(0o755)
    assert build_kernel(tmp_path, "--path").returncode == 0, "the path alone says nothing of it"
    booted = build_kernel(tmp_path, "--boots")
    assert booted.returncode == 1
    assert "not a kernel" in booted.stderr, "its console is shown"


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("kernel.config", "CONFIG_KERNEL_STACK_ORDER=4", "CONFIG_KERNEL_STACK_ORDER=5"),
        ("build-kernel", "HOST_FP_SIZE, 12288", "HOST_FP_SIZE, 16384"),
    ],
)
def test_its_name_follows_what_goes_into_it(tmp_path: Path, name: str, old: str, new: str) -> None:
    lab = tmp_path / "lab"
    shutil.copytree(LAB, lab)
    before = build_kernel(tmp_path, "--path", lab=lab).stdout
    assert before == build_kernel(tmp_path, "--path").stdout, "two checkouts share it"
    text = (lab / name).read_text()
    assert old in text
    (lab / name).write_text(text.replace(old, new))
    assert build_kernel(tmp_path, "--path", lab=lab).stdout != before
