"""The pictures of the page, of the live page, and of what others find in run.mcap.

    python tests/bench/page_pictures.py [-o FOLDER] [--only NAME]      # make pictures: beside the texts that show them

The pages are drawn by a headless Chromium; the content of run.mcap is read by the package mcap and its ROS 2 decoder.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from bench import MESHES, ROOT, SCENES
from browser import Page
from crease.draw.plot import COLOURS, STYLE, new_figure, save_figure
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

SCENE = SCENES / "edge90_cube.crs"
PATH = MESHES / "edge90_cube.csv"
AXIS_COLOURS = ("#D55E00", "#009E73", "#0072B2")


def crease(*words: object) -> None:
    """The command."""
    subprocess.run(
        [sys.executable, "-m", "crease", *map(str, words)], check=True, stdout=subprocess.DEVNULL
    )


def draw_page(out: Path, folder: Path) -> None:
    """Two replays side by side, as the page opens."""
    tables = [folder / f"{response}.csv" for response in ("way_out", "fixed45")]
    for table in tables:
        crease("replay", SCENE, PATH, "-o", table, "--response", table.stem)
    crease("view", *tables, "--scene", SCENE, "-o", folder / "page.html")
    with Page(1200, 800) as tab:
        tab.open(folder / "page.html")
        tab.seek(tab.run("crease.player.frame"))
        tab.picture(out)


def draw_live(out: Path, _folder: Path) -> None:
    """The ball pressed onto the edge by a mouse."""
    words = [
        "view",
        "--live",
        "--no-open",
        "--title",
        "drag the ball",
        str(SCENES / "edge90_sphere.crs"),
    ]
    program = subprocess.Popen(
        [sys.executable, "-m", "crease", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert program.stderr is not None
    try:
        address = program.stderr.readline().removeprefix("live: ").strip()
        with Page(1100, 760) as tab:
            tab.ask("Page.navigate", url=address)
            while not tab.run("Boolean(window.crease && crease.live && crease.live.drawn > 1)"):
                time.sleep(0.1)
            place: list[float] = tab.run("crease.live.view.position_m")
            for hand in ([place[0] + 0.06, place[1], place[2]], [0.028, place[1], 0.018]):
                tab.run(f"crease.live.say({hand})")
                time.sleep(1.5)
            tab.run("crease.live.stage.sharpness = 1; crease.live.keepUp = () => {}; 0")
            time.sleep(2.0)
            tab.picture(out)
    finally:
        program.send_signal(2)
        program.communicate()


def decode(path: Path) -> dict[str, list[tuple[float, Any]]]:
    """Topic -> (s, message) of each message."""
    found: dict[str, list[tuple[float, Any]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((1e-9 * message.log_time, decoded))
    return found


def draw_mcap(out: Path, folder: Path) -> None:
    """Wrench, mode, contact points and areas of a run of the loop, from the messages alone."""
    crease("hil", SCENE, "--operator", PATH, "-o", folder / "run.mcap")
    found = decode(folder / "run.mcap")
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 5.0)
        grid = figure.add_gridspec(2, 2, width_ratios=[1.5, 1.0])
        left = [figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])]
        right = figure.add_subplot(grid[:, 1])
        wrench = found["/contact/wrench"]
        t_s = [t for t, _ in wrench]
        for k, axis in enumerate("xyz"):
            values = [getattr(m.wrench.force, axis) for _, m in wrench]
            left[0].plot(t_s, values, color=AXIS_COLOURS[k], label=f"force.{axis}")
        left[0].set(title="/contact/wrench", ylabel="N")
        left[0].legend()
        servo = found["/device/servo"]
        names = list(dict.fromkeys(m.mode for _, m in servo))
        left[1].step(t_s, [names.index(m.mode) for _, m in servo], color=COLOURS[7], where="post")
        left[1].set_yticks(range(len(names)), names)
        left[1].set(title="/device/servo mode", xlabel="log time, s")
        deepest = max(range(len(wrench)), key=lambda i: _interest(found["/contact/points"][i][1]))
        _draw_clouds(right, found, deepest)
        with out.open("wb") as file:
            save_figure(figure, file, "png")


def _read(message: Any) -> Any:
    """A PointCloud2 as a structured array."""
    kind = np.dtype([(f.name, _KIND[f.datatype]) for f in message.fields])
    return np.frombuffer(bytes(message.data), kind)


def _interest(message: Any) -> tuple[int, int]:
    """More patches, then more points, say more."""
    points = _read(message)
    _, counts = np.unique(points["patch"], return_counts=True)
    return int((counts > 20).sum()), len(points)


def _draw_clouds(axes: Any, found: dict[str, list[tuple[float, Any]]], at: int) -> None:
    """Points and areas of one tick, seen along y."""
    points, areas = (_read(found[topic][at][1]) for topic in ("/contact/points", "/contact/areas"))
    for k, patch in enumerate(np.unique(points["patch"])):
        of = points[points["patch"] == patch]
        axes.plot(
            1e3 * of["x"],
            1e3 * of["z"],
            ".",
            ms=3,
            color=COLOURS[(2 + 2 * k) % 7],
            label=f"patch {patch}",
        )
    for area in areas:
        axes.annotate(
            "",
            (1e3 * area["x"] + 4 * area["fx"], 1e3 * area["z"] + 4 * area["fz"]),
            (1e3 * area["x"], 1e3 * area["z"]),
            arrowprops={"arrowstyle": "-|>", "color": COLOURS[0], "lw": 2.5},
        )
    x, z = 1e3 * points["x"].mean(), 1e3 * points["z"].mean()
    axes.set(
        xlim=(x - 32, x + 32), ylim=(z - 32, z + 32), xlabel="x, mm", ylabel="z, mm", aspect="equal"
    )
    axes.set_title(
        f"/contact/points, /contact/areas\nat {found['/contact/points'][at][0]:.3f} s, seen along y"
    )
    axes.legend()


_KIND = {7: "<f4", 6: "<u4", 5: "<i4"}

PICTURES = {
    "page.png": (draw_page, "host/crease/draw/view"),
    "live.png": (draw_live, "host/crease/live"),
    "mcap.png": (draw_mcap, "host/docs"),
}


def main() -> None:
    """Command line: see the top of the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "-o", "--output", type=Path, help="one folder for all (default: where they are shown)"
    )
    parser.add_argument("--only", choices=PICTURES, help="one of them")
    args = parser.parse_args()
    for name in [args.only] if args.only else PICTURES:
        draw, place = PICTURES[name]
        out = (args.output or ROOT / place) / name
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="crease-pictures-") as folder:
            draw(out, Path(folder))
        print(out)


if __name__ == "__main__":
    main()
