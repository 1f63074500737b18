/* Velocity, damping, limits, passivity, compensation and the state machine, each by itself. */
#include "servo/servo_stages.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <cmocka.h>

#define PI 3.14159265358979323846
#define STEP_M 60e-6

/* A control on the guide alone, at the reference posture, with nothing in the way of the force. */
typedef struct {
    cr_servo_config config;
    cr_control control;
    cr_kinematics kinematics;
    cr_control_input in;
    cr_control_output out;
} bench;

static void set_joints(bench *b, float guide, float upper, float fore) {
    const cr_joints joints = {{guide, upper, fore}, {0}};
    cr_kinematics_solve(&b->config.arm, &joints, &b->kinematics);
    memcpy(b->in.joint, joints.joint, sizeof b->in.joint);
}

static bench make_bench(void) {
    bench b;
    memset(&b, 0, sizeof b);
    b.config = cr_servo_config_default();
    b.config.control.ramp_s = 0.0f;
    b.config.control.force_rate_max_N_s = 1e6f;
    b.config.control.friction_share = 0.0f;
    b.config.axis[1].gravity = b.config.axis[2].gravity = 0.0f;
    b.in.period_s = 1e-3f;
    set_joints(&b, 0.0f, (float)(PI / 4.0), (float)(-PI / 4.0));
    return b;
}

static void step(bench *b, float fx, float fy, float fz) {
    b->in.kinematics = &b->kinematics;
    b->in.contact_force_N = v3(fx, fy, fz);
    cr_control_step(&b->config, &b->control, &b->in, &b->out);
    assert_true(b->out.finite);
}

static int near(float a, double b, double tolerance) { return fabs((double)a - b) <= tolerance; }

/* ------------------------------------------------------------------------------------------------------ velocity */

/* Root mean square error at constant speed, once settled. */
static double noise_at(double speed_m_s, uint32_t window) {
    cr_velocity v;
    double sum = 0.0;
    cr_velocity_reset(&v);
    for (int k = 0; k < 20000; k++) {
        const int32_t counts = (int32_t)floor(speed_m_s * 1e-3 * k / STEP_M + 0.5);
        const double error = (double)cr_velocity_step(&v, counts, window) * STEP_M / 1e-3 - speed_m_s;
        sum += k < 1000 ? 0.0 : error * error;
    }
    return sqrt(sum / 19000.0);
}

/* Lag behind a sine: the phase of the estimate's first harmonic. */
static double lag_at(double amplitude_m, double Hz, uint32_t window) {
    cr_velocity v;
    double sine = 0.0, cosine = 0.0;
    const double omega = 2.0 * PI * Hz;
    cr_velocity_reset(&v);
    for (int k = 0; k < 20000; k++) {
        const double t = 1e-3 * k;
        const int32_t counts = (int32_t)floor(amplitude_m * sin(omega * t) / STEP_M + 0.5);
        const double speed = (double)cr_velocity_step(&v, counts, window) * STEP_M / 1e-3;
        sine += speed * sin(omega * t);
        cosine += speed * cos(omega * t);
    }
    return atan2(sine, cosine) / omega;
}

static void velocity_is_quiet_at_constant_speed(void **state) {
    (void)state;
    const double speeds[] = {0.0011, 0.0053, 0.0207, 0.1013}, bounds[] = {2.0e-3, 0.6e-3, 0.9e-3, 0.6e-3};
    for (int i = 0; i < 4; i++) {
        const double noise = noise_at(speeds[i], 16u);
        print_message("velocity: %.1f mm/s RMS at %.1f mm/s\n", 1e3 * noise, 1e3 * speeds[i]);
        assert_true(noise < bounds[i]);
    }
}

static void velocity_lags_less_the_faster_the_motion_bends(void **state) {
    (void)state;
    const double slow = lag_at(0.05, 1.0, 16u), middle = lag_at(0.005, 5.0, 16u), fast = lag_at(0.001, 20.0, 16u);
    print_message("velocity: lag %.1f, %.1f, %.1f ms\n", 1e3 * slow, 1e3 * middle, 1e3 * fast);
    assert_true(slow < 7e-3 && middle < 4.5e-3 && fast < 3e-3 && fast < middle && middle < slow);
}

static void velocity_of_a_still_joint_is_zero_even_on_a_step_edge(void **state) {
    (void)state;
    cr_velocity v;
    float worst = 0.0f;
    cr_velocity_reset(&v);
    for (int k = 0; k < 100; k++) {
        assert_true(cr_velocity_step(&v, 12345, 16u) == 0.0f);
    }
    for (int k = 0; k < 1000; k++) { /* flickers between two counts */
        worst = max_f(worst, abs_f(cr_velocity_step(&v, 12345 + k % 2, 16u)));
    }
    assert_true(worst < 0.1f); /* counts per period: 6 mm/s against 60 of the plain difference */
}

static void velocity_survives_the_wrap_of_the_counter(void **state) {
    (void)state;
    cr_velocity v;
    cr_velocity_reset(&v);
    for (uint32_t k = 0; k < 40u; k++) {
        const uint32_t counts = 0x7ffffff0u + k;
        const float speed = cr_velocity_step(&v, (int32_t)counts, 16u);
        assert_true(k == 0u || near(speed, 1.0, 1e-6));
    }
}

/* -------------------------------------------------------------------------------------------------------- torque */

static void torque_is_the_transposed_jacobian_times_force(void **state) {
    (void)state;
    bench b = make_bench();
    step(&b, 1.0f, 2.0f, -3.0f);
    const double c = cos(PI / 4.0), l = 0.45;
    assert_true(near(b.out.torque[0], 1.0, 1e-6));
    assert_true(near(b.out.torque[1], -l * c * 2.0 + l * c * -3.0, 1e-6));
    assert_true(near(b.out.torque[2], l * c * 2.0 + l * c * -3.0, 1e-6));
    assert_int_equal(b.out.limits, 0);
}

static void gravity_and_friction_are_compensated_in_part(void **state) {
    (void)state;
    bench b = make_bench();
    b.config.axis[0].gravity = 0.3f;
    b.config.axis[1].gravity = 0.2f;
    b.config.control.friction_share = 0.5f;
    b.in.speed[0] = -b.config.axis[0].friction_speed;
    step(&b, 0.0f, 0.0f, 0.0f);
    assert_true(near(b.out.torque[0], 0.3 - 0.5 * 1.0 * 0.5, 1e-6));
    assert_true(near(b.out.torque[1], 0.2 * cos(PI / 4.0), 1e-6));
    b.in.speed[0] = 1e6f;
    step(&b, 0.0f, 0.0f, 0.0f);
    assert_true(b.out.torque[0] <= 0.3f + 0.5f * b.config.axis[0].coulomb);
}

static void damping_opposes_and_never_pulls(void **state) {
    (void)state;
    bench b = make_bench();
    b.config.control.contact_damping_Ns_m = 5.0f;
    b.in.speed[0] = -0.1f; /* into the wall: the force grows */
    step(&b, 2.0f, 0.0f, 0.0f);
    assert_true(near(b.out.force_N.x, 2.5, 1e-6));
    b.in.speed[0] = 0.9f; /* out of it, faster than the spring: nothing, not a pull */
    step(&b, 2.0f, 0.0f, 0.0f);
    assert_true(b.out.force_N.x == 0.0f);
    b.config.control.free_damping_Ns_m = 3.0f;
    b.in.speed[0] = 0.2f;
    step(&b, 0.0f, 0.0f, 0.0f);
    assert_true(near(b.out.force_N.x, -0.6, 1e-6));
}

static void ramp_grows_from_nothing_to_all(void **state) {
    (void)state;
    bench b = make_bench();
    b.config.control.ramp_s = 0.1f;
    step(&b, 5.0f, 0.0f, 0.0f);
    assert_true(near(b.out.force_N.x, 0.05, 1e-6));
    for (int k = 1; k < 101; k++) {
        step(&b, 5.0f, 0.0f, 0.0f);
    }
    assert_true(near(b.out.force_N.x, 5.0, 1e-6));
}

/* -------------------------------------------------------------------------------------------------------- limits */

static void limit_force_keeps_the_direction(void **state) {
    (void)state;
    bench b = make_bench();
    b.config.control.force_max_N = 10.0f;
    step(&b, 30.0f, 0.0f, 40.0f);
    assert_int_equal(b.out.limits, CR_LIMIT_FORCE);
    assert_true(near(b.out.force_N.x, 6.0, 1e-5) && near(b.out.force_N.z, 8.0, 1e-5));
}

static void limit_rate_bounds_growth_and_lets_go_at_once(void **state) {
    (void)state;
    bench b = make_bench();
    b.config.control.force_rate_max_N_s = 1000.0f;
    for (int k = 1; k <= 5; k++) {
        step(&b, 10.0f, 0.0f, 0.0f);
        assert_int_equal(b.out.limits, CR_LIMIT_RATE);
        assert_true(near(b.out.force_N.x, (double)k, 1e-4));
    }
    step(&b, 0.5f, 0.0f, 0.0f);
    assert_true(near(b.out.force_N.x, 0.5, 1e-6) && b.out.limits == 0u);
    step(&b, -10.0f, 0.0f, 0.0f); /* turned round: from nothing, one step */
    assert_true(near(b.out.force_N.x, -1.0, 1e-4) && b.out.limits == CR_LIMIT_RATE);
}

static void limit_torque_scales_all_axes_alike(void **state) {
    (void)state;
    bench b = make_bench();
    b.config.axis[0].torque_max = 4.0f;
    step(&b, 8.0f, 2.0f, 0.0f);
    assert_int_equal(b.out.limits, CR_LIMIT_TORQUE);
    assert_true(near(b.out.torque[0], 4.0, 1e-5) && near(b.out.force_N.y, 1.0, 1e-5));
    for (int a = 0; a < CR_AXES; a++) {
        assert_true(abs_f(b.out.torque[a]) <= b.config.axis[a].torque_max);
    }
}

static void limit_power_holds_back_only_what_drives(void **state) {
    (void)state;
    bench b = make_bench();
    b.config.control.power_max_W = 1.0f;
    b.in.speed[0] = 0.5f;
    step(&b, 10.0f, 3.0f, 0.0f);
    assert_int_equal(b.out.limits, CR_LIMIT_POWER);
    assert_true(near(b.out.force_N.x, 2.0, 1e-4) && near(b.out.force_N.y, 3.0, 1e-4));
    b.in.speed[0] = -0.5f; /* braking takes power: free */
    step(&b, 10.0f, 3.0f, 0.0f);
    assert_true(b.out.limits == 0u && near(b.out.force_N.x, 10.0, 1e-4));
}

static void limit_speed_fades_what_would_speed_up(void **state) {
    (void)state;
    bench b = make_bench();
    b.config.control.speed_max_m_s = 0.5f;
    b.config.control.power_max_W = 100.0f;
    b.in.speed[0] = 0.75f;
    step(&b, 4.0f, 0.0f, 0.0f);
    assert_true(b.out.limits == CR_LIMIT_SPEED && near(b.out.force_N.x, 2.0, 1e-4));
    b.in.speed[0] = 1.5f;
    step(&b, 4.0f, 0.0f, 0.0f);
    assert_true(b.out.limits == CR_LIMIT_SPEED && near(b.out.force_N.x, 0.0, 1e-4));
}

static void limit_workspace_fades_towards_the_ends_and_the_singularity(void **state) {
    (void)state;
    bench b = make_bench();
    set_joints(&b, 0.735f, (float)(PI / 4.0), (float)(-PI / 4.0)); /* half of the last 2 % */
    step(&b, 4.0f, 0.0f, 0.0f);
    assert_true(b.out.limits == CR_LIMIT_WORKSPACE && near(b.out.force_N.x, 2.0, 1e-3));
    set_joints(&b, 0.8f, (float)(PI / 4.0), (float)(-PI / 4.0));
    step(&b, 4.0f, 0.0f, 0.0f);
    assert_true(b.out.force_N.x == 0.0f);
    b.config.arm.elbow_min_rad = 0.0f;
    set_joints(&b, 0.0f, 0.25f, 0.0f); /* nearly stretched: margin 0.247 of 0.5 */
    step(&b, 4.0f, 0.0f, 0.0f);
    assert_true(near(b.out.force_N.x, 4.0 * sin(0.25) / 0.5, 1e-3));
}

static void bridge_halves_the_last_torque(void **state) {
    (void)state;
    bench b = make_bench();
    step(&b, 4.0f, 1.0f, 0.0f);
    const float before = b.out.torque[1];
    cr_control_bridge(&b.control, &b.out);
    assert_true(b.out.limits == CR_LIMIT_STALE && b.out.torque[0] == 2.0f && b.out.torque[1] == 0.5f * before);
    cr_control_bridge(&b.control, &b.out);
    assert_true(b.out.torque[0] == 1.0f);
}

static void not_a_number_comes_out_as_zero_and_is_told(void **state) {
    (void)state;
    const float bad[] = {NAN, INFINITY, -INFINITY};
    for (int i = 0; i < 3; i++) {
        for (int where = 0; where < 3; where++) {
            bench b = make_bench();
            step(&b, 1.0f, 0.0f, 0.0f);
            b.in.contact_force_N = where == 0 ? v3(bad[i], 0.0f, 0.0f) : v3(1.0f, 0.0f, 0.0f);
            b.in.speed[1] = where == 1 ? bad[i] : 0.0f;
            b.kinematics.column[2].x = where == 2 ? bad[i] : 0.0f;
            b.in.speed[2] = 0.1f;
            cr_control_step(&b.config, &b.control, &b.in, &b.out);
            assert_true(!b.out.finite && b.out.torque[0] == 0.0f && b.out.torque[1] == 0.0f && b.out.torque[2] == 0.0f);
            b = make_bench();
            step(&b, 1.0f, 0.0f, 0.0f);
            assert_true(b.out.torque[0] == 1.0f);
        }
    }
}

/* ----------------------------------------------------------------------------------------------------- passivity */

/* A mass on the guide against a wall at x = 0 that pushes to +x, with the delay that the bus has. Returns the largest energy that
 * the wall ever gave back beyond what it took; *bounce: speed out over speed in. */
static double bounce_off_wall(float stiffness, float damping_max, double *bounce, uint32_t *limited) {
    bench b = make_bench();
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
        const int32_t counts[CR_AXES] = {(int32_t)floor(x / STEP_M + 0.5), 0, 0};
        cr_control_speeds(&b.config, &b.control, counts, 1e-3f, b.in.speed);
        b.in.speed[1] = b.in.speed[2] = 0.0f;
        const float seen = (float)counts[0] * (float)STEP_M;
        set_joints(&b, seen, (float)(PI / 4.0), (float)(-PI / 4.0));
        step(&b, seen < 0.0f ? -stiffness * seen : 0.0f, 0.0f, 0.0f);
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
    bench b = make_bench();
    b.config.control.passivity_damping_max_Ns_m = 0.0f;
    double work = 0.0, x = 0.0, applied[3] = {0};
    for (int k = 0; k < 500; k++) {
        const double before = x;
        x = -1e-3 - 5e-3 * sin(0.02 * k);
        applied[2] = applied[1]; /* of tick k - 2, held from SYNC k - 1 to SYNC k */
        applied[1] = applied[0];
        set_joints(&b, (float)x, (float)(PI / 4.0), (float)(-PI / 4.0));
        const float force = (float)(6.0 + 2.0 * cos(0.03 * k));
        step(&b, force, 0.0f, 0.0f);
        work += k > 0 ? applied[2] * (x - before) : 0.0;
        applied[0] = (double)force;
        assert_true(near(b.out.energy_J, work, 2e-6));
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
static void give_energy(bench *b, float speed_x, float speed_y) {
    b->config.control.passivity_damping_max_Ns_m = 10.0f;
    for (int k = 0; k < 20; k++) {
        set_joints(b, 1e-4f * (float)k, (float)(PI / 4.0), (float)(-PI / 4.0));
        step(b, 5.0f, 0.0f, 0.0f);
    }
    b->in.speed[0] = speed_x;
    b->in.speed[1] = speed_y;
}

static void passivity_controller_keeps_the_direction_of_the_force(void **state) {
    (void)state;
    bench b = make_bench();
    give_energy(&b, 0.05f, 0.2f);
    step(&b, 5.0f, 0.0f, 0.0f);
    assert_true((b.out.limits & CR_LIMIT_PASSIVITY) != 0u);
    assert_true(b.out.force_N.x > 0.0f && b.out.force_N.x < 5.0f);
    assert_true(near(b.out.force_N.x, 5.0 - 10.0 * 0.05, 1e-5));
    assert_true(b.out.force_N.y == 0.0f && b.out.force_N.z == 0.0f);
}

static void passivity_account_lets_friction_burn_an_excess_but_saves_nothing_up(void **state) {
    (void)state;
    bench b = make_bench();
    give_energy(&b, 0.0f, 0.0f);
    const float before = b.out.energy_J;
    b.config.control.passivity_damping_max_Ns_m = 0.0f;
    b.in.speed[0] = 0.1f; /* the sample stays: no work, only friction at 1 N s/m */
    for (int k = 0; k < 100; k++) {
        step(&b, 5.0f, 0.0f, 0.0f);
    }
    assert_true(before > 5e-3f && near(b.out.energy_J, (double)before - 100.0 * 1e-3 * 1.0 * 0.01, 2e-6));
    for (int k = 0; k < 10000; k++) {
        step(&b, 5.0f, 0.0f, 0.0f);
    }
    assert_true(b.out.energy_J == 0.0f);
}

static void passivity_controller_lets_a_passive_contact_alone(void **state) {
    (void)state;
    bench b = make_bench();
    for (int k = 0; k < 300; k++) { /* only presses in: takes energy */
        b.in.speed[0] = -0.01f;
        set_joints(&b, -1e-5f * (float)k, (float)(PI / 4.0), (float)(-PI / 4.0));
        step(&b, 1e-2f * (float)k, 0.0f, 0.0f);
        assert_int_equal(b.out.limits, 0);
        assert_true(b.out.energy_J <= 0.0f);
    }
}

static void energy_account_closes_when_the_contact_ends(void **state) {
    (void)state;
    bench b = make_bench();
    for (int k = 0; k < 50; k++) {
        set_joints(&b, -1e-4f * (float)k, (float)(PI / 4.0), (float)(-PI / 4.0));
        step(&b, 5.0f, 0.0f, 0.0f);
    }
    assert_true(b.out.energy_J < -1e-3f);
    for (int k = 0; k < 4; k++) {
        step(&b, 0.0f, 0.0f, 0.0f);
    }
    assert_true(b.out.energy_J == 0.0f);
}

/* -------------------------------------------------------------------------------------------------- state machine */

static void modes_follow_the_table(void **state) {
    (void)state;
    const struct {
        uint32_t mode, events, next;
    } table[] = {
        {CR_MODE_INIT, 0u, CR_MODE_INIT},
        {CR_MODE_INIT, CR_EVENT_START, CR_MODE_INIT},
        {CR_MODE_INIT, CR_EVENT_DRIVES_SEEN, CR_MODE_BUS_UP},
        {CR_MODE_BUS_UP, CR_EVENT_START | CR_EVENT_RESTED, CR_MODE_BUS_UP},
        {CR_MODE_BUS_UP, CR_EVENT_DRIVES_ENABLED, CR_MODE_CALIBRATING},
        {CR_MODE_CALIBRATING, CR_EVENT_START, CR_MODE_CALIBRATING},
        {CR_MODE_CALIBRATING, CR_EVENT_RESTED, CR_MODE_IDLE},
        {CR_MODE_IDLE, 0u, CR_MODE_IDLE},
        {CR_MODE_IDLE, CR_EVENT_START, CR_MODE_RENDERING},
        {CR_MODE_IDLE, CR_EVENT_START | CR_EVENT_STOP, CR_MODE_IDLE},
        {CR_MODE_RENDERING, CR_EVENT_LIMIT, CR_MODE_LIMITED},
        {CR_MODE_LIMITED, 0u, CR_MODE_RENDERING},
        {CR_MODE_RENDERING, CR_EVENT_STOP, CR_MODE_IDLE},
        {CR_MODE_LIMITED, CR_EVENT_STOP | CR_EVENT_LIMIT, CR_MODE_IDLE},
        {CR_MODE_FAULT, CR_EVENT_START | CR_EVENT_DRIVES_ENABLED | CR_EVENT_RESTED, CR_MODE_FAULT},
        {CR_MODE_FAULT, CR_EVENT_CLEAR, CR_MODE_INIT},
        {CR_MODE_COUNT, 0u, CR_MODE_FAULT},
        {77u, CR_EVENT_START, CR_MODE_FAULT},
    };
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        assert_int_equal(cr_mode_next(table[i].mode, table[i].events), table[i].next);
    }
}

static void fault_wins_over_every_event_in_every_mode(void **state) {
    (void)state;
    for (uint32_t mode = 0; mode < CR_MODE_COUNT; mode++) {
        for (uint32_t events = 0; events < 256u; events++) {
            const uint32_t next = cr_mode_next(mode, events | CR_EVENT_FAULT);
            assert_int_equal(next, CR_MODE_FAULT);
            assert_true(mode != CR_MODE_FAULT || (events & CR_EVENT_CLEAR) != 0u ||
                        cr_mode_next(mode, events) == CR_MODE_FAULT);
        }
    }
}

/* --------------------------------------------------------------------------------------------------- configuration */

static void config_default_is_valid(void **state) {
    (void)state;
    const cr_servo_config config = cr_servo_config_default();
    assert_null(cr_servo_config_error(&config));
}

/* Every field, one by one, refuses not-a-number: no float of the configuration goes unchecked. */
static void config_refuses_not_a_number_in_any_field(void **state) {
    (void)state;
    const cr_servo_config good = cr_servo_config_default();
    const size_t words = sizeof good / 4u;
    for (size_t i = 0; i < words; i++) {
        cr_servo_config bad = good;
        const float none = NAN;
        memcpy((char *)&bad + 4u * i, &none, sizeof none); /* as a whole number: 2,143,289,344 */
        const char *error = cr_servo_config_error(&bad);
        assert_non_null(error);
        assert_true(strlen(error) > 10u);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(velocity_is_quiet_at_constant_speed),
        cmocka_unit_test(velocity_lags_less_the_faster_the_motion_bends),
        cmocka_unit_test(velocity_of_a_still_joint_is_zero_even_on_a_step_edge),
        cmocka_unit_test(velocity_survives_the_wrap_of_the_counter),
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
        cmocka_unit_test(bridge_halves_the_last_torque),
        cmocka_unit_test(not_a_number_comes_out_as_zero_and_is_told),
        cmocka_unit_test(passivity_observer_agrees_with_the_work_done),
        cmocka_unit_test(passivity_controller_takes_back_what_the_delay_gives),
        cmocka_unit_test(passivity_controller_keeps_the_direction_of_the_force),
        cmocka_unit_test(passivity_account_lets_friction_burn_an_excess_but_saves_nothing_up),
        cmocka_unit_test(passivity_controller_lets_a_passive_contact_alone),
        cmocka_unit_test(energy_account_closes_when_the_contact_ends),
        cmocka_unit_test(modes_follow_the_table),
        cmocka_unit_test(fault_wins_over_every_event_in_every_mode),
        cmocka_unit_test(config_default_is_valid),
        cmocka_unit_test(config_refuses_not_a_number_in_any_field),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
