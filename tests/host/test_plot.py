"""Figures: files that are whole, panels that hold the numbers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from crease.base.table import read_table
from crease.draw.corner import CornerCase, draw_corner, section_xz
from crease.draw.plot import Table, draw_ticks, forces_N, plain, save_figure, torques_Nm, turn_deg
from crease.mesh.mesh import load_mesh
from host_tools import Run
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

STARTS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(STARTS))
def test_figure_is_written_in_every_format(
    folder: Path, press_out: Path, crease: Run, kind: str
) -> None:
    figure = folder / f"figure.{kind}"
    said = crease("plot", press_out, "-o", figure, "--title", "press")
    assert (said.status, said.out) == (0, f"{figure}\n")
    assert figure.read_bytes().startswith(STARTS[kind])
    assert figure.stat().st_size > 5_000


@pytest.mark.slow
def test_png_has_many_colours(folder: Path, press_out: Path, crease: Run) -> None:
    figure = folder / "many.png"
    crease("plot", press_out, "-o", figure)
    with Image.open(figure) as image:
        assert min(image.size) > 800
        assert len(image.convert("RGB").getcolors(1 << 24) or []) > 50


@pytest.mark.slow
def test_several_tables_share_a_figure_with_their_names(
    folder: Path, press_out: Path, crease: Run
) -> None:
    other = folder / "other_out.csv"
    other.write_bytes(press_out.read_bytes())
    figure = folder / "two.svg"
    assert crease("plot", press_out, other, "-o", figure).status == 0
    drawn = draw_ticks([read_table(press_out), read_table(other)], ["press_out", "other_out"])
    legend = drawn.axes[0].get_legend()
    assert legend is not None
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["press_out", "other_out"]


def test_a_name_that_is_no_utf8_is_drawn_with_a_mark(
    folder: Path, press_out: Path, crease: Run
) -> None:
    other = folder / "pr\udcffss.csv"
    other.write_bytes(press_out.read_bytes())
    figure = folder / "mark.svg"
    assert crease("plot", other, "-o", figure, "--title", "a \udcc3\udcb6").status == 0
    assert plain("a \udcc3\udcb6 $") == "a \u00f6 \\$"
    assert plain("pr\udcffss") == "pr\ufffdss"


def test_panels_hold_the_numbers_of_the_table(press_out: Path) -> None:
    table = read_table(press_out)
    axes = draw_ticks([table], ["press"]).axes
    assert len(axes) == 8
    torque_Nm = np.linalg.norm(torques_Nm(table), axis=1)
    assert torque_Nm.any()
    assert np.array_equal(axes[0].lines[0].get_ydata(), np.linalg.norm(forces_N(table), axis=1))
    for panel, force_N in zip(axes[1:4], forces_N(table).T, strict=True):
        assert np.array_equal(panel.lines[0].get_ydata(), force_N)
    assert np.array_equal(axes[4].lines[0].get_ydata(), torque_Nm)
    assert np.array_equal(axes[5].lines[0].get_ydata(), 1e3 * table["depth_m"])
    assert np.array_equal(axes[7].lines[0].get_ydata(), 1e-3 * table["tick_ns"])


def test_of_several_tables_each_component_has_a_panel_to_one_scale(press_out: Path) -> None:
    table = read_table(press_out)
    pushed = {**table, "fx_N": table["fz_N"] + 3.0}
    axes = draw_ticks([table, pushed], ["one", "two"]).axes
    assert [panel.get_ylabel() for panel in axes[:4]] == ["|F|, N", "Fx, N", "Fy, N", "Fz, N"]
    for panel, name in zip(axes[1:4], "xyz", strict=True):
        drawn = [np.asarray(line.get_ydata()) for line in panel.lines]
        assert np.array_equal(drawn, [table[f"f{name}_N"], pushed[f"f{name}_N"]])
        assert panel.get_ylim() == axes[1].get_ylim()
    low, high = axes[1].get_ylim()
    assert low < 0.0
    assert high > pushed["fx_N"].max()


def test_rounding_does_not_fill_a_panel(press_out: Path) -> None:
    noise = 1e-9 * np.random.default_rng(1).random(len(read_table(press_out)["t_s"]))
    table = {**read_table(press_out), "depth_m": noise}
    table |= {f"f{axis}_N": noise for axis in "xyz"} | {f"t{axis}_Nm": noise for axis in "xyz"}
    table["fz_N"] = 2.0 + noise
    for tables in ([table], [table, table]):
        for panel in draw_ticks(tables, ["a", "b"][: len(tables)]).axes[:-1]:
            low, high = panel.get_ylim()
            for line in panel.lines:
                drawn = np.asarray(line.get_ydata(), dtype=np.float64)
                assert np.nanmin(drawn) >= low
                assert np.nanmax(drawn) <= high
                assert np.nanmax(drawn) - np.nanmin(drawn) < 1e-3 * (high - low)


def test_turns_that_span_decades_have_an_axis_of_decades(press_out: Path) -> None:
    smooth = read_table(press_out)
    at = np.arange(len(smooth["t_s"]))
    slow = np.radians(0.02 * at)
    smooth |= {"fx_N": np.sin(slow), "fy_N": 0.0 * slow, "fz_N": np.cos(slow)}
    turned = slow + np.radians(45.0) * (at > 100)
    jump = {**smooth, "fx_N": np.sin(turned), "fz_N": np.cos(turned)}
    for table, scale in ((smooth, "linear"), (jump, "log")):
        (panel,) = (p for p in draw_ticks([table], ["a"]).axes if "deg" in p.get_ylabel())
        assert panel.get_yscale() == scale
        low, high = panel.get_ylim()
        assert low < 0.02 < np.nanmax(turn_deg(forces_N(table))) < high


@pytest.mark.parametrize("largest_deg", [9.5, 12.0, 17.9, 18.5, 60.0])
@pytest.mark.parametrize("usual_deg", [0.01, 8.0])
def test_the_word_noticeable_stands_inside_the_panel_with_its_line(
    largest_deg: float, usual_deg: float, press_out: Path
) -> None:
    table = dict(read_table(press_out))
    count = len(table["t_s"])
    angle = np.radians(np.cumsum(np.r_[largest_deg - usual_deg, np.full(count - 1, usual_deg)]))
    angle -= angle[0] * (np.arange(count) == 0)
    table |= {"fx_N": np.cos(angle), "fy_N": np.sin(angle), "fz_N": np.zeros(count)}
    figure = draw_ticks([table], ["turns"])
    figure.canvas.draw()
    axes = next(axes for axes in figure.axes if "direction" in axes.get_ylabel())
    (word,) = axes.texts
    assert word.get_text() == "noticeable"
    inside, box = axes.get_window_extent(), word.get_window_extent()
    assert inside.y0 <= box.y0
    assert box.y1 <= inside.y1
    low, high = axes.get_ylim()
    assert low < 18.0 < high


def test_table_without_torque_has_no_panel_for_it(press_out: Path) -> None:
    table = {k: v for k, v in read_table(press_out).items() if not k.endswith("_Nm")}
    assert "torque" not in " ".join(axes.get_ylabel() for axes in draw_ticks([table], ["a"]).axes)


@pytest.mark.slow
def test_same_table_gives_the_same_svg(folder: Path, press_out: Path, crease: Run) -> None:
    one, two = folder / "one.svg", folder / "two_same.svg"
    for figure in (one, two):
        crease("plot", press_out, "-o", figure, "--title", "same")
    assert one.read_bytes() == two.read_bytes()


@pytest.mark.parametrize("name", ["$x^{$", "a$b", "力 覚"])
def test_names_and_titles_are_drawn_as_they_stand_and_nothing_is_said(
    tmp_path: Path, press_out: Path, crease: Run, recwarn: pytest.WarningsRecorder, name: str
) -> None:
    table, other = tmp_path / f"{name}.csv", tmp_path / "other.csv"
    for path in (table, other):
        path.write_bytes(press_out.read_bytes())
    for tables, more in (([table], []), ([table, other], ["--title", name])):
        said = crease("plot", *tables, "-o", tmp_path / "out.png", "--force", *more)
        assert (said.status, said.err) == (0, "")
    assert not recwarn.list


def test_a_home_that_cannot_be_written_is_not_spoken_of(folder: Path, press_out: Path) -> None:
    kept = {k: v for k, v in os.environ.items() if k not in ("MPLCONFIGDIR", "XDG_CONFIG_HOME")}
    words = (sys.executable, "-m", "crease", "plot", press_out, "-o", folder / "homeless.png")
    said = subprocess.run(
        words, env={**kept, "HOME": "/proc/none"}, capture_output=True, text=True, check=False
    )
    assert (said.returncode, said.stderr) == (0, "")


def test_one_row_is_seen(press_out: Path) -> None:
    table = read_table(press_out)
    one = {name: column[300:301] for name, column in table.items()}
    for axes in draw_ticks([one], ["one"]).axes:
        assert {line.get_marker() for line in axes.lines} == {"o"}
    assert {line.get_marker() for line in draw_ticks([table], ["all"]).axes[0].lines} == {"None"}


def test_depth_of_a_held_tool_is_named_as_what_it_is(press_out: Path) -> None:
    free = read_table(press_out)
    held = {**free, "couple_N_m": np.full(len(free["t_s"]), 1000.0)}

    def label(*tables: Table) -> str:
        axes = draw_ticks(tables, [str(i) for i in range(len(tables))]).axes
        return axes[5].get_ylabel()

    assert label(free) == "depth, mm"
    assert label(held) == label(held, held) == "hand from the\nheld tool, mm"
    assert label(held, free) == "depth, or hand from\nthe held tool, mm"


def test_table_of_another_kind_is_refused(folder: Path, press_csv: Path, crease: Run) -> None:
    said = crease("plot", press_csv, "-o", folder / "no.png")
    assert said.status == 1
    assert "no column fx_N" in said.err
    assert not (folder / "no.png").exists()


def test_too_many_tables_are_refused(folder: Path, press_out: Path, crease: Run) -> None:
    said = crease("plot", *[press_out] * 9, "-o", folder / "no.png")
    assert (said.status, said.err.count("\n")) == (2, 1)


@given(st.floats(0.0, 179.0), st.floats(0.01, 100.0))
def test_turn_is_the_angle_between_neighbours(angle_deg: float, force_N: float) -> None:
    angle = np.radians(angle_deg)
    forces = force_N * np.array(
        [[0.0, 0.0, 1.0], [np.sin(angle), 0.0, np.cos(angle)], [0.0, 0.0, 0.0]]
    )
    turn = turn_deg(forces)
    assert turn[1] == pytest.approx(angle_deg, abs=1e-6)
    assert np.isnan(turn[[0, 2]]).all()


def test_section_of_a_block_is_its_rectangle(block_stl: Path) -> None:
    (outline,) = section_xz(load_mesh(block_stl, 1e-3), 0.01)
    assert outline.min(axis=0) == pytest.approx([-0.04, -0.04])
    assert outline.max(axis=0) == pytest.approx([0.04, 0.0])


def test_corner_figure_draws_a_panel_for_each_case(
    folder: Path, block_stl: Path, press_out: Path
) -> None:
    table = read_table(press_out)
    position_m = np.stack([table["dx_m"], table["dy_m"], table["dz_m"]], axis=1)
    cases = [CornerCase(name, position_m, forces_N(table)) for name in ("one", "two")]
    figure = draw_corner(cases, section_xz(load_mesh(block_stl, 1e-3)), 0.01)
    assert [axes.get_title() for axes in figure.axes] == ["one", "two", ""]
    with (folder / "corner.png").open("wb") as file:
        save_figure(figure, file, "png")
    assert (folder / "corner.png").stat().st_size > 20_000
