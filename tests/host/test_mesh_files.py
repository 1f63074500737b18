"""Mesh files that are cut off or damaged: one line that says what, and on which line of the file where it is text."""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh
from crease.base.errors import MeshError
from crease.mesh.mesh import load_mesh, read_arrays

FACET = (
    "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
)
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def refusal(path: Path, content: str) -> str:
    """What is said of a file that is refused, without its name."""
    path.write_text(content)
    with pytest.raises(MeshError) as caught:
        load_mesh(path, 1e-3)
    return str(caught.value).removeprefix(f"{path}: ")


@pytest.fixture
def ply() -> str:
    """A ball of 80 triangles as PLY in text."""
    ball = trimesh.creation.icosphere(1, radius=10.0)
    return str(ball.export(file_type="ply", encoding="ascii"), "ascii")


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (1, "is cut off: it holds 79 of 80 faces; copy or export it again"),
        (20, "is cut off: it holds 60 of 80 faces; copy or export it again"),
        (100, "is cut off: it holds 22 of 42 vertices; copy or export it again"),
    ],
)
def test_a_ply_in_text_that_is_cut_off_is_refused(
    tmp_path: Path, ply: str, rows: int, said: str
) -> None:
    assert refusal(tmp_path / "ball.ply", "".join(ply.splitlines(keepends=True)[:-rows])) == said


def test_a_ply_that_is_cut_off_within_its_last_face_or_its_head_is_refused(
    tmp_path: Path, ply: str
) -> None:
    within = refusal(tmp_path / "ball.ply", ply.rstrip().rsplit(" ", 1)[0])
    assert within.startswith("is cut off: its last face has fewer vertices than it says")
    head = refusal(tmp_path / "ball.ply", ply[: ply.index("end_header")])
    assert head.startswith("is cut off: its head does not end with end_header")


def test_a_whole_ply_in_text_is_read_however_it_ends(tmp_path: Path, ply: str) -> None:
    path = tmp_path / "ball.ply"
    for text in (ply, ply.rstrip(), ply + "\n\n", ply.replace("\n", "\r\n")):
        path.write_bytes(text.encode())
        assert len(read_arrays(path, 1e-3)[1]) == 80


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.stl", f"solid\n{FACET.replace('1 0 0', '1,5 0 0')}endsolid", "line 5: '1,5' is not a number"),
        ("b.stl", f"solid\n{FACET.replace('vertex 1 0 0', '')}endsolid", "line 8: a facet has 2 vertices"),
        ("c.stl", f"solid\n{FACET.replace('1 0 0', '1 0')}endsolid", "line 5: a vertex has 2 numbers, not 3"),
        ("d.stl", "no mesh, a letter\n" * 9, "is a text, but no STL"),
        ("e.obj", f"{CORNERS.replace('v 1', 'v abc')}f 1 2 3\n", "line 2: 'abc' is not a number"),
        ("f.obj", f"{CORNERS.replace('v 1', 'v 1,0')}f 1 2 3\n", "'1,0' is not a number: it has a decimal comma"),
        ("g.obj", f"{CORNERS}f 1 2 9\n", "line 4: a face names vertex 9, there are 3"),
        ("h.obj", f"{CORNERS}f 0 1 2\n", "line 4: a face names vertex 0, the first is 1"),
        ("j.off", "solid\n3 1 0\n", "the first line does not say OFF"),
        ("k.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\nx\n", "line 6: 'x' is not"),
        ("i.off", "OFF\n3 1 0\n0 0 0\n1 x 0\n0 1 0\n3 0 1 2\n", "line 4: 'x' is not a number"),
    ],
)  # fmt: skip
def test_a_damaged_text_is_refused_with_its_line_and_without_words_of_the_reader(
    tmp_path: Path, name: str, content: str, said: str
) -> None:
    text = refusal(tmp_path / name, content)
    assert said in text
    assert "again" in text
    assert not any(word in text for word in ("reshape", "string or file", "axis 0", "billion"))


def test_a_binary_ply_that_is_cut_off_is_told_so(tmp_path: Path) -> None:
    path = tmp_path / "ball.ply"
    path.write_bytes(trimesh.creation.icosphere(1).export(file_type="ply")[:-5])
    with pytest.raises(MeshError, match="it is not as long as its head says"):
        load_mesh(path, 1e-3)


def glb(path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """A box of 10 mm as GLB, its JSON changed."""
    data = trimesh.creation.box((0.01, 0.01, 0.01)).export(file_type="glb")
    size = int.from_bytes(data[12:16], "little")
    told, rest = json.loads(data[20 : 20 + size]), data[20 + size :]
    change(told)
    text = json.dumps(told).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    path.write_bytes(head + struct.pack("<I4s", len(text), b"JSON") + text + rest)
    return path


def position(told: dict[str, Any]) -> dict[str, Any]:
    """The accessor of the vertices."""
    index = told["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    found: dict[str, Any] = told["accessors"][index]
    return found


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda data: data[:3], "is no GLB: it does not begin with glTF"),
        (lambda data: data[:12], "is cut off within its head: 12 bytes"),
        (lambda data: data[:-1], "is cut off: it holds"),
        (lambda data: data[:4] + b"\3" + data[5:], "is a GLB of version 3, not 2"),
        (lambda data: data[:17] + b"X" + data[18:], "is damaged: its first chunk is no text"),
        (lambda data: data[:22] + b"\0" + data[23:], "is damaged: its text is no JSON"),
        (lambda data: data.replace(b'"bufferViews"', b'"nufferViews"'), "its text tells does not fit the bytes"),
    ],
)  # fmt: skip
def test_a_damaged_glb_is_refused_without_words_of_the_reader(
    tmp_path: Path, damage: Callable[[bytes], bytes], said: str
) -> None:
    path = glb(tmp_path / "box.glb", lambda _: None)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(MeshError, match=f"box.glb: .*{said}.*; copy or export it again"):
        load_mesh(path, "m")


DRACO = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda told: told.update(extensionsRequired=["KHR_draco_mesh_compression"]),
         "needs the extension KHR_draco_mesh_compression, which is not read; export it without compression"),
        (lambda told: told.update(extensionsRequired=["EXT_meshopt_compression"]),
         "needs the extension EXT_meshopt_compression, which is not read; export it without compression"),
        (lambda told: told.update(extensionsRequired=["KHR_mesh_quantization", "X_y"]),
         "needs the extension X_y, which is not read; export it without"),
        (lambda told: told["nodes"][-1].update(extensions={"EXT_mesh_gpu_instancing": {}}),
         "uses the extension EXT_mesh_gpu_instancing, which is not read; export every instance as a node of its own"),
        (lambda told: position(told).update(sparse={"count": 1}),
         "mesh 0: accessor 1 is sparse, which is not read; export it without sparse accessors"),
        (lambda told: position(told).update(normalized=True, componentType=5122),
         "mesh 0: accessor 1 holds normalized integers, which are not read; export it with positions as float"),
        (lambda told: position(told).pop("bufferView"),
         "mesh 0: accessor 1 has no numbers of its own; export it without compression"),
        (lambda told: told["meshes"][0]["primitives"].append({**told["meshes"][0]["primitives"][0], "mode": 6}),
         "mesh 0: has a fan of triangles, which is not read; export single triangles"),
        (lambda told: told["meshes"][0].update(weights=[0.0, 0.5]),
         "mesh 0: has a shape blended in (weights), which is not read; apply it and export again"),
        (lambda told: told["nodes"][-1].update(skin=0),
         "mesh 0: is moved by bones (skin), which are not read; apply them and export again"),
        (lambda told: told["nodes"][-1].update(weights=[1.0]),
         "mesh 0: has a shape blended in (weights), which is not read; apply it and export again"),
    ],
)  # fmt: skip
def test_a_glb_whose_reader_would_read_it_wrongly_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], change: Any, said: str
) -> None:
    path = glb(tmp_path / "box.glb", change)
    with pytest.raises(MeshError) as caught:
        load_mesh(path, "m")
    assert str(caught.value) == f"{path}: {said}"
    assert capfd.readouterr().err == ""


def test_a_glb_with_extensions_that_change_nothing_is_read_in_silence(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def change(told: dict[str, Any]) -> None:
        told["extensionsRequired"] = ["KHR_mesh_quantization", "KHR_materials_unlit"]
        told["extensionsUsed"] = [*told["extensionsRequired"], *DRACO]
        told["meshes"][0]["primitives"][0]["extensions"] = DRACO
        told["meshes"][0]["weights"] = [1.0]
        told["nodes"][-1]["weights"] = [0.0]
        told["skins"] = [{"joints": [0]}]  # of no mesh

    assert len(load_mesh(glb(tmp_path / "box.glb", change), "m").triangles) == 12
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("code", ["latin-1", "cp1252", "shift-jis", "utf-8"])
@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".off"])
def test_a_name_or_comment_in_another_encoding_is_passed_over(
    tmp_path: Path, ply: str, suffix: str, code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for guesser in ("chardet", "charset_normalizer"):  # users need not have what guesses encodings
        monkeypatch.setitem(sys.modules, guesser, None)
    name = ("\u90e8\u54c1" if code == "shift-jis" else "Geh\u00e4use").encode(code)
    ball = trimesh.creation.icosphere(1, radius=10.0)
    stl = trimesh.exchange.stl.export_stl_ascii(ball).encode()
    path = tmp_path / f"part{suffix}"
    path.write_bytes(
        {
            ".stl": b"solid " + name + stl[len(b"solid") :],
            ".obj": b"# " + name + b"\no " + name + b"\n" + ball.export(file_type="obj").encode(),
            ".ply": ply.encode().replace(b"1.0\n", b"1.0\ncomment " + name + b"\n", 1),
            ".off": b"OFF\n# " + name + ball.export(file_type="off").encode()[len(b"OFF") :],
        }[suffix]
    )
    assert len(load_mesh(path, 1e-3).triangles) == 80


def test_a_binary_ply_with_a_comment_in_another_encoding_is_read(tmp_path: Path) -> None:
    data = trimesh.creation.icosphere(1, radius=10.0).export(file_type="ply")
    path = tmp_path / "ball.ply"
    path.write_bytes(data.replace(b" 1.0\n", b" 1.0\ncomment \xe4\n", 1))
    assert len(load_mesh(path, 1e-3).triangles) == 80


@pytest.mark.parametrize(("before", "after"), [("", " \n" * 1500), ("\n" * 3000, "")])
def test_blanks_round_an_stl_in_text_are_passed_over(
    tmp_path: Path, before: str, after: str
) -> None:
    path = tmp_path / "box.stl"
    text = trimesh.exchange.stl.export_stl_ascii(trimesh.creation.box())
    path.write_text(f"{before}{text}{after}", encoding="ascii")
    assert len(load_mesh(path, "m").triangles) == 12


def test_an_stl_in_text_without_facets_has_no_triangles(tmp_path: Path) -> None:
    said = refusal(tmp_path / "a.stl", "solid a\nendsolid a\n")
    assert said == "has no triangles; export the surface, not points or curves"


def test_a_binary_stl_of_another_name_is_told_so(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_bytes(trimesh.creation.box().export(file_type="stl"))
    with pytest.raises(MeshError, match=r"is no OBJ but a binary STL; name it \.stl"):
        load_mesh(path, "m")
