"""SPEC.md and servo/SPEC.md tell the truth: tables are the C structs, an image can be read by its page alone."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from crease.bake.bake import BakeOptions, bake_scene
from crease.base.native import ffi, lib
from crease.base.scene import Scene, open_image, open_scene
from crease.mesh.mesh import make_mesh

ROOT = Path(__file__).resolve().parent.parent.parent
TEXT = (ROOT / "firmware" / "SPEC.md").read_text(encoding="utf-8")
SERVO_TEXT = (ROOT / "firmware" / "servo" / "SPEC.md").read_text(encoding="utf-8")

C_TYPES = {
    "u8": "uint8_t",
    "u16": "uint16_t",
    "u32": "uint32_t",
    "i16": "int16_t",
    "f32": "float",
}
NUMPY_TYPES = {"u8": "u1", "u16": "<u2", "u32": "<u4", "i16": "<i2", "f32": "<f4"}
TABLE = re.compile(r"^#+ [^\n]*`(cr_img_\w+)`, (\d+) bytes$(.*?)(?=^#)", re.MULTILINE | re.DOTALL)
FIELD = re.compile(r"^\| (\d+) \| (\w+)(?:\[(\d+)\])? \| (\w+) \|", re.MULTILINE)
SECTION = re.compile(r"^\| (\d+) \| `(CR_SEC_\w+)` \| (?:`(\w+)`|(\w+)) \| (\d+) \|", re.MULTILINE)
CONSTANT = re.compile(r"^\| `(CR_\w+)` \| (-?\w+) \|", re.MULTILINE)

Records = dict[str, tuple[int, list[tuple[int, str, int, str]]]]


def spec_records() -> Records:
    """Size and fields (offset, type, count, name) of every record, as SPEC.md has them."""
    return {
        name: (
            int(size),
            [(int(at), kind, int(n or 1), field) for at, kind, n, field in FIELD.findall(body)],
        )
        for name, size, body in TABLE.findall(TEXT)
    }


RECORDS = spec_records()
HERE = ("cr_img_header", "cr_img_section", "cr_img_meta", "cr_img_brick", "cr_img_kind")
THERE = ("facet", "pair", "edge", "cluster", "sum", "group", "neighbour")


def test_spec_has_a_table_for_every_record() -> None:
    assert sorted(RECORDS) == sorted([*HERE, *(f"cr_img_{name}" for name in THERE)])


@pytest.mark.parametrize("name", RECORDS)
def test_record_is_laid_out_as_in_c(name: str) -> None:
    size, fields = RECORDS[name]
    kind = ffi.typeof(f"struct {name}")
    in_c = []
    for field, info in kind.fields:
        array = info.type.kind == "array"
        item = info.type.item if array else info.type
        in_c.append((info.offset, item.cname, info.type.length if array else 1, field))
    assert size == ffi.sizeof(kind)
    assert [(at, C_TYPES[t], count, field) for at, t, count, field in fields] == in_c


def test_records_have_no_gaps() -> None:
    for size, fields in RECORDS.values():
        at = 0
        for offset, kind, count, _ in fields:
            assert offset == at
            at += np.dtype(NUMPY_TYPES[kind]).itemsize * count
        assert at == size


def test_sections_are_numbered_as_in_c() -> None:
    rows = SECTION.findall(TEXT)
    assert [int(row[0]) for row in rows] == list(range(1, int(lib.CR_SEC_COUNT) + 1))
    for number, constant, struct, plain, stride in rows:
        assert getattr(lib, constant) == int(number)
        size = RECORDS[struct][0] if struct else np.dtype(NUMPY_TYPES[plain]).itemsize
        assert size == int(stride)


def test_constants_have_the_values_of_c() -> None:
    rows = CONSTANT.findall(TEXT)
    assert len({name for name, _ in rows}) > 25
    for name, value in rows:
        assert getattr(lib, name) == int(value, 0), name


RECORD_ROW = re.compile(r"^\| (\d+) \| (\w+?)(?:\[(\d+)\])? \| (\w*) ?\| ", re.MULTILINE)
RECORD_SIZES = {"u8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4, "f32": 4, "u64": 8}


def test_record_of_a_tick_is_laid_out_as_in_c_and_without_gaps() -> None:
    body = SERVO_TEXT[SERVO_TEXT.index("### `cr_record`, 512 bytes") :]
    rows = RECORD_ROW.findall(body)
    in_c = {name: (f.offset, ffi.sizeof(f.type)) for name, f in ffi.typeof("cr_record").fields}
    at = 0
    for offset, kind, count, name in rows:
        assert int(offset) == at
        size = RECORD_SIZES[kind] * int(count or 1)
        assert not name or in_c.pop(name) == (at, size), name
        at += size
    assert (at, in_c) == (ffi.sizeof("cr_record"), {})


def test_bits_of_faults_and_limits_have_the_names_of_c() -> None:
    for head, text in (
        ("Fault bits:", lib.cr_servo_fault_text),
        ("Limit bits:", lib.cr_limit_text),
    ):
        line = SERVO_TEXT[SERVO_TEXT.index(head) + len(head) :].split(".")[0]
        for item in line.split(","):
            bit, name = item.split()
            assert ffi.string(text(1 << int(bit))).decode() == name


class SpecImage:
    """An image read with the tables and formulas of SPEC.md and nothing else."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.header = np.frombuffer(data, self._record("cr_img_header"), 1)[0]
        table = np.frombuffer(data, self._record("cr_img_section"), len(SECTION.findall(TEXT)), 64)
        self.part: dict[str, npt.NDArray[Any]] = {}
        for row, (number, name, struct, plain, _) in zip(table, SECTION.findall(TEXT), strict=True):
            assert row["id"] == int(number)
            kind = self._record(struct) if struct else np.dtype(NUMPY_TYPES[plain])
            found = np.frombuffer(data, kind, int(row["count"]), int(row["offset"]))
            self.part[name.removeprefix("CR_SEC_")] = found
        self.meta = self.part["META"][0]

    @staticmethod
    def _record(name: str) -> np.dtype[Any]:
        size, fields = RECORDS[name]
        return np.dtype(
            {
                "names": [field for *_, field in fields],
                "formats": [
                    (NUMPY_TYPES[t], (n,)) if n > 1 else NUMPY_TYPES[t] for _, t, n, _ in fields
                ],
                "offsets": [at for at, *_ in fields],
                "itemsize": size,
            }
        )

    def crc(self) -> int:
        at = 16
        return zlib.crc32(
            self.data[:at] + bytes(4) + self.data[at + 4 : int(self.header["size_bytes"])]
        )

    def distance(self, p: npt.NDArray[np.float64]) -> tuple[float, npt.NDArray[np.float64]]:
        """phi and gradient at p by "Distance at a point"."""
        m = self.meta
        dims = m["dims"].astype(int)
        g = (p - m["origin_m"]) / m["brick_m"]
        c = np.clip(g, 0.0, dims * (1 - 1e-9))
        brick_at = c.astype(int)
        u = c - brick_at
        entry = int(self.part["TOP"][(brick_at[2] * dims[1] + brick_at[1]) * dims[0] + brick_at[0]])
        if entry & 0x80000000:
            beyond = m["brick_m"] * np.linalg.norm(g - c)
            bound = (entry & 0x3FFFFFFF) * m["quantum_m"] + beyond
            return float(-bound if entry & 0x40000000 else bound), np.zeros(3)
        brick = self.part["BRICKS"][entry]
        phi, gradient = self._interpolate(brick, u)
        if abs(phi) < m["crease_m"] and brick["creased"]:
            cell = np.minimum((8 * u).astype(int), 7)
            index = brick["kind"]
            if brick["cells"] != 0xFFFFFFFF:
                index = self.part["CELLS"][
                    int(brick["cells"]) + (cell[2] * 8 + cell[1]) * 8 + cell[0]
                ]
            kind = self.part["KINDS"][index]
            if kind["kind"] in (3, 4):
                return self._planes(kind, p)
        return phi, gradient

    def _interpolate(
        self, brick: Any, u: npt.NDArray[np.float64]
    ) -> tuple[float, npt.NDArray[np.float64]]:
        side = int(brick["side"])
        first = int(brick["samples"])
        v = side * u
        k = np.minimum(v.astype(int), side - 1)
        f = v - k
        entry = int(self.part["SAMPLES"][first + 736 + k @ [1, 8, 64]]) if brick["fine"] else 0
        if entry:
            n = 4 if entry & 0x4000 else 2
            first, side, v = first + 32 * (entry & 0x3FFF), side * n, n * f
            k = np.minimum(v.astype(int), n - 1)
            f = v - k
        n = (n if entry else side) + 1
        cube = self.part["SAMPLES"][first : first + n**3].reshape(n, n, n).astype(np.float64)
        eight = cube[k[2] : k[2] + 2, k[1] : k[1] + 2, k[0] : k[0] + 2]
        ends = [np.array([1 - t, t]) for t in f]
        slope = np.array([-1.0, 1.0])
        quantum, step = (
            float(self.meta["quantum_m"]),
            float(self.meta["brick_m"]) / side,
        )

        def weigh(x: Any, y: Any, z: Any) -> float:
            return float(np.einsum("zyx,x,y,z", eight, x, y, z)) * quantum

        rows = [
            (slope, ends[1], ends[2]),
            (ends[0], slope, ends[2]),
            (ends[0], ends[1], slope),
        ]
        return weigh(*ends), np.array([weigh(*row) for row in rows]) / step

    def _planes(
        self, kind: Any, p: npt.NDArray[np.float64]
    ) -> tuple[float, npt.NDArray[np.float64]]:
        s = 1.0 if kind["kind"] == 3 else -1.0
        facets = self.part["FACETS"][kind["facet"][: kind["count"]]]
        m = s * facets["normal"].astype(np.float64)
        h = m @ p - s * facets["offset_m"]
        i = int(h.argmax())
        if h[i] <= 0:
            return float(s * h[i]), s * m[i]
        e = h - h[i] * (m @ m[i])
        e[i] = -np.inf
        j = int(e.argmax())
        c = float(m[i] @ m[j])
        if e[j] <= 0 or 1 - c * c < 1e-6:
            return float(s * h[i]), s * m[i]
        o = h[i] * m[i] + e[j] / (1 - c * c) * (m[j] - c * m[i])
        rest = h - m @ o
        rest[[i, j]] = -np.inf
        k = int(rest.argmax())
        if rest[k] > 0 and abs(np.linalg.det(m[[i, j, k]])) >= 1e-3:
            o = np.linalg.solve(m[[i, j, k]], h[[i, j, k]])
        d = float(np.linalg.norm(o))
        return s * d, s * o / d


@pytest.fixture(scope="module")
def spec_image(scene_crs: Path) -> SpecImage:
    return SpecImage(scene_crs.read_bytes())


@pytest.fixture(scope="module")
def thin_image() -> bytes:
    """A tube with a wall of 0.7 mm, voxels of 1 mm."""
    tube = trimesh.creation.annulus(r_min=9.3, r_max=10.0, height=20.0, sections=48)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=5.0)
    static, tool = (
        make_mesh(m.vertices, m.faces, 1e-3, source="made", digest_sha256="0" * 64)
        for m in (tube, ball)
    )
    return bake_scene(static, tool, BakeOptions(voxel_m=1e-3, spacing_m=1e-3)).image


def test_checksum_is_the_one_described(spec_image: SpecImage) -> None:
    assert spec_image.crc() == int(spec_image.header["crc32"])
    assert bytes(spec_image.header["magic"]).hex(" ") in TEXT


def looked_up(scene: Scene, points: npt.NDArray[np.float32]) -> list[npt.NDArray[Any]]:
    """Distances, gradients and facets that the tick would see at points (n, 3)."""
    phi = np.empty(len(points), np.float32)
    gradient = np.empty((len(points), 3), np.float32)
    kind, facet = np.empty(len(points), np.uint32), np.empty(len(points), np.uint32)
    lib.crp_look_up(
        scene.handle,
        ffi.from_buffer("float[]", points.reshape(-1)),
        len(points),
        ffi.from_buffer("float[]", phi),
        ffi.from_buffer("float[]", gradient.reshape(-1)),
        ffi.from_buffer("uint32_t[]", kind),
        ffi.from_buffer("uint32_t[]", facet),
    )
    return [phi, gradient, facet]


@pytest.mark.slow
def test_distances_of_fine_voxels_come_from_the_page_alone(thin_image: bytes) -> None:
    """A wall thinner than a voxel: many points lie in voxels that have samples of their own."""
    image = SpecImage(thin_image)
    assert (image.part["BRICKS"]["fine"] == 1).sum() > 3
    rng = np.random.default_rng(5)
    turn, radius, z = rng.uniform([0.0, 0.0085, -0.011], [6.28, 0.0108, 0.011], (3000, 3)).T
    points = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), z])
    phi, gradient, _ = looked_up(open_image(thin_image, "thin"), points.astype(np.float32))
    read = [image.distance(p) for p in points.astype(np.float32).astype(np.float64)]
    np.testing.assert_allclose(phi, [r[0] for r in read], atol=1e-6)
    off = np.linalg.norm(gradient - np.array([r[1] for r in read]), axis=1)
    assert (off < 1e-3).mean() > 0.995


def test_distances_come_from_the_page_alone(scene_crs: Path, spec_image: SpecImage) -> None:
    """Planes, edges and vertices of the block, flat and far bricks, and points beyond the grid."""
    rng = np.random.default_rng(3)
    anywhere = rng.uniform(-0.12, 0.12, (1500, 3))
    corners = np.array(
        [[x, y, z] for x in (-0.04, 0.04) for y in (-0.04, 0.04) for z in (-0.04, 0)]
    )
    near = corners[rng.integers(0, 8, 1500)] + rng.normal(scale=0.002, size=(1500, 3))
    sides = rng.uniform([-0.04, -0.04, -0.003], [0.04, 0.04, 0.003], (500, 3))
    points = np.concatenate([anywhere, near, sides]).astype(np.float32)
    phi, gradient, facet = looked_up(open_scene(scene_crs), points)
    read = [spec_image.distance(p) for p in points.astype(np.float64)]
    assert (facet != 0xFFFFFFFF).sum() > 500
    assert (np.linalg.norm(gradient, axis=1) == 0).sum() > 100
    np.testing.assert_allclose(phi, [r[0] for r in read], atol=1e-6)
    # Where two planes are equally near, rounding decides: all but a few directions agree.
    off = np.linalg.norm(gradient - np.array([r[1] for r in read]), axis=1)
    assert (off < 1e-3).mean() > 0.995


def test_rectangles_hold_their_facets_and_no_more(spec_image: SpecImage) -> None:
    """Of the six faces of the block: 80 x 80 x 40 mm."""
    facets = spec_image.part["FACETS"]
    assert len(facets) == 6
    corners = np.array(
        [[x, y, z] for x in (-0.04, 0.04) for y in (-0.04, 0.04) for z in (-0.04, 0)]
    )
    for row in facets:
        mine = corners[np.abs(corners @ row["normal"] - row["offset_m"]) < 1e-6]
        along = row["along"] / 32767.0
        at = mine @ np.stack([along, np.cross(row["normal"], along)]).T
        np.testing.assert_allclose(row["low_m"], at.min(axis=0), atol=1e-8)
        np.testing.assert_allclose(row["high_m"], at.max(axis=0), atol=1e-8)
        sides = np.sort(row["high_m"] - row["low_m"])
        np.testing.assert_allclose(sides, np.sort(np.ptp(mine, axis=0))[1:], atol=1e-5)
