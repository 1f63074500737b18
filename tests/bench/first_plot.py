"""How long a new user needs from nothing to a plot of two STL files of his own.

    python3 tests/bench/first_plot.py [--here]      # make first-plot

A fresh clone, `make build` there (environment, packages, extension), then the ten lines of
host/notebooks/ten_lines.ipynb on two STL files. --here: the ten lines alone, in the environment of this checkout.
System packages are there already.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 300.0
TOOL = "solid tool\n{}endsolid tool\n"


def write_wedge(path: Path) -> None:
    """A tool of one's own: a wedge of 12 x 12 x 20 mm that stands on its edge, as ASCII STL."""
    corners = [(-6, -6, 20), (6, -6, 20), (6, 6, 20), (-6, 6, 20), (0, -6, 0), (0, 6, 0)]
    faces = [(0, 1, 2), (0, 2, 3), (0, 4, 1), (2, 5, 3), (0, 3, 5), (0, 5, 4), (1, 4, 5), (1, 5, 2)]
    text = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*corners[i]) for i in face)
        + "endloop\nendfacet\n"
        for face in faces
    )
    path.write_text(TOOL.format(text), encoding="ascii")


def write_block(path: Path) -> None:
    """A part of one's own: a block of 60 x 40 x 30 mm."""
    corners = [(x, y, z) for x in (-30, 30) for y in (-20, 20) for z in (-30, 0)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    text = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*corners[i]) for i in face)
        + "endloop\nendfacet\n"
        for face in faces
    )
    path.write_text(TOOL.format(text), encoding="ascii")


def ten_lines() -> str:
    """The notebook's code with the names of the user's files, and the plot saved."""
    book = json.loads((ROOT / "host/notebooks/ten_lines.ipynb").read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"]
    return "\n".join(
        ['PART, TOOL, UNIT = "part.stl", "tool.stl", "mm"', *cells[1:], 'plt.savefig("force.png")']
    )


def main() -> int:
    """Command line: see above.   Output: 1 when it takes too long."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--here", action="store_true", help="only the ten lines, with this checkout's environment"
    )
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="crease-first-") as name:
        folder, start = Path(name), time.monotonic()
        checkout = ROOT
        if not args.here:
            checkout = folder / "crease"
            subprocess.run(["git", "clone", "--quiet", ROOT, checkout], check=True)
            subprocess.run(["make", "--silent", "build"], cwd=checkout, check=True)
        built_s = time.monotonic() - start
        write_block(folder / "part.stl")
        write_wedge(folder / "tool.stl")
        python = checkout / ".venv/bin/python"
        subprocess.run(
            [python, "-c", ten_lines()],
            cwd=folder,
            check=True,
            env={"MPLBACKEND": "Agg", "PATH": "/usr/bin:/bin", "HOME": name},
        )
        whole_s = time.monotonic() - start
        assert (folder / "force.png").stat().st_size > 5000
    print(
        f"first plot: {whole_s:.0f} s: clone and build {built_s:.0f} s, ten lines {whole_s - built_s:.0f} s"
    )
    return int(whole_s > LIMIT_S)


if __name__ == "__main__":
    sys.exit(main())
