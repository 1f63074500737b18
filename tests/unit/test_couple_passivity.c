/* The controller of six axes: nothing while the loop is passive, energy taken back where it is not, limits, faults. */
#include "couple/couple_parts.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#define T 1e-3f

static cr_couple_passivity made(const cr_couple_passivity_config *config) {
    cr_couple_passivity p;
    assert_int_equal(cr_couple_passivity_init(&p, config), CR_OK);
    return p;
}

static cr_pose at(float x, float turn_z) {
    const cr_pose pose = {{x, 0.0f, 0.0f}, {cosf(0.5f * turn_z), 0.0f, 0.0f, sinf(0.5f * turn_z)}};
    return pose;
}

static cr_couple_output feels(float fx, float tz) {
    cr_couple_output felt;
    memset(&felt, 0, sizeof felt);
    felt.force_world_N.x = fx;
    felt.torque_world_Nm.z = tz;
    felt.pressing = 1u;
    return felt;
}

static cr_couple_wrench step(cr_couple_passivity *p, float x, float turn_z, float fx, float tz) {
    const cr_pose pose = at(x, turn_z);
    const cr_couple_output felt = feels(fx, tz);
    cr_couple_wrench w;
    cr_couple_passivity_step(p, &pose, T, &felt, &w);
    return w;
}

static void assert_nothing(const cr_couple_wrench *w, uint32_t faults) {
    const cr_couple_wrench none = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f, 0u, faults};
    assert_memory_equal(w, &none, sizeof none);
}

/* ----------------------------------------------------------------------------------------------------- passive */

static void passive_loop_is_not_touched(void **state) {
    (void)state;
    const cr_couple_passivity_config config = cr_couple_passivity_config_default();
    cr_couple_passivity p = made(&config);
    for (int k = 0; k < 4000; k++) { /* springs with so much damping that they lose in every stroke */
        const float a = 0.004f * (float)k, x = 0.005f - 0.005f * cosf(a), turn = 0.1f * sinf(0.5f * a);
        const float v = 0.02f * sinf(a), w = 0.2f * cosf(0.5f * a);
        const float f = -500.0f * x - 20.0f * v, t = -2.0f * turn - 0.02f * w;
        const cr_couple_wrench out = step(&p, x, turn, f, t);
        assert_true(out.force_world_N.x == f && out.torque_world_Nm.z == t);
        assert_int_equal(out.limits, 0);
        assert_true(out.energy_J <= 0.0f);
    }
}

static void controller_that_is_off_counts_only(void **state) {
    (void)state;
    cr_couple_passivity_config config = cr_couple_passivity_config_default();
    config.damping_max_Ns_m = 0.0f;
    cr_couple_passivity p = made(&config);
    cr_couple_wrench out = step(&p, 0.0f, 0.0f, 2.0f, 0.0f);
    for (int k = 1; k <= 100; k++) {
        out = step(&p, 1e-4f * (float)k, 0.0f, 2.0f, 0.0f);
        assert_true(out.force_world_N.x == 2.0f && out.limits == 0u);
    }
    assert_true(fabsf(out.energy_J - 2.0f * 99e-4f) < 1e-6f); /* the first wrench acts a period late */
}

static void work_is_that_of_the_wrench_that_acted(void **state) {
    (void)state;
    for (uint32_t delay = 0; delay <= CR_COUPLE_DELAY_MAX; delay += 4u) {
        cr_couple_passivity_config config = cr_couple_passivity_config_default();
        config.delay_ticks = delay;
        config.damping_max_Ns_m = 0.0f;
        cr_couple_passivity p = made(&config);
        double expected = 0.0;
        for (int k = 0; k < 40; k++) {
            const float x = 1e-3f * (float)k, turn = 2e-3f * (float)k;
            const cr_couple_wrench out = step(&p, x, turn, 1.0f + (float)k, 0.01f * (float)k);
            const int sent = k - 1 - (int)delay;
            expected += sent >= 0 && k > 0 ? 1e-3 * (1.0 + sent <= 20.0 ? 1.0 + sent : 20.0) +
                                                 2e-3 * 0.01 * sent * (1.0 + sent <= 20.0 ? 1.0 : 20.0 / (1.0 + sent))
                                           : 0.0;
            assert_true(fabs((double)out.energy_J - expected) < 1e-5 * (1.0 + expected));
        }
    }
}

/* ------------------------------------------------------------------------------------------------------ active */

/* Energy that a push of constant wrench along a motion has given in the end. */
static float given(float damping_max, float fx, float tz) {
    cr_couple_passivity_config config = cr_couple_passivity_config_default();
    config.damping_max_Ns_m = damping_max;
    cr_couple_passivity p = made(&config);
    float most = 0.0f;
    for (int k = 0; k < 200; k++) {
        const cr_couple_wrench out = step(&p, 1e-4f * (float)k, 1e-3f * (float)k, fx, tz);
        assert_true(out.force_world_N.x >= 0.0f && out.force_world_N.x <= fx);
        assert_true(fabsf(out.force_world_N.x * tz - out.torque_world_Nm.z * fx) < 1e-6f); /* the same direction */
        most = out.energy_J;
    }
    return most;
}

static void excess_along_and_about_is_held_back(void **state) {
    (void)state;
    const float along = given(0.0f, 3.0f, 0.0f), turning = given(0.0f, 0.0f, 0.3f), both = given(0.0f, 3.0f, 0.3f);
    assert_true(given(1e4f, 3.0f, 0.0f) < 0.6f * along);
    assert_true(given(1e4f, 0.0f, 0.3f) < 0.6f * turning);
    assert_true(given(1e4f, 3.0f, 0.3f) < 0.6f * both);
    assert_true(given(10.0f, 3.0f, 0.0f) < along); /* bounded damping takes less */
    assert_true(given(10.0f, 3.0f, 0.0f) > given(1e4f, 3.0f, 0.0f));
}

static void excess_is_damped_on_the_way_in_too_and_not_at_rest(void **state) {
    (void)state;
    cr_couple_passivity_config config = cr_couple_passivity_config_default();
    config.damping_max_Ns_m = 10.0f;
    cr_couple_passivity p = made(&config);
    cr_couple_wrench out = step(&p, 0.0f, 0.0f, 1.0f, 0.0f);
    for (int k = 1; k <= 20; k++) {
        out = step(&p, 1e-3f * (float)k, 0.0f, 1.0f, 0.0f);
    }
    assert_true(out.energy_J > 0.0f);
    for (int k = 0; k < 60; k++) {
        out = step(&p, 0.02f, 0.0f, 1.0f, 0.0f);
    }
    assert_true(out.limits == 0u && out.force_world_N.x == 1.0f); /* at rest */
    for (int k = 1; k < 8; k++) {
        out = step(&p, 0.02f - 1e-5f * (float)k, 0.0f, 1.0f, 0.0f);
    }
    assert_true(out.limits == CR_COUPLE_LIMIT_PASSIVITY &&
                out.force_world_N.x > 1.0f); /* into the wall: it takes energy */
    assert_true(out.force_world_N.x <= 1.0f + 10.0f * 0.011f);
}

/* A mass of 1.6 kg against a spring that is sampled, held, and a period late.   Output  the most it has of its speed before, in later strokes. */
static double thrown_back(float damping_max) {
    cr_couple_passivity_config config = cr_couple_passivity_config_default();
    config.damping_max_Ns_m = damping_max;
    cr_couple_passivity p = made(&config);
    double x = 0.01, v = -0.1, acting = 0.0, next = 0.0;
    for (int k = 0; k < 2000 && !(v > 0.0 && x > 0.0); k++) {
        acting = next;
        next = (double)step(&p, (float)x, 0.0f, x < 0.0 ? (float)(-3000.0 * x) : 0.0f, 0.0f).force_world_N.x;
        for (int i = 0; i < 10; i++) {
            v += 1e-4 * acting / 1.6;
            x += 1e-4 * v;
        }
    }
    return v / 0.1;
}

static void mass_comes_back_slower_with_the_controller(void **state) {
    (void)state;
    assert_true(thrown_back(0.0f) > 1.05);
    assert_true(thrown_back(30.0f) < 1.0 + 0.75 * (thrown_back(0.0f) - 1.0));
}

static void own_friction_burns_an_excess_and_no_credit(void **state) {
    (void)state;
    cr_couple_passivity_config config = cr_couple_passivity_config_default();
    config.damping_max_Ns_m = 0.0f;
    config.own_damping_Ns_m = 2.0f;
    config.own_damping_Nms_rad = 0.01f;
    cr_couple_passivity p = made(&config);
    cr_couple_wrench out = step(&p, 0.0f, 0.0f, 0.15f, 0.0f);
    for (int k = 1; k <= 50; k++) { /* 0.1 m/s: 0.15 N give 15 mW, friction takes 20; then 1 rad/s: 10 mW, given 5 */
        out = step(&p, 1e-4f * (float)k, 0.0f, 0.15f, 0.0f);
        assert_true(k < 30 || out.energy_J <= 1e-9f);
    }
    for (int k = 1; k <= 50; k++) {
        out = step(&p, 5e-3f, 1e-3f * (float)k, 0.0f, 0.005f);
    }
    assert_true(out.energy_J <= 1e-9f);
    for (int k = 1; k <= 50; k++) {
        out = step(&p, 5e-3f, 0.05f - 1e-3f * (float)k, 0.0f, 0.005f);
    }
    assert_true(fabsf(out.energy_J + 0.005f * 0.05f) < 1e-6f); /* what it took stays */
}

static void account_is_closed_when_the_contact_is_over(void **state) {
    (void)state;
    const cr_couple_passivity_config config = cr_couple_passivity_config_default();
    cr_couple_passivity p = made(&config);
    cr_couple_wrench out = step(&p, 0.0f, 0.0f, 1.0f, 0.0f);
    for (int k = 1; k <= 10; k++) {
        out = step(&p, -1e-3f * (float)k, 0.0f, 1.0f, 0.0f);
    }
    assert_true(out.energy_J < -8e-3f);
    out = step(&p, -0.011f, 0.0f, 0.0f, 0.0f);
    out = step(&p, -0.012f, 0.0f, 0.0f, 0.0f);
    assert_true(out.energy_J < -8e-3f); /* the last wrench has just acted */
    for (int k = 0; k < 5; k++) {
        out = step(&p, -0.013f, 0.0f, 0.0f, 0.0f);
        assert_true(out.energy_J == 0.0f);
    }
}

/* ---------------------------------------------------------------------------------------------- limits, faults */

static void limits_keep_the_ratio_of_force_and_torque(void **state) {
    (void)state;
    cr_couple_passivity_config config = cr_couple_passivity_config_default();
    cr_couple_passivity p = made(&config);
    cr_couple_wrench out = step(&p, 0.0f, 0.0f, 40.0f, 0.5f);
    assert_true(fabsf(out.force_world_N.x - 20.0f) < 1e-4f && fabsf(out.torque_world_Nm.z - 0.25f) < 1e-6f);
    assert_int_equal(out.limits, CR_COUPLE_LIMIT_FORCE);
    out = step(&p, 0.0f, 0.0f, 10.0f, 4.0f);
    assert_true(fabsf(out.force_world_N.x - 2.5f) < 1e-5f && fabsf(out.torque_world_Nm.z - 1.0f) < 1e-6f);
    assert_int_equal(out.limits, CR_COUPLE_LIMIT_TORQUE);
    out = step(&p, 0.0f, 0.0f, 100.0f, 50.0f);
    assert_true(out.force_world_N.x <= 20.0f && out.torque_world_Nm.z <= 1.000001f);
    assert_int_equal(out.limits, CR_COUPLE_LIMIT_FORCE | CR_COUPLE_LIMIT_TORQUE);
}

static void bad_input_leaves_nothing_until_a_reset(void **state) {
    (void)state;
    const cr_couple_passivity_config config = cr_couple_passivity_config_default();
    for (int bad = 0; bad < 7; bad++) {
        cr_couple_passivity p = made(&config);
        (void)step(&p, 0.0f, 0.0f, 1.0f, 0.0f);
        cr_pose pose = at(0.0f, 0.0f);
        cr_couple_output felt = feels(1.0f, 0.1f);
        pose.pos_m.y = bad == 0 ? NAN : bad == 1 ? INFINITY : 0.0f;
        pose.rot.w = bad == 2 ? NAN : 1.0f;
        felt.force_world_N.z = bad == 3 ? INFINITY : 0.0f;
        felt.torque_world_Nm.x = bad == 4 ? NAN : 0.0f;
        felt.faults = bad == 6 ? (uint32_t)CR_COUPLE_FAULT_CONTACT : 0u;
        const float period_s = bad == 5 ? 1.5f : T;
        const uint32_t faults = bad < 5    ? (uint32_t)CR_FAULT_NUMBER
                                : bad == 5 ? (uint32_t)CR_FAULT_PERIOD
                                           : (uint32_t)CR_COUPLE_FAULT_CONTACT;
        cr_couple_wrench out;
        cr_couple_passivity_step(&p, &pose, period_s, &felt, &out);
        assert_nothing(&out, faults);
        out = step(&p, 0.0f, 0.0f, 1.0f, 0.0f);
        assert_nothing(&out, faults); /* it latches */
        cr_couple_passivity_reset(&p);
        assert_true(step(&p, 0.0f, 0.0f, 1.0f, 0.0f).force_world_N.x == 1.0f);
    }
}

/* A clock that stands, nearly: no speed is a number then. */
static void energy_that_is_no_number_is_a_fault(void **state) {
    (void)state;
    cr_couple_passivity_config config = cr_couple_passivity_config_default();
    config.own_damping_Ns_m = 1.0f;
    cr_couple_passivity p = made(&config);
    const cr_couple_output felt = feels(1.0f, 0.0f);
    cr_couple_wrench out;
    cr_pose pose = at(0.0f, 0.0f);
    for (int k = 0; k < 20; k++) {
        pose.pos_m.x += k < 4 ? 1e-3f : 0.0f;
        cr_couple_passivity_step(&p, &pose, 1e-40f, &felt, &out);
    }
    assert_nothing(&out, CR_FAULT_NUMBER);
}

static void settings_are_checked(void **state) {
    (void)state;
    cr_couple_passivity p;
    const cr_couple_passivity_config good = cr_couple_passivity_config_default();
    assert_null(cr_couple_passivity_config_error(&good));
    assert_int_equal(cr_couple_passivity_init(NULL, &good), CR_ERR_NULL);
    assert_int_equal(cr_couple_passivity_init(&p, NULL), CR_ERR_NULL);
    for (int bad = 0; bad < 7; bad++) {
        cr_couple_passivity_config c = good;
        float *const members[] = {&c.reach_m,     &c.damping_max_Ns_m, &c.own_damping_Ns_m, &c.own_damping_Nms_rad,
                                  &c.force_max_N, &c.torque_max_Nm};
        if (bad < 6) {
            *members[bad] = bad % 2 == 0 ? NAN : -1.0f;
        } else {
            c.delay_ticks = CR_COUPLE_DELAY_MAX + 1u;
        }
        assert_non_null(cr_couple_passivity_config_error(&c));
        assert_int_equal(cr_couple_passivity_init(&p, &c), CR_ERR_CONFIG);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(passive_loop_is_not_touched),
        cmocka_unit_test(controller_that_is_off_counts_only),
        cmocka_unit_test(work_is_that_of_the_wrench_that_acted),
        cmocka_unit_test(excess_along_and_about_is_held_back),
        cmocka_unit_test(excess_is_damped_on_the_way_in_too_and_not_at_rest),
        cmocka_unit_test(mass_comes_back_slower_with_the_controller),
        cmocka_unit_test(own_friction_burns_an_excess_and_no_credit),
        cmocka_unit_test(account_is_closed_when_the_contact_is_over),
        cmocka_unit_test(limits_keep_the_ratio_of_force_and_torque),
        cmocka_unit_test(bad_input_leaves_nothing_until_a_reset),
        cmocka_unit_test(energy_that_is_no_number_is_a_fault),
        cmocka_unit_test(settings_are_checked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
