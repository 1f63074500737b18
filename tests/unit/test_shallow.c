/* Which hits are measured: those that may be deeper than what is known. Scenes of meshes: tests/property/test_shallow.py. */
#include "image_builder.h"
#include "shallow.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>

#include <cmocka.h>

#define HALF_M 8e-3
#define POSES 100

static crt_rig rig;
static cr_motion motion;
static shallow hits;

static void open_cube(const crt_solid *solid, int planes) {
    crt_open_cube(&rig, solid, HALF_M, 2e-3, 2e-3);
    if (planes) {
        const cr_config config = cr_config_default();
        crt_mark_planes(&rig);
        crt_seal(rig.image);
        assert_int_equal(cr_scene_open(&rig.scene, rig.image, rig.size_bytes), CR_OK);
        crt_restart(&rig, &config);
    }
    memset(&motion, 0, sizeof motion);
    motion.wake_count = rig.scene.group_count * CR_LANES;
    motion.wake_m = calloc(motion.wake_count, sizeof(float));
    hits.field = &rig.field;
    hits.motion = &motion;
}

static void close_cube(void) {
    free(motion.wake_m);
    crt_close(&rig);
}

/* Some degrees about any axis, and more about the vertical. */
static cr_quat lean(uint64_t *seed) {
    const double x = crt_uniform(seed, -0.04, 0.04), y = crt_uniform(seed, -0.04, 0.04);
    const double z = crt_uniform(seed, -0.4, 0.4), w = sqrt(1.0 - x * x - y * y - z * z);
    return (cr_quat){(float)w, (float)x, (float)y, (float)z};
}

/* Lying flat, leaning, anyhow; over one plane and over several that meet convexly and concavely, over a round surface, and through a thin wall. */
static void hits_that_are_passed_over_are_no_deeper(void **state) {
    (void)state;
    const crt_solid solids[] = {crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0),
                                crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0),
                                crt_wedge(1.0, 40e-3, 30e-3),
                                crt_room(-24e-3, 20e-3, 24e-3, -24e-3, 20e-3),
                                crt_box(-3e-3, 3e-3, 40e-3, -40e-3, 0.0),
                                crt_ball(15e-3)};
    const size_t count = sizeof solids / sizeof *solids;
    for (size_t s = 0; s < 2u * count; s++) {
        const crt_solid *solid = &solids[s % count];
        const int planes = s >= count;
        uint64_t seed = 7u + s;
        shallow_tally t = {0};
        if (planes && solid->ball_m > 0.0) {
            continue;
        }
        open_cube(solid, planes);
        for (int i = 0; i < POSES; i++) {
            cr_pose pose = crt_pose(crt_uniform(&seed, -22e-3, 22e-3), crt_uniform(&seed, -9e-3, 9e-3),
                                    crt_uniform(&seed, -12e-3, 22e-3));
            if (i % 3 != 0) {
                pose.rot = i % 3 == 1 ? crt_random_rotation(&seed) : lean(&seed);
            }
            shallow_compare(&hits, &pose, &t);
        }
        assert_true(t.deep > 15u && t.hits > 200u && t.together < 0.2 * t.alone);
        assert_true(t.short_m <= (double)CR_WAY_SLACK_M);
        close_cube();
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(hits_that_are_passed_over_are_no_deeper)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
