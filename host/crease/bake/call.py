"""`crease.bake`: two meshes into a scene that is open."""

from __future__ import annotations

from collections.abc import Callable

from crease.bake.bake import BakeOptions, bake_scene
from crease.bake.bodies import pack_bodies
from crease.base.arguments import check_number, check_positive
from crease.base.errors import MeshError
from crease.base.scene import Scene, open_image
from crease.mesh.mesh import Mesh


def bake(
    static: Mesh,
    tool: Mesh,
    *,
    spacing_m: float | None = None,
    voxel_m: float | None = None,
    crease_angle_deg: float = 30.0,
    tolerance_m: float | None = None,
    depth_max_m: float | None = None,
    even: bool = False,
    image_max_bytes: int | None = None,
    memory_max_bytes: int | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Scene:
    """Bake a mock-up at rest and a tool into a scene.

    static, tool: what `load_mesh` or `make_mesh` gave: closed surfaces, vertices_m (n, 3) and triangles (m, 3); the
    frame of static becomes the world, that of tool the one that poses move.
    spacing_m: distance between samples of the tool; None: 1/30 of its middle size, at most about 20,000 samples.
    voxel_m: side of a voxel; None: the spacing, at least 1/600 of the mock-up. crease_angle_deg: 0 to 180, edges
    that turn more are creases. tolerance_m: refine until the distance error near the surface is below this; None: a
    quarter of a voxel. depth_max_m: how far the tool goes in; what lies deeper is kept roughly.
    even: cut the tool by area alone, whatever its triangles: for one that is held in six degrees of freedom.
    image_max_bytes: choose voxels for an image of at most this size. memory_max_bytes: refuse work that takes more;
    None: half of the machine's. progress: called with what is done and the part of the whole
    bake that is, 0..1.

    Units    m, degrees, bytes.
    Output   a scene as `crease bake` makes it, to the byte; `warnings` holds what there is to say of it, and of the
             meshes.
    Errors   MeshError naming the argument: out of range, sizes that do not fit together, more memory than may be.
    Cost     about a second for small parts, minutes for a million triangles.
    Source   host/crease/bake/README.md "Voxmap" and "Point shell".
    """
    for name, mesh in (("static", static), ("tool", tool)):
        if not isinstance(mesh, Mesh):
            raise MeshError(
                f"{name} is a {type(mesh).__name__}, not a mesh; give load_mesh(path, unit)"
            )
    for name, value, unit in (
        ("spacing_m", spacing_m, "a number of metres"),
        ("voxel_m", voxel_m, "a number of metres"),
        ("tolerance_m", tolerance_m, "a number of metres"),
        ("depth_max_m", depth_max_m, "a number of metres"),
        ("image_max_bytes", image_max_bytes, "a number of bytes"),
        ("memory_max_bytes", memory_max_bytes, "a number of bytes"),
    ):
        if value is not None:
            check_positive(name, value, unit, MeshError)
    check_number("crease_angle_deg", crease_angle_deg, 0.0, 180.0, "degrees", MeshError)
    options = BakeOptions(
        voxel_m=voxel_m,
        spacing_m=spacing_m,
        crease_angle_deg=crease_angle_deg,
        tolerance_m=tolerance_m,
        memory_max_bytes=memory_max_bytes,
        image_max_bytes=image_max_bytes,
        depth_max_m=depth_max_m,
        even=even,
    )
    made = bake_scene(static, tool, options, progress)
    said = (*static.warnings, *tool.warnings, *made.warnings)
    source = f"{static.source} and {tool.source}"
    return open_image(made.image, source, pack_bodies(static, tool), said)
