"""How late creased wakes up, and how long it takes from SYNC to the torque frame: histogram, p50, p99, p99.9, max.

    python tests/bench/latency.py SCENE.crs [--transport unix|vcan] [--seconds S] [--figure OUT.png]

unix: creased with its socket exchanged for a UNIX one (latency_can.c), drives in a second process: this kernel's
scheduler and sockets, no CAN. vcan: creased as it is on vcan0. The clock is the machine's; the hand holds the tool in
the wall.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from crease.base.native import lib
from crease.lab.setup import machine
from crease.replay.recording import fault_names, load_recording

F64 = npt.NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "gcc"
TIP_M = (-0.04, 0.6163961, 0.02)
"""Base frame: a cube of 60 mm goes 10 mm into the wall, as far as the hand is let."""
DEVICE = """[bus]
missing_max = 10
torque_timeout_ms = 0   # what is measured here shall not end the measurement
[loop]
overrun_us = 2000
deadline_us = 900
"""


@dataclass(frozen=True)
class Figures:
    """us, one value a tick. wake: period began late by. end: SYNC to torque frame sent, where all states came."""

    wake_us: F64
    end_us: F64
    ticks: int
    contact: int
    skipped: int
    faults: tuple[str, ...]
    warnings: tuple[str, ...]


def quantiles(values: F64) -> dict[str, float]:
    """The figures of one histogram."""
    names = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9}
    found = {name: float(np.percentile(values, at)) for name, at in names.items()}
    return found | {"max": float(values.max()), "count": float(len(values))}


def drives_command(transport: str, path: Path, folder: Path) -> list[str]:
    """The other end of the bus."""
    if transport == "unix":
        return [str(BUILD / "latency_drives"), str(path), *map(str, TIP_M)]
    operator = folder / "operator.csv"
    rows = [
        f"{t},{TIP_M[0]},{TIP_M[1]},{z}" for t, z in ((0, 0.04), (0.5, TIP_M[2]), (0.6, TIP_M[2]))
    ]
    operator.write_text("t_s,x_m,y_m,z_m\n" + "\n".join(rows) + "\n", encoding="ascii")
    words = ["-m", "crease", "sim", "-i", "socketcan", "-c", "vcan0", "--operator", str(operator)]
    return [sys.executable, *words]


def measure(scene: Path, transport: str, seconds: float) -> Figures:
    """One run.   Errors: RuntimeError with what creased said."""
    with tempfile.TemporaryDirectory(prefix="crease-latency-") as name:
        folder = Path(name)
        socket, device, record = folder / "bus", folder / "device.toml", folder / "run.crr"
        device.write_text(DEVICE, encoding="ascii")
        creased = BUILD / ("creased-unix" if transport == "unix" else "creased")
        interface = str(socket) if transport == "unix" else "vcan0"
        with subprocess.Popen(
            drives_command(transport, socket, folder), stdout=subprocess.DEVNULL
        ) as drives:
            end_s = time.monotonic() + 20.0
            while transport == "unix" and not socket.exists() and time.monotonic() < end_s:
                time.sleep(0.01)
            time.sleep(0.05 if transport == "unix" else 3.0)
            words = [creased, "--config", device, "--interface", interface, "--record", record]
            words += ["--start", "--seconds", f"{seconds:g}", "--quiet", scene]
            command = [str(word) for word in words]
            said = subprocess.run(
                command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
            )
            drives.terminate()
        if said.returncode not in (0, 4):
            raise RuntimeError(said.stderr.strip())
        rows = load_recording(record).rows
    return figures(rows, said)


def figures(rows: npt.NDArray[Any], said: subprocess.CompletedProcess[str]) -> Figures:
    """What a recording and the last line of creased tell."""
    answered = (rows["fresh"] & 7) == 7
    contact = np.isin(rows["mode"], (lib.CR_MODE_RENDERING, lib.CR_MODE_LIMITED)) & (
        rows["areas"] > 0
    )
    end_us = 1e-3 * ((rows["now_ns"] - rows["sync_ns"]).astype(np.float64) + rows["tick_ns"])
    skipped = next(line for line in said.stdout.splitlines() if " skipped" in line)
    return Figures(
        1e-3 * rows["wake_late_ns"].astype(np.float64),
        end_us[answered],
        len(rows),
        int(contact.sum()),
        int(skipped.split(" skipped")[0].split()[-1]),
        tuple(fault_names(int(np.bitwise_or.reduce(rows["faults"])))),
        tuple(line for line in said.stderr.splitlines() if line.startswith("warning")),
    )


def draw(runs: Figures, title: str, path: Path) -> None:
    """Both histograms, logarithmic, with their quantiles."""
    import matplotlib as mpl
    from crease.draw.plot import COLOURS, STYLE, new_figure, save_figure

    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 4.2)
        names = ("wake-up late by, us", "SYNC to torque frame sent, us")
        for axes, values, name in zip(
            figure.subplots(1, 2), (runs.wake_us, runs.end_us), names, strict=True
        ):
            low, high = max(values.min(), 0.5), max(values.max(), 10.0)
            axes.hist(values, bins=list(np.geomspace(low, 1.05 * high, 60)), color=COLOURS[0])
            axes.set_xscale("log")
            axes.set_yscale("log")
            found = quantiles(values)
            for k, (quantile, style) in enumerate((("p50", "-"), ("p99", "--"), ("p99.9", ":"))):
                label = f"{quantile}: {found[quantile]:,.0f} us"
                axes.axvline(found[quantile], color=COLOURS[1 + k], ls=style, lw=1.6, label=label)
            axes.axvline(
                found["max"], color="#555555", lw=0.8, label=f"max: {found['max']:,.0f} us"
            )
            axes.set_xlabel(name)
            axes.set_ylabel("ticks")
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
        figure.suptitle(title, fontsize=11, fontweight="bold")
        with path.open("wb") as file:
            save_figure(figure, file, "png")


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("scene", type=Path)
    parser.add_argument("--transport", choices=("unix", "vcan"), default="unix")
    parser.add_argument(
        "--where", default="", help="words for the title: native, User-Mode Linux, ..."
    )
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    load_before = os.getloadavg()[0]
    runs = measure(args.scene, args.transport, args.seconds)
    title = f"creased at 1 kHz, {args.transport}{', ' + args.where if args.where else ''}"
    print(f"{machine()}\n{title}; load of the machine {load_before:.1f}")
    for text in runs.warnings:
        print(text)
    faults = ", ".join(runs.faults) or "none"
    print(
        f"{runs.ticks:,} ticks, {runs.contact:,} in contact, {runs.skipped:,} skipped, faults: {faults}"
    )
    report: dict[str, Any] = {"title": title, "ticks": runs.ticks, "skipped": runs.skipped}
    for name, values in (("wake-up", runs.wake_us), ("SYNC to torque frame", runs.end_us)):
        if len(values) == 0:
            print(f"{name:22s} no drive ever answered")
            return 1
        report[name] = found = quantiles(values)
        text = "  ".join(f"{q} {us:,.0f} us" for q, us in found.items() if q != "count")
        print(f"{name:22s} {text}  ({len(values):,} ticks)")
    if args.figure:
        args.figure.parent.mkdir(parents=True, exist_ok=True)
        draw(runs, title, args.figure)
        print(args.figure)
    if args.json:
        args.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
