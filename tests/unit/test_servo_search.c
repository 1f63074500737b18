/* The servo with its search beside the ticks: recordings run again to the bit whenever the answers came, a search that stands still ends in a
 * fault, and what is felt is what a tick that searches itself would answer. */
#include "servo_loop.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define LATE_MAX 40u

static uint32_t next_random(uint32_t *seed) {
    *seed = *seed * 1664525u + 1013904223u;
    return *seed >> 16;
}

static cr_rerun run_again(const crt_loop *l, const cr_record *records, uint32_t pieces) {
    cr_servo *fresh;
    cr_rerun result = {0};
    const size_t size = cr_servo_size(crt_loop_scene(), &l->config);
    void *memory = aligned_alloc(64, (size + 63u) / 64u * 64u);
    assert_int_equal(cr_servo_init(&fresh, memory, size, crt_loop_scene(), &l->config), CR_OK);
    for (uint32_t i = 0; i < pieces; i++) {
        const uint32_t from = l->record_count * i / pieces, to = l->record_count * (i + 1u) / pieces;
        assert_int_equal(cr_servo_rerun(fresh, records + from, to - from, &result, NULL), CR_OK);
    }
    free(memory);
    return result;
}

/* Press, slide and lift, with a search that gets more and less time; now and then a fault and a new start. */
static void wander(crt_loop *l, uint32_t seed, uint32_t *late_of) {
    for (uint32_t k = 0; k < 2400u; k++) {
        const uint32_t busy = next_random(&seed) % 8u;
        l->search_work = 1u + next_random(&seed) % 6u;
        l->search[0] = busy == 0u ? 40u : next_random(&seed) % 3u;
        l->search[1] = busy == 1u ? 40u : next_random(&seed) % 3u;
        l->target[0] = 0.03 * sin((double)k * 0.004);
        l->target[2] = 0.03 + 0.02 * cos((double)k * 0.02);
        if (k == 400u) {
            l->skip_ns = 3000000u; /* an overrun */
        }
        l->skip_ns += k % 97u == 0u ? 1000000u : 0u; /* a late tick */
        cr_servo_input(l->servo, k == 410u ? CR_COMMAND_CLEAR : 0u);
        cr_servo_input(l->servo, crt_loop_mode(l) == CR_MODE_IDLE ? CR_COMMAND_START : 0u);
        crt_loop_period(l);
        const uint32_t late = l->records[l->record_count - 1u].contact_late_ticks;
        late_of[late <= LATE_MAX + 1u ? late : LATE_MAX + 2u]++;
    }
}

static void recording_of_two_rates_runs_again_to_the_bit(void **state) {
    (void)state;
    uint32_t late_of[LATE_MAX + 3u] = {0}, ages = 0u, forces = 0u;
    for (uint32_t seed = 1; seed <= 8u; seed++) {
        crt_loop l = crt_loop_make_beside(LATE_MAX);
        crt_loop_press(&l);
        wander(&l, seed, late_of);
        for (uint32_t i = 0; i < l.record_count; i++) {
            forces += l.records[i].contact_force_world_N.z > 0.0f;
        }
        const uint32_t pieces[] = {1u, 7u, l.record_count};
        for (uint32_t i = 0; i < 3u; i++) {
            const cr_rerun result = run_again(&l, l.records, pieces[i]);
            assert_int_equal(result.records, l.record_count);
            assert_int_equal(result.different, 0);
            assert_int_equal(result.gap, 0);
        }
        crt_loop_free(&l);
    }
    for (uint32_t i = 0; i <= LATE_MAX; i++) {
        ages += late_of[i] > 0u;
    }
    assert_int_equal(late_of[0], 0);
    assert_true(ages >= 35u && forces > 1000u && late_of[LATE_MAX + 2u] > 0u);
    print_message("%u ages, %u ticks with force\n", ages, forces);
}

static void re_run_with_another_age_is_another(void **state) {
    (void)state;
    uint32_t late_of[LATE_MAX + 3u] = {0};
    crt_loop l = crt_loop_make_beside(LATE_MAX);
    crt_loop_press(&l);
    wander(&l, 1u, late_of);
    for (uint32_t i = 0; i < l.record_count; i++) {
        if (l.records[i].contact_force_world_N.z > 0.0f && l.records[i].contact_late_ticks > 1u) {
            l.records[i].contact_late_ticks--;
            const cr_rerun result = run_again(&l, l.records, 1u);
            assert_true(result.different > 0u);
            crt_loop_free(&l);
            return;
        }
    }
    fail_msg("no late contact");
}

static void search_that_stands_still_is_a_fault(void **state) {
    (void)state;
    crt_loop l = crt_loop_make_beside(LATE_MAX);
    crt_loop_press(&l);
    l.search[1] = 0u;
    for (uint32_t k = 1; k <= LATE_MAX; k++) {
        crt_loop_period(&l);
        const cr_record *r = cr_servo_get_record(l.servo);
        assert_true(cr_mode_is_rendering(r->mode) && r->contact_force_world_N.z > 0.0f);
    }
    crt_loop_period(&l);
    crt_loop_period(&l);
    const cr_record *r = cr_servo_get_record(l.servo);
    assert_int_equal(r->mode, CR_MODE_FAULT);
    assert_int_equal(r->faults, CR_FAULT_LATE);
    assert_true(crt_loop_torque_is_zero(&l));
    assert_string_equal(cr_servo_fault_text(CR_FAULT_LATE), "late");
    /* it answers again: clear, and all is as before */
    l.search[1] = 1u;
    cr_servo_input(l.servo, CR_COMMAND_CLEAR);
    crt_loop_period(&l);
    crt_loop_press(&l);
    crt_loop_free(&l);
}

/* Of three periods two are without a state of drive X: nothing is felt in them, and contact is no older for them. */
static void age_of_contact_counts_poses_that_were_felt(void **state) {
    (void)state;
    crt_loop l = crt_loop_make_beside(LATE_MAX);
    crt_loop_press(&l);
    const uint32_t row = l.config.bus.missing_max + 1u;
    uint32_t periods = 0u;
    l.search[1] = 0u;
    for (; cr_mode_is_rendering(crt_loop_mode(&l)); periods++) {
        assert_true(periods < 4u * row * LATE_MAX);
        l.drives[0].mute = periods % row != row - 1u;
        crt_loop_period(&l);
        assert_true((cr_servo_get_record(l.servo)->contact_late_ticks == CR_NOT_FELT) == l.drives[0].mute);
    }
    assert_int_equal(cr_servo_get_record(l.servo)->faults, CR_FAULT_LATE);
    assert_int_equal(row, 3); /* what device.toml and DESIGN.md say */
    assert_in_range(periods, row * LATE_MAX, row * (LATE_MAX + 2u));
    crt_loop_free(&l);
}

static void search_that_never_answered_is_a_fault_too(void **state) {
    (void)state;
    crt_loop l = crt_loop_make_beside(LATE_MAX);
    l.search[1] = 0u;
    assert_true(crt_loop_run_until(&l, CR_MODE_IDLE, 3000u));
    cr_servo_input(l.servo, CR_COMMAND_START);
    for (uint32_t k = 0; k <= LATE_MAX + 1u && crt_loop_mode(&l) != CR_MODE_FAULT; k++) {
        crt_loop_period(&l);
        assert_true(cr_servo_get_record(l.servo)->contact_force_world_N.z == 0.0f);
    }
    assert_int_equal(cr_servo_get_record(l.servo)->faults, CR_FAULT_LATE);
    crt_loop_free(&l);
}

static void search_that_stands_still_is_none_while_nothing_is_rendered(void **state) {
    (void)state;
    crt_loop l = crt_loop_make_beside(LATE_MAX);
    assert_true(crt_loop_run_until(&l, CR_MODE_IDLE, 2000u));
    l.target[2] = 0.02; /* into the wall */
    for (uint32_t k = 0; k < 400u; k++) {
        crt_loop_period(&l);
    }
    assert_true(cr_servo_get_record(l.servo)->contact_force_world_N.z > 0.0f);
    l.search[1] = 0u;
    for (uint32_t k = 0; k < 2u * LATE_MAX; k++) {
        crt_loop_period(&l);
        const cr_record *r = cr_servo_get_record(l.servo);
        assert_int_equal(r->mode, CR_MODE_IDLE);
        assert_true(r->contact_late_ticks <= LATE_MAX + 1u);
        assert_true((r->contact_force_world_N.z > 0.0f) == (r->contact_late_ticks <= LATE_MAX));
    }
    assert_int_equal(cr_servo_get_record(l.servo)->contact_late_ticks, LATE_MAX + 1u);
    /* It answers again: what is too old to be felt does not come back beside the first answer that is not. */
    l.search[1] = 1u;
    l.search_work = 24u;
    float before_N = 0.0f;
    uint32_t rises = 0u, felt = 0u;
    for (uint32_t k = 0; k < 4u * LATE_MAX && (rises == 0u || felt < rises); k++) {
        crt_loop_period(&l);
        const cr_record *r = cr_servo_get_record(l.servo);
        const float force_N = r->contact_force_world_N.z;
        rises = felt == 0u && force_N > 0.0f ? r->contact_late_ticks : rises;
        felt += force_N > 0.0f;
        assert_true(rises == 0u || before_N == 0.0f ||
                    fabsf(force_N - before_N * (float)felt / (float)(felt - 1u)) < 0.1f * force_N);
        before_N = force_N;
    }
    assert_true(rises > 1u && felt == rises);
    const cr_rerun result = run_again(&l, l.records, 3u);
    assert_int_equal(result.different, 0);
    crt_loop_free(&l);
}

/* An answer that is too old to be felt is in no recording: the search after it does not look ahead by it. */
static void recording_with_an_answer_that_was_too_old_runs_again_to_the_bit(void **state) {
    (void)state;
    uint32_t too_old = 0u;
    for (uint32_t phase = 100u; phase < 124u; phase += 3u) {
        crt_loop l = crt_loop_make_beside(LATE_MAX);
        assert_true(crt_loop_run_until(&l, CR_MODE_IDLE, 2000u));
        l.target[0] = 0.07;
        l.target[2] = 0.02;
        for (uint32_t k = 0; k < 1400u; k++) {
            crt_loop_period(&l);
        }
        l.search_work = 24u;
        for (uint32_t k = 0; k < 500u; k++) {
            l.search[1] = k < phase || k >= phase + LATE_MAX + 20u;
            l.target[0] = 0.072 + 0.012 * sin((double)k * 0.03);
            l.target[2] = 0.02 + 0.005 * sin((double)k * 0.05);
            crt_loop_period(&l);
            too_old += cr_servo_get_record(l.servo)->contact_late_ticks == LATE_MAX + 1u;
        }
        assert_int_equal(run_again(&l, l.records, 1u).different, 0);
        crt_loop_free(&l);
    }
    assert_true(too_old > 100u);
}

/* Force of a world that searches in its tick, at the pose of a record. */
static float force_at(cr_world *world, const cr_record *r) {
    cr_output out;
    cr_tick(world, &r->world_from_tool, 1e-3f, &out);
    return out.force_world_N.z;
}

static void what_is_felt_is_what_a_tick_would_answer(void **state) {
    (void)state;
    crt_loop l = crt_loop_make_beside(LATE_MAX);
    crt_loop_press(&l);
    const size_t size = cr_world_size(crt_loop_scene(), &l.config.world);
    void *memory = aligned_alloc(64, (size + 63u) / 64u * 64u);
    cr_world *world;
    float most_N = 0.0f, first_N = 0.0f, other_N = 0.0f, speed_m_s = 0.0f;
    assert_int_equal(cr_world_init(&world, memory, size, crt_loop_scene(), &l.config.world), CR_OK);
    for (uint32_t k = 0; k < 600u; k++) {
        l.target[0] = 0.02 * sin((double)k * 0.01);
        l.target[2] = 0.025 + 0.003 * cos((double)k * 0.02);
        crt_loop_period(&l);
        const cr_record *r = cr_servo_get_record(l.servo);
        assert_int_equal(r->contact_late_ticks, 1u);
        const float felt_N = r->contact_force_world_N.z, off_N = fabsf(felt_N - force_at(world, r));
        most_N = fmaxf(most_N, felt_N);
        first_N = felt_N > 0.0f ? first_N : fmaxf(first_N, off_N);
        other_N = felt_N > 0.0f ? fmaxf(other_N, off_N) : other_N;
        speed_m_s = fmaxf(speed_m_s, fabsf(r->velocity_world_m_s.z));
    }
    print_message("force up to %.3f N; %.6f N from a tick of its own, %.6f N in the first tick of a contact\n",
                  (double)most_N, (double)other_N, (double)first_N);
    /* A flat wall: the plane of one tick ago is this tick's. A contact that was not there then is felt a tick later. */
    assert_true(most_N > 1.0f && other_N < 0.002f && first_N > 0.0f);
    assert_true(first_N < 1.5f * speed_m_s * 1e-3f * l.config.world.stiffness_N_m);
    free(memory);
    crt_loop_free(&l);
}

static void servo_that_searches_in_its_tick_has_nothing_to_search_beside(void **state) {
    (void)state;
    crt_loop l = crt_loop_make();
    crt_loop_press(&l);
    assert_int_equal(cr_servo_search(l.servo, 1u << 20), 0);
    assert_int_equal(cr_servo_get_record(l.servo)->contact_late_ticks, 0);
    crt_loop_free(&l);
    cr_servo_config config = cr_servo_config_default();
    config.late_max_ticks = CR_LATE_MAX + 1u;
    assert_string_equal(cr_servo_config_error(&config), "late_max_ticks: 0..255");
    config.late_max_ticks = CR_LATE_MAX;
    assert_null(cr_servo_config_error(&config));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(recording_of_two_rates_runs_again_to_the_bit),
        cmocka_unit_test(re_run_with_another_age_is_another),
        cmocka_unit_test(search_that_stands_still_is_a_fault),
        cmocka_unit_test(age_of_contact_counts_poses_that_were_felt),
        cmocka_unit_test(search_that_never_answered_is_a_fault_too),
        cmocka_unit_test(search_that_stands_still_is_none_while_nothing_is_rendered),
        cmocka_unit_test(recording_with_an_answer_that_was_too_old_runs_again_to_the_bit),
        cmocka_unit_test(what_is_felt_is_what_a_tick_would_answer),
        cmocka_unit_test(servo_that_searches_in_its_tick_has_nothing_to_search_beside),
    };
    return cmocka_run_group_tests(tests, crt_loop_build_scene, crt_loop_free_scene);
}
