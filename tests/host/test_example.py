"""The C example of README.md compiles without a warning, links with the firmware, and pushes."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
FIRMWARE = ROOT / "firmware"
EXAMPLE = re.findall(r"```c\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
SOURCES = sorted((FIRMWARE / "contact").glob("*.c"))
FLAGS = ["-std=c11", "-ffp-contract=off", "-fno-math-errno", "-O1"]

SCENE_S = """.section .rodata
.balign 64
.global scene_crs
.global scene_crs_end
scene_crs:
.incbin "{path}"
scene_crs_end:
.section .note.GNU-stack,"",@progbits
"""

MAIN_C = """#include "crease.h"
#include <stdio.h>
cr_err haptic_init(void);
uint32_t haptic_tick(const cr_pose *world_from_tool, cr_vec3 *force_world_N, cr_vec3 *torque_world_Nm);
int main(void) {
    const cr_pose pose = {{0.0f, 0.0f, 0.008f}, {1.0f, 0.0f, 0.0f, 0.0f}};
    cr_vec3 force, torque;
    const cr_err err = haptic_init();
    const uint32_t faults = err == CR_OK ? haptic_tick(&pose, &force, &torque) : 0u;
    if (err == CR_OK) {
        printf("%u %.4f %.4f %.4f", (unsigned)faults, (double)force.x, (double)force.y, (double)force.z);
    }
    return -(int)err;
}
"""


@pytest.mark.slow
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_example_of_the_readme_compiles_and_pushes(
    compiler: str, tmp_path: Path, scene_crs: Path
) -> None:
    """The ball of radius 10 mm stands 2 mm deep in the block: 2 N upwards at 1000 N/m."""
    assert len(EXAMPLE) == 1
    example, main = tmp_path / "example.c", tmp_path / "main.c"
    example.write_text(EXAMPLE[0], encoding="utf-8")
    main.write_text(MAIN_C, encoding="utf-8")
    (tmp_path / "scene.S").write_text(SCENE_S.format(path=scene_crs), encoding="utf-8")
    program = tmp_path / "example"
    command: list[str | Path] = [
        compiler,
        *FLAGS,
        "-Wall",
        "-Wextra",
        "-Werror",
        f"-I{FIRMWARE}",
        example,
        main,
    ]
    command += [tmp_path / "scene.S", *SOURCES, "-lm", "-o", program]
    subprocess.run(command, check=True)
    said = subprocess.run([program], capture_output=True, text=True, check=True).stdout.split()
    assert said[0] == "0"
    x, y, z = (float(v) for v in said[1:])
    assert abs(x) < 0.02
    assert abs(y) < 0.02
    assert abs(z - 2.0) < 0.05
