"""The TOML of creased (firmware/port/linux/toml.c) against tomllib: it takes nothing that means something else."""

from __future__ import annotations

import ctypes
import itertools
import random
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = (ROOT / "firmware/port/linux/device.toml").read_text(encoding="utf-8")
TABLE, PAIR, WRONG = 1, 2, 3


class Reader(ctypes.Structure):
    """toml_reader."""

    _fields_ = (
        ("at", ctypes.c_char_p),
        ("line", ctypes.c_int),
        ("wrong", ctypes.c_char_p),
        ("text", ctypes.c_char * 400),
    )


@pytest.fixture(scope="session")
def lib(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """Reader and configuration of creased as a library."""
    out = tmp_path_factory.mktemp("toml") / "toml.so"
    port = [ROOT / "firmware/port/linux" / f"{name}.c" for name in ("toml", "device")]
    rooms = [p for room in ("contact", "servo") for p in (ROOT / "firmware" / room).glob("*.c")]
    words: list[str | Path] = [
        "gcc",
        "-std=c11",
        "-O1",
        "-shared",
        "-fPIC",
        f"-I{ROOT / 'firmware'}",
        "-o",
        out,
    ]
    subprocess.run([*words, *port, *rooms, "-lm"], check=True)
    found = ctypes.CDLL(str(out))
    found.toml_text.restype = ctypes.c_void_p
    found.toml_text.argtypes = [ctypes.c_void_p]
    return found


def read(lib: ctypes.CDLL, text: bytes) -> dict[str, Any] | None:
    """Tables and pairs as a caller of toml.h puts them together; None: refused."""
    reader = Reader(at=text)
    name, value = ctypes.c_void_p(), ctypes.c_void_p()
    found: dict[str, Any] = {}
    here = found
    while kind := lib.toml_next(ctypes.byref(reader), ctypes.byref(name), ctypes.byref(value)):
        if kind == WRONG:
            return None
        key = ctypes.string_at(name.value or 0).decode()
        if key in (found if kind == TABLE else here):
            return None
        if kind == TABLE:
            here = found[key] = {}
        elif (got := read_value(lib, value)) is None:
            return None
        else:
            here[key] = got
    return found


def read_value(lib: ctypes.CDLL, value: ctypes.c_void_p) -> Any:
    """A text, a number, or an array of up to four; None: none of them."""
    start = ctypes.string_at(value.value or 0)
    if start.startswith(b'"'):
        text = lib.toml_text(value)
        return None if text is None else ctypes.string_at(text).decode()
    at, number, numbers = value, ctypes.c_double(), []
    if is_array := start.startswith(b"["):
        at = ctypes.c_void_p((value.value or 0) + 1)
    while lib.toml_number(ctypes.byref(at), ctypes.byref(number)) == 0:
        numbers.append(number.value)
        rest = ctypes.string_at(at.value or 0)
        if not is_array:
            return numbers[0] if not rest else None
        if rest == b"]":
            return numbers
        if not rest.startswith(b","):
            return None
        at = ctypes.c_void_p((at.value or 0) + 1)
    return None


def judged(text: bytes) -> dict[str, Any] | None:
    """What Python's reader makes of it; None: no TOML."""
    try:
        return tomllib.loads(text.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError):
        return None


def same(lib: ctypes.CDLL, text: bytes) -> bool:
    """Whether it was taken; then it means the same to both.   Errors: AssertionError."""
    ours = read(lib, text)
    if ours is not None:
        assert ours == judged(text), text
    return ours is not None


TAKEN = [
    "0", "-0", "+0", "7", "-90", "+12", "1000000", "2.5", "-0.5", "0.0", "1e3", "1E3", "3e-1", "-2.5e+7", "0e0",
    "1.25e-3", "0x0", "0x1F", "0xdeadbeef", "[1, -2.5, 3e-1]", "[1,2]", "[ 0.5 , 1 ]", "[1]", '"vcan7"', '""',
    '"a b"', '"#no comment"', '"a=b"', '"[x]"', '"a\tb"', '"Ø"', '7 # "text"', "7\t", '"it\'s"',
]  # fmt: skip
NO_TOML = [
    "", "01", "-01", "00.5", "1.", ".5", "-.5", "1.e3", "1e", "1e+", "+-1", "--1", "0x", "0xg", "-0x10", "+0x1",
    "0X1", "0x1.8", "0x1p3", "infinity", "NaN", "1 2", "1,2", "[1 2]", "[1", "1]", "[1]]", "[,1]", "can0", '"open',
    'shut"', '"a"b', '"a""b"', '"\\q"', '"\\"', '"a\x01b"', '"a\x7f"', "7 # \x07", "7 \r 8", "7\x0b", "1__0", "1_",
    "0o", "'", "truth", "2020-13-01", "= 3", "1f", "1d",
]  # fmt: skip
REFUSED = [
    "1_000", "0o17", "0b11", "inf", "-inf", "nan", "[1, 2,]", "[]", "[[1], [2]]", "true", '"\\t"', '"\\u00d8"',
    "'literal'", '"""long"""', "{a = 1}", "2020-01-01", '[1, "a"]', "1e999", "1e-999",
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("value", TAKEN)
def test_values_are_taken_as_toml_means_them(value: str, lib: ctypes.CDLL) -> None:
    assert same(lib, f"[t]\nkey = {value}\n".encode())


@pytest.mark.parametrize("value", NO_TOML)
def test_what_is_no_toml_is_refused(value: str, lib: ctypes.CDLL) -> None:
    text = f"[t]\nkey = {value}\n".encode()
    assert judged(text) is None
    assert read(lib, text) is None


@pytest.mark.parametrize("value", REFUSED)
def test_toml_beyond_the_subset_is_refused_not_guessed(value: str, lib: ctypes.CDLL) -> None:
    text = f"[t]\nkey = {value}\n".encode()
    assert judged(text) is not None
    assert read(lib, text) is None


@pytest.mark.parametrize(
    ("text", "is_taken"),
    [
        (b"", True), (b"\n\n", True), (b"# only this", True), (b"[t]\r\nkey = 1\r\n", True),
        (b"[t] # c\n key=1", True), (b"[t]\nkey = 1\r", False), (b"[t]\rkey = 1\n", False),
        (b"[t]\nkey = 1\nkey = 2\n", False), (b"[t]\n[t]\n", False), (b"[t\n", False), (b"t]\n", False),
        (b"[t] x\n", False), (b"[[t]]\n", False), (b"key\n", False), (b"= 1\n", False),
        (b"[t]\n# \xc3\x98\n", True), (b"# \xc3\n", False), (b"# \xff\n", False), (b"# \xed\xa0\x80\n", False),
        (b"# \xe0\x80\x80\n", False), (b"# \xf4\x90\x80\x80\n", False), (b"# \xf0\x9f\x98\x80\n", True),
        (b"# \xc0\x80\n", False), (b"# \xf0\x80\x80\x80\n", False), (b"# " + 500 * b"x", False),
    ],
)  # fmt: skip
def test_lines(text: bytes, is_taken: bool, lib: ctypes.CDLL) -> None:
    assert same(lib, text) == is_taken


def test_every_short_value_is_refused_or_means_the_same(lib: ctypes.CDLL) -> None:
    """All values of up to five letters of numbers: 19,607, 319 of them TOML."""
    letters = "01+-.ex"
    taken = 0
    for size in range(1, 6):
        for value in itertools.product(letters, repeat=size):
            taken += same(lib, f"k = {''.join(value)}".encode())
    assert taken > 300


@pytest.mark.slow
@settings(max_examples=3000, deadline=None, derandomize=True)
@given(st.text(alphabet='0123456789+-.eE_xX []",#\\=\tabn\r\nØ', max_size=24))
@example("1 # \\")
def test_any_text_is_refused_or_means_the_same(value: str) -> None:
    same(LIB[0], f"[t]\nkey = {value}\n".encode())
    same(LIB[0], value.encode())


LIB: list[ctypes.CDLL] = []
"""For hypothesis, which takes no fixture of a test's own."""


@pytest.fixture(autouse=True)
def _shared(lib: ctypes.CDLL) -> None:
    LIB[:] = [lib]


@pytest.mark.slow
def test_a_device_that_is_taken_is_toml(lib: ctypes.CDLL) -> None:
    """device.toml with bytes and lines spoiled: what creased starts with, every other tool reads too."""
    rng = random.Random(11)
    good = EXAMPLE.encode()
    device, error = ctypes.create_string_buffer(65536), ctypes.create_string_buffer(300)
    assert lib.device_parse(b"d", good, device, error) == 0
    assert same(lib, good)
    taken = refused = 0
    for _ in range(6000):
        lines = good.splitlines(keepends=True)
        at = rng.randrange(len(lines))
        way = rng.randrange(4)
        if way == 0:
            lines.insert(rng.randrange(len(lines)), lines[at])
        elif way == 1:
            del lines[at]
        text = bytearray(b"".join(lines))
        for _ in range(way - 1):
            text[rng.randrange(len(text))] = rng.choice(
                b'0123456789.eE+-_"#[]= \t\r\n\\x\x01\xc3\x98'
            )
        is_taken = lib.device_parse(b"d", bytes(text), device, error) == 0
        taken += is_taken
        refused += not is_taken
        assert not is_taken or judged(bytes(text)) is not None, bytes(text)
    assert taken > 500
    assert refused > 500
