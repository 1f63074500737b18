/* Search and feel in threads of their own, of a world and of a servo. A program by itself: two threads at once spoil the counts of a coverage build. */
#include "contact/math3.h"
#include "image_builder.h"
#include "rise.h"
#include "servo_loop.h"

#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdlib.h>
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
    crt_rise first = {0u, 0u, 0, 0u};
    atomic_store(&ended, 0);
    assert_int_equal(pthread_create(&thread, NULL, search_on, &wall), 0);
    const time_t until = time(NULL) + PATIENCE_S;
    for (int i = 0; answers < 500u && time(NULL) < until; i++) {
        const double depth = 1e-3 + 0.5e-3 * sin(1e-3 * i);
        const cr_pose pose = crt_pose(0.0, 0.0, HALF_M - depth);
        cr_output out;
        cr_feel(wall.world, &pose, 1e-3f, &out);
        felt += out.area_count > 0u;
        answers += out.stats.late_ticks <= before;
        const int whole = crt_has_risen(&first, felt > 0u, before, out.stats.late_ticks);
        before = out.stats.late_ticks;
        if (before > 100u) {
            sched_yield(); /* one processor for both */
        }
        if (whole) {
            assert_float_equal(out.force_world_N.z, STIFFNESS_N_M * (float)depth, ROUNDING_N);
        }
    }
    atomic_store(&ended, 1);
    assert_int_equal(pthread_join(thread, NULL), 0);
    assert_true(felt > 100u && answers == 500u);
}

static _Atomic uint32_t searches; /* brought to their end */

static void *search_for_servo(void *servo) {
    while (!atomic_load(&ended)) {
        if (cr_servo_search(servo, 3u) == 0u) {
            atomic_fetch_add(&searches, 1u);
        }
    }
    return NULL;
}

/* A busy machine may run the other thread late: a loop of its own speed waits for it before the servo takes it for dead. */
static void wait_for_search(void) {
    const struct timespec nap = {0, 100000};
    const uint32_t before = atomic_load(&searches);
    for (int i = 0; i < 100000 && atomic_load(&searches) == before; i++) {
        nanosleep(&nap, NULL);
    }
}

/* The search at whatever speed this machine gives it: what was felt is felt again. */
static void run_of_a_servo_with_a_search_in_a_thread_runs_again_to_the_bit(void **state) {
    (void)state;
    pthread_t thread;
    cr_servo *again;
    cr_rerun result = {0};
    crt_loop l = crt_loop_make_beside(CR_LATE_MAX);
    uint32_t felt = 0u;
    l.search[1] = 0u;
    atomic_store(&ended, 0);
    assert_int_equal(pthread_create(&thread, NULL, search_for_servo, l.servo), 0);
    const time_t until = time(NULL) + PATIENCE_S;
    while (felt < 1000u && l.record_count < l.record_max && time(NULL) < until) {
        const cr_record *r = cr_servo_get_record(l.servo);
        cr_servo_input(l.servo, r->mode == CR_MODE_IDLE ? CR_COMMAND_START : 0u);
        cr_servo_input(l.servo, r->mode == CR_MODE_FAULT ? CR_COMMAND_CLEAR : 0u);
        l.target[2] = fmax(0.02, l.target[2] - 1e-4);
        crt_loop_period(&l);
        felt += r->contact_force_world_N.z > 0.0f;
        if (r->contact_late_ticks != CR_NOT_FELT && r->contact_late_ticks > 20u) {
            wait_for_search();
        }
    }
    atomic_store(&ended, 1);
    assert_int_equal(pthread_join(thread, NULL), 0);
    assert_true(felt >= 100u);
    const size_t size = cr_servo_size(crt_loop_scene(), &l.config);
    void *memory = aligned_alloc(64, (size + 63u) / 64u * 64u);
    assert_int_equal(cr_servo_init(&again, memory, size, crt_loop_scene(), &l.config), CR_OK);
    assert_int_equal(cr_servo_rerun(again, l.records, l.record_count, &result, NULL), CR_OK);
    assert_int_equal(result.records, l.record_count);
    assert_int_equal(result.different, 0);
    free(memory);
    crt_loop_free(&l);
}

static int open_both(void **state) { return open_wall(state) | crt_loop_build_scene(state); }
static int close_both(void **state) { return close_wall(state) | crt_loop_free_scene(state); }

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(feel_and_search_in_two_threads_answer_the_pose_at_hand),
        cmocka_unit_test(run_of_a_servo_with_a_search_in_a_thread_runs_again_to_the_bit),
    };
    return cmocka_run_group_tests(tests, open_both, close_both);
}
