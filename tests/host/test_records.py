"""What C writes into a struct is what NumPy reads there, by name; attitudes are those of the tick."""

from __future__ import annotations

import numpy as np
from crease.base.attitude import to_matrix
from crease.base.native import ffi, lib
from crease.base.records import record
from crease.loop.hil import MECHANISM
from crease.replay.contacts import ZONE
from crease.replay.recording import RECORD, ages_text, contact_ages


def test_members_of_a_recorded_tick_are_where_c_writes_them() -> None:
    c = ffi.new("cr_record[2]")
    tick = c[1]
    tick.tick, tick.now_ns, tick.fresh, tick.tick_ns = 7, 1 << 40, 8, 9
    tick.joints.joint[2], tick.joints.wrist_rad[0] = 1.5, 2.5
    tick.world_from_tool.pos_m.y, tick.world_from_tool.rot.z = 3.5, 4.5
    tick.contact_torque_world_Nm.x, tick.target[1], tick.counts[2] = 5.5, -6, -7
    tick.frames[11].id, tick.frames[11].data[7] = 0x181, 200
    tick.counters.missing[2], tick.counters.wrist_missing, tick.zone_count = 10, 11, 12
    row = np.frombuffer(ffi.buffer(c), RECORD)[1]
    assert (row["tick"], row["now_ns"], row["fresh"], row["tick_ns"]) == (7, 1 << 40, 8, 9)
    assert (row["joint"][2], row["wrist_rad"][0]) == (1.5, 2.5)
    assert (row["position_m"][1], row["quaternion"][3]) == (3.5, 4.5)
    assert (row["contact_torque_Nm"][0], row["target"][1], row["counts"][2]) == (5.5, -6, -7)
    assert (row["frames"]["id"][11], row["frames"]["data"][11, 7]) == (0x181, 200)
    assert (row["counters"]["missing"][2], row["counters"]["wrist_missing"]) == (10, 11)
    assert row["zones"] == 12


def test_sizes_are_those_of_c() -> None:
    assert (ZONE.itemsize, MECHANISM.itemsize) == (40, 144)
    assert RECORD.itemsize == ffi.sizeof("cr_record") == 512


def test_arrays_put_together_keep_the_layout_of_c() -> None:
    """NumPy packs what is not marked as aligned: a tick of 508 bytes is then no record."""
    for kind in (RECORD, ZONE, MECHANISM):
        both = np.concatenate([np.zeros(1, kind), np.zeros(2, kind)])
        assert both.dtype == kind
        assert both.nbytes == 3 * kind.itemsize


def test_a_struct_in_a_struct_keeps_its_members() -> None:
    kind = record("cr_pose")
    assert kind.fields is not None
    assert {name: (t.shape, at) for name, (t, at, *_) in kind.fields.items()} == {
        "pos_m": ((3,), 0),
        "rot": ((4,), 12),
    }


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    half = np.sqrt(0.5)
    one = to_matrix([half, 0.0, 0.0, half])
    np.testing.assert_allclose(one @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)
    many = to_matrix(np.array([[half, 0.0, 0.0, half], [1.0, 0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(many, [one, np.eye(3)], atol=1e-15)


def test_ages_of_contact_are_counts_and_minus_one_where_none_was_asked_for() -> None:
    rows = np.zeros(4, dtype=RECORD)
    rows["contact_late_ticks"] = [lib.CR_NOT_FELT, 0, 3, 5]
    rows["areas"] = [0, 0, 1, 2]
    assert contact_ages(rows).tolist() == [-1, 0, 3, 5]
    assert ages_text(rows) == "found 4.0 ticks before on average, 5 at most"
    rows["contact_late_ticks"] = 0
    assert ages_text(rows) == "of each tick's own pose"
    rows["areas"] = 0
    assert ages_text(rows) == "none"
