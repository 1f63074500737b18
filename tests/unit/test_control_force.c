/* From force to torque: compensation, damping, limits and passivity, each by itself. */
#include "control_bench.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <cmocka.h>

#define PI 3.14159265358979323846

/* Every axis sampled in every period. */
static const uint32_t every[CR_AXES] = {1u, 1u, 1u};

/* -------------------------------------------------------------------------------------------------------- torque */

static void torque_is_the_transposed_jacobian_times_force(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    crt_bench_step(&b, 1.0f, 2.0f, -3.0f);
    const double c = cos(PI / 4.0), l = 0.45;
    assert_true(crt_near(b.out.torque[0], 1.0, 1e-6));
    assert_true(crt_near(b.out.torque[1], -l * c * 2.0 + l * c * -3.0, 1e-6));
    assert_true(crt_near(b.out.torque[2], l * c * 2.0 + l * c * -3.0, 1e-6));
    assert_int_equal(b.out.limits, 0);
}

static void gravity_and_friction_are_compensated_in_part(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    b.config.axis[0].gravity = 0.3f;
    b.config.axis[1].gravity = 0.2f;
    b.config.control.friction_share = 0.5f;
    b.in.speed[0] = -b.config.axis[0].friction_speed;
    crt_bench_step(&b, 0.0f, 0.0f, 0.0f);
    assert_true(crt_near(b.out.torque[0], 0.3 - 0.5 * 1.0 * 0.5, 1e-6));
    assert_true(crt_near(b.out.torque[1], 0.2 * cos(PI / 4.0), 1e-6));
    b.in.speed[0] = 1e6f;
    crt_bench_step(&b, 0.0f, 0.0f, 0.0f);
    assert_true(b.out.torque[0] <= 0.3f + 0.5f * b.config.axis[0].coulomb);
}

static void damping_opposes_and_never_pulls(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    b.config.control.contact_damping_Ns_m = 5.0f;
    b.in.speed[0] = -0.1f; /* into the wall: the force grows */
    crt_bench_step(&b, 2.0f, 0.0f, 0.0f);
    assert_true(crt_near(b.out.force_N.x, 2.5, 1e-6));
    b.in.speed[0] = 0.9f; /* out of it, faster than the spring: nothing, not a pull */
    crt_bench_step(&b, 2.0f, 0.0f, 0.0f);
    assert_true(b.out.force_N.x == 0.0f);
    b.config.control.free_damping_Ns_m = 3.0f;
    b.in.speed[0] = 0.2f;
    crt_bench_step(&b, 0.0f, 0.0f, 0.0f);
    assert_true(crt_near(b.out.force_N.x, -0.6, 1e-6));
}

static void ramp_grows_from_nothing_to_all(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    b.config.control.ramp_s = 0.1f;
    crt_bench_step(&b, 5.0f, 0.0f, 0.0f);
    assert_true(crt_near(b.out.force_N.x, 0.05, 1e-6));
    for (int k = 1; k < 101; k++) {
        crt_bench_step(&b, 5.0f, 0.0f, 0.0f);
    }
    assert_true(crt_near(b.out.force_N.x, 5.0, 1e-6));
}

/* -------------------------------------------------------------------------------------------------------- limits */

static void limit_force_keeps_the_direction(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    b.config.control.force_max_N = 10.0f;
    crt_bench_step(&b, 30.0f, 0.0f, 40.0f);
    assert_int_equal(b.out.limits, CR_LIMIT_FORCE);
    assert_true(crt_near(b.out.force_N.x, 6.0, 1e-5) && crt_near(b.out.force_N.z, 8.0, 1e-5));
}

static void limit_rate_bounds_growth_and_lets_go_at_once(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    b.config.control.force_rate_max_N_s = 1000.0f;
    for (int k = 1; k <= 5; k++) {
        crt_bench_step(&b, 10.0f, 0.0f, 0.0f);
        assert_int_equal(b.out.limits, CR_LIMIT_RATE);
        assert_true(crt_near(b.out.force_N.x, (double)k, 1e-4));
    }
    crt_bench_step(&b, 0.5f, 0.0f, 0.0f);
    assert_true(crt_near(b.out.force_N.x, 0.5, 1e-6) && b.out.limits == 0u);
    crt_bench_step(&b, -10.0f, 0.0f, 0.0f); /* turned round: from nothing, one step */
    assert_true(crt_near(b.out.force_N.x, -1.0, 1e-4) && b.out.limits == CR_LIMIT_RATE);
}

static void limit_torque_scales_all_axes_alike(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    b.config.axis[0].torque_max = 4.0f;
    crt_bench_step(&b, 8.0f, 2.0f, 0.0f);
    assert_int_equal(b.out.limits, CR_LIMIT_TORQUE);
    assert_true(crt_near(b.out.torque[0], 4.0, 1e-5) && crt_near(b.out.force_N.y, 1.0, 1e-5));
    for (int a = 0; a < CR_AXES; a++) {
        assert_true(abs_f(b.out.torque[a]) <= b.config.axis[a].torque_max);
    }
}

static void limit_power_holds_back_only_what_drives(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    b.config.control.power_max_W = 1.0f;
    b.in.speed[0] = 0.5f;
    crt_bench_step(&b, 10.0f, 3.0f, 0.0f);
    assert_int_equal(b.out.limits, CR_LIMIT_POWER);
    assert_true(crt_near(b.out.force_N.x, 2.0, 1e-4) && crt_near(b.out.force_N.y, 3.0, 1e-4));
    b.in.speed[0] = -0.5f; /* braking takes power: free */
    crt_bench_step(&b, 10.0f, 3.0f, 0.0f);
    assert_true(b.out.limits == 0u && crt_near(b.out.force_N.x, 10.0, 1e-4));
}

static void limit_speed_fades_what_would_speed_up(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    b.config.control.speed_max_m_s = 0.5f;
    b.config.control.power_max_W = 100.0f;
    b.in.speed[0] = 0.75f;
    crt_bench_step(&b, 4.0f, 0.0f, 0.0f);
    assert_true(b.out.limits == CR_LIMIT_SPEED && crt_near(b.out.force_N.x, 2.0, 1e-4));
    b.in.speed[0] = 1.5f;
    crt_bench_step(&b, 4.0f, 0.0f, 0.0f);
    assert_true(b.out.limits == CR_LIMIT_SPEED && crt_near(b.out.force_N.x, 0.0, 1e-4));
}

static void limit_workspace_fades_towards_the_ends_and_the_singularity(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    crt_bench_set_joints(&b, 0.735f, (float)(PI / 4.0), (float)(-PI / 4.0)); /* half of the last 2 % */
    crt_bench_step(&b, 4.0f, 0.0f, 0.0f);
    assert_true(b.out.limits == CR_LIMIT_WORKSPACE && crt_near(b.out.force_N.x, 2.0, 1e-3));
    crt_bench_set_joints(&b, 0.8f, (float)(PI / 4.0), (float)(-PI / 4.0));
    crt_bench_step(&b, 4.0f, 0.0f, 0.0f);
    assert_true(b.out.force_N.x == 0.0f);
    b.config.arm.elbow_min_rad = 0.0f;
    crt_bench_set_joints(&b, 0.0f, 0.25f, 0.0f); /* nearly stretched: margin 0.247 of 0.5 */
    crt_bench_step(&b, 4.0f, 0.0f, 0.0f);
    assert_true(crt_near(b.out.force_N.x, 4.0 * sin(0.25) / 0.5, 1e-3));
}

static void bridge_gives_a_share_of_the_last_torque(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    crt_bench_step(&b, 4.0f, 1.0f, 0.0f);
    const float before = b.out.torque[1];
    cr_control_bridge(&b.control, 0.5f, &b.out);
    assert_true(b.out.limits == CR_LIMIT_STALE && b.out.torque[0] == 2.0f && b.out.torque[1] == 0.5f * before);
    cr_control_bridge(&b.control, 0.5f, &b.out);
    assert_true(b.out.torque[0] == 1.0f);
    cr_control_bridge(&b.control, 1.0f, &b.out);
    assert_true(b.out.limits == CR_LIMIT_STALE && b.out.torque[0] == 1.0f);
}

static void not_a_number_comes_out_as_zero_and_is_told(void **state) {
    (void)state;
    const float bad[] = {NAN, INFINITY, -INFINITY};
    for (int i = 0; i < 3; i++) {
        for (int where = 0; where < 3; where++) {
            crt_bench b = crt_bench_make();
            crt_bench_step(&b, 1.0f, 0.0f, 0.0f);
            b.in.contact_force_N = where == 0 ? v3(bad[i], 0.0f, 0.0f) : v3(1.0f, 0.0f, 0.0f);
            b.in.speed[1] = where == 1 ? bad[i] : 0.0f;
            b.kinematics.column[2].x = where == 2 ? bad[i] : 0.0f;
            b.in.speed[2] = 0.1f;
            cr_control_step(&b.config, &b.control, &b.in, &b.out);
            assert_true(!b.out.finite && b.out.torque[0] == 0.0f && b.out.torque[1] == 0.0f && b.out.torque[2] == 0.0f);
            b = crt_bench_make();
            crt_bench_step(&b, 1.0f, 0.0f, 0.0f);
            assert_true(b.out.torque[0] == 1.0f);
        }
    }
}

/* ----------------------------------------------------------------------------------------------------- passivity */

/* A mass on the guide against a wall at x = 0 that pushes to +x, with the delay that the bus has. Returns the largest energy that
 * the wall ever gave back beyond what it took; *bounce: speed out over speed in. */
static double bounce_off_wall(float stiffness, float damping_max, double *bounce, uint32_t *limited) {
    crt_bench b = crt_bench_make();
    b.config.control.passivity_damping_max_Ns_m = damping_max;
    b.config.control.speed_max_m_s = 10.0f;
    b.config.control.power_max_W = 1e3f;
    b.config.control.force_max_N = 1e3f;
    b.config.axis[0].torque_max = 1e3f;
    const double mass = 5.4, in_m_s = -0.2;
    double x = 0.01, v = in_m_s, now = 0.0, next = 0.0, given = 0.0, most = -1.0;
    *limited = 0u;
    for (int k = 0; k < 400; k++) {
        now = next; /* SYNC: the torque of the tick before acts */
        const int32_t counts[CR_AXES] = {(int32_t)floor(x / CRT_STEP_M + 0.5), 0, 0};
        cr_control_speeds(&b.config, &b.control, counts, every, b.in.speed);
        b.in.speed[1] = b.in.speed[2] = 0.0f;
        const float seen = (float)counts[0] * (float)CRT_STEP_M;
        crt_bench_set_joints(&b, seen, (float)(PI / 4.0), (float)(-PI / 4.0));
        crt_bench_step(&b, seen < 0.0f ? -stiffness * seen : 0.0f, 0.0f, 0.0f);
        *limited += (b.out.limits & CR_LIMIT_PASSIVITY) != 0u ? 1u : 0u;
        next = (double)b.out.torque[0];
        const double before = x;
        v += now / mass * 1e-3;
        x += (v - 0.5 * now / mass * 1e-3) * 1e-3;
        given += now * (x - before);
        most = fmax(most, given);
    }
    *bounce = -v / in_m_s;
    return most;
}

static void passivity_observer_agrees_with_the_work_done(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    b.config.control.passivity_damping_max_Ns_m = 0.0f;
    double work = 0.0, x = 0.0, applied[3] = {0};
    for (int k = 0; k < 500; k++) {
        const double before = x;
        x = -1e-3 - 5e-3 * sin(0.02 * k);
        applied[2] = applied[1]; /* of tick k - 2, held from SYNC k - 1 to SYNC k */
        applied[1] = applied[0];
        crt_bench_set_joints(&b, (float)x, (float)(PI / 4.0), (float)(-PI / 4.0));
        const float force = (float)(6.0 + 2.0 * cos(0.03 * k));
        crt_bench_step(&b, force, 0.0f, 0.0f);
        work += k > 0 ? applied[2] * (x - before) : 0.0;
        applied[0] = (double)force;
        assert_true(crt_near(b.out.energy_J, work, 2e-6));
    }
}

/* The tip moves evenly, so that the work of every period is known, those without a sample included. */
static void passivity_observer_agrees_over_lost_states(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    b.config.control.passivity_damping_max_Ns_m = 0.0f;
    b.config.control.own_damping_Ns_m = 0.0f;
    const double way_m = -12e-6; /* a period */
    double work = 0.0, x = 0.0, applied[3] = {0};
    for (int k = 0; k < 400; k++) {
        x += k > 0 ? way_m : 0.0;
        applied[2] = applied[1];
        applied[1] = applied[0];
        work += k > 0 ? applied[2] * way_m : 0.0;
        if (k % 9 >= 7) {
            cr_control_bridge(&b.control, 0.5f, &b.out);
        } else {
            crt_bench_set_joints(&b, (float)x, (float)(PI / 4.0), (float)(-PI / 4.0));
            crt_bench_step(&b, (float)(6.0 + 2.0 * cos(0.03 * k)), 0.0f, 0.0f);
            assert_true(crt_near(b.out.energy_J, work, 2e-6));
        }
        applied[0] = (double)b.out.force_N.x;
    }
}

static void own_friction_burns_through_lost_states_too(void **state) {
    (void)state;
    for (int lost = 0; lost < 3; lost++) {
        crt_bench b = crt_bench_make();
        b.config.control.passivity_damping_max_Ns_m = 0.0f;
        b.config.control.own_damping_Ns_m = 2.0f;
        b.in.speed[0] = 0.1f;
        crt_bench_step(&b, 1.0f, 0.0f, 0.0f);
        b.control.energy_J = 1e-3f;
        for (int k = 0; k < lost; k++) {
            cr_control_bridge(&b.control, 0.5f, &b.out);
        }
        memset(b.control.applied_N, 0, sizeof b.control.applied_N);
        b.control.bridged_N = v3(0.0f, 0.0f, 0.0f);
        crt_bench_step(&b, 1.0f, 0.0f, 0.0f);
        assert_true(
            crt_near(b.out.energy_J, 1e-3 - 2.0 * 0.01 * 1e-3 * (1 + lost), 1e-8)); /* d v^2 T for each period */
    }
}

static void passivity_controller_takes_back_what_the_delay_gives(void **state) {
    (void)state;
    double bounce_with, bounce_without;
    uint32_t limited, never;
    const double with = bounce_off_wall(3000.0f, 100.0f, &bounce_with, &limited);
    const double without = bounce_off_wall(3000.0f, 0.0f, &bounce_without, &never);
    print_message("wall of 3000 N/m: bounce %.3f, %.2f mJ given; with the controller %.3f, %.2f mJ\n", bounce_without,
                  1e3 * without, bounce_with, 1e3 * with);
    assert_true(bounce_without > 1.02 && never == 0u);
    assert_true(limited > 0u && bounce_with < 1.0 + 0.65 * (bounce_without - 1.0) && with < 0.65 * without);
}

/* A contact that gave energy: it is pressed in without force, and pushes on the way out. */
static void give_energy(crt_bench *b, float speed_x, float speed_y) {
    b->config.control.passivity_damping_max_Ns_m = 10.0f;
    for (int k = 0; k < 20; k++) {
        crt_bench_set_joints(b, 1e-4f * (float)k, (float)(PI / 4.0), (float)(-PI / 4.0));
        crt_bench_step(b, 5.0f, 0.0f, 0.0f);
    }
    b->in.speed[0] = speed_x;
    b->in.speed[1] = speed_y;
}

static void passivity_controller_keeps_the_direction_of_the_force(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    give_energy(&b, 0.05f, 0.2f);
    crt_bench_step(&b, 5.0f, 0.0f, 0.0f);
    assert_true((b.out.limits & CR_LIMIT_PASSIVITY) != 0u);
    assert_true(b.out.force_N.x > 0.0f && b.out.force_N.x < 5.0f);
    assert_true(crt_near(b.out.force_N.x, 5.0 - 10.0 * 0.05, 1e-5));
    assert_true(b.out.force_N.y == 0.0f && b.out.force_N.z == 0.0f);
}

static void passivity_account_lets_friction_burn_an_excess_but_saves_nothing_up(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    give_energy(&b, 0.0f, 0.0f);
    const float before = b.out.energy_J;
    b.config.control.passivity_damping_max_Ns_m = 0.0f;
    b.in.speed[0] = 0.1f; /* the sample stays: no work, only friction at 1 N s/m */
    for (int k = 0; k < 100; k++) {
        crt_bench_step(&b, 5.0f, 0.0f, 0.0f);
    }
    assert_true(before > 5e-3f && crt_near(b.out.energy_J, (double)before - 100.0 * 1e-3 * 1.0 * 0.01, 2e-6));
    for (int k = 0; k < 10000; k++) {
        crt_bench_step(&b, 5.0f, 0.0f, 0.0f);
    }
    assert_true(b.out.energy_J == 0.0f);
}

static void passivity_controller_lets_a_passive_contact_alone(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    for (int k = 0; k < 300; k++) { /* only presses in: takes energy */
        b.in.speed[0] = -0.01f;
        crt_bench_set_joints(&b, -1e-5f * (float)k, (float)(PI / 4.0), (float)(-PI / 4.0));
        crt_bench_step(&b, 1e-2f * (float)k, 0.0f, 0.0f);
        assert_int_equal(b.out.limits, 0);
        assert_true(b.out.energy_J <= 0.0f);
    }
}

static void energy_account_closes_when_the_contact_ends(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    for (int k = 0; k < 50; k++) {
        crt_bench_set_joints(&b, -1e-4f * (float)k, (float)(PI / 4.0), (float)(-PI / 4.0));
        crt_bench_step(&b, 5.0f, 0.0f, 0.0f);
    }
    assert_true(b.out.energy_J < -1e-3f);
    for (int k = 0; k < 4; k++) {
        crt_bench_step(&b, 0.0f, 0.0f, 0.0f);
    }
    assert_true(b.out.energy_J == 0.0f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(torque_is_the_transposed_jacobian_times_force),
        cmocka_unit_test(gravity_and_friction_are_compensated_in_part),
        cmocka_unit_test(damping_opposes_and_never_pulls),
        cmocka_unit_test(ramp_grows_from_nothing_to_all),
        cmocka_unit_test(limit_force_keeps_the_direction),
        cmocka_unit_test(limit_rate_bounds_growth_and_lets_go_at_once),
        cmocka_unit_test(limit_torque_scales_all_axes_alike),
        cmocka_unit_test(limit_power_holds_back_only_what_drives),
        cmocka_unit_test(limit_speed_fades_what_would_speed_up),
        cmocka_unit_test(limit_workspace_fades_towards_the_ends_and_the_singularity),
        cmocka_unit_test(bridge_gives_a_share_of_the_last_torque),
        cmocka_unit_test(not_a_number_comes_out_as_zero_and_is_told),
        cmocka_unit_test(passivity_observer_agrees_with_the_work_done),
        cmocka_unit_test(passivity_observer_agrees_over_lost_states),
        cmocka_unit_test(own_friction_burns_through_lost_states_too),
        cmocka_unit_test(passivity_controller_takes_back_what_the_delay_gives),
        cmocka_unit_test(passivity_controller_keeps_the_direction_of_the_force),
        cmocka_unit_test(passivity_account_lets_friction_burn_an_excess_but_saves_nothing_up),
        cmocka_unit_test(passivity_controller_lets_a_passive_contact_alone),
        cmocka_unit_test(energy_account_closes_when_the_contact_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
