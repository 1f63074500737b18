/* cr_search and cr_feel in threads of their own. A program by itself: two threads at once spoil the counts of a coverage build. */
#include "contact/math3.h"
#include "image_builder.h"

#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <string.h>
#include <time.h>

#include <cmocka.h>

#define HALF_M 8e-3
#define STIFFNESS_N_M 1000.0f
/* The distances of the image are rounded to this, and the force with them. */
#define ROUNDING_N 2e-3f

/* How long the other thread may take for its answers on a busy machine. */
#define PATIENCE_S 60

static crt_rig wall;

static int open_wall(void **state) {
    (void)state;
    const crt_solid flat = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    cr_config config = cr_config_default();
    config.stiffness_N_m = STIFFNESS_N_M;
    crt_open_cube(&wall, &flat, HALF_M, 0.5e-3, 2e-3);
    crt_restart(&wall, &config);
    return 0;
}

static int close_wall(void **state) {
    (void)state;
    crt_close(&wall);
    return 0;
}

static _Atomic int ended;

static void *search_on(void *rig) {
    while (!atomic_load(&ended)) {
        (void)cr_search(((const crt_rig *)rig)->world, 40u);
    }
    return NULL;
}

static void feel_and_search_in_two_threads_answer_the_pose_at_hand(void **state) {
    (void)state;
    pthread_t thread;
    uint32_t felt = 0u, answers = 0u, before = 0u;
    atomic_store(&ended, 0);
    assert_int_equal(pthread_create(&thread, NULL, search_on, &wall), 0);
    const time_t until = time(NULL) + PATIENCE_S;
    for (int i = 0; answers < 2000u && time(NULL) < until; i++) {
        const double depth = 1e-3 + 0.5e-3 * sin(1e-3 * i);
        const cr_pose pose = crt_pose(0.0, 0.0, HALF_M - depth);
        cr_output out;
        cr_feel(wall.world, &pose, 1e-3f, &out);
        felt += out.area_count > 0u;
        answers += out.stats.late_ticks <= before;
        before = out.stats.late_ticks;
        if (before > 100u) {
            sched_yield(); /* one processor for both */
        }
        if (felt > 0u) {
            assert_float_equal(out.force_world_N.z, STIFFNESS_N_M * (float)depth, ROUNDING_N);
        }
    }
    atomic_store(&ended, 1);
    assert_int_equal(pthread_join(thread, NULL), 0);
    assert_true(felt > 100u && answers == 2000u);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(feel_and_search_in_two_threads_answer_the_pose_at_hand)};
    return cmocka_run_group_tests(tests, open_wall, close_wall);
}
