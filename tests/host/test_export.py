"""`crease export`: what the readers of others find in the files, in their own, unmodified code."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crease.base.table import read_table
from crease.replay.cdr import MESSAGES, Message, definition
from crease.replay.recording import load_recording, mode_names, to_columns
from host_tools import Run
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pyarrow import parquet

Decoded = dict[str, list[Any]]


def decode(path: Path) -> Decoded:
    """Topic -> (time in ns, message) of each message, in order; by the readers of mcap and mcap-ros2-support."""
    found: Decoded = {}
    with path.open("rb") as file:
        for _schema, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def numbers(of: Any, names: str = "x y z") -> list[float]:
    return [getattr(of, name) for name in names.split()]


POSED = {"/tf", "/tool/pose"}


def check_poses(found: Decoded, rows: Any) -> list[int]:
    """Every rotation is one, and there is one for every known pose.   Output: the rows with a known pose."""
    turns = [t.transform.rotation for _, m in found["/tf"] for t in m.transforms]
    turns += [m.pose.orientation for _, m in found["/tool/pose"]]
    lengths = np.linalg.norm([numbers(turn, "x y z w") for turn in turns], axis=1)
    assert np.abs(lengths - 1.0).max() < 1e-5
    known = np.flatnonzero(rows["quaternion"].any(axis=1))
    times = (rows["sync_ns"] - rows["sync_ns"][0])[known].tolist()
    for topic in POSED:
        assert [at for at, _ in found[topic]] == times
    return known.tolist()


@pytest.fixture(scope="module")
def run_crr(folder: Path, scene_crs: Path, press_csv: Path, crease: Run) -> Path:
    """A recording of the closed loop along the press."""
    path = folder / "export_run.crr"
    said = crease("hil", scene_crs, "--operator", press_csv, "-o", path)
    assert said.status == 0, said.err
    return path


def test_a_table_is_read_back_from_mcap(press_out: Path, tmp_path: Path, crease: Run) -> None:
    out = tmp_path / "run.mcap"
    said = crease("export", press_out, "--to", "mcap", "-o", out, "--json")
    assert said.status == 0, said.err
    columns, found = read_table(press_out), decode(out)
    assert said.json == {
        "output": str(out),
        "ticks": len(columns["t_s"]),
        "bytes": out.stat().st_size,
        "warnings": [],
    }
    assert set(found) == {
        "/tf",
        "/tool/pose",
        "/tool/display_pose",
        "/contact/wrench",
        "/contact/state",
    }
    assert {len(messages) for messages in found.values()} == {len(columns["t_s"])}
    for i in range(0, len(columns["t_s"]), 7):
        row = {name: float(column[i]) for name, column in columns.items()}
        time_ns, pose = found["/tool/pose"][i]
        assert (
            time_ns
            == round(1e9 * row["t_s"])
            == pose.header.stamp.sec * 10**9 + pose.header.stamp.nanosec
        )
        assert pose.header.frame_id == "world"
        assert numbers(pose.pose.position) == [row[n] for n in ("x_m", "y_m", "z_m")]
        assert numbers(pose.pose.orientation, "x y z w") == [
            row[n] for n in ("qx", "qy", "qz", "qw")
        ]
        wrench = found["/contact/wrench"][i][1]
        assert wrench.header.frame_id == "tool_origin"
        assert numbers(wrench.wrench.force) == [row[n] for n in ("fx_N", "fy_N", "fz_N")]
        assert numbers(wrench.wrench.torque) == [row[n] for n in ("tx_Nm", "ty_Nm", "tz_Nm")]
        state = found["/contact/state"][i][1]
        assert numbers(state, "depth_m areas zones contacts tick_ns") == [
            row[n] for n in ("depth_m", "areas", "zones", "contacts", "tick_ns")
        ]
        assert numbers(state.normal) == [row[n] for n in ("nx", "ny", "nz")]
        tool, origin = found["/tf"][i][1].transforms
        assert [t.child_frame_id for t in (tool, origin)] == ["tool", "tool_origin"]
        assert numbers(tool.transform.translation) == numbers(pose.pose.position)
        assert numbers(origin.transform.rotation, "x y z w") == [0.0, 0.0, 0.0, 1.0]
    assert max(m.wrench.force.z for _, m in found["/contact/wrench"]) > 1.0


def schemas(path: Path) -> dict[int, tuple[str, bytes]]:
    """Id -> name and definition of the schemas of a file."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return {one.id: (one.name, one.data) for one in summary.schemas.values()}


@pytest.mark.slow
def test_a_schema_has_one_id_in_every_file(
    press_out: Path, run_crr: Path, scene_crs: Path, press_csv: Path, tmp_path: Path, crease: Run
) -> None:
    files = [tmp_path / f"{name}.mcap" for name in ("table", "recording", "replay", "hil")]
    for words in (
        ("export", press_out, "--to", "mcap", "-o", files[0]),
        ("export", run_crr, "--to", "mcap", "-o", files[1]),
        ("replay", scene_crs, press_csv, "-o", files[2]),
        ("hil", scene_crs, "--operator", press_csv, "-o", files[3]),
    ):
        assert crease(*words).status == 0
    first = schemas(files[0])
    assert [first[i + 1][0] for i in range(len(first))] == list(MESSAGES)
    assert all(schemas(file) == first for file in files[1:])


def test_a_recording_is_read_back_from_mcap(run_crr: Path, crease: Run) -> None:
    said = crease("export", run_crr, "--to", "mcap")
    assert said.status == 0, said.err
    found, rows = decode(run_crr.with_suffix(".mcap")), load_recording(run_crr).rows
    assert set(found) == {
        "/tf",
        "/tool/pose",
        "/contact/wrench",
        "/device/force",
        "/device/joints",
        "/device/servo",
    }
    known = check_poses(found, rows)
    assert len(known) < len(rows)  # before the calibration there is no pose
    assert {len(found[topic]) for topic in set(found) - POSED} == {len(rows)}
    for i in range(0, len(rows), 5):
        row = rows[i]
        assert found["/device/servo"][i][0] == int(row["sync_ns"] - rows["sync_ns"][0])
        wrench = found["/contact/wrench"][i][1].wrench
        assert numbers(wrench.force) == row["contact_force_N"].astype(float).tolist()
        assert numbers(wrench.torque) == row["contact_torque_Nm"].astype(float).tolist()
        assert numbers(found["/device/force"][i][1].vector) == row["force_N"].astype(float).tolist()
        joints, servo = found["/device/joints"][i][1], found["/device/servo"][i][1]
        assert list(joints.name) == ["guide", "upper_arm", "forearm"]
        assert list(joints.position) == row["joint"].astype(float).tolist()
        assert list(joints.effort) == row["torque"].astype(float).tolist()
        assert list(joints.velocity) == []
        assert servo.mode == mode_names()[int(row["mode"])]
        assert (servo.depth_m, servo.areas, servo.tick_ns) == (
            row["depth_m"],
            row["areas"],
            row["tick_ns"],
        )
    for at, (_, pose) in zip(known, found["/tool/pose"], strict=True):
        orientation = numbers(pose.pose.orientation, "w x y z")
        assert orientation == rows[at]["quaternion"].astype(float).tolist()
    assert max(m.depth_m for _, m in found["/device/servo"]) > 0.5e-3


@pytest.mark.parametrize("kind", ["csv", "npz", "parquet"])
def test_a_recording_becomes_a_table(kind: str, run_crr: Path, tmp_path: Path, crease: Run) -> None:
    out = tmp_path / f"run.{kind}"
    said = crease("export", run_crr, "--to", kind, "-o", out)
    assert said.status == 0, said.err
    table = parquet.read_table(out).to_pydict() if kind == "parquet" else read_table(out)
    known = to_columns(load_recording(run_crr).rows)
    assert list(table) == list(known)
    assert all(
        np.array_equal(np.asarray(table[name], column.dtype), column)
        for name, column in known.items()
    )


def test_texts_of_any_length_and_many_of_them_are_aligned() -> None:
    from mcap_ros2._dynamic import generate_dynamic

    name = "crease_msgs/msg/ServoState"
    decoder = generate_dynamic(name, definition(name))[name]
    for length in range(9):
        faults = ["x" * n for n in range(length)]
        message = (
            Message()
            .header(-1_500_000_000, "f" * length)
            .string("m" * length)
            .strings(faults)
            .strings(())
        )
        got = decoder(message.float64((1.5, -2.5, 3.5)).uint32(1, 2, 4_000_000_000).done())
        assert (got.header.stamp.sec, got.header.stamp.nanosec) == (-2, 500_000_000)
        assert (got.header.frame_id, got.mode, list(got.faults)) == (
            "f" * length,
            "m" * length,
            faults,
        )
        assert numbers(got, "energy_joules margin depth_m areas tick_ns") == [
            1.5,
            -2.5,
            3.5,
            1,
            4_000_000_000,
        ]


@pytest.mark.parametrize(
    ("text", "words", "reason"),
    [
        (None, ("--to", "mcap"), "there is no such file"),
        ("t_s,a\n0,1\n", ("--to", "mcap"), "has neither poses nor forces"),
        ("a,b\n0,1\n", ("--to", "npz"), "has no column t_s"),
        ("t_s,a\n0,1\n", ("--to", "csv"), "is an input"),
        ("t_s,a\n0,1\n", ("--to", "npz", "-o", "out.csv"), "the suffix is not one of .npz"),
    ],
)
def test_what_cannot_be_exported_is_refused(
    text: str | None, words: tuple[str, ...], reason: str, tmp_path: Path, crease: Run, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    if text is not None:
        (tmp_path / "in.csv").write_text(text, encoding="ascii")
    said = crease("export", "in.csv", *words)
    assert (said.status, said.out) == (1, "")
    assert said.err.startswith("error: ")
    assert reason in said.err
    assert said.err.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == (["in.csv"] if text is not None else [])


def test_the_suffix_of_the_output_says_the_format(
    press_out: Path, tmp_path: Path, crease: Run
) -> None:
    for name in ("a.npz", "b.CSV"):
        assert crease("export", press_out, "-o", tmp_path / name).status == 0
    assert crease("export", press_out, "--to", "npz", "-o", tmp_path / "c.npz").status == 0
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "c.npz").read_bytes()
    assert (tmp_path / "b.CSV").read_text("utf-8").startswith("t_s,")
    said = crease("export", press_out, "-o", tmp_path / "d.xls")
    assert (said.status, "is not one of .mcap, .csv, .npz, .parquet" in said.err) == (1, True)
    said = crease("export", press_out)
    assert (said.status, said.err) == (
        2,
        "error: export to what? give -o OUT with its suffix, or --to; see `crease export --help`\n",
    )


def test_another_kind_of_file_is_told_the_kinds_it_takes(tmp_path: Path, crease: Run) -> None:
    other = tmp_path / "passwd"
    other.write_text("root", encoding="ascii")
    said = crease("export", other, "--to", "csv")
    assert (said.status, said.out) == (1, "")
    assert "is no recording (.crr) and no table (.csv, .npz)" in said.err
    assert list(tmp_path.iterdir()) == [other]


@pytest.mark.parametrize(("kind", "package"), [("mcap", "mcap.writer"), ("parquet", "pyarrow")])
def test_a_package_that_is_missing_is_named(
    kind: str, package: str, press_out: Path, tmp_path: Path, crease: Run, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    monkeypatch.setitem(sys.modules, package, None)
    said = crease("export", press_out, "--to", kind, "-o", tmp_path / f"out.{kind}")
    assert said.status == 1
    assert f"pip install {package.partition('.')[0]}" in said.err
    assert list(tmp_path.iterdir()) == []


def fields(message: Any) -> dict[str, np.ndarray[Any, Any]]:
    """Columns of a PointCloud2, read as its own fields say."""
    kinds = {7: "<f4", 6: "<u4", 5: "<i4"}
    kind = np.dtype(
        {
            "names": [f.name for f in message.fields],
            "formats": [kinds[f.datatype] for f in message.fields],
            "offsets": [f.offset for f in message.fields],
            "itemsize": message.point_step,
        }
    )
    assert (message.height, message.row_step, len(message.data)) == (
        1,
        message.width * message.point_step,
        message.width * message.point_step,
    )
    assert (message.is_bigendian, message.is_dense) == (False, True)
    rows = np.frombuffer(bytes(message.data), kind)
    return {name: rows[name] for name in kind.names or ()}


def check_clouds(found: Decoded, scene_crs: Path) -> int:
    """The forces of the areas make the wrench, the points are inside.   Output: ticks in contact."""
    touching = 0
    for i, (_, message) in enumerate(found["/contact/areas"]):
        areas, points = fields(message), fields(found["/contact/points"][i][1])
        force = numbers(found["/contact/wrench"][i][1].wrench.force)
        assert message.header.frame_id == "world"
        total = [float(areas[n].sum(dtype=np.float64)) for n in ("fx", "fy", "fz")]
        assert total == pytest.approx(force, abs=1e-5)
        touching += len(areas["x"]) > 0
        if len(areas["x"]):
            assert len(points["x"]) > 0
            assert (
                points["z"].max() < 1.5e-3
            )  # the top of the block is z = 0; a soft sample has a size
            assert set(points["area"]) == {1}
            assert (points["patch"] >= 0).any()
            middle = np.array([points[n].mean() for n in "xyz"])
            assert np.array([areas[n][0] for n in "xyz"]) == pytest.approx(middle, abs=2e-3)
    return touching


def test_a_replay_writes_mcap_itself(
    scene_crs: Path, press_csv: Path, press_out: Path, tmp_path: Path, crease: Run
) -> None:
    out = tmp_path / "run.mcap"
    said = crease("replay", scene_crs, press_csv, "-o", out)
    assert said.status == 0, said.err
    found, columns = decode(out), read_table(press_out)
    own = {"/contact/points", "/contact/areas"}
    assert set(found) == own | {
        "/tf",
        "/tool/pose",
        "/tool/display_pose",
        "/contact/wrench",
        "/contact/state",
    }
    assert {len(messages) for messages in found.values()} == {len(columns["t_s"])}
    assert check_clouds(found, scene_crs) == int((columns["areas"] > 0).sum())
    widths = [message.width for _, message in found["/contact/points"]]
    assert (
        np.array(widths) >= columns["contacts"]
    ).all()  # soft: those near the surface count in part
    assert max(widths) < 2 * columns["contacts"].max()
    forces = [message.wrench.force.z for _, message in found["/contact/wrench"]]
    assert forces == pytest.approx(columns["fz_N"].tolist(), rel=1e-6)


@pytest.mark.slow
def test_a_loop_writes_mcap_itself_and_export_the_same(
    scene_crs: Path, press_csv: Path, run_crr: Path, tmp_path: Path, crease: Run
) -> None:
    direct, later = tmp_path / "run.mcap", tmp_path / "later.mcap"
    said = crease("hil", scene_crs, "--operator", press_csv, "-o", direct)
    assert said.status == 0, said.err
    said = crease("export", run_crr, "--to", "mcap", "--scene", scene_crs, "-o", later)
    assert said.status == 0, said.err
    assert direct.read_bytes() == later.read_bytes()
    again = tmp_path / "again.mcap"
    assert crease("replay", scene_crs, run_crr, "-o", again).status == 0
    assert again.read_bytes() == later.read_bytes()
    found, rows = decode(direct), load_recording(run_crr).rows
    check_poses(found, rows)
    assert {len(found[topic]) for topic in set(found) - POSED} == {len(rows)}
    assert {"/device/servo", "/device/joints", "/device/force"} <= set(found)
    assert check_clouds(found, scene_crs) == int((rows["areas"] > 0).sum()) > 100


def test_contact_points_need_the_right_scene(
    run_crr: Path, press_out: Path, scene_crs: Path, block_stl: Path, tmp_path: Path, crease: Run
) -> None:
    other = tmp_path / "other.crs"
    said = crease("bake", block_stl, block_stl, "-o", other, "--unit", "mm", "--spacing", "9mm")
    assert said.status == 0, said.err
    out = tmp_path / "x.mcap"
    for words, reason in (
        ((run_crr, "--scene", other), "is not the scene that"),
        ((press_out, "--scene", scene_crs), "crease replay -o OUT.mcap"),
    ):
        said = crease("export", *words, "--to", "mcap", "-o", out)
        assert said.status == 1
        assert reason in said.err
        assert not out.exists()
