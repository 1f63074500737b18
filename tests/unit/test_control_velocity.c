/* The velocity of an axis from its encoder: noise, lag, and states that were lost. */
#include "control_bench.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>

#include <cmocka.h>

#define PI 3.14159265358979323846

/* Root mean square error at constant speed, once settled. */
static double noise_at(double speed_m_s, uint32_t window) {
    cr_velocity v;
    double sum = 0.0;
    cr_velocity_reset(&v);
    for (int k = 0; k < 20000; k++) {
        const int32_t counts = (int32_t)floor(speed_m_s * 1e-3 * k / CRT_STEP_M + 0.5);
        const double error = (double)cr_velocity_step(&v, counts, 1u, window) * CRT_STEP_M / 1e-3 - speed_m_s;
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
        const int32_t counts = (int32_t)floor(amplitude_m * sin(omega * t) / CRT_STEP_M + 0.5);
        const double speed = (double)cr_velocity_step(&v, counts, 1u, window) * CRT_STEP_M / 1e-3;
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
        assert_true(cr_velocity_step(&v, 12345, 1u, 16u) == 0.0f);
    }
    for (int k = 0; k < 1000; k++) { /* flickers between two counts */
        worst = max_f(worst, abs_f(cr_velocity_step(&v, 12345 + k % 2, 1u, 16u)));
    }
    assert_true(worst < 0.1f); /* counts per period: 6 mm/s against 60 of the plain difference */
}

/* Steady motion of whole counts is read exactly, whatever was lost; any other within a count over the window. */
static void velocity_is_right_after_lost_states(void **state) {
    (void)state;
    static const double speeds_m_s[] = {0.120, -0.120, 0.060, 0.037, -0.0213, 0.451};
    for (size_t i = 0; i < sizeof speeds_m_s / sizeof *speeds_m_s; i++) {
        for (uint32_t lost = 0; lost <= 10u; lost++) {
            cr_velocity v;
            cr_velocity_reset(&v);
            uint32_t periods = 1u;
            double worst = 0.0;
            for (uint32_t k = 0; k < 200u; k++) {
                if (k >= 100u && k < 100u + lost) {
                    periods++;
                    continue;
                }
                const int32_t counts = (int32_t)floor(speeds_m_s[i] * 1e-3 * k / CRT_STEP_M + 0.5);
                const double speed = (double)cr_velocity_step(&v, counts, periods, 16u) * CRT_STEP_M / 1e-3;
                worst = k < 50u ? 0.0 : fmax(worst, fabs(speed - speeds_m_s[i]));
                periods = 1u;
            }
            assert_true(worst <= (i < 3u ? 1e-6 : CRT_STEP_M / 16e-3)); /* one count over the window */
        }
    }
}

static void velocity_follows_a_sine_with_lost_states(void **state) {
    (void)state;
    cr_velocity v;
    const double omega = 2.0 * PI * 5.0, amplitude_m = 5e-3;
    double sine = 0.0, cosine = 0.0;
    uint32_t periods = 1u, samples = 0u;
    cr_velocity_reset(&v);
    for (uint32_t k = 0; k < 20000u; k++) {
        if (k % 17u >= 15u) { /* two states in a row of every 17 */
            periods++;
            continue;
        }
        const double t = 1e-3 * k;
        const int32_t counts = (int32_t)floor(amplitude_m * sin(omega * t) / CRT_STEP_M + 0.5);
        const double speed = (double)cr_velocity_step(&v, counts, periods, 16u) * CRT_STEP_M / 1e-3;
        sine += speed * sin(omega * t);
        cosine += speed * cos(omega * t);
        periods = 1u;
        samples++;
    }
    const double lag_s = atan2(sine, cosine) / omega;
    const double share = 2.0 * sqrt(sine * sine + cosine * cosine) / samples / (amplitude_m * omega);
    print_message("velocity with lost states: lag %.2f ms, amplitude %.4f of it\n", 1e3 * lag_s, share);
    assert_true(fabs(lag_s - lag_at(amplitude_m, 5.0, 16u)) < 5e-4 && fabs(share - 1.0) < 0.02);
}

static void velocity_starts_anew_after_a_gap_beyond_its_window(void **state) {
    (void)state;
    cr_velocity v;
    cr_velocity_reset(&v);
    for (int k = 0; k < 40; k++) {
        (void)cr_velocity_step(&v, 2 * k, 1u, 16u);
    }
    assert_true(cr_velocity_step(&v, 100000, CR_WINDOW_MAX + 1u, 16u) == 0.0f);
    assert_true(cr_velocity_step(&v, 100003, 1u, 16u) == 3.0f);
    assert_true(cr_velocity_step(&v, INT32_MIN, 3u, 16u) != 0.0f); /* the longest way: nothing overflows */
}

static void speeds_of_an_axis_without_a_sample_wait_for_the_next(void **state) {
    (void)state;
    crt_bench b = crt_bench_make();
    float speed[CR_AXES];
    uint32_t periods[CR_AXES] = {1u, 1u, 1u};
    for (int k = 0; k <= 50; k++) {
        const int32_t counts[CR_AXES] = {2 * k, 3 * k, -4 * k};
        periods[1] = k == 48 || k == 49 ? 0u : k == 50 ? 3u : 1u;
        cr_control_speeds(&b.config, &b.control, counts, periods, speed);
        assert_true(periods[1] > 0u || speed[1] == 0.0f);
    }
    assert_true(crt_near(speed[0], 0.120, 1e-6) &&
                crt_near(speed[1], 3.0 * (double)b.config.axis[1].step / 1e-3, 1e-5) &&
                crt_near(speed[2], -4.0 * (double)b.config.axis[2].step / 1e-3, 1e-5));
}

static void velocity_survives_the_wrap_of_the_counter(void **state) {
    (void)state;
    cr_velocity v;
    cr_velocity_reset(&v);
    for (uint32_t k = 0; k < 40u; k++) {
        const uint32_t counts = 0x7ffffff0u + k;
        const float speed = cr_velocity_step(&v, (int32_t)counts, 1u, 16u);
        assert_true(k == 0u || crt_near(speed, 1.0, 1e-6));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(velocity_is_quiet_at_constant_speed),
        cmocka_unit_test(velocity_lags_less_the_faster_the_motion_bends),
        cmocka_unit_test(velocity_of_a_still_joint_is_zero_even_on_a_step_edge),
        cmocka_unit_test(velocity_is_right_after_lost_states),
        cmocka_unit_test(velocity_follows_a_sine_with_lost_states),
        cmocka_unit_test(velocity_starts_anew_after_a_gap_beyond_its_window),
        cmocka_unit_test(speeds_of_an_axis_without_a_sample_wait_for_the_next),
        cmocka_unit_test(velocity_survives_the_wrap_of_the_counter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
