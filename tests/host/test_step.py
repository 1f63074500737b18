"""STEP files: a box written by formula comes back with its size, its unit and its volume."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crease.base.errors import MeshError
from crease.mesh import topology
from crease.mesh.mesh import load_mesh

pytest.importorskip("cascadio")

Place = tuple[int, int, int]
HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('box','2026-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));
ENDSEC;
DATA;
"""


class StepBox:
    """A box from the origin, in mm, as an AP214 boundary representation."""

    def __init__(self, sides_mm: tuple[float, float, float]) -> None:
        self.sides = np.array(sides_mm)
        self.lines: list[str] = []
        self.edges: dict[tuple[Place, Place], str] = {}
        corners = [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
        self.vertices = {c: self.add(f"VERTEX_POINT('',{self.point(c)})") for c in corners}
        faces = [self.face(axis, end) for axis in range(3) for end in (0, 1)]
        shell = self.add(f"CLOSED_SHELL('',({','.join(faces)}))")
        self.product(self.add(f"MANIFOLD_SOLID_BREP('',{shell})"))

    def add(self, text: str) -> str:
        self.lines.append(f"#{len(self.lines) + 1}={text};")
        return f"#{len(self.lines)}"

    def numbers(self, kind: str, values: object) -> str:
        row = ",".join(repr(float(x)) for x in np.asarray(values).tolist())
        return self.add(f"{kind}('',({row}))")

    def point(self, corner: Place) -> str:
        return self.numbers("CARTESIAN_POINT", self.sides * corner)

    def frame(self, corner: Place, z: list[int], x: list[int]) -> str:
        z_id, x_id = self.numbers("DIRECTION", z), self.numbers("DIRECTION", x)
        return self.add(f"AXIS2_PLACEMENT_3D('',{self.point(corner)},{z_id},{x_id})")

    def edge(self, a: Place, b: Place) -> str:
        way = ".F." if (b, a) in self.edges else ".T."
        if way == ".T.":
            along = self.sides * (np.array(b) - np.array(a))
            length = float(np.linalg.norm(along))
            vector = self.add(f"VECTOR('',{self.numbers('DIRECTION', along / length)},{length!r})")
            line = self.add(f"LINE('',{self.point(a)},{vector})")
            self.edges[a, b] = self.add(
                f"EDGE_CURVE('',{self.vertices[a]},{self.vertices[b]},{line},.T.)"
            )
        curve = self.edges[(a, b) if way == ".T." else (b, a)]
        return self.add(f"ORIENTED_EDGE('',*,*,{curve},{way})")

    def face(self, axis: int, end: int) -> str:
        u, v = (axis + 1) % 3, (axis + 2) % 3
        corners: list[Place] = []
        for p, q in ((0, 0), (1, 0), (1, 1), (0, 1)):
            at = [0, 0, 0]
            at[axis], at[u], at[v] = end, p, q
            corners.append((at[0], at[1], at[2]))
        corners = corners if end else corners[::-1]
        edges = [self.edge(c, corners[(i + 1) % 4]) for i, c in enumerate(corners)]
        loop = self.add(f"EDGE_LOOP('',({','.join(edges)}))")
        bound = self.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        z, x = [0, 0, 0], [0, 0, 0]
        z[axis], x[u] = (1 if end else -1), 1
        plane = self.add(f"PLANE('',{self.frame(corners[0], z, x)})")
        return self.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)")

    def product(self, solid: str) -> None:
        mm = self.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")
        rad = self.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
        sr = self.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
        near = self.add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),{mm},'','')")
        context = self.add(
            f"(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({near}))"
            f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({mm},{rad},{sr}))REPRESENTATION_CONTEXT('',''))"
        )
        frame = self.frame((0, 0, 0), [0, 0, 1], [1, 0, 0])
        shape = self.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({frame},{solid}),{context})")
        app = self.add("APPLICATION_CONTEXT('automotive design')")
        usage = self.add(f"PRODUCT_CONTEXT('',{app},'mechanical')")
        product = self.add(f"PRODUCT('box','box','',({usage}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        design = self.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{app},'design')")
        definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},{design})")
        of = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        self.add(f"SHAPE_DEFINITION_REPRESENTATION({of},{shape})")

    def text(self) -> str:
        return HEAD + "\n".join(self.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"


@pytest.mark.parametrize("unit_m", [1e-3, 0.0254])
def test_a_step_box_has_its_own_size_whatever_the_unit(tmp_path: Path, unit_m: float) -> None:
    path = tmp_path / "box.step"
    path.write_text(StepBox((30.0, 20.0, 10.0)).text())
    mesh = load_mesh(path, unit_m)
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx([0.03, 0.02, 0.01], rel=1e-6)
    assert topology.volumes_m3(mesh.vertices_m, mesh.triangles).sum() == pytest.approx(6e-6)
    assert mesh.warnings == ()


def test_a_damaged_step_is_refused_on_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "box.stp"
    path.write_text(StepBox((30.0, 20.0, 10.0)).text()[:2000])
    with pytest.raises(MeshError, match=r"box\.stp: .*STEP") as caught:
        load_mesh(path, 1e-3)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")  # nor does its reader say anything
