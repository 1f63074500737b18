"""`crease sim` and `crease bus` as a person uses them."""

from __future__ import annotations

import contextlib
import gc
import io
import json
import logging
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from bus_tools import NODES, Link, enable, last_state, make_link, setup_layout, torques
from crease.base.errors import BusError
from crease.bus.inprocess import InprocessBus
from crease.bus.transport import open_bus
from crease.cli import main
from crease.verbs.sim import load_path, parse_fault
from host_tools import Said

LOGS = (".log", ".asc", ".blf")


def crease(*args: object) -> Said:
    """One command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main([str(arg) for arg in args])
    return Said(status, out.getvalue(), err.getvalue())


@contextlib.contextmanager
def chatter(link: Link) -> Iterator[None]:
    """A host that sends torques and SYNC all the time."""
    stop = threading.Event()

    def run() -> None:
        while not stop.is_set():
            link.send(0x181, torques(10, 20, -30))
            link.sync()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.mark.parametrize("suffix", LOGS)
def test_bus_shows_decoded_frames_and_its_log_reads_back_the_same(
    link: Link, tmp_path: Path, suffix: str
) -> None:
    setup_layout(link)
    enable(link)
    log = tmp_path / f"bus{suffix}"
    with chatter(link):
        live = crease(
            "bus", "-i", link.transport, "-c", link.channel, "--seconds", "0.3", "-o", log, "--json"
        )
    assert live.status == 0, live.err
    seen = json.loads(live.out)
    assert seen["frames"]["0x181"]["values"] == pytest.approx(
        {"X N": 0.1, "Y Nm": 0.072, "Z Nm": -0.108}
    )
    assert seen["frames"]["0x191"]["values"]["state"] == "operation enabled"
    assert seen["frames"]["0x192"]["count"] > 20
    if (
        link.transport != "virtual"
    ):  # there a busy machine answers after the next SYNC, and it is counted
        assert seen["missed"] <= 3, "the three answers to the SYNC before the first one we heard"
    again = json.loads(crease("bus", "--read", log, "--json").out)
    counts = {cob: row["count"] for cob, row in seen["frames"].items()}
    assert {cob: row["count"] for cob, row in again["frames"].items()} == counts
    assert again["frames"]["0x193"]["values"] == seen["frames"]["0x193"]["values"]


def test_bus_counts_what_is_missing_or_malformed(tmp_path: Path) -> None:
    path = tmp_path / "bad.log"
    with can.Logger(path) as log:
        for tick in range(10):
            stamp = 1.0 + 0.001 * tick
            frames = [(0x080, b""), *((0x180 + n, bytes(8)) for n in NODES)]
            if tick == 5:
                frames.pop()
            if tick == 7:
                frames.append((0x191, b"\x01"))
                frames.append((0x333, b"\x01"))
            for cob, data in frames:
                log.on_message_received(
                    can.Message(
                        arbitration_id=cob,
                        data=data,
                        is_extended_id=False,
                        timestamp=stamp,
                        channel="c",
                    )
                )
    report = json.loads(crease("bus", "--read", path, "--json").out)
    assert report["missed"] == 1
    assert report["frames"]["0x191"]["malformed"] == 1
    assert report["frames"]["0x333"]["name"] == "unknown"
    assert "answers missed" in crease("bus", "--read", path).out


def test_exported_files_that_exist_are_replaced_with_force_only(tmp_path: Path) -> None:
    assert crease("bus", "--export", tmp_path).status == 0
    mine = tmp_path / "crease_y.eds"
    mine.write_text("mine")
    said = crease("bus", "--export", tmp_path)
    assert said.status == 1
    assert said.err.endswith("exists already; give --force to replace it\n")
    assert mine.read_text() == "mine"
    assert crease("bus", "--export", tmp_path, "--force").status == 0
    assert mine.read_text() != "mine"


@pytest.mark.slow
def test_bus_exports_files_and_prints_the_schedule(tmp_path: Path) -> None:
    assert crease("bus", "--export", tmp_path / "out").status == 0
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "crease.dbc", "crease_x.eds", "crease_y.eds", "crease_z.eds",
    ]  # fmt: skip
    assert "920" in crease("bus", "--schedule").out
    report = json.loads(crease("bus", "--schedule", "--json").out)
    assert report["cycle"]["deadline_us"] == 700.0
    assert report["cycle"]["budget_us"] == 210.0
    assert [row["feasible"] for row in report["layouts"]] == [True, False, False, True, False, True]
    assert report["cycle_six"]["deadline_us"] == 550.0


@pytest.mark.parametrize(
    ("args", "text", "status"),
    [
        (["sim", "-i", "socketcan", "-c", "nowhere7"], "there is no such interface", 1),
        (["sim", "-i", "socketcan", "-c", "vcan77"],
         "vcan77: there is no such interface; make it: sudo ip link add vcan77 type vcan && ", 1),
        (["bus", "-i", "socketcan", "-c", "vcan77"], "sudo ip link set vcan77 up", 1),
        (["bus", "-i", "socketcan", "-c", "can7"], "can7: there is no such interface; see `ip link show type can`", 1),
        (["sim", "-i", "nothing", "-c", "x"], "cannot be opened", 1),
        (["sim", "-i", "inprocess", "-c", "x"], "use socketcan or virtual", 2),
        (["sim", "-i", "virtual", "-c", "x", "-b", "500000"], "runs at 1000000", 1),
        (["sim", "-i", "virtual", "-c", "x", "--fault", "drop"], "write KIND:tick=N", 2),
        (
            ["sim", "-i", "virtual", "-c", "x", "--fault", "drop:tick=1,axis=Q"],
            "'axis=Q' is not understood", 2,
        ),
        (["sim", "-i", "virtual", "-c", "x", "--fault", "drop:tick=1,id=0x800"],
         "fault 'drop:tick=1,id=0x800': id 0x800 is out of range, 0x0..0x7ff", 2),
        (["sim", "-i", "virtual", "-c", "x", "--fault", "drop:tick=-1"], "tick -1 is out of range, 0..4294967295", 2),
        (["sim", "-i", "virtual", "-c", "x", "--fault", "drop:tick=99999999999"], "tick 99999999999 is out of", 2),
        (["sim", "-i", "virtual", "-c", "x", "--fault", "drop:tick=1,ticks=-3"], "ticks -3 is out of range, 1..", 2),
        (["sim", "-i", "virtual", "-c", "x", "--fault", "drop:tick=1,ticks=0"], "ticks 0 is out of range, 1..", 2),
        (["sim", "-i", "virtual", "-c", "x", "--fault", "drop:tick=1,id=-1"], "id -0x1 is out of range, 0x0..0x7ff", 2),
        (["sim", "-i", "virtual", "-c", "x", "--fault", "drive_error:tick=1,value=65536"],
         "value 65536 is out of range, 0..65535, an error code of 16 bits", 2),
        (["sim", "-i", "virtual", "-c", "x", "--fault", "encoder_jump:tick=1,value=99999999999"],
         "value 99999999999 is out of range, -2147483648..2147483647, counts", 2),
        (["sim", "-i", "virtual", "-c", "x", "--fault", "drop:tick=1,tick=2"], "tick is given twice", 2),
        *(
            (["sim", "-i", "virtual", "-c", "x", "--seconds", "0.1", "--fault", f"{kind}:tick=1"],
             f"fault '{kind}:tick=1': {kind} needs id=, such as id=0x191: see `crease bus --schedule`", 2)
            for kind in ("drop", "delay", "duplicate", "reorder", "corrupt", "babble")
        ),
        *(
            (["sim", "-i", "virtual", "-c", "x", "--seconds", "0.1", "--fault", f"{kind}:tick=1{value}"],
             f"{kind} by nothing is no fault; give value=, {what}, such as value=3; see", 2)
            for kind, value, what in (
                ("delay", ",id=0x191", "ticks"),
                ("corrupt", ",id=0x191,value=0x100", "a byte, and 256 for each byte before it"),
                ("babble", ",id=0x191,value=0", "frames a tick"),
                ("encoder_jump", "", "counts"),
            )
        ),
        *(
            (["sim", "-i", "virtual", "-c", "x", "--seconds", "0.1", "--fault", f"{kind}:tick=1,{part}"],
             f"fault '{kind}:tick=1,{part}': {kind} has no {name}; leave it out; see", 2)
            for kind, part, name in (
                ("silent", "id=0x191", "id"),
                ("encoder_jump", "value=3,id=0x191", "id"),
                ("drop", "id=0x191,value=3", "value"),
                ("babble", "id=0x191,to=host,value=3", "to"),
                ("drive_reset", "ticks=3", "ticks"),
            )
        ),
        (["sim", "-i", "virtual", "-c", "x", *["--fault", "drop:tick=1"] * 65], "65 are too many; at most 64", 2),
        (
            ["sim", "-i", "virtual", "-c", "x", "--operator", "/nowhere.csv"],
            "there is no such file", 1,
        ),
        (["sim", "-i", "virtual", "-c", "x", "--device", "/nowhere.toml"], "cannot be read", 1),
        (["bus"], "nothing to watch", 2),
        (["bus", "-i", "nothing", "-c", "x"], "cannot be opened", 1),
        (["bus", "-i", "virtual", "-c", "x", "-o", "/tmp/a.trc"], "other formats lose frames", 1),
        (["bus", "--read", "/nowhere.log"], "there is no such file", 1),
        (["bus", "--read", "a.log", "-o", "b.log"], "-o is of a bus that is watched; leave it out with --read", 2),
        (["bus", "--schedule", "--seconds", "1"], "--seconds is of a bus that is watched", 2),
        (["bus", "--export", "no", "-c", "vcan0"], "-c is of a bus that is watched", 2),
        (["bus", "--schedule", "--read", "a.log"], "--schedule and --read: give one of them", 2),
    ],
)  # fmt: skip
def test_wrong_words_get_one_clear_line(args: list[str], text: str, status: int) -> None:
    said = crease(*args)
    assert said.status == status
    assert said.err.startswith("error: ")
    assert said.err.count("\n") == 1
    assert text in said.err


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("hand_mass = 1.0", "parameter 'hand_mass' is not known"),
        ("hand_mass_kg = 'heavy'", "is not a finite number"),
        (
            "rigid = 1\nhand_mass_kg = -1.0",
            "parameter hand_mass_kg: -1.0 is out of range; see cr_sim_params",
        ),
        (
            "[axes.Y]\nmass_kg = -2.0",
            "parameter axes.Y.mass_kg: -2.0 is out of range; see cr_sim_params",
        ),
        ("[wrist]\npadding = 1", "parameter 'padding' is not known"),
        (
            "[wrist]\nsubsteps = 10\npath_Hz = 0.0",
            "device.toml: parameter wrist.path_Hz: 0.0 is out of range; see cr_sim_wrist_params",
        ),
        (
            "[wrist]\ncoulomb_Nm = [0.0, 0.0, 11.0]",
            "device.toml: parameter wrist.coulomb_Nm: [0.0, 0.0, 11.0] is out of range; see cr_sim_wrist_params",
        ),
        ("[axes.X]\nmass = 1.0", "parameter 'mass' is not known"),
        ("[axes.W]\nmass_kg = 1.0", "axis 'W' is not known"),
        ("axes = 3", "axes must be tables"),
        ("= 3", "cannot be read"),
    ],
)
def test_device_file_with_a_mistake_is_refused(tmp_path: Path, content: str, text: str) -> None:
    path = tmp_path / "device.toml"
    path.write_text(content, encoding="utf-8")
    said = crease("sim", "-i", "virtual", "-c", "x", "--seconds", "0.01", "--device", path)
    assert (said.status, said.err.count("\n")) == (1, 1)
    assert text in said.err


def test_device_file_that_is_no_text_is_told_so(tmp_path: Path) -> None:
    path = tmp_path / "device.toml"
    path.write_bytes(b"hand_mass_kg = 1.0 # \xff\n")
    said = crease("sim", "-i", "virtual", "-c", "x", "--seconds", "0.01", "--device", path)
    assert said.status == 1
    assert said.err == f"error: {path}: is no text in UTF-8; save it as TOML in UTF-8\n"


def test_operator_path_is_read_row_by_period(tmp_path: Path) -> None:
    path = tmp_path / "operator.csv"
    path.write_text("t_s,x_m,y_m,z_m,yaw_rad\n0,0,0.6,0,0\n0.01,0.01,0.6,0,0.1\n", encoding="utf-8")
    rows = load_path(path, np.zeros(3), 1e-3)
    assert rows is not None
    assert rows.shape == (11, 6)
    assert rows[5] == pytest.approx([0.005, 0.6, 0.0, 0.05, 0.0, 0.0])
    assert np.isfinite(rows).all()


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("0.01,0,nan,0,0", "y_m is nan, not a finite number"),
        ("0.01,0,0,0,inf", "yaw_rad is inf, not a finite number"),
        ("0.01,0,0,0,a", "yaw_rad is 'a', not a number"),
        ("0,0,0.6,0,0", "time does not increase: 0 s after 0 s"),
    ],
)
def test_a_bad_row_of_an_operator_path_is_named(tmp_path: Path, row: str, reason: str) -> None:
    path = tmp_path / "operator.csv"
    path.write_text(f"t_s,x_m,y_m,z_m,yaw_rad\n0,0,0.6,0,0\n{row}\n", encoding="utf-8")
    said = crease("sim", "-i", "virtual", "-c", "no", "--operator", path, "--seconds", "0.01")
    assert (said.status, said.err) == (1, f"error: {path}:3: {reason}\n")


def test_fault_text_says_all_that_a_row_can() -> None:
    fault = parse_fault("delay:tick=100,ticks=3,axis=Z,id=0x181,to=drives,value=2")
    assert (fault.kind, fault.tick, fault.ticks, fault.axis) == ("delay", 100, 3, 2)
    assert (fault.id, fault.to_drives, fault.value) == (0x181, True, 2)


@pytest.mark.slow
def test_sim_serves_a_python_can_bus_and_reports() -> None:
    result: list[Said] = []
    with make_link("inprocess"):
        pass  # a bus that was there and went leaves nothing behind
    thread = threading.Thread(
        target=lambda: result.append(
            crease("sim", "-i", "virtual", "-c", "served", "--seconds", "1.5", "--json")
        )
    )
    thread.start()
    with can.Bus(interface="virtual", channel="served") as bus:
        link = Link("virtual", "served", bus)
        time.sleep(0.3)
        setup_layout(link)
        enable(link)
        link.sync(5)
        assert last_state(link, 0x11)[2] & 0x6F == 0x27
        thread.join()
    report = json.loads(result[0].out)
    assert report["states"] == ["operation enabled"] * 3
    assert report["ticks"] >= 17
    assert report["frames_lost"] == 0


class _Broken(can.BusABC):
    """An interface that fails at the first frame."""

    channel_info = "broken wire"

    def __init__(self, channel: str, **_: object) -> None:
        super().__init__(channel)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        raise can.CanOperationError("the wire\nis cut")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("the wire\nis cut")


@pytest.mark.parametrize("verb", ["sim", "bus"])
def test_interface_that_fails_gets_one_clear_line(
    monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    monkeypatch.setattr(can, "Bus", lambda channel, interface: _Broken(channel))
    said = crease(verb, "-i", "virtual", "-c", "x", "--seconds", "1")
    assert (said.status, said.err) == (
        1,
        "error: broken wire: the interface failed: the wire is cut\n",
    )


def test_a_fault_that_never_acted_is_said() -> None:
    words = (
        "sim",
        "-i",
        "virtual",
        "-c",
        "quiet",
        "--seconds",
        "0.05",
        "--fault",
        "drop:tick=7,id=0x191",
    )
    said = crease(*words)
    assert said.status == 0
    assert said.err == "warning: --fault drop:tick=7,id=0x191: never came; the drives saw 0 SYNC\n"
    assert "injected  0 faults\n" in said.out
    assert len(json.loads(crease(*words, "--json").out)["warnings"]) == 1


def test_a_log_that_is_none_is_told_by_its_line(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text("(1.5) vcan0 191#00\njunk\n", encoding="ascii")
    said = crease("bus", "--read", path)
    assert said.status == 1
    assert said.err.startswith(f"error: {path}: line 2 is no candump line")
    assert said.err.count("\n") == 1


@pytest.mark.parametrize("cut", ["(1.6) vca", "(1.6) vcan0 191#0", "(1.6) vcan0 191#0011"])
def test_a_last_line_that_is_cut_off_is_left_out_with_a_warning(tmp_path: Path, cut: str) -> None:
    path = tmp_path / "a.log"
    path.write_text(f"(1.4) vcan0 080#\n\n(1.5) vcan0 191#{'00' * 8}\n{cut}", encoding="ascii")
    said = crease("bus", "--read", path, "--json")
    assert said.status == 0
    assert (
        said.err == f"warning: {path}: line 4, the last, does not end: it is cut off and left out\n"
    )
    frames = json.loads(said.out)["frames"]
    assert {cob: (row["count"], row["malformed"]) for cob, row in frames.items()} == {
        "0x080": (1, 0),
        "0x191": (1, 0),
    }


@pytest.mark.parametrize("suffix", [".log", ".asc"])
def test_a_log_without_a_frame_is_an_error(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_text(
        "\n" if suffix == ".log" else "base hex  timestamps absolute\n", encoding="ascii"
    )
    said = crease("bus", "--read", path)
    assert (said.status, said.out) == (1, "")
    assert said.err == (
        f"error: {path}: holds no whole frame; record it with `candump -L` or `crease bus -o`\n"
    )


def test_a_bus_that_cannot_be_opened_is_one_line_without_those_of_its_library() -> None:
    words = [sys.executable, "-m", "crease", "sim", "-i", "udp_multicast", "-c", "1.2"]
    said = subprocess.run(words, capture_output=True, text=True, check=False)
    assert said.returncode == 1
    assert said.stderr.startswith("error: udp_multicast 1.2: cannot be opened: ")
    assert said.stderr.endswith("; see python-can's page of this interface\n")
    assert said.stderr.count("\n") == 1


@pytest.mark.parametrize("error", [can.CanInitializationError, BusError, KeyboardInterrupt])
def test_a_bus_that_cannot_be_opened_leaves_the_log_of_its_library_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    error: type[BaseException],
) -> None:
    def connect(_: can.BusABC) -> None:
        raise OSError("no wire")

    def refuse(self: can.BusABC, channel: str, **_: object) -> None:
        can.BusABC.__init__(self, channel)
        try:
            connect(self)
        except OSError as cause:
            raise error(channel) from cause

    monkeypatch.setattr(InprocessBus, "__init__", refuse)
    monkeypatch.setattr(InprocessBus, "shutdown", lambda self: None)
    caplog.set_level(logging.INFO, "can")
    with pytest.raises((BusError, KeyboardInterrupt)):
        open_bus("inprocess", "x")
    gc.collect()
    assert logging.getLogger("can").level == logging.INFO
    assert caplog.records == [], "a bus that was half made says nothing of its end"


def test_a_kernel_without_socketcan_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crease.bus.transport._has_socketcan", lambda: False)
    said = crease("sim", "-i", "socketcan", "-c", "vcan77")
    assert "there is no such interface; make it: " in said.err
    assert said.err.endswith("this kernel has no SocketCAN\n")


def test_a_log_on_a_full_disk_is_named(tmp_path: Path) -> None:
    log = tmp_path / "full.asc"
    log.symlink_to("/dev/full")
    said = crease("bus", "-i", "virtual", "-c", "full", "-o", log, "--force", "--seconds", "0.1")
    assert said.status == 1
    assert said.err == f"error: {log}: cannot be written: No space left on device\n"
