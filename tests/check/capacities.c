/* Replays a path with whatever capacities it was built with; fails unless every answer is finite and within limits.
 *
 *     capacities SCENE.crs PATH.bin RESPONSE COVERAGE SKIP
 *
 * PATH.bin holds rows of eight doubles, as cr_path_row. Prints `ticks touching overflowing largest-force-N`. */
#include "blob.h"
#include "crease.h"
#include "replay.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define FORCE_MAX_N 20.0f

static float norm_of(const float *v) { return sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

static int is_sound(const cr_replay_row *r) {
    const float force = norm_of(r->force_N), torque = norm_of(r->torque_Nm), place = norm_of(r->display_pos_m);
    return isfinite(force) && isfinite(torque) && isfinite(place) && isfinite(norm_of(r->normal)) &&
           r->depth_m >= 0.0f && isfinite(r->depth_m) && force <= FORCE_MAX_N * 1.0001f && r->areas <= CR_AREAS_MAX &&
           r->faults == 0;
}

int main(int argc, char **argv) {
    if (argc != 6) {
        fprintf(stderr, "usage: %s SCENE.crs PATH.bin RESPONSE COVERAGE SKIP\n", argv[0]);
        return 2;
    }
    const blob image = blob_read(argv[1]), path = blob_read(argv[2]);
    const size_t count = path.size / sizeof(cr_path_row);
    cr_config config = cr_config_default();
    config.response = (uint32_t)strtoul(argv[3], NULL, 10);
    config.coverage = (uint32_t)strtoul(argv[4], NULL, 10);
    config.skip = (uint32_t)strtoul(argv[5], NULL, 10);
    config.damping_Ns_m = 2.0f;
    config.force_max_N = FORCE_MAX_N;
    cr_scene scene;
    cr_world *world = NULL;
    cr_err err = cr_scene_open(&scene, image.bytes, image.size);
    const size_t size = err == CR_OK ? cr_world_size(&scene, &config) : 0;
    const blob memory = blob_make(size);
    cr_replay_row *rows = calloc(count + 1, sizeof *rows);
    err = err == CR_OK ? cr_world_init(&world, memory.bytes, memory.size, &scene, &config) : err;
    if (err != CR_OK || rows == NULL) {
        fprintf(stderr, "%s: %s\n", argv[1], cr_err_text(err));
        return 1;
    }
    cr_replay_run(world, path.bytes, count, 1e-3, rows);
    size_t touching = 0, over = 0;
    float most = 0.0f;
    for (size_t i = 0; i < count; i++) {
        if (!is_sound(&rows[i])) {
            fprintf(stderr, "tick %zu: not finite or out of limits\n", i);
            return 1;
        }
        touching += rows[i].areas > 0;
        over += rows[i].overflow > 0;
        most = fmaxf(most, norm_of(rows[i].force_N));
    }
    printf("%zu %zu %zu %g\n", count, touching, over, (double)most);
    free(rows);
    free(memory.bytes);
    free(path.bytes);
    free(image.bytes);
    return 0;
}
