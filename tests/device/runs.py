"""Jobs (tests/check/job.h) on emulated boards, every instruction counted."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from jobs import ROOT

BUILD = ROOT / "build" / "device"
DEVICES = {
    "m7": ("mps2-an500", 0x60000000),
    "m4f": ("mps2-an386", 0x21000000),
    "m55": ("mps3-an547", 0x60000000),
}
LIMIT_S = 600.0


class CheckError(Exception):
    """A check could not be made: one line says why."""


@dataclass(frozen=True)
class Run:
    """What one job printed, and for a device the instructions of each tick: (ticks, 1 + stages)."""

    hashes: tuple[str, str]
    figures: dict[str, int]
    ticks: npt.NDArray[np.int64] | None = None
    stages: tuple[str, ...] = ()
    functions: tuple[tuple[str, int, int], ...] = ()


def command(words: Sequence[str | Path], cwd: Path | None = None) -> str:
    """What a program prints.   Errors: CheckError when it fails."""
    text = [str(word) for word in words]
    done = subprocess.run(
        text,
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        timeout=LIMIT_S,
        stdin=subprocess.DEVNULL,
    )
    if done.returncode != 0:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise CheckError(
            f"{text[0]} ended with {done.returncode}: {said[-1] if said else 'nothing said'}"
        )
    return done.stdout


def read_line(text: str) -> tuple[tuple[str, str], dict[str, int]]:
    """Hashes and figures of the line that a runner prints: pairs of name and value."""
    words = text.split()
    pairs = dict(zip(words[::2], words[1::2], strict=True))
    hashes = (pairs.pop("answers"), pairs.pop("all"))
    return hashes, {name: int(value) for name, value in pairs.items()}


def emulator(name: str, elf: Path, job: Path, plugin: str) -> list[str | Path]:
    """Words that run one job on an emulated board."""
    machine, address = DEVICES[name]
    words: list[str | Path] = [
        "qemu-system-arm",
        "-M",
        machine,
        "-nographic",
        "-monitor",
        "none",
        "-serial",
        "null",
    ]
    words += ["-chardev", "stdio,id=out,signal=off"]
    words += ["-semihosting-config", "enable=on,target=native,chardev=out", "-kernel", elf]
    words += ["-device", f"loader,file={job},addr={address:#x},force-raw=on"]
    return [*words, "-plugin", plugin]


def run_device(name: str, elf: Path, job: Path, made: Path | None = None) -> Run:
    """One job on an emulated board, every instruction counted."""
    with tempfile.TemporaryDirectory(prefix="crease-device-") as folder:
        counts = Path(folder) / "counts.txt"
        words = emulator(name, elf, job, f"{BUILD / 'count.so'},out={counts}")
        line = command(words, cwd=Path(folder))
        if made is not None:
            made.write_bytes((Path(folder) / "made.bin").read_bytes())
        return read_counts(*read_line(line), counts.read_text(encoding="utf-8"))


def run_blocks(name: str, elf: Path, job: Path) -> dict[int, int]:
    """One job on an emulated board: how often the instruction at each address ran."""
    build_counter("blocks")
    with tempfile.TemporaryDirectory(prefix="crease-device-") as folder:
        counts = Path(folder) / "blocks.txt"
        command(emulator(name, elf, job, f"{BUILD / 'blocks.so'},out={counts}"), cwd=Path(folder))
        found: dict[int, int] = {}
        for line in counts.read_text(encoding="ascii").splitlines():
            count, *addresses = line.split()
            for address in addresses:
                found[int(address, 16)] = found.get(int(address, 16), 0) + int(count)
        return found


def read_counts(hashes: tuple[str, str], figures: dict[str, int], text: str) -> Run:
    """The plugin's file."""
    lines = [line.split() for line in text.splitlines()]
    stages = tuple(lines[0][1:])
    ticks = np.array([line[2:] for line in lines if line[0] == "tick"], dtype=np.int64)
    if len(ticks) != figures["ticks"]:
        raise CheckError(f"{len(ticks)} ticks were counted, {figures['ticks']} were run")
    functions = tuple((line[3], int(line[1]), int(line[2])) for line in lines if line[0] == "fn")
    return Run(hashes, figures, ticks, stages, functions)


def build_counter(name: str = "count") -> None:
    """The emulator's plugin that counts: instructions of ticks, or blocks."""
    BUILD.mkdir(parents=True, exist_ok=True)
    source = ROOT / f"tests/device/{name}.c"
    command(["gcc", "-O2", "-shared", "-fPIC", "-o", BUILD / f"{name}.so", source])
