"""The library as a CMSIS-Pack: a description that lists every source of its rooms, and a zip of what it lists.

cmsis_pack.py FOLDER -> FOLDER/crease.crease.VERSION.pack
"""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TEMPLATE = ROOT / "firmware/package/crease.pdsc.in"
NAME = "crease.crease"
ROOMS = ("contact", "servo", "couple")
"""Of firmware/: all their sources are the library, as for `make`, Zephyr and PlatformIO."""
PAGES = (
    "CHANGELOG.md",
    "DESIGN.md",
    "SPEC.md",
    "contact/DESIGN.md",
    "servo/DESIGN.md",
    "servo/SPEC.md",
    "couple/DESIGN.md",
)


def version() -> str:
    """As the header has it."""
    text = (ROOT / "firmware/crease.h").read_text("utf-8")
    return ".".join(re.findall(r"^#define CR_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)", text, re.M))


def date() -> str:
    """Of the last commit; of the header where there is no git."""
    said = subprocess.run(
        ["git", "-C", str(ROOT), "log", "-1", "--format=%cs"],
        capture_output=True,
        text=True,
        check=False,
    )
    changed = datetime.fromtimestamp((ROOT / "firmware/crease.h").stat().st_mtime, UTC)
    return said.stdout.strip() or changed.strftime("%Y-%m-%d")


def sources(room: str) -> list[str]:
    """C files of a room of firmware/, as the pack names them."""
    return [
        f"firmware/{room}/{path.name}" for path in sorted((ROOT / "firmware" / room).glob("*.c"))
    ]


def description() -> str:
    """The .pdsc."""
    text = TEMPLATE.read_text("utf-8").replace("@VERSION@", version()).replace("@DATE@", date())
    for room in ROOMS:
        lines = [f'        <file category="source" name="{name}"/>' for name in sources(room)]
        text = text.replace(f"@{room.upper()}@", "\n".join(lines))
    return text


def files() -> list[Path]:
    """What is in the pack beside its description."""
    firmware = ROOT / "firmware"
    found = [path for room in ROOMS for path in (firmware / room).glob("*.[ch]")]
    return sorted(
        [*found, *firmware.glob("*.h"), *(firmware / page for page in PAGES), ROOT / "LICENSE"]
    )


def main(arguments: list[str]) -> int:
    """Command line: see above."""
    if len(arguments) != 1:
        print("error: cmsis_pack.py FOLDER", file=sys.stderr)
        return 2
    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    made, whole = folder / "unfinished", folder / f"{NAME}.{version()}.pack"
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as pack:
        pack.writestr(f"{NAME}.pdsc", description())
        for path in files():
            pack.write(path, path.relative_to(ROOT).as_posix())
    made.replace(whole)
    print(whole)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
