"""Writes the C source of a cffi extension: the declarations are read from the C headers themselves.

The preprocessor expands the headers; what comes from the named headers (and the headers beside them) is handed to
cffi, what comes from the system is left out. Integer macros become constants whose value the C compiler fills in.
"""

from __future__ import annotations

import argparse
import re
import subprocess
from pathlib import Path

from cffi import FFI

LINE_MARKER = re.compile(r'^# \d+ "(?P<path>[^"]*)"')
INT_MACRO = re.compile(
    r"^#define (?P<name>[A-Z][A-Z0-9_]*) \(?-?(0[xX][0-9a-fA-F]+|\d+)[uUlL]*\)?$"
)
STATIC_ASSERT = re.compile(r"_Static_assert\s*\(.*?\)\s*;", re.DOTALL)


def preprocess(cc: str, options: list[str], headers: list[Path]) -> str:
    """The headers after the preprocessor, with line markers and macro definitions kept."""
    source = "".join(f'#include "{header}"\n' for header in headers)
    command = [cc, "-E", "-dD", "-std=c11", *options, "-x", "c", "-"]
    return subprocess.run(command, input=source, capture_output=True, text=True, check=True).stdout


def declarations(expanded: str, folders: set[Path]) -> str:
    """The part of `expanded` that stands in files of `folders`, in the subset of C that cffi reads."""
    kept: list[str] = []
    ours = False
    for line in expanded.splitlines():
        if marker := LINE_MARKER.match(line):
            path = Path(marker["path"])
            ours = path.is_absolute() and path.parent.resolve() in folders
        elif ours and (macro := INT_MACRO.match(line)):
            kept.append(f"#define {macro['name']} ...")
        elif ours and not line.startswith("#"):
            kept.append(line)
    return STATIC_ASSERT.sub("", "\n".join(kept))


def main() -> None:
    """Command line of the build: see host/CMakeLists.txt."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cc", required=True)
    parser.add_argument("--include", type=Path, action="append", default=[])
    parser.add_argument("--define", action="append", default=[])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--module", default="crease._native")
    parser.add_argument("headers", type=Path, nargs="+")
    args = parser.parse_args()
    options = [f"-I{path.resolve()}" for path in args.include]
    options += [f"-D{name}" for name in args.define]
    headers = [path.resolve() for path in args.headers]
    ffi = FFI()
    ffi.cdef(declarations(preprocess(args.cc, options, headers), {path.parent for path in headers}))
    ffi.set_source(args.module, "".join(f'#include "{header}"\n' for header in headers))
    ffi.emit_c_code(str(args.out))


if __name__ == "__main__":
    main()
