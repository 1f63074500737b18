"""`crease view --live`: the loop keeps time, the page gets its views, the mouse is felt, strangers are refused."""

from __future__ import annotations

import http.client
import json
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from browser import Page
from crease.base.errors import CreaseError
from crease.base.native import lib
from crease.base.scene import open_scene
from crease.live.session import HAND_STEP_M, Session
from crease.loop.hil import resample
from crease.replay.trajectory import load_trajectory
from host_tools import Run, write_path
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

BUILD = Path(__file__).resolve().parents[2] / "build"
SCENE = BUILD / "scenes/edge90_sphere.crs"
PICTURES = BUILD / "view"


@dataclass
class Live:
    """A loop that runs as a program of its own."""

    program: subprocess.Popen[str]
    address: str
    told: dict[str, Any] = field(default_factory=dict)

    def end(self, number: int = signal.SIGINT) -> dict[str, Any]:
        """Ctrl-C or another signal, and what it reports."""
        if not self.told:
            self.program.send_signal(number)
            out, err = self.program.communicate(timeout=30)
            assert self.program.returncode == 0, err
            self.told = json.loads(out)
        return self.told

    @property
    def host(self) -> str:
        return urlsplit(self.address).netloc

    @property
    def socket(self) -> str:
        return self.address.replace("http", "ws") + "live"


def start(*words: object) -> Live:
    command = [
        sys.executable,
        "-m",
        "crease",
        "view",
        "--live",
        "--json",
        "--no-open",
        *map(str, words),
    ]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert program.stderr is not None
    line = program.stderr.readline()
    assert line.startswith("live: http://127.0.0.1:"), line
    return Live(program, line.removeprefix("live: ").strip())


@pytest.fixture
def live() -> Iterator[Live]:
    running = start(SCENE)
    yield running
    running.end()


def open_page(tab: Page, address: str) -> None:
    """Until the first view is drawn."""
    tab.ask("Page.navigate", url=address)
    end_s = time.monotonic() + 60.0
    while not tab.run("Boolean(window.crease)"):
        assert time.monotonic() < end_s
        assert tab.complaints == []
        time.sleep(0.05)
    tab.run("crease.ready.then(() => 0)")
    while tab.run("crease.live.drawn") < 2:
        time.sleep(0.05)


def place_of_tool(tab: Page) -> tuple[float, float]:
    x, y = tab.run(
        """(() => {
          const { stage } = crease.live, at = crease.live.at().project(stage.camera);
          const box = stage.canvas.getBoundingClientRect();
          return [box.left + (at.x + 1) / 2 * box.width, box.top + (1 - at.y) / 2 * box.height];
        })()"""
    )
    return x, y


@pytest.mark.slow
def test_the_report_comes_however_the_loop_is_told_to_end() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        running = start(SCENE)
        time.sleep(0.3)
        assert running.end(number)["ticks"] > 50


@pytest.mark.slow
@pytest.mark.quiet
def test_sixty_views_a_second_while_no_tick_is_lost(live: Live) -> None:
    start_s = time.monotonic()
    with Page(800, 700) as tab:
        open_page(tab, live.address)
        tab.run(  # how often the browser would let the page draw, counted beside it
            "crease.beats = 0; (function beat() { crease.beats++; requestAnimationFrame(beat); })()"
        )
        look = "[crease.live.views, crease.live.view.ticks, crease.live.drawn, crease.beats, performance.now()]"
        time.sleep(4.0)  # the page finds its resolution
        first = tab.run(look)
        time.sleep(4.0)
        views, ticks, drawn, beats, ms = (b - a for a, b in zip(first, tab.run(look), strict=True))
        work_ms = tab.run(  # all but the drawing, which the graphics processor of a reader does
            """(() => {
              const { live } = crease, spent = [];
              for (let k = 0; k < 100; k++) {
                const view = structuredClone(live.view), start = performance.now();
                live.takeView(view);
                live.draw(start);
                spent.push(performance.now() - start);
              }
              return spent.sort((a, b) => a - b)[50];
            })()"""
        )
        print(
            f"{1e3 * views / ms:.1f} views/s, {1e3 * drawn / ms:.1f} of them drawn, {1e3 * beats / ms:.1f} frames/s of "
            f"the browser, {1e3 * ticks / ms:.0f} ticks/s, {work_ms:.1f} ms a frame"
        )
        assert views / ms > 0.050
        assert views / ticks > 0.055  # what is late on the way is not the server's
        assert 0 < drawn <= min(views, beats) + 2
        told = tab.run(  # five views come while one is drawn
            """(() => {
              const { live } = crease;
              live.arrivals = [];
              live.drawings = [];
              for (let k = 0; k < 5; k++) live.takeView(structuredClone(live.view));
              live.draw(performance.now());
              return [live.rows.received.textContent, live.rows.drawn.textContent];
            })()"""
        )
        assert told == ["5 views a second", "1 of them"]
        assert work_ms < 16.0
        assert tab.complaints == []
        assert {urlsplit(url).netloc for url in tab.requests} == {live.host}
    lasted_s = time.monotonic() - start_s  # the end itself takes as long as the machine likes
    ended = live.end()
    assert ended["ticks_lost"] == 0
    assert ended["views_sent"] > views
    assert ended["ticks"] == pytest.approx(1e3 * lasted_s, abs=1000)


@pytest.mark.slow
def test_the_mouse_leads_the_tool_and_the_force_is_told(live: Live) -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    with Page(800, 600) as tab:  # drawn without a graphics processor: each pixel costs
        open_page(tab, live.address)
        assert tab.run("find('hint').hidden") is False
        x, y = place_of_tool(tab)
        tab.mouse("mousePressed", x, y, button="left", buttons=1, clickCount=1)
        for step in range(1, 16):
            tab.mouse("mouseMoved", x, y + 10.0 * step, button="left", buttons=1)
            time.sleep(0.03)
        tab.mouse("mouseReleased", x, y + 150.0, button="left", clickCount=1)
        assert tab.run("find('hint').hidden") is True
        end_s = time.monotonic() + 20.0
        while tab.run("crease.live.view.depth_m") < 1e-3:
            assert time.monotonic() < end_s
            time.sleep(0.1)
        time.sleep(1.0)
        view = tab.run("crease.live.view")
        # At once: the tool may move on between two questions.
        told, force_N = tab.run(
            "crease.live.stage.dirty = true; crease.live.draw(performance.now() + 100);"
            " [document.querySelector('#force b').textContent, crease.live.view.force_N]"
        )
        tab.picture(PICTURES / "live.png")
        assert view["force_N"][2] > 1.0
        assert view["contact_N"][2] == pytest.approx(1000.0 * view["depth_m"], rel=0.01)
        assert view["hand_m"][2] < view["position_m"][2] - 1e-3  # the tool stays behind the hand
        assert len(view["areas"]) == 1
        assert len(view["samples"]) > 20
        assert float(told) == pytest.approx(np.linalg.norm(force_N), abs=0.5)
        turned = tab.run("crease.live.stage.azimuth")
        tab.run("find('hint').hidden = false")
        tab.drag((40.0, 350.0), (140.0, 350.0))  # beside the tool
        assert tab.run("find('hint').hidden") is True
        assert tab.run("crease.live.stage.azimuth") == pytest.approx(turned - 0.8, abs=1e-6)
        tab.press("b")
        end_s = time.monotonic() + 20.0
        while tab.run("crease.live.view.depth_m") > 0.0:
            assert time.monotonic() < end_s
            time.sleep(0.1)
        assert tab.complaints == []


@pytest.mark.slow
def test_until_the_first_view_the_page_says_what_it_waits_for_and_how_long(live: Live) -> None:
    with Page(800, 700) as tab:
        tab.ask(  # a loop that never answers
            "Page.addScriptToEvaluateOnNewDocument",
            source="window.WebSocket = class extends EventTarget { static OPEN = 1; };",
        )
        tab.ask("Page.navigate", url=live.address)
        end_s = time.monotonic() + 60.0
        while not tab.run("Boolean(window.crease && crease.live)"):
            assert time.monotonic() < end_s
            time.sleep(0.1)
        said = tab.run("find('state').textContent")
        assert re.fullmatch(
            r"asking the loop for its first view; it runs already: about 1 s, \d+ s so far", said
        )
        tab.run("wait.since_ms -= 20000; wait.tell()")
        assert "is the program that gave this address still there?" in tab.run(
            "find('state').textContent"
        )
        assert tab.complaints == []


def answer(live: Live, path: str, host: str) -> int:
    connection = http.client.HTTPConnection(live.host, timeout=10)
    connection.request("GET", path, headers={"Host": host})
    return connection.getresponse().status


@pytest.mark.slow
def test_only_the_address_answers_and_only_here(live: Live) -> None:
    path = urlsplit(live.address).path
    assert len(path) > 30
    assert answer(live, path, live.host) == 200
    for wrong in (
        "/",
        path[:-2] + "/",
        path + "x",
        "/favicon.ico",
        "/" + "a" * (len(path) - 2) + "/",
    ):
        assert answer(live, wrong, live.host) == 403, wrong
    assert (
        answer(live, path, "crease.example:80") == 403
    )  # a name that somebody made to mean this machine
    port = int(live.host.split(":")[1])
    for other in ("127.0.0.2", socket.gethostbyname(socket.gethostname())):
        if other != "127.0.0.1":
            with pytest.raises(OSError), socket.create_connection((other, port), timeout=2):  # noqa: PT011
                pass
    for origin in (None, Origin("https://example.com")):
        with pytest.raises(InvalidStatus, match="403"):
            connect(live.socket, origin=origin)


@pytest.mark.slow
@pytest.mark.parametrize(
    "said",
    [
        "?",
        "[]",
        '{"hand": [1, 2]}',
        '{"hand": [0, 0, 1e9]}',
        '{"hand": [0, 0, NaN]}',
        '{"foot": 1}',
    ],
)
def test_nonsense_ends_the_talk_and_not_the_loop(said: str, live: Live) -> None:
    origin = Origin(f"http://{live.host}")
    with connect(live.socket, origin=origin) as talk:
        talk.send(said)
        with pytest.raises(ConnectionClosedError, match="1008"):
            list(talk)
    with connect(live.socket, origin=origin) as talk:
        view = json.loads(talk.recv(timeout=10))
        assert view["mode"] == "rendering"
        assert np.isfinite(view["position_m"]).all()


@pytest.mark.slow
def test_views_tell_every_tick_once(live: Live) -> None:
    with connect(live.socket, origin=Origin(f"http://{live.host}")) as talk:
        views = [json.loads(talk.recv(timeout=10)) for _ in range(40)]
    times = np.concatenate([np.reshape(v["trace"], (-1, 4))[:, 0] for v in views[1:]])
    assert np.diff(times) == pytest.approx(1e-3, abs=2e-5)


def test_the_hand_follows_a_path_until_it_is_led() -> None:
    path = resample(load_trajectory(BUILD / "meshes/edge90_sphere.csv"))
    running = Session(open_scene(SCENE), path)
    for _ in range(40):
        running._tick(20)
    assert np.linalg.norm(running._pose[:3] - path.position_m[799]) < 1e-9
    assert running._last.contact_force_N[-1, 2] > 1.0
    running.hand_m(path.position_m[0])
    before = running._pose[:3].copy()
    running._tick(10)
    assert np.linalg.norm(running._pose[:3] - before) == pytest.approx(10 * HAND_STEP_M)
    running.hand_m(None)
    for _ in range(40):
        running._tick(20)
    assert np.linalg.norm(running._pose[:3] - path.position_m, axis=1).min() < 1e-9  # on it again


@pytest.mark.slow
def test_a_fault_switches_the_device_off_and_on_again() -> None:
    running = Session(open_scene(SCENE))
    running.loop.run(np.tile(running._home, (5, 1)))
    lib.cr_servo_input(running.loop._loop.servo.c, int(lib.CR_INPUT_BUS_OFF))
    running.loop.hold(5)
    assert running.loop.faults
    running._restart()
    assert (running.counts.restarts, running.loop.faults, running.loop.mode) == (1, [], "rendering")
    assert running.counts.why


def test_a_machine_that_stood_still_loses_ticks_and_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    running = Session(open_scene(SCENE))
    clock, now = iter([0.0, 0.01, 0.02, 1.02, 1.03]), [0.0]

    def told() -> float:
        now[0] = next(clock, now[0])
        if now[0] == 1.03:
            running._stop.set()
        return now[0]

    monkeypatch.setattr("crease.live.session.time.perf_counter", told)
    running._run()
    assert running.counts.lost == 999
    assert running.counts.ticks == 1.03e3 - 999
    assert running.counts.late_max_ms == pytest.approx(999.0)  # the loss is the worst of all


@pytest.mark.slow
def test_a_place_out_of_reach_is_told_and_the_tool_stays() -> None:
    running = Session(open_scene(SCENE))
    running.hand_m(np.array([0.0, 5.0, 0.0]))
    for _ in range(80):
        running._tick(50)
    assert running.counts.refused > 0
    assert running.loop.mode in ("rendering", "limited")


@pytest.mark.slow
def test_what_cannot_be_live_is_refused(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    far = write_path(folder / "far.csv", np.tile([0.0, 9.0, 0.0], (3, 1)))
    taken = socket.socket()
    taken.bind(("127.0.0.1", 0))
    taken.listen()
    port = taken.getsockname()[1]
    bare = folder / "naked.crs"
    bare.write_bytes(scene_crs.read_bytes())
    for words, reason, status in (
        ((scene_crs, "-o", folder / "live.html"), "a page that is live is served", 2),
        ((scene_crs, press_csv, press_csv), "the hand follows one path", 2),
        ((scene_crs, far), "the device does not reach this pose", 1),
        ((scene_crs, "--port", port), f"port {port}: cannot be had", 1),
        ((bare,), "naked.crs.glb", 1),
        ((press_csv,), "of which scene? give --scene SCENE.crs", 2),
    ):
        said = crease("view", "--live", "--no-open", "--seconds", 1, *words)
        assert (said.status, said.out) == (status, ""), reason
        assert reason in said.err.splitlines()[-1]
        assert said.err.count("error: ") == 1
    taken.close()
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    said = crease("view", "--live", "--no-open", scene_crs)
    assert "pip install websockets" in said.err


def test_a_path_is_shown_before_any_replay(
    folder: Path, scene_crs: Path, press_csv: Path, press_out: Path, crease: Run
) -> None:  # fmt: skip
    page = folder / "before.html"
    said = crease("view", scene_crs, press_csv, press_out, "-o", page, "--json")
    assert said.status == 0, said.err
    assert said.json["replays"] == 2
    header = json.loads(page.read_text("utf-8").split('id="header">')[1].split("</script>")[0])
    assert [r["preview"] for r in header["replays"]] == [True, False]
    assert header["replays"][0]["settings"] == "way_out, 1000 N/m"
    for words, reason in (
        ((scene_crs,), "-o PAGE.html"),
        ((scene_crs, "-o", folder / "x.html"), "give a path or a table"),
    ):
        refused = crease("view", *words)
        assert refused.status == 2
        assert reason in refused.err


@pytest.mark.slow
def test_a_path_before_any_replay_says_so_and_is_drawn(
    folder: Path, scene_crs: Path, press_csv: Path, crease: Run
) -> None:  # fmt: skip
    page = folder / "path.html"
    assert crease("view", scene_crs, press_csv, "-o", page).status == 0
    with Page() as tab:
        tab.open(page)
        told = tab.run("crease.player.panes[0].told.textContent")
        assert "not replayed yet: way_out, 1000 N/m" in told
        assert tab.run("crease.player.stage.withTrack") is True
        touching = tab.run("crease.player.replays[0].areas.reduce((a, b) => a + (b > 0), 0)")
        assert touching > 200
        tab.picture(PICTURES / "path.png")
        assert tab.complaints == []


def test_nothing_of_the_session_outlives_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    running = Session(open_scene(SCENE))

    def broken(_count: int) -> None:
        raise CreaseError("broken")

    monkeypatch.setattr(running, "_tick", broken)
    running.start()
    running._thread.join(10)
    with pytest.raises(CreaseError, match="broken"):
        running.stop()
