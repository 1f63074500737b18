"""creased beside a disk and a terminal that do not answer: its own loop, with a UNIX socket in place of the CAN one.

What must happen soon is counted in ticks, and where it matters these are long, so that it depends little on how soon a
machine wakes a thread. A loop in real time is `quiet` all the same: with nothing beside it.
"""

from __future__ import annotations

import fcntl
import os
import re
import resource
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from crease.base.native import lib
from crease.base.scene import open_scene
from crease.replay.recording import RECORD, fault_names, load_recording, rerun

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.quiet
CREASED, DRIVES = (ROOT / "build" / "gcc" / name for name in ("creased-unix", "latency_drives"))
PERIOD_NS = 8_000_000
DEVICE = """[bus]
missing_max = 10
torque_timeout_ms = 0
drive_timeout_ms = 2000
host_timeout_ms = 2000
[loop]
period_us = 8000
overrun_us = 16000
deadline_us = 7000
rest_ticks = 0
"""
CALM = (
    DEVICE.replace("period_us = 8000", "period_us = 20000")
    .replace("overrun_us = 16000", "overrun_us = 40000")
    .replace("deadline_us = 7000", "deadline_us = 17500")
)
"""Periods that no busy machine overruns, for what is not of time."""
CALM_NS = 20_000_000
Rows = npt.NDArray[Any]


class Run:
    """creased and the simulated drives; the drives end with it."""

    def __init__(self, process: subprocess.Popen[bytes], record: Path) -> None:
        self.process, self.record = process, record

    def command(self, text: str) -> int:
        """A line on its standard input; gives the time, ns."""
        assert self.process.stdin is not None
        at_ns = time.monotonic_ns()
        self.process.stdin.write(text.encode() + b"\n")
        self.process.stdin.flush()
        return at_ns

    def signal(self, number: int) -> int:
        """Gives the time, ns."""
        at_ns = time.monotonic_ns()
        self.process.send_signal(number)
        return at_ns

    def wait_for_torque(self, seconds: float = 30.0) -> None:
        """Until the record has a tick with torque."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            rows = rows_of(self.record.read_bytes() if self.record.exists() else b"")
            if len(rows) and (rows["target"][-1] != 0).any():
                return
            assert self.process.poll() is None, "creased has ended"
            time.sleep(0.05)
        raise AssertionError("no torque in time")


def rows_of(data: bytes) -> Rows:
    """The whole records of a recording that may still grow."""
    start = int(lib.CR_RECORDS_AT)
    count = max(0, len(data) - start) // RECORD.itemsize
    return np.frombuffer(data, dtype=RECORD, count=count, offset=start if count else 0)


HELD_UP_S = 1.0
"""How long after an order a disk or a terminal still does not answer."""


def assert_torque_ended(rows: Rows, asked_ns: int) -> None:
    """The next tick asks for no torque (one more may have begun), nor does any that follows, while all is held up."""
    assert not rows["faults"][rows["now_ns"] < asked_ns].any()
    assert (rows["target"][rows["now_ns"] < asked_ns][-5:] != 0).any(), "there was torque before"
    after = rows[rows["now_ns"] >= asked_ns]
    quiet = ~(after["target"] != 0).any(axis=1)
    assert quiet.any()
    first = int(np.argmax(quiet))
    assert first <= 2
    assert int(after["now_ns"][first]) - asked_ns < HELD_UP_S * 1e9
    assert quiet[first:].all()


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        process.kill()


@contextmanager
def running(
    folder: Path,
    scene: Path,
    *options: str,
    device: str = DEVICE,
    record: Path | None = None,
    tip_z_m: float = 0.02,
    **how: Any,
) -> Iterator[Run]:
    """creased with its drives, rendering as soon as it can."""
    assert CREASED.exists(), "run make build/gcc/creased-unix build/gcc/latency_drives"
    bus, config, record = folder / "bus", folder / "device.toml", record or folder / "run.crr"
    config.write_text(device, encoding="ascii")
    with ExitStack() as stack:
        tip = ("0", "0.6363961", f"{tip_z_m:g}")
        drives = stack.enter_context(subprocess.Popen([str(DRIVES), str(bus), *tip]))
        stack.callback(drives.kill)
        with suppress(PermissionError):  # frames that a busy machine holds back come in a burst
            os.sched_setscheduler(drives.pid, os.SCHED_FIFO, os.sched_param(50))
        end_s = time.monotonic() + 10.0
        while not bus.exists() and time.monotonic() < end_s:
            time.sleep(0.01)
        time.sleep(0.05)
        words: Sequence[str | Path] = (
            CREASED, "--config", config, "--interface", bus, "--record", record, "--start", *options, scene,
        )  # fmt: skip
        settings: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        settings |= {"stderr": subprocess.STDOUT} | how
        process = stack.enter_context(subprocess.Popen([str(w) for w in words], **settings))
        stack.callback(_end, process)
        yield Run(process, record)


def full_pipe() -> tuple[int, int]:
    """A pipe that takes not one byte more."""
    read, write = os.pipe()
    fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, 4096)
    os.set_blocking(write, False)
    for size in (4096, 1):
        with suppress(BlockingIOError):
            while True:
                os.write(write, bytes(size))
    os.set_blocking(write, True)
    return read, write


def end_of(run: Run, seconds: float = 10.0) -> tuple[int, str]:
    """Its status, and what it said."""
    out, _ = run.process.communicate(timeout=seconds)
    return run.process.returncode, (out or b"").decode()


# ------------------------------------------------------------------------------------------------------------ figures


@pytest.mark.slow
def test_signal_in_the_sleep_spoils_no_figure(tmp_path: Path, scene_crs: Path) -> None:
    """A sleep that is cut short began its period before its time: 1.8e19 us late, by unsigned arithmetic."""
    for k in range(4):
        folder = tmp_path / str(k)
        folder.mkdir()
        with running(folder, scene_crs) as run:
            time.sleep(0.4 + 0.0023 * k)
            run.signal(signal.SIGINT)
            _, text = end_of(run)
        late_us = re.search(r"wake-up at most (\d+) us late", text)
        assert late_us is not None, text
        assert float(late_us[1]) < 1e6
        rows = rows_of(run.record.read_bytes())
        assert rows["wake_late_ns"].max() < 1e9
        assert (np.diff(rows["sync_ns"].astype(np.int64)) > PERIOD_NS // 2).all(), "none came early"


def test_deadline_runs_from_the_sync(tmp_path: Path, scene_crs: Path) -> None:
    """Nobody answers: each tick waits the whole deadline after its SYNC, however late the period began."""
    device = DEVICE.replace("deadline_us = 7000", "deadline_us = 2000")
    with running(tmp_path, scene_crs, device=device) as run:
        time.sleep(0.5)
        run.signal(signal.SIGINT)
        end_of(run)
    rows = rows_of(run.record.read_bytes())
    waited_ns = (rows["now_ns"] - rows["sync_ns"]).astype(np.int64)
    assert len(waited_ns) > 20
    assert (waited_ns >= 2_000_000).all(), "also in the tick that the signal interrupts"


# ------------------------------------------------------------------------------------------------ terminals and disks


BLOCKED = ("stop", "SIGTERM", "SIGHUP", "SIGQUIT")
LEFT = ("SIGPIPE", "SIGTSTP", "SIGTTIN", "SIGTTOU")


@dataclass(frozen=True)
class Ended:
    """How a loop ended, its record, and when it was told, ns."""

    status: int
    rows: Rows
    told_ns: int


def told_while_blocked(folder: Path, scene: Path, how: str) -> Ended:
    """An order to a loop in contact whose terminal takes nothing."""
    read, write = full_pipe()
    try:
        with running(folder, scene, device=CALM, stdout=write, stderr=write) as run:
            run.wait_for_torque()
            order = run.command("stop") if how == "stop" else run.signal(signal.Signals[how])
            time.sleep(HELD_UP_S)
            if how == "stop":
                run.signal(signal.SIGTERM)
            status, _ = end_of(run)
    finally:
        os.close(read)
        os.close(write)
    return Ended(status, rows_of(run.record.read_bytes()), order)


def told_of_its_terminal(folder: Path, scene: Path, how: str) -> Ended:
    """A signal of a terminal to a loop in contact, two seconds before its end."""
    with running(folder, scene, device=CALM) as run:
        run.wait_for_torque()
        if how == "SIGPIPE":
            assert run.process.stdout is not None
            run.process.stdout.close()
            run.process.stdout = None
            run.command("stop")
            time.sleep(0.2)
            run.command("start")
        told_ns = run.signal(signal.Signals[how])
        time.sleep(2.0)
        run.signal(signal.SIGTERM)
        status, _ = end_of(run)
    return Ended(status, rows_of(run.record.read_bytes()), told_ns)


def all_at_once(
    what: Callable[[Path, Path, str], Ended], base: Path, scene: Path, names: Sequence[str]
) -> dict[str, Future[Ended]]:
    """Loops of 20 ms periods, which sleep nearly all the time, beside each other."""
    folders = [base / name for name in names]
    for folder in folders:
        folder.mkdir()
    with ThreadPoolExecutor(len(names)) as pool:
        return {
            name: pool.submit(what, folder, scene, name)
            for name, folder in zip(names, folders, strict=True)
        }


@pytest.fixture(scope="module")
def blocked(tmp_path_factory: pytest.TempPathFactory, scene_crs: Path) -> dict[str, Future[Ended]]:
    """Loops with a blocked terminal, by what they were told."""
    # When the tests run under nohup creased would keep it ignored.
    kept = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        folder = tmp_path_factory.mktemp("blocked")
        return all_at_once(told_while_blocked, folder, scene_crs, BLOCKED)
    finally:
        signal.signal(signal.SIGHUP, kept)


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory, scene_crs: Path) -> dict[str, Future[Ended]]:
    """Loops whose terminal went away, by the signal."""
    return all_at_once(told_of_its_terminal, tmp_path_factory.mktemp("left"), scene_crs, LEFT)


@pytest.mark.slow
@pytest.mark.parametrize("how", BLOCKED)
def test_blocked_terminal_holds_up_no_command_and_no_signal(
    blocked: dict[str, Future[Ended]], how: str
) -> None:
    ended = blocked[how].result()
    assert ended.status == 0
    assert_torque_ended(ended.rows, ended.told_ns)


@pytest.mark.slow
def test_blocked_disk_holds_up_no_signal(tmp_path: Path, scene_crs: Path) -> None:
    """The record is a pipe that nobody reads until the signal is out."""
    fifo, seen = tmp_path / "run.crr", bytearray()
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    with running(tmp_path, scene_crs, "--force", device=CALM, record=fifo) as run:
        time.sleep(8.0)  # nothing can be read that would tell when there is torque
        order = run.signal(signal.SIGTERM)
        time.sleep(HELD_UP_S)
        end_s = time.monotonic() + 10.0
        while run.process.poll() is None and time.monotonic() < end_s:
            with suppress(BlockingIOError):
                seen += os.read(reader, 1 << 20)
            time.sleep(0.002)
        status, _ = end_of(run)
        seen += os.read(reader, 1 << 20)
    os.close(reader)
    assert status == 0
    assert_torque_ended(rows_of(bytes(seen)), order)


@pytest.mark.slow
def test_disk_that_never_answers_is_left_behind_and_said(tmp_path: Path, scene_crs: Path) -> None:
    fifo = tmp_path / "run.crr"
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    with running(tmp_path, scene_crs, "--force", record=fifo) as run:
        time.sleep(1.5)
        start_s = time.monotonic()
        run.signal(signal.SIGTERM)
        status, text = end_of(run, 20.0)
    os.close(reader)
    assert status == 1
    assert "the record ends here" in text
    assert 4.0 < time.monotonic() - start_s < 10.0


@pytest.mark.slow
def test_full_disk_is_said_at_once_and_the_record_ends_with_a_whole_tick(
    tmp_path: Path, scene_crs: Path
) -> None:
    room = int(lib.CR_RECORDS_AT) + 100 * RECORD.itemsize + 200

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    with running(tmp_path, scene_crs, preexec_fn=limit) as run:
        assert run.process.stdout is not None
        lines: list[str] = []
        while not lines or "the record ends here" not in lines[-1]:
            lines.append(run.process.stdout.readline().decode())
            assert lines[-1], "it ended without a word"
        ticking = run.process.poll() is None
        run.signal(signal.SIGTERM)
        status, _ = end_of(run)
    assert ticking
    assert (status, run.record.stat().st_size) == (1, room - 200)
    assert lines[-1] == "error: the record ends here: File too large; the loop goes on\n"


@pytest.mark.slow
@pytest.mark.parametrize("how", LEFT)
def test_terminal_that_goes_away_ends_nothing(left: dict[str, Future[Ended]], how: str) -> None:
    ended = left[how].result()
    assert ended.status == 0
    after = ended.rows[ended.rows["sync_ns"] > ended.told_ns + 10 * CALM_NS]
    after = after[after["mode"] != lib.CR_MODE_IDLE]
    assert len(after) > 25
    assert (after["target"] != 0).any()


# ------------------------------------------------------------------------------------------------- who watches the loop


@pytest.mark.slow
def test_watchdog_hears_the_loop_and_is_disarmed_at_the_end(
    tmp_path: Path, scene_crs: Path
) -> None:
    watchdog = tmp_path / "watchdog"
    watchdog.touch()
    device = f'{DEVICE}watchdog = "{watchdog}"\n'
    with running(tmp_path, scene_crs, device=device) as run:
        time.sleep(1.5)
        before = watchdog.read_bytes()
        run.signal(signal.SIGTERM)
        status, text = end_of(run)
    assert status in (0, 3), text
    assert set(before) == set(b"k")
    assert 5 <= len(before) <= 16
    assert watchdog.read_bytes().endswith(b"kV")


def test_watchdog_that_is_not_there_is_refused(tmp_path: Path, scene_crs: Path) -> None:
    device = f'{DEVICE}watchdog = "{tmp_path}/none"\n'
    with running(tmp_path, scene_crs, device=device) as run:
        status, text = end_of(run)
    assert status == 2
    assert text == f"error: watchdog {tmp_path}/none: cannot be opened: No such file or directory\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["file", "abstract"])
def test_service_manager_hears_ready_alive_and_stopping(
    tmp_path: Path, scene_crs: Path, name: str
) -> None:
    path = str(tmp_path / "notify") if name == "file" else f"@crease-test-{os.getpid()}"
    said: list[str] = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(path if name == "file" else "\0" + path[1:])
        manager.settimeout(0.3)
        environment = os.environ | {"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "200000"}
        environment.pop("WATCHDOG_PID", None)
        with running(tmp_path, scene_crs, env=environment) as run:
            end_s = time.monotonic() + 1.5
            while not said or said[-1] != "STOPPING=1":
                with suppress(TimeoutError):
                    said.append(manager.recv(256).decode())
                if time.monotonic() > end_s:
                    end_s = float("inf")
                    run.signal(signal.SIGTERM)
            end_of(run)
    assert (said[0], said[-1]) == ("READY=1", "STOPPING=1")
    assert set(said[1:-1]) == {"WATCHDOG=1"}
    assert 5 <= len(said) - 2 <= 16, "every 100 ms"


# ------------------------------------------------------------------------------------------------------- what it says


def test_drive_of_another_make_is_named_with_what_was_found(
    tmp_path: Path, scene_crs: Path
) -> None:
    device = DEVICE.replace("[bus]\n", "[bus]\nvendor_id = 7\n")
    with running(tmp_path, scene_crs, "--exit-on-fault", device=device) as run:
        status, text = end_of(run, 30.0)
    assert status == 4
    want = "fault: mismatch; drive X (node 0x11): 0x1018:1 is 0 (0x0), must be 7 (0x7)\n"
    assert want in text


def test_record_that_is_a_folder_is_refused(tmp_path: Path, scene_crs: Path) -> None:
    with running(tmp_path, scene_crs, record=tmp_path) as run:
        status, text = end_of(run)
    assert (status, text) == (1, f"error: {tmp_path}: is a folder; name a file\n")


def test_a_scene_that_cannot_be_opened_is_told_with_its_mend_once(
    tmp_path: Path, scene_crs: Path
) -> None:
    whole = scene_crs.read_bytes()
    device = ROOT / "firmware" / "port" / "linux" / "device.toml"
    scene = tmp_path / "bad.crs"
    for data in (whole[:1000], bytes([*whole[:5000], whole[5000] ^ 1, *whole[5001:]])):
        scene.write_bytes(data)
        said = subprocess.run(
            [CREASED, "--config", device, scene], capture_output=True, text=True, check=False
        )
        assert said.returncode == 2
        assert said.stderr.count("bake it again") == said.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("size", "reason"),
    [
        (0, "is an empty file"),
        (30, "is cut off, after 30 bytes, or damaged"),
        (1000, "is cut off, after 1000 bytes, or damaged"),
        (None, "cannot be read: No such file or directory"),
    ],
)
def test_a_scene_that_is_not_there_or_cut_off_is_told_so(
    tmp_path: Path, scene_crs: Path, size: int | None, reason: str
) -> None:
    device, scene = ROOT / "firmware/port/linux/device.toml", tmp_path / "cut.crs"
    if size is not None:
        scene.write_bytes(scene_crs.read_bytes()[:size])
    said = subprocess.run(
        [CREASED, "--config", device, scene], capture_output=True, text=True, check=False
    )
    mend = "" if size is None else "; bake it again"
    assert said.stderr == f"error: {scene}: {reason}{mend}\n"
    assert said.returncode == 2


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ((), "--config is missing"),
        (("--config", "d.toml"), "scene.crs is missing"),
        (("--config", "d.toml", "a.crs", "b.crs"), "more than one scene.crs is given"),
        (("--bogus", "a.crs"), "there is no option --bogus"),
        (("--start", "--bogus=1"), "there is no option --bogus"),
        (("--st",), "there is no option --st"),
        (("--start", "-zy"), "there is no option -z"),
        (("--start=now",), "--start takes no value"),
        (("a.crs", "--config"), "--config needs a value"),
    ],
)
def test_a_wrong_command_line_is_told_in_one_line(words: tuple[str, ...], error: str) -> None:
    said = subprocess.run([CREASED, *words], capture_output=True, text=True, check=False)
    assert (said.returncode, said.stdout) == (2, "")
    assert said.stderr == f"error: {error}; see `creased --help`\n"


def test_help_lists_the_words_of_a_fault() -> None:
    said = subprocess.run([CREASED, "--help"], capture_output=True, text=True, check=True).stdout
    words = re.split(r",\s+", said.split("its error code (0x603F):\n")[1].strip().rstrip("."))
    texts = [1 << bit for bit in range(int(lib.CR_FAULT_COUNT))]
    assert words == [name for bit in texts for name in fault_names(bit)]
    assert max(len(line) for line in said.splitlines()) <= 120


def test_unknown_command_is_said_and_changes_nothing(tmp_path: Path, scene_crs: Path) -> None:
    with running(tmp_path, scene_crs) as run:
        time.sleep(0.3)
        run.command("sotp")
        time.sleep(0.3)
        run.command("quit")
        status, text = end_of(run)
    assert "'sotp' is no command; start, stop, clear, quit\n" in text
    assert status in (0, 3)


@pytest.mark.slow
@pytest.mark.parametrize(("late_max", "youngest"), [(100, 1), (0, 0)])
def test_contact_is_searched_beside_the_ticks_or_in_them_and_both_run_again(
    tmp_path: Path, scene_crs: Path, late_max: int, youngest: int
) -> None:
    device = f"{CALM}[contact]\nlate_max_ticks = {late_max}\n"
    with running(tmp_path, scene_crs, device=device, tip_z_m=0.008) as run:
        run.wait_for_torque()
        time.sleep(2.0)
        run.command("quit")
        status, text = end_of(run, 30.0)
    assert status == 0, text
    recording = load_recording(run.record)
    late = recording.rows["contact_late_ticks"][recording.rows["areas"] > 0]
    assert len(late) > 50
    assert late.min() == youngest
    assert late.max() <= late_max
    again = rerun(recording, open_scene(scene_crs))
    assert (again.records, again.different, again.gap) == (len(recording), 0, False)
