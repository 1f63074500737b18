"""What the experiments share: where meshes and images are, what a result is, and how its files are written."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from crease.bake.scene_list import is_newer
from crease.base.errors import CreaseError
from crease.base.scene import Scene, open_scene
from crease.base.table import write_atomic, write_bytes, write_table
from crease.mesh.mesh import Mesh, load_mesh
from crease.replay.trajectory import Trajectory, load_trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from crease.bake.bake import BakeOptions

F64 = npt.NDArray[np.float64]
MM = 1e-3
UNIT_M = 1e-3
"""The meshes of the experiments are in mm."""

TICK_S = 1e-3


def image_options(image: Mapping[str, Any]) -> BakeOptions:
    """What a scene of meshes/six asks of its image: `voxel_mm`, `spacing_mm`, perhaps `tolerance_mm` and `even`."""
    from crease.bake.bake import BakeOptions

    tolerance_mm = image.get("tolerance_mm")
    return BakeOptions(
        voxel_m=image["voxel_mm"] * MM,
        spacing_m=image["spacing_mm"] * MM,
        tolerance_m=None if tolerance_mm is None else tolerance_mm * MM,
        even=bool(image.get("even", False)),
    )


@dataclass(frozen=True)
class Table:
    """A short table: caption, heads of the columns, rows of text."""

    caption: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass
class Result:
    """What an experiment found. Figures and files are names in its folder; figures with a caption."""

    name: str
    title: str
    about: str
    tables: list[Table] = field(default_factory=list)
    figures: list[tuple[str, str]] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    found: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Setup:
    """Folders of meshes and of images already baked, the folder to write to, and how much to leave out.

    `every`: only each n-th pose of a path, for a quick look. `repeat`: runs of which timings are the least.
    """

    meshes: Path
    images: Path
    out: Path
    every: int = 1
    repeat: int = 20
    _meshes: dict[str, Mesh] = field(default_factory=dict, repr=False)
    _scenes: dict[tuple[str, str, tuple[float, ...]], Scene] = field(
        default_factory=dict, repr=False
    )

    def mesh(self, name: str) -> Mesh:
        """A mesh by name.   Errors: CreaseError, with how to make it."""
        path = self.meshes / f"{name}.stl"
        if not path.exists():
            raise CreaseError(
                f"{path}: is missing; run `make meshes`, or name its folder with --meshes"
            )
        if name not in self._meshes:
            self._meshes[name] = load_mesh(path, UNIT_M)
        return self._meshes[name]

    def path(self, name: str) -> Trajectory:
        """A recorded path by name, thinned out.   Errors: CreaseError."""
        file = self.meshes / f"{name}.csv"
        if not file.exists():
            raise CreaseError(
                f"{file}: is missing; run `make meshes`, or name its folder with --meshes"
            )
        whole = load_trajectory(file)
        return Trajectory(np.ascontiguousarray(self.thinned(whole.rows)), whole.source)

    def thinned(self, rows: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Each n-th row.   Errors: CreaseError when no step is left between two."""
        left = rows[:: self.every]
        self.check_left(len(left) >= 2, f"{len(left)} of the {len(rows):,} poses of a path")
        return left

    def check_left(self, enough: bool, left: str) -> None:
        """Errors: CreaseError, when what is left of a path is not enough."""
        if not enough:
            raise CreaseError(f"--every {self.every}: leaves {left}; take a smaller one")

    def scene(
        self,
        static: str,
        tool: str,
        voxel_mm: float,
        spacing_mm: float,
        tolerance_mm: float | None = None,
    ) -> Scene:
        """The image of two meshes: one that is there and of the same meshes, else baked into out/images.

        Images in out/images that are older than the code that bakes are baked again; the others are `make scenes`'s,
        which have the tolerance of their voxels.
        """
        sizes_mm = (voxel_mm, spacing_mm, *(() if tolerance_mm is None else (tolerance_mm,)))
        key = (static, tool, sizes_mm)
        if key not in self._scenes:
            self._scenes[key] = self._find_or_bake(static, tool, sizes_mm)
        return self._scenes[key]

    def _find_or_bake(self, static: str, tool: str, sizes_mm: tuple[float, ...]) -> Scene:
        from crease.bake.bake import BakeOptions, bake_scene

        meshes = self.mesh(static), self.mesh(tool)
        voxel_m, spacing_m, *tolerance_m = (size * MM for size in sizes_mm)
        sizes = "-".join(f"{size:g}" for size in sizes_mm)
        own = self.out / "images" / f"{static}-{tool}-{sizes}.crs"
        others = [] if tolerance_m else sorted(self.images.glob("*.crs"))
        candidates = [*([own] if is_newer(own) else []), *others]
        for image in candidates:
            if _is_of(image, meshes, voxel_m, spacing_m):
                return open_scene(image)
        own.parent.mkdir(exist_ok=True)
        options = BakeOptions(voxel_m, spacing_m, tolerance_m=next(iter(tolerance_m), None))
        write_bytes(own, bake_scene(*meshes, options, lambda _label, _part: None).image)
        return open_scene(own)

    def write_csv(self, result: Result, name: str, columns: Mapping[str, npt.NDArray[Any]]) -> None:
        """A CSV beside the figures."""
        write_table(self.out / name, columns)
        result.files.append(name)

    def write_figure(self, result: Result, name: str, figure: Figure, caption: str) -> None:
        """A figure as PNG."""
        from crease.draw.plot import save_figure

        write_atomic(self.out / name, lambda file: save_figure(figure, file, "png"))
        result.figures.append((name, caption))


def _is_of(image: Path, meshes: tuple[Mesh, Mesh], voxel_m: float, spacing_m: float) -> bool:
    """Whether an image was baked from these very files with these settings, by this version of the format."""
    try:
        scene = open_scene(image)
    except CreaseError:
        return False
    meta = scene.meta  # lies in the scene's memory
    digests = (bytes(meta.static_sha256).hex(), bytes(meta.tool_sha256).hex())
    sizes = np.array([meta.voxel_m, meta.spacing_m])
    return digests == tuple(m.digest_sha256 for m in meshes) and bool(
        np.allclose(sizes, [voxel_m, spacing_m], rtol=1e-5)
    )


def poses_of(path: Trajectory) -> F64:
    """x y z and quaternion of every row, (n, 7)."""
    return np.asarray(path.rows[:, 1:8], dtype=np.float64)


def make_path(poses: F64) -> Trajectory:
    """A path of poses (n, 7), one tick each."""
    times = TICK_S * np.arange(len(poses))
    return Trajectory(np.ascontiguousarray(np.column_stack([times, poses])), "made here")


def upright(position_m: F64) -> F64:
    """Poses (n, 7) at positions (n, 3), not turned."""
    return np.hstack([position_m, np.tile([1.0, 0.0, 0.0, 0.0], (len(position_m), 1))])


def machine() -> str:
    """Processor and system, in one line."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line for line in cpuinfo.read_text().splitlines() if line.startswith("model name")]
        model = names[0].split(":", 1)[1].strip() if names else model
    return f"{model}, {platform.system()} {platform.machine()}, one thread"


def text_rows(rows: Sequence[Sequence[object]]) -> tuple[tuple[str, ...], ...]:
    """Rows of a table as text; numbers with three significant digits."""

    def text(value: object) -> str:
        return f"{value:.3g}" if isinstance(value, float) else str(value)

    return tuple(tuple(text(v) for v in row) for row in rows)
