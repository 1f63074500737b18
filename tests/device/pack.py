"""`make check-pack`: a project with crease from its CMSIS-Pack only feels on an emulated Cortex-M7 what Python feels.

    pack.py CREASE.pack

The files of its components are compiled as they are listed, with the board's start-up beside them.
"""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Sequence
from pathlib import Path

import crease
import numpy as np
from crease.replay.trajectory import load_trajectory

ROOT = Path(__file__).resolve().parents[2]
PORT = ROOT / "firmware/port/cortex-m7"
BOARD = ("startup.c", "semihost.c", "semihost.h", "board.h", "mps2-an500.ld", "sections.ld")
"""What such a project has of its own: the emulated board."""
SCENE = "edge90_cube"
CPU = ["-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-sp-d16", "-mfloat-abi=hard"]
FLAGS = [
    "-std=c11",
    "-O2",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-ffunction-sections",
    "-Wall",
    "-Wextra",
    "-Werror",
]
LINK = ["-nostartfiles", "--specs=nano.specs", "-Wl,--gc-sections", "-T", "mps2-an500.ld"]
EVERY = 8
"""One pose of the path in so many: seconds of emulation."""
LIMIT_S = 300.0


def call(words: Sequence[str | Path], cwd: Path) -> str:
    """Output of a command.   Errors: SystemExit with its last line when it fails."""
    said = subprocess.run(
        [str(word) for word in words],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        timeout=LIMIT_S,
        stdin=subprocess.DEVNULL,
    )
    if said.returncode != 0:
        raise SystemExit(f"error: {words[0]}: {(said.stderr or said.stdout).strip()[-2000:]}")
    return said.stdout


def build(pack: Path, folder: Path) -> Path:
    """The project's program, from the pack and its own files.   Errors: SystemExit."""
    with zipfile.ZipFile(pack) as file:
        file.extractall(folder / "pack")
    for name in BOARD:
        shutil.copy(PORT / name, folder)
    shutil.copy(ROOT / "tests/device/outside_m7.c", folder / "main.c")
    (described,) = (folder / "pack").glob("*.pdsc")
    named = [
        (f.attrib["category"], f.attrib["name"])
        for f in ET.parse(described).iterfind(".//component//file")
    ]
    includes = [f"-Ipack/{name}" for category, name in named if category == "include"]
    sources = [f"pack/{name}" for category, name in named if category == "source"]
    own = ["main.c", "startup.c", "semihost.c"]
    call(
        ["arm-none-eabi-gcc", *CPU, *FLAGS, *includes, *LINK, *own, *sources, "-o", "main.elf"],
        folder,
    )
    return folder / "main.elf"


def run(elf: Path, scene: bytes, poses: bytes) -> bytes:
    """What it felt.   Errors: SystemExit."""
    room = bytearray(64 + (len(scene) + 63) // 64 * 64)
    struct.pack_into("<2I", room, 0, len(scene), len(poses) // 28)
    room[64 : 64 + len(scene)] = scene
    (elf.parent / "scene.bin").write_bytes(bytes(room) + poses)
    call(
        [
            "qemu-system-arm",
            "-M",
            "mps2-an500",
            "-nographic",
            "-monitor",
            "none",
            "-serial",
            "null",
            "-chardev",
            "stdio,id=out,signal=off",
            "-semihosting-config",
            "enable=on,target=native,chardev=out",
            "-kernel",
            elf,
            "-device",
            "loader,file=scene.bin,addr=0x60000000,force-raw=on",
        ],
        elf.parent,
    )
    return (elf.parent / "felt.bin").read_bytes()


def main(arguments: Sequence[str]) -> int:
    """Command line: see above."""
    image = ROOT / f"build/scenes/{SCENE}.crs"
    path = load_trajectory(ROOT / f"build/meshes/{SCENE}.csv")
    poses = path.rows[::EVERY, 1:]
    felt = crease.World(image, stiffness=1000.0).replay(poses)
    expected = np.hstack([felt.force_N, felt.torque_Nm]).astype("<f4").tobytes()
    with tempfile.TemporaryDirectory(prefix="crease-pack-") as folder:
        elf = build(Path(arguments[0]).resolve(), Path(folder))
        got = run(elf, image.read_bytes(), poses.astype("<f4").tobytes())
    ticks = len(expected) // 24
    verdict = "the same bits as" if got == expected else "NOT what"
    print(f"pack: {ticks} ticks of {SCENE} on an emulated Cortex-M7, {verdict} Python feels")
    return 0 if got == expected else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
