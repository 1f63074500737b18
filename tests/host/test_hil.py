"""The closed loop in one process, its recording, and the recording run again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crease.base.errors import LoopError
from crease.base.native import ffi, lib
from crease.base.scene import open_scene
from crease.base.table import read_table
from crease.draw.plot_loop import draw_loop, motor_force_N, recording_table, slack_text
from crease.loop.call import Loop as ApiLoop
from crease.loop.hil import (
    MECHANISM,
    Loop,
    LoopResult,
    describe,
    hand_targets,
    lead_in,
    resample,
    run_inprocess,
)
from crease.replay import recording as rec
from crease.replay.measures import buzz_m_s2
from crease.replay.recording import load_recording
from crease.replay.trajectory import load_trajectory
from host_tools import Run, write_path


@pytest.fixture(scope="session")
def slow_press_csv(folder: Path) -> Path:
    """The ball comes down on the block with 20 mm/s, 2 mm deep, slides, and leaves."""
    down = np.linspace([0.0, 0.0, 0.014], [0.0, 0.0, 0.008], 300)
    along = np.linspace([0.0, 0.0, 0.008], [0.010, 0.0, 0.008], 300)
    up = np.linspace([0.010, 0.0, 0.008], [0.010, 0.0, 0.014], 300)
    return write_path(folder / "slow_press.csv", np.concatenate([down, along, up]))


@pytest.fixture(scope="session")
def run_crr(folder: Path, scene_crs: Path, slow_press_csv: Path, crease: Run) -> Path:
    """Recording of the press."""
    path = folder / "run.crr"
    said = crease(
        "hil", scene_crs, "--operator", slow_press_csv, "-o", path, "--table", folder / "run.csv"
    )
    assert said.status == 0, said.err
    return path


def test_hil_renders_the_contact_without_a_fault(
    folder: Path, scene_crs: Path, slow_press_csv: Path, crease: Run
) -> None:
    said = crease(
        "hil",
        scene_crs,
        "--operator",
        slow_press_csv,
        "-o",
        folder / "json.crr",
        "--log",
        folder / "run.log",
        "--json",
    )
    assert said.status == 0, said.err
    assert (said.json["faulted"], said.json["faults"]) == (False, [])
    assert said.json["ticks_rendering"] >= 900
    assert said.json["ticks_in_contact"] > 400
    assert 0.3 < said.json["force_max_N"] < 3.0
    assert said.json["missing"] == said.json["overruns"] == 0
    log = (folder / "run.log").read_text(encoding="ascii").splitlines()
    assert sum(" 080#" in line for line in log) >= said.json["ticks"] - 60
    table = (
        np.genfromtxt(folder / "run.csv", delimiter=",", names=True)
        if (folder / "run.csv").exists()
        else None
    )
    assert table is None or np.isfinite(table["fx_N"]).all()


@pytest.mark.parametrize("middle", [slice(300, 700), slice(0, 0)])
def test_buzz_of_a_run_is_of_its_ticks_in_contact(run_crr: Path, middle: slice) -> None:
    recording = load_recording(run_crr)
    rows = recording.rows.copy()
    rows["areas"] = 0
    rows["areas"][middle] = 1
    at = np.arange(len(rows))
    loud = np.where((at > 200) & (at < 800), 0.1, 5.0)  # as far off as the filter smears it
    mechanism = np.zeros(len(rows), dtype=MECHANISM)
    mechanism["tip_acc_m_s2"][:, 0] = loud * np.sin(2.0 * np.pi * 60e-3 * at)
    told = describe(LoopResult(replace(recording, rows=rows), mechanism, 100))["buzz_m_s2"]
    expected = 0.1 * np.sqrt(0.5) if middle.stop else 0.0
    assert told == pytest.approx(expected, rel=0.05)


def test_a_long_title_of_a_run_is_broken_where_the_figure_ends(run_crr: Path) -> None:
    figure: Any = draw_loop(recording_table(load_recording(run_crr)), "a run of many words " * 12)
    figure.canvas.draw()
    title = figure._suptitle.get_window_extent()
    assert title.x0 >= 0.0
    assert title.x1 <= figure.bbox.width


def test_a_table_ends_with_the_last_tick_that_was_rendered(run_crr: Path, folder: Path) -> None:
    table, rows = read_table(folder / "run.csv"), load_recording(run_crr).rows
    assert rows["mode"][-1] == lib.CR_MODE_IDLE  # stopped after the path
    assert set(table["mode"]) <= {lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED}
    assert len(table["t_s"]) == 900  # one a pose


def test_hil_gives_the_same_bytes_twice(
    folder: Path, scene_crs: Path, slow_press_csv: Path, run_crr: Path, crease: Run
) -> None:
    again = folder / "again.crr"
    assert crease("hil", scene_crs, "--operator", slow_press_csv, "-o", again).status == 0
    assert again.read_bytes() == run_crr.read_bytes()


def test_replay_of_a_recording_reproduces_every_tick_to_the_bit(
    folder: Path, scene_crs: Path, run_crr: Path, crease: Run
) -> None:
    said = crease("replay", scene_crs, run_crr, "-o", folder / "rerun.csv", "--json")
    assert said.status == 0, said.err
    assert said.json["ticks_different"] == 0
    assert said.json["ticks"] == len(rec.load_recording(run_crr))


def test_replay_tells_the_first_tick_that_differs(
    folder: Path, scene_crs: Path, run_crr: Path, crease: Run
) -> None:
    data = bytearray(run_crr.read_bytes())
    at = int(lib.CR_RECORDS_AT) + 1500 * 512
    offset = rec.RECORD.fields["target"][1]  # type: ignore[index]
    data[at + offset] ^= 1
    changed = folder / "changed.crr"
    changed.write_bytes(data)
    said = crease("replay", scene_crs, changed, "-o", folder / "changed.csv")
    assert said.status == 1
    assert "1 of" in said.err
    assert "the first is 1500" in said.err


@pytest.mark.slow
def test_replay_refuses_a_recording_of_another_scene(
    folder: Path, run_crr: Path, block_stl: Path, ball_stl: Path, crease: Run
) -> None:
    other = folder / "other.crs"
    assert (
        crease("bake", block_stl, ball_stl, "-o", other, "--unit", "mm", "--spacing", "2mm").status
        == 0
    )
    said = crease("replay", other, run_crr, "-o", folder / "other.csv")
    assert said.status == 1
    assert "another scene" in said.err


def test_replay_reads_a_recording_that_is_cut_up_to_its_last_whole_record(
    folder: Path, scene_crs: Path, run_crr: Path, crease: Run
) -> None:
    data, rows = run_crr.read_bytes(), rec.load_recording(run_crr).rows
    path = folder / "cut.crr"
    path.write_bytes(data[:-100])
    whole = len(rows)
    assert (rec.load_recording(path).rows == rows[:-1]).all()
    said = crease("replay", scene_crs, path, "-o", folder / "cut.csv", "--json")
    assert said.status == 0
    assert said.json["ticks"] == whole - 1
    assert said.json["ticks_different"] == 0
    left = rec.RECORD.itemsize - 100
    warning = f"last whole one; {left} bytes after it are left out"
    assert warning in said.err
    for verb in (
        ("plot", path, "-o", folder / "cut.png", "--title", "$x^{$"),
        ("export", path, "--to", "csv"),
    ):
        said = crease(*verb, "--force")
        assert said.status == 0, said.err
        assert warning in said.err


def test_a_recording_without_its_head_is_told_to_be_empty_or_cut_off(
    tmp_path: Path, scene_crs: Path, run_crr: Path, crease: Run
) -> None:
    path = tmp_path / "cut.crr"
    for data, reason in (
        (b"", "is an empty file; record it again"),
        (run_crr.read_bytes()[:5], "is cut off within its head: 5 of"),
        (run_crr.read_bytes()[:20], "is cut off within its head: 20 of"),
        (b"no recording", "is no recording: 12 bytes are less than its head"),
    ):
        path.write_bytes(data)
        for verb in (
            ("replay", scene_crs, path, "-o", tmp_path / "cut.csv"),
            ("plot", path, "-o", tmp_path / "cut.png"),
            ("export", path, "--to", "csv"),
        ):
            said = crease(*verb)
            assert said.status == 1
            assert said.err.startswith(f"error: {path}: {reason}")


def test_replay_refuses_a_recording_without_a_record_or_of_another_version(
    folder: Path, scene_crs: Path, run_crr: Path, crease: Run
) -> None:
    data = run_crr.read_bytes()
    version = bytearray(data)
    version[8] = 9
    settings, sizes = bytearray(data), bytearray(data)
    settings[200:600] = b"\xff" * 400
    sizes[12:24] = b"\xff" * 12
    for name, content, why in (
        ("none", data[: int(lib.CR_RECORDS_AT) + 100], "no whole record"),
        ("head", data[:500], "is cut off within its head"),
        ("version", bytes(version), "is a recording of format 9, not"),
        ("settings", bytes(settings), "is damaged: the settings in its head are none that"),
        ("sizes", bytes(sizes), "is damaged: its head tells other sizes than"),
    ):
        path = folder / f"{name}.crr"
        path.write_bytes(content)
        said = crease("replay", scene_crs, path, "-o", folder / f"{name}.csv")
        assert said.status == 1
        assert why in said.err
        assert said.err.count("\n") == 1


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        ("silent:tick=1600,ticks=50,axis=Y", "silent"),
        ("encoder_jump:tick=1600,axis=X,value=400", "jump"),
        ("drive_reset:tick=1600,axis=Z", "reset"),
        ("drive_error:tick=1600,axis=X,value=0x2310", "drive"),  # its EMCY comes below the states
        ("babble:tick=1600,axis=Y,id=0x692,value=20", "babble"),
    ],
)
def test_fault_of_a_simulated_drive_zeroes_the_torque_and_is_in_the_recording(
    folder: Path, scene_crs: Path, slow_press_csv: Path, crease: Run, fault: str, name: str
) -> None:
    path = folder / f"fault_{name}.crr"
    said = crease(
        "hil", scene_crs, "--operator", slow_press_csv, "-o", path, "--fault", fault, "--json"
    )
    assert said.status == 4, said.err
    assert said.json["faulted"] is True
    assert name in said.json["first_faults"]
    assert set(said.json["faults"]) >= set(said.json["first_faults"])
    recording = rec.load_recording(path)
    rows = recording.rows
    first = int(np.flatnonzero(rows["faults"])[0])
    assert 1650 <= first <= 1655, "SYNC 1600 goes out in tick 1650: the first 50 listen"
    assert (rows["target"][first:] == 0).all()
    assert (rows["mode"][first:] == lib.CR_MODE_FAULT).all()
    assert rec.rerun(recording, open_scene(scene_crs)).different == 0


def test_fault_clears_on_command_only(scene_crs: Path, slow_press_csv: Path) -> None:
    loop = Loop(open_scene(scene_crs))
    targets = hand_targets(resample(load_trajectory(slow_press_csv)), loop.config)
    lead = lead_in(targets, loop.drives.state.tip_pos_m)
    loop.bring_up(lead)
    loop.command(int(lib.CR_INPUT_BUS_OFF))
    loop.tick()
    for _ in range(300):
        loop.command(int(lib.CR_COMMAND_START))
        loop.tick()
        assert loop.mode == lib.CR_MODE_FAULT
    loop.command(int(lib.CR_COMMAND_CLEAR))
    loop.bring_up(lead)
    loop.command(int(lib.CR_COMMAND_START))
    loop.tick()
    assert loop.mode in (lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED)


@pytest.mark.slow
def test_plot_of_a_run_holds_commanded_and_felt_force_energy_timing_and_state(
    folder: Path, run_crr: Path, crease: Run
) -> None:
    recording = rec.load_recording(run_crr)
    axes = draw_loop(recording_table(recording), "run").axes
    lines = {str(line.get_label()): np.asarray(line.get_ydata()) for line in axes[0].lines}
    commanded = np.linalg.norm(recording.rows["force_N"], axis=1)
    assert lines["commanded"] == pytest.approx(commanded, rel=1e-6)
    energy_mJ = 1e3 * recording.rows["energy_J"].astype(np.float64)
    assert np.asarray(axes[2].lines[0].get_ydata()) == pytest.approx(energy_mJ, rel=1e-6)
    legend = axes[4].get_legend()
    assert legend is not None
    labels = [text.get_text() for text in legend.get_texts()]
    assert {"init", "bus-up", "calibrating", "rendering"} <= set(labels)
    for name, table in (("crr", run_crr), ("csv", folder / "run.csv")):
        figure = folder / f"loop_{name}.png"
        said = crease("plot", table, "-o", figure)
        assert (said.status, said.out) == (0, f"{figure}\n")
    assert crease("plot", run_crr, folder / "run.csv", "-o", folder / "two.png").status == 2


def test_force_of_the_motors_follows_the_commanded_one_two_ticks_later(run_crr: Path) -> None:
    """The drives tell per mille of what acted since the last SYNC, through an amplifier of 500 Hz."""
    recording = rec.load_recording(run_crr)
    told = np.linalg.norm(motor_force_N(recording), axis=1)
    commanded = np.linalg.norm(recording.rows["force_N"], axis=1)
    press = np.flatnonzero(commanded > 0.5)[5:]
    error_N = told[press] - commanded[press - 2]
    assert np.abs(error_N).max() < 0.15, "0.15 N: friction compensation changes within the delay"
    assert abs(error_N.mean()) < 0.01


def test_firmware_and_simulator_assume_the_same_device() -> None:
    from crease._sim import lib as sim

    config, params = lib.cr_servo_config_default(), sim.cr_sim_params_default()
    links = (1.0, config.arm.upper_m, config.arm.fore_m)
    assert list(params.link_m) == pytest.approx([config.arm.upper_m, config.arm.fore_m])
    for axis in range(3):
        assert params.axes[axis].step_m / links[axis] == pytest.approx(
            config.axis[axis].step, rel=1e-5
        )
        assert params.axes[axis].coulomb_N * links[axis] == pytest.approx(
            config.axis[axis].coulomb, rel=1e-5
        )
    assert params.gravity_N * config.arm.upper_m == pytest.approx(config.axis[1].gravity, rel=1e-5)
    assert params.wrist_step_rad == pytest.approx(config.wrist_step_rad, rel=1e-5)


def test_path_out_of_reach_is_refused_with_its_row(
    folder: Path, scene_crs: Path, crease: Run
) -> None:
    path = write_path(folder / "far.csv", np.array([[0.0, 0.0, 0.014], [0.0, 0.9, 0.014]]))
    said = crease("hil", scene_crs, "--operator", path, "-o", folder / "far.crr")
    assert said.status == 1
    mend = "move the path or the base"
    assert said.err == f"error: {path}:3: the device does not reach this pose; {mend}\n"


def test_a_path_in_millimetres_is_asked_for_its_metres_at_its_line(
    folder: Path, scene_crs: Path, crease: Run
) -> None:
    down = np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, 8.0], 200)  # out of reach in between
    path = write_path(folder / "mm.csv", down)
    said = crease("hil", scene_crs, "--operator", path, "-o", folder / "mm.crr")
    assert said.status == 1
    assert f"error: {path}:" in said.err
    line = int(said.err.split(f"{path}:")[1].split(":")[0])
    assert 2 < line < 50
    path = write_path(folder / "mm.csv", np.array([[0.0, 0.0, 14.0]] * 2))
    said = crease("hil", scene_crs, "--operator", path, "-o", folder / "mm.crr")
    ask = "the device does not reach this pose; are its positions in metres?"
    assert said.err == f"error: {path}:2: {ask}\n"
    api = load_trajectory(path)
    with pytest.raises(LoopError, match=r"mm\.csv:2: .*in metres\?"):
        ApiLoop(scene_crs).run(api)


@pytest.mark.parametrize("words", [("-c", "vcan0"), ("-b", "1000000")])
def test_what_is_of_a_bus_is_refused_without_one(
    folder: Path, scene_crs: Path, slow_press_csv: Path, crease: Run, words: tuple[str, str]
) -> None:
    out = folder / "no_bus.crr"
    said = crease("hil", scene_crs, "--operator", slow_press_csv, "-o", out, *words)
    assert said.status == 2
    assert said.err.startswith(f"error: {words[0]} is of a bus; give -i socketcan too")
    assert not out.exists()


def test_wrong_bitrate_and_missing_interface_are_told_on_one_line(
    folder: Path, scene_crs: Path, slow_press_csv: Path, crease: Run
) -> None:
    words = ["hil", scene_crs, "--operator", slow_press_csv, "-o", folder / "no.crr"]
    said = crease(*words, "-b", "500000")
    assert said.status == 1
    assert "500000" in said.err
    said = crease(*words, "-i", "socketcan", "-c", "nocan9")
    assert said.status == 1
    assert "nocan9" in said.err
    assert said.err.count("\n") == 1


@pytest.mark.slow
def test_slow_edge_is_quiet_and_without_a_fault(scene_crs: Path, folder: Path) -> None:
    """The ball over the edge of the block at 20 mm/s: stable, no fault, buzz below what a hand feels."""
    around = np.linspace(np.pi / 2, 0.0, 2500)
    radius = 0.0085
    path = write_path(
        folder / "edge.csv",
        np.column_stack([0.04 + radius * np.cos(around), np.zeros(2500), radius * np.sin(around)]),
    )
    result = run_inprocess(open_scene(scene_crs), load_trajectory(path), ffi.NULL or None)
    rows = result.recording.rows
    assert int(rows["counters"]["faults"][-1]) == 0
    along = result.mechanism["tip_acc_m_s2"][result.path_start + 500 :]
    assert buzz_m_s2(along) < 0.05


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("drop:tick=90000,id=0x191", "never came; the drives saw "),
        ("drop:tick=1600,id=0x7f", "never acted; no frame or drive that it is about came in its ticks"),
        ("drop:tick=1600,id=0x191", ""),
    ],
)  # fmt: skip
def test_hil_says_of_a_fault_that_it_never_acted(
    tmp_path: Path, scene_crs: Path, slow_press_csv: Path, crease: Run, fault: str, said: str
) -> None:
    out = crease(
        "hil", scene_crs, "--operator", slow_press_csv, "-o", tmp_path / "a.crr", "--fault", fault
    )
    assert (f"warning: --fault {fault}: {said}" in out.err) == bool(said), out.err


def test_slack_is_of_the_ticks_of_a_loop_that_runs() -> None:
    modes = [lib.CR_MODE_BUS_UP, lib.CR_MODE_CALIBRATING, lib.CR_MODE_RENDERING, lib.CR_MODE_FAULT]
    table = {"mode": np.array(modes), "torque_us": np.array([700.0, 510.0, 520.0, 700.0])}
    assert slack_text(table) == "least slack 480 us"
    assert slack_text({name: column[:1] for name, column in table.items()}) == (
        "no tick with the drives up"
    )


def test_hil_tells_all_faults_the_first_marked(
    tmp_path: Path, scene_crs: Path, slow_press_csv: Path, crease: Run
) -> None:
    words = ["hil", scene_crs, "--operator", slow_press_csv, "-o", tmp_path / "a.crr"]
    faults = ["silent:tick=1600,ticks=50,axis=Y", "drive_error:tick=1700,axis=X,value=0x2310"]
    said = crease(*words, *(word for fault in faults for word in ("--fault", fault)))
    assert said.status == 4
    last = said.out.splitlines()[-1]
    assert last.startswith("faults ")
    assert "silent (first)" in last
    assert "emcy" in last
