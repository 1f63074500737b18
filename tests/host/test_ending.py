"""How the command ends when it is told to: at once, with what was begun undone, and nothing raised."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from crease.base import ending

STUBBORN = """
try:
    while True:
        open("loading", "w").close()
except BaseException:
    pass
"""
"""A library that is still loading, and swallows what is raised meanwhile."""

WORK = """
import os, sys
from crease.base import ending

sys.path.insert(0, ".")
ending.hear()
open("half", "w").close()
with ending.undone_by(lambda: os.unlink("half")), ending.undone_by(lambda: os.unlink("gone")):
    import stubborn
"""


class Ended(BaseException):
    """In place of the end of this process."""


@pytest.fixture(autouse=True)
def _end_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def leave(status: int) -> None:
        raise Ended(status)

    monkeypatch.setattr(ending, "_die", leave)
    monkeypatch.setattr(ending, "_begun", [])
    monkeypatch.setattr(ending, "_heard", [])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_no_library_that_loads_keeps_a_signal(tmp_path: Path, number: signal.Signals) -> None:
    """An exception there was swallowed, became another, or crashed an extension."""
    (tmp_path / "stubborn.py").write_text(STUBBORN)
    kept = signal.signal(signal.SIGINT, signal.SIG_DFL)
    child = subprocess.Popen([sys.executable, "-c", WORK], cwd=tmp_path, stderr=subprocess.PIPE)
    signal.signal(signal.SIGINT, kept)
    while child.poll() is None and not (tmp_path / "loading").exists():
        pass
    child.send_signal(number)
    said = child.communicate(timeout=60)[1]
    assert (child.returncode, said) == (-number, b"error: interrupted\n")
    assert not (tmp_path / "half").exists()


def test_what_was_begun_last_is_undone_first() -> None:
    undone: list[str] = []
    with ending.undone_by(lambda: undone.append("done already")):
        pass
    with (
        ending.undone_by(lambda: undone.append("folder")),
        ending.undone_by(lambda: undone.append("file")),
        pytest.raises(Ended),
    ):
        ending.end()
    assert undone == ["file", "folder"]


def test_steps_that_belong_together_are_done_before_the_end() -> None:
    steps: list[int] = []

    def work() -> None:
        with ending.steady():
            with ending.steady():
                ending.end()
                steps.append(1)
            steps.append(2)

    with pytest.raises(Ended):
        work()
    assert steps == [1, 2]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_work_that_ends_in_its_own_way_is_interrupted_as_ever(number: signal.Signals) -> None:
    before = signal.signal(number, ending.end)
    try:
        with ending.raising(), pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
        assert signal.getsignal(number) is ending.end
        ending.be_deaf()
        signal.raise_signal(number)
    finally:
        signal.signal(number, before)
