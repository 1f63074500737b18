"""The page of `crease view` in a real browser, headless: drawn, moved, dragged, measured."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Page
from crease.base.scene import open_scene
from crease.base.table import read_table, write_table
from crease.replay.contacts import find_areas
from crease.replay.replay import ReplayOptions, run_path, to_columns
from crease.replay.trajectory import check_rows, load_trajectory
from host_tools import Run
from PIL import Image

pytestmark = pytest.mark.slow

BUILD = Path(__file__).resolve().parents[2] / "build"
SCENE, PATH = BUILD / "scenes" / "edge90_sphere.crs", BUILD / "meshes" / "edge90_sphere.csv"
PICTURES = BUILD / "view"
"""Screenshots are kept here, to be looked at."""

STAGE = (10, 150, 710, 530)
"""Part of the window of 1440 x 900 that the left pane draws in, below its text."""

LONG_TICKS = 20_000


def replay_both(folder: Path, ticks: int | None = None) -> list[Path]:
    """Tables of the corner with both responses; over `ticks` rows, with the tremor of a hand."""
    scene, path = open_scene(SCENE), load_trajectory(PATH)
    if ticks is not None:
        rng = np.random.default_rng(1)
        at_s = np.linspace(0.0, path.t_s[-1], ticks)
        rows = np.stack([np.interp(at_s, path.t_s, column) for column in path.rows.T], axis=1)
        rows[:, 0] = 1e-3 * np.arange(ticks)
        window = np.hanning(15) / np.hanning(15).sum()
        noise = rng.normal(0.0, 1e-4, (ticks, 3))
        rows[:, 1:4] += np.stack([np.convolve(n, window, "same") for n in noise.T], axis=1)
        path = check_rows(rows, "long")
    tables = [folder / f"{response}.npz" for response in ("way_out", "fixed45")]
    for table in tables:
        rows = run_path(scene, path, ReplayOptions(response=table.stem))
        write_table(table, to_columns(path, rows))
    return tables


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return replay_both(tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def page_html(tables: list[Path], crease: Run) -> Path:
    PICTURES.mkdir(parents=True, exist_ok=True)
    path = PICTURES / "corner.html"
    said = crease("view", *tables, "--scene", SCENE, "-o", path, "--force")
    assert said.status == 0, said.err
    return path


@pytest.fixture
def page(page_html: Path) -> Iterator[Page]:
    with Page() as tab:
        tab.open(page_html)
        yield tab
        assert tab.complaints == []


def colours_of(picture: Path, box: tuple[int, int, int, int] = STAGE) -> np.ndarray:
    with Image.open(picture) as image:
        return np.asarray(image.convert("RGB").crop(box), dtype=np.int16)


def count_near(pixels: np.ndarray, colour: tuple[int, int, int]) -> int:
    """Pixels of about this hue: dots and arrows are shaded."""
    return int((np.abs(pixels - np.array(colour)).max(axis=2) < 40).sum())


def test_page_draws_obstacle_tool_force_and_zones(page: Page) -> None:
    shown = PICTURES / "corner_1000.png"
    page.seek(1000)
    page.picture(shown)
    pixels = colours_of(shown)
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 300
    assert count_near(pixels, (0, 114, 178)) > 300  # force arrow of the first replay
    assert count_near(pixels, (230, 159, 0)) > 100  # one zone
    assert count_near(pixels, (0, 158, 115)) > 100  # the other
    plots = colours_of(shown, (0, 580, 1440, 880))
    assert count_near(plots, (213, 94, 0)) > 300


def test_page_asks_for_nothing_but_itself(page: Page, page_html: Path) -> None:
    assert page.requests == [page_html.resolve().as_uri()]
    assert page.run("performance.getEntriesByType('resource').length") == 0
    blocked = page.run("fetch('data:text/plain,x').then(() => 'loaded', () => 'refused')")
    assert blocked == "refused"
    page.complaints.clear()  # the browser has noted that


def test_seeking_moves_the_tool_as_the_path_says(page: Page, tables: list[Path]) -> None:
    table, pictures = read_table(tables[0]), []
    for tick in (0, 400, 1500):
        page.seek(tick)
        look = page.run("crease.look(0)")
        place = [table[f"{axis}_m"][tick] for axis in "xyz"]
        assert look["tick"] == tick
        assert look["tool"][12:15] == pytest.approx(place, abs=1e-6)
        assert look["cursor_s"] == pytest.approx(table["t_s"][tick], abs=1e-6)
        pictures.append(PICTURES / f"corner_{tick}.png")
        page.picture(pictures[-1])
    first, second, third = (colours_of(p) for p in pictures)
    assert (np.abs(first - second).max(axis=2) > 20).sum() > 5_000
    assert (np.abs(second - third).max(axis=2) > 20).sum() > 5_000


def test_page_has_the_numbers_of_the_tables(page: Page, tables: list[Path]) -> None:
    for i, path in enumerate(tables):
        table = read_table(path)
        seen = page.run(
            "((r) => [[...r.force_N], [...r.depth_m], [...r.tick_ns]])"
            f"(crease.player.data.replay{i})"
        )
        force_N = np.stack([table[f"f{axis}_N"] for axis in "xyz"], axis=1)
        assert np.abs(np.reshape(seen[0], (-1, 3)) - force_N).max() <= 0.51e-4
        assert np.abs(np.array(seen[1]) - table["depth_m"]).max() <= 0.51e-7
        assert np.array_equal(seen[2], table["tick_ns"])


def test_times_say_of_how_many_runs_they_are_the_least(page: Page) -> None:
    heads = "[...document.querySelectorAll('#plots h2')].map((h) => h.textContent)"
    assert [h for h in page.run(heads) if "tick cost" in h] == [
        "tick cost, usone run"
    ]  # of one each
    for given, said in (
        ("{ runs: 5 }, { runs: 5 }", "least of 5 runs"),
        ("{ runs: 5 }, { runs: 1 }", "least of 5 runs; one run"),
        ("{ runs: null }", "runs not told"),
    ):
        assert page.run(f"timesOf([{given}])") == said


def test_samples_in_contact_are_the_same_from_both_sides(page: Page) -> None:
    def samples(tick: int) -> list[int]:
        page.run(f"crease.seek({tick}); crease.draw()")
        found: list[int] = page.run(
            "[...Object.values(crease.player.stage.samples)[0].now.entries()].filter(([, s]) => s).flat()"
        )
        return found

    there = {tick: samples(tick) for tick in (0, 300, 900, 901, 2029)}
    assert len(there[0]) == 0
    assert len(there[900]) > 100
    assert all(samples(tick) == there[tick] for tick in (901, 0, 2029, 900, 300))


def cursor_gaps(page: Page) -> list[float]:
    """Between the line of the cursor and its dots, pixels, over all plots."""
    gaps: list[float] = page.run(
        """(() => {
          const middle = (e) => { const b = e.getBoundingClientRect(); return b.left + b.width / 2; };
          return crease.player.plots.panels.flatMap(({ box }) => {
            const line = middle(box.querySelector(".u-cursor-x"));
            return [...box.querySelectorAll(".u-cursor-pt")].map((dot) => Math.abs(middle(dot) - line));
          });
        })()"""
    )
    return gaps


def test_the_cursor_and_its_dots_stay_together_when_the_window_narrows(page: Page) -> None:
    page.seek(700)
    settle = "new Promise((done) => setTimeout(() => done(0), 400))"
    for width in (1000, 1440, 700):
        page.resize(width, 900)
        page.run(settle)
        assert len(cursor_gaps(page)) > 10
        assert max(cursor_gaps(page)) < 2.0, width
    page.run("crease.player.plots.zoom(0.3, 0.9)")
    page.run(settle)
    assert max(cursor_gaps(page)) < 2.0


def test_in_a_narrow_window_the_tool_is_not_behind_the_text_nor_cut(page: Page) -> None:
    settle = "new Promise((done) => setTimeout(() => done(0), 400))"
    for width in (500, 1440):
        page.resize(width, 800)
        page.run(settle)
        seen = page.run(
            """crease.player.panes.map(({ pane, told }, i) => {
              const { width, height, shift, drop } = crease.player.stage.panes[i];
              const at = [0.5 * width + shift, 0.5 * height + drop];
              return { at, size: [width, height], told: [told.offsetWidth, told.offsetHeight] };
            })"""
        )
        for one in seen:
            (x, y), (across, down), (right, low) = one["at"], one["size"], one["told"]
            assert x > right or y > low, (width, one)
            assert across - x > 0.2 * across, (width, one)
            assert down - y > 0.2 * down, (width, one)
    page.resize(1440, 900)


def test_the_page_opens_at_a_jump_and_goes_to_the_next(page: Page, tables: list[Path]) -> None:
    zones, fixed45 = (read_table(path) for path in tables)

    def apart_deg(tick: int) -> float:
        a, b = ([t[f"f{axis}_N"][tick] for axis in "xyz"] for t in (zones, fixed45))
        return float(np.degrees(np.arccos(np.dot(a, b) / np.linalg.norm(a) / np.linalg.norm(b))))

    start = page.run("crease.player.frame")
    jumps = page.run("crease.player.jumps")
    assert start in jumps
    assert apart_deg(start) > 40.0
    assert page.run("crease.player.replays[1].turn_deg[crease.player.frame]") > 40.0
    seen = []
    for _ in jumps:
        page.run("document.getElementById('jump').click()")
        seen.append(page.run("crease.player.frame"))
    assert sorted(seen) == jumps
    assert seen[-1] == start
    page.press("J", shift=True)
    assert page.run("crease.player.frame") == seen[-2]
    assert page.run("crease.player.header.replays[0].jumps") == []  # the zones turn it steadily


def test_numbers_of_the_pane_are_those_of_the_tick(page: Page, tables: list[Path]) -> None:
    table = read_table(tables[1])
    tick = page.run("crease.player.frame")
    texts: list[list[str]] = page.run(
        "[...crease.player.panes[1].told.querySelectorAll('tr')].map((r) => [...r.cells].map((c) => c.textContent))"
    )
    told = {row[0]: row[1] for row in texts if len(row) == 2}
    torque = [table[f"t{axis}_Nm"][tick] for axis in "xyz"]
    assert told["torque"] == f"{1e3 * np.linalg.norm(torque):.1f} mN m"
    force_N = np.stack([table[f"f{axis}_N"] for axis in "xyz"], axis=1)
    moved = np.linalg.norm([table[f"{a}_m"][tick] - table[f"{a}_m"][tick - 1] for a in "xyz"])
    step = np.linalg.norm(force_N[tick] - force_N[tick - 1])
    assert float(told["amplification"]) == pytest.approx(step / (1000.0 * moved), rel=0.01)
    points = [row for row in texts if len(row) == 5]
    assert points[0] == ["x, mm", "y", "z", "depth", "N"]
    assert len(points) == 1 + table["areas"][tick]
    assert float(points[1][3]) == pytest.approx(1e3 * table["depth_m"][tick], abs=0.006)
    assert float(points[1][4]) == pytest.approx(np.linalg.norm(force_N[tick]), abs=0.006)
    page.press("l")
    assert page.run("crease.player.panes[1].points.rows.length") == 0


def test_torque_and_path_are_drawn(page: Page) -> None:
    page.seek(700)
    page.run("crease.draw()")
    assert page.run("crease.player.stage.ring.group.visible") is True
    steps, perStep = page.run(
        "((r) => [r.tube.drawRange.count, r.perStep])(crease.player.stage.ring)"
    )
    torque, most = page.run(
        "((s) => [vector(crease.player.replays[1].torque_Nm, 700).length(), s.torque_max_Nm])"
        "(crease.player.stage)"
    )
    assert steps / perStep == pytest.approx(96 * torque / most, abs=0.51)
    before, after = PICTURES / "corner_no_path.png", PICTURES / "corner_path.png"
    page.picture(before)
    page.press("p")
    page.seek(700)
    page.picture(after)
    blue = (0, 114, 178)
    assert count_near(colours_of(after), blue) > count_near(colours_of(before), blue) + 30


def test_legend_names_the_zones_touched_and_no_colour_twice(page: Page) -> None:
    def legend() -> str:
        text: str = page.run("document.getElementById('zones').textContent")
        return text

    page.seek(0)
    assert legend() == "no zone is touched"
    page.seek(1000)
    assert legend().count("zone on patch") == 2
    colours = page.run("Array.from({ length: 60 }, (_, i) => zoneColour(i))")
    assert len(set(colours)) == 60


def test_forces_of_several_areas_are_drawn_each(crease: Run, tmp_path: Path) -> None:
    scene, out, html = BUILD / "scenes/part_spanner.crs", tmp_path / "s.npz", tmp_path / "s.html"
    path = BUILD / "meshes/part_spanner.csv"
    for words in (("replay", scene, path, "-o", out), ("view", out, "--scene", scene, "-o", html)):
        said = crease(*words)
        assert said.status == 0, said.err
    table = read_table(out)
    tick = int(np.argmax(np.asarray(table["areas"])))
    with Page() as tab:
        tab.open(html)
        tab.seek(tick)
        tab.run("crease.draw()")
        shown = tab.run("crease.player.stage.parts.filter((p) => p.group.visible).length")
        areas = find_areas(open_scene(scene), load_trajectory(path), ReplayOptions()).of(tick)
        assert len(areas) == table["areas"][tick]
        packed_N = areas["force_N"].round(3)  # the page's resolution
        assert shown == np.count_nonzero(packed_N.any(axis=1)) > 1
        sums = tab.run(
            "((r, at) => { const sum = new THREE.Vector3(); for (let i = r.area_at[at]; i < r.area_at[at + 1]; i++)"
            f" sum.add(vector(r.area_force_N, i)); return sum.toArray(); }})(crease.player.replays[0], {tick})"
        )
        assert sums == pytest.approx([table[f"f{a}_N"][tick] for a in "xyz"], abs=0.01)
        assert tab.complaints == []


def test_keys_step_and_play(page: Page) -> None:
    assert page.run("crease.player.replays[0].areas[crease.player.frame]") > 0  # opens in contact
    for key, shift, frame in (
        ("Home", False, 0),
        *(("ArrowRight", False, 1), ("ArrowRight", True, 21), ("ArrowLeft", False, 20)),
        *(("End", False, 2029), ("ArrowRight", False, 2029), ("Home", False, 0)),
    ):
        page.press(key, shift)
        assert page.run("crease.player.frame") == frame, key
    page.press(" ")
    moved = page.run("new Promise((done) => setTimeout(() => done(crease.player.frame), 1500))")
    page.press(" ")
    assert 0 < moved < 2029
    assert page.run("crease.player.playing") is False


def test_dragging_on_a_plot_seeks_and_on_the_stage_turns(page: Page) -> None:
    box = page.run(
        "(({left, top, width, height}) => [left, top, width, height])"
        "(crease.player.plots.panels[3].plot.over.getBoundingClientRect())"
    )
    left, top, width, height = box
    page.drag((left + 5, top + height / 2), (left + 0.5 * width, top + height / 2))
    low_s, high_s = page.run(
        "(({min, max}) => [min, max])(crease.player.plots.panels[3].plot.scales.x)"
    )
    middle_s = 0.5 * (low_s + high_s)
    assert page.run("crease.player.plots.time_s") == pytest.approx(middle_s, abs=0.02)
    before = page.run("crease.player.stage.azimuth")
    page.drag((300, 300), (400, 320))
    assert page.run("crease.player.stage.azimuth") == pytest.approx(before - 0.8, abs=1e-6)
    page.mouse("mouseWheel", left + 0.5 * width, top + 20, deltaX=0, deltaY=-400)
    page.run("new Promise((done) => setTimeout(() => done(0), 200))")
    zoomed = page.run(
        "crease.player.plots.panels.map(({plot}) => plot.scales.x.max - plot.scales.x.min)"
    )
    assert max(zoomed) < 0.8 * (high_s - low_s)
    assert max(zoomed) == pytest.approx(min(zoomed))


def test_dark_narrow_and_by_area(page_html: Path) -> None:
    with Page(430, 1400) as tab:
        tab.dark(True)
        tab.open(page_html, "#frame=700")
        assert tab.run("crease.player.frame") == 700
        tab.press("c")
        tab.press("d")
        tab.seek(701)
        tab.picture(PICTURES / "corner_narrow.png")
        background = colours_of(PICTURES / "corner_narrow.png", (0, 0, 430, 8))
        assert background.mean() < 60
        wide = tab.run("document.documentElement.scrollWidth")
        assert wide <= 430
        assert tab.complaints == []


def test_replays_of_different_length_share_the_time(
    tables: list[Path], tmp_path: Path, crease: Run
) -> None:
    short, html = tmp_path / "short.csv", tmp_path / "lengths.html"
    write_table(short, {name: column[:1200] for name, column in read_table(tables[1]).items()})
    said = crease("view", short, tables[0], "--scene", SCENE, "-o", html)
    assert said.status == 0, said.err
    with Page() as tab:
        tab.open(html)
        tab.seek(1800)
        assert [tab.run(f"crease.look({i}).tick") for i in range(2)] == [1199, 1800]
        tab.seek(600)
        assert [tab.run(f"crease.look({i}).tick") for i in range(2)] == [600, 600]
        assert tab.complaints == []


def test_twenty_thousand_ticks_stay_small_and_smooth(tmp_path: Path, crease: Run) -> None:
    html = tmp_path / "long.html"
    said = crease("view", *replay_both(tmp_path, LONG_TICKS), "--scene", SCENE, "-o", html)
    assert said.status == 0, said.err
    assert html.stat().st_size < 8_000_000
    with Page() as tab:
        tab.open(html)
        assert tab.run("crease.frames") == LONG_TICKS
        # The work of a frame but for the drawing, which the graphics processor of a reader does.
        seek_ms, follow_ms = tab.run(
            """(() => {
              const median = (values) => values.sort((a, b) => a - b)[values.length >> 1];
              const time = (work) => { const start = performance.now(); work(); return performance.now() - start; };
              const seeks = [], follows = [], samples = Object.values(crease.player.stage.samples)[0];
              for (let k = 0; k < 200; k++) {
                const frame = (k * 7919) % crease.frames;
                seeks.push(time(() => crease.seek(frame)));
                follows.push(time(() => samples.seek(frame)));
              }
              return [median(seeks), median(follows)];
            })()"""
        )
        print(f"{html.stat().st_size} bytes, seek {seek_ms:.2f} ms, contacts {follow_ms:.2f} ms")
        assert seek_ms + follow_ms < 16.0
        assert tab.complaints == []
