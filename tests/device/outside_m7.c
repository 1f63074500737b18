/* A project that has crease from its pack only, on an emulated Cortex-M7: a path through a scene, force and torque of each tick into felt.bin.
 * The scene's memory is filled from outside: sizes of scene and path, the scene at 64, the path at the next multiple of 64. */
#include "semihost.h"

#include <crease.h>

#define STATE_MAX (128u * 1024u)

extern const uint8_t _scene_start[];

static int fail(const char *text) {
    semihost_print(text);
    semihost_print("\n");
    return 1;
}

int main(void);

int main(void) {
    static _Alignas(64) uint8_t memory[STATE_MAX];
    static cr_output out;
    const uint32_t *sizes = (const uint32_t *)(const void *)_scene_start;
    const cr_pose *poses = (const cr_pose *)(const void *)(_scene_start + 64u + (sizes[0] + 63u) / 64u * 64u);
    const cr_config config = cr_config_default();
    cr_scene scene;
    cr_world *world;
    cr_err err = cr_version() == CR_VERSION ? CR_OK : CR_ERR_VERSION;
    err = err != CR_OK ? err : cr_scene_open(&scene, _scene_start + 64u, sizes[0]);
    err = err != CR_OK ? err : cr_world_init(&world, memory, sizeof memory, &scene, &config);
    if (err != CR_OK) {
        return fail(cr_err_text(err));
    }
    const int file = semihost_create("felt.bin");
    if (file < 0) {
        return fail("felt.bin cannot be written");
    }
    for (uint32_t i = 0; i < sizes[1]; i++) {
        cr_tick(world, &poses[i], 1e-3f, &out);
        const cr_vec3 felt[2] = {out.force_world_N, out.torque_world_Nm};
        if (semihost_write(file, felt, sizeof felt) != 0) {
            return fail("felt.bin cannot be written");
        }
    }
    semihost_close(file);
    return 0;
}
