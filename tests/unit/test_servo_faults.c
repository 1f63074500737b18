/* Every fault of a servo that presses on a wall, and the re-run of its recording. */
#include "servo_loop.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define MS 1000000ull

typedef enum {
    DO_SILENT,
    DO_HEARTBEAT,
    DO_RESET,
    DO_DRIVE_FAULT,
    DO_DRIVE_OFF,
    DO_EMCY,
    DO_JUMP,
    DO_WRIST_JUMP,
    DO_WRIST_SILENT,
    DO_RANGE,
    DO_NOT_FINITE,
    DO_OVERRUN,
    DO_NO_SYNC,
    DO_BACKWARDS,
    DO_PERIOD,
    DO_ALIEN,
    DO_TWICE,
    DO_BABBLE,
    DO_BUS_OFF,
    DO_SEND_FAILED,
    DO_COUNT
} deed;

/* `ticks`: periods until the fault, 1 is the very tick. */
static const struct {
    uint32_t fault, ticks;
} outcomes[DO_COUNT] = {
    {CR_FAULT_SILENT, 3u},      {CR_FAULT_HEARTBEAT, 252u}, {CR_FAULT_RESET, 1u},      {CR_FAULT_DRIVE, 1u},
    {CR_FAULT_DRIVE_STATE, 1u}, {CR_FAULT_EMCY, 1u},        {CR_FAULT_JUMP, 1u},       {CR_FAULT_JUMP, 2u},
    {CR_FAULT_SILENT, 7u},      {CR_FAULT_RANGE, 400u},     {CR_FAULT_NOT_FINITE, 1u}, {CR_FAULT_OVERRUN, 1u},
    {CR_FAULT_BAD_STATE, 1u},   {CR_FAULT_BAD_STATE, 1u},   {CR_FAULT_BAD_STATE, 1u},  {CR_FAULT_ALIEN, 1u},
    {CR_FAULT_ALIEN, 3u},       {CR_FAULT_BABBLE, 1u},      {CR_FAULT_BUS_OFF, 1u},    {CR_FAULT_BUS_OFF, 1u},
};

static void commit(crt_loop *l, deed what, uint32_t axis, int again) {
    crt_loop_drive *d = &l->drives[axis];
    switch (what) {
    case DO_SILENT:
        d->mute = 1;
        break;
    case DO_HEARTBEAT:
        d->mute_heartbeat = 1;
        break;
    case DO_RESET:
        crt_loop_add_extra(l, (uint16_t)(0x711u + axis), 1u, 0x00, 0);
        break;
    case DO_DRIVE_FAULT:
        d->state = CRT_DRIVE_FAULTED;
        break;
    case DO_DRIVE_OFF:
        d->state = CRT_DRIVE_ON;
        break;
    case DO_EMCY:
        crt_loop_add_extra(l, (uint16_t)(0x691u + axis), 8u, 0x10, 0x23);
        break;
    case DO_JUMP:
        d->slide += again ? 0 : 100;
        break;
    case DO_WRIST_JUMP:
        l->wrist[1] = 500;
        break;
    case DO_WRIST_SILENT:
        l->mute_wrist = 1;
        break;
    case DO_RANGE:
        d->slide += 40;
        break;
    case DO_NOT_FINITE:
        l->servo->control.energy_J = NAN;
        break;
    case DO_OVERRUN:
        l->skip_ns = 3u * MS;
        break;
    case DO_NO_SYNC:
        l->no_sync = 1;
        break;
    case DO_BACKWARDS:
        l->now_ns -= 5u * MS;
        break;
    case DO_PERIOD:
        l->period_s = NAN;
        break;
    case DO_ALIEN:
        crt_loop_add_extra(l, 0x181, 6u, 0x10, 0);
        break;
    case DO_TWICE: /* the drive's own state a second time */
        crt_loop_add_extra(l, (uint16_t)(0x191u + axis), 8u, 0, 0);
        memcpy(l->extra[0].data, cr_servo_get_record(l->servo)->frames[axis].data, 8);
        break;
    case DO_BABBLE:
        for (int i = 0; i < 20; i++) {
            crt_loop_add_extra(l, (uint16_t)(0x691u + axis), 8u, 0, 0);
        }
        break;
    case DO_BUS_OFF:
        cr_servo_input(l->servo, CR_INPUT_BUS_OFF);
        break;
    case DO_SEND_FAILED:
        cr_servo_input(l->servo, CR_INPUT_SEND_FAILED);
        break;
    default:
        break;
    }
}

/* A tick 1.9 ms after the last is one period late, 2.9 ms are two, 3.9 three. */
static void late_ticks_hold_the_torque_then_halve_it_then_are_a_fault(void **state) {
    (void)state;
    static const struct {
        uint32_t count, skip_ns;
        float share;
    } late[] = {
        {1u, 900000u, 1.0f}, {2u, 900000u, 0.5f}, {1u, 1900000u, 0.5f}, {3u, 900000u, 0.0f}, {1u, 2900000u, 0.0f}};
    for (size_t i = 0; i < sizeof late / sizeof *late; i++) {
        crt_loop l = crt_loop_make();
        crt_loop_press(&l);
        const cr_record *r = cr_servo_get_record(l.servo);
        cr_record before = *r;
        for (uint32_t k = 0; k < late[i].count; k++) {
            before = *r;
            l.skip_ns = late[i].skip_ns;
            crt_loop_period(&l);
        }
        const int fault = late[i].share == 0.0f;
        assert_true(r->counters.overruns == late[i].count && r->faults == (fault ? (uint32_t)CR_FAULT_OVERRUN : 0u));
        assert_true((fault || (r->limits & CR_LIMIT_STALE) != 0u) && before.torque[1] != 0.0f);
        for (int a = 0; a < CR_AXES; a++) {
            assert_true(r->torque[a] == late[i].share * before.torque[a]);
        }
        crt_loop_period(&l);
        assert_true((r->limits & CR_LIMIT_STALE) == 0u && cr_mode_is_rendering(r->mode) == !fault);
        crt_loop_free(&l);
    }
}

static void one_fault(deed what, uint32_t axis, int wait) {
    crt_loop l = crt_loop_make();
    crt_loop_press(&l);
    for (int k = 0; k < wait; k++) {
        crt_loop_period(&l);
    }
    assert_true(v3_norm(cr_servo_get_record(l.servo)->force_world_N) > 0.5f);
    uint32_t ticks = 0u;
    while (crt_loop_mode(&l) != CR_MODE_FAULT && ticks < 500u) {
        commit(&l, what, axis, ticks > 0u);
        crt_loop_period(&l);
        ticks++;
        if (crt_loop_mode(&l) != CR_MODE_FAULT) {
            assert_true(cr_mode_is_rendering(crt_loop_mode(&l)));
        }
    }
    const cr_servo_status first = cr_servo_get_status(l.servo);
    assert_true(ticks <= outcomes[what].ticks);
    assert_true((first.first_fault & outcomes[what].fault) != 0u);
    assert_true(crt_loop_torque_is_zero(&l));
    /* It latches: no start, no time, no good behaviour brings it back. */
    l.drives[axis].mute = l.drives[axis].mute_heartbeat = 0;
    for (int k = 0; k < 300; k++) {
        cr_servo_input(l.servo, CR_COMMAND_START);
        crt_loop_period(&l);
        assert_true(crt_loop_mode(&l) == CR_MODE_FAULT && crt_loop_torque_is_zero(&l));
    }
    assert_true(l.drives[0].held == 0 && l.drives[1].held == 0 && l.drives[2].held == 0);
    assert_int_equal(cr_servo_get_status(l.servo).counters.faults, 1);
    assert_true((l.records[l.record_count - 1u].faults & outcomes[what].fault) != 0u);
    /* Commanded, it comes back from the start, and renders. */
    l.drives[axis].slide = 0;
    l.wrist[1] = 0;
    l.mute_wrist = 0;
    cr_servo_input(l.servo, CR_COMMAND_CLEAR);
    crt_loop_period(&l);
    assert_int_equal(crt_loop_mode(&l), CR_MODE_INIT);
    crt_loop_press(&l);
    crt_loop_free(&l);
}

/* Late ticks and missing states by turns: neither is ever as many in a row as its own fault asks for. */
static void no_state_in_time_for_long_is_a_fault_whatever_kept_it(void **state) {
    (void)state;
    crt_loop l = crt_loop_make();
    crt_loop_press(&l);
    const cr_record *r = cr_servo_get_record(l.servo);
    uint32_t periods = 0u;
    for (uint32_t k = 0; k < 12u && r->faults == 0u; k++) {
        const int late = k % 3u == 0u;
        l.skip_ns = late ? 900000u : 0u;
        l.drives[1].mute = !late;
        periods += late ? 2u : 1u;
        crt_loop_period(&l);
    }
    assert_true(r->faults == CR_FAULT_SILENT && periods == 3u * l.config.bus.missing_max + 1u);
    assert_true(crt_loop_torque_is_zero(&l) && r->counters.overruns == 2u);
    crt_loop_free(&l);
}

static void every_fault_zeroes_in_its_tick_latches_and_clears(void **state) {
    (void)state;
    for (int what = 0; what < DO_COUNT; what++) {
        for (int wait = 0; wait < 200; wait += 50) {
            one_fault((deed)what, what == DO_RANGE ? 0u : (uint32_t)(wait / 50) % 3u, wait);
        }
    }
}

/* Leaning on the wall for seconds, and sliding along it, is no reason to suspect an encoder, though X keeps its count. */
static void joint_that_rests_in_contact_is_no_fault(void **state) {
    (void)state;
    crt_loop l = crt_loop_make();
    crt_loop_press(&l);
    for (int k = 0; k < 3000; k++) {
        l.target[1] += k > 1500 ? 1e-5 : 0.0;
        crt_loop_period(&l);
        assert_true(cr_mode_is_rendering(crt_loop_mode(&l)));
    }
    assert_true(cr_servo_get_record(l.servo)->area_count == 1u);
    crt_loop_free(&l);
}

static void stuck_encoder_is_noticed_when_the_torque_swings(void **state) {
    (void)state;
    for (uint32_t axis = 1; axis < 3u; axis++) {
        crt_loop l = crt_loop_make();
        crt_loop_press(&l);
        l.drives[axis].stuck = 1;
        int k = 0;
        for (; k < 1000 && crt_loop_mode(&l) != CR_MODE_FAULT; k++) {
            l.target[2] -= k > 100 && k < 600 ? 1e-4 : 0.0;
            crt_loop_period(&l);
        }
        assert_int_equal(cr_servo_get_status(l.servo).first_fault, CR_FAULT_STUCK);
        assert_true(crt_loop_torque_is_zero(&l) && k > 200);
        crt_loop_free(&l);
    }
}

static void stuck_encoder_is_not_watched_when_told_so(void **state) {
    (void)state;
    crt_loop l = crt_loop_make();
    l.servo->config.axis[1].stuck = 0.0f;
    crt_loop_press(&l);
    l.drives[1].stuck = 1;
    for (int k = 0; k < 1000; k++) {
        l.target[2] -= k > 100 && k < 600 ? 1e-4 : 0.0;
        crt_loop_period(&l);
        assert_true(cr_mode_is_rendering(crt_loop_mode(&l)));
    }
    crt_loop_free(&l);
}

/* -------------------------------------------------------------------------------------------------------- re-run */

static cr_rerun rerun(const crt_loop *l, const cr_record *records, size_t count, cr_record *out) {
    cr_servo *fresh;
    cr_rerun result = {0};
    const size_t size = cr_servo_size(crt_loop_scene(), &l->config);
    void *memory = aligned_alloc(64, (size + 63u) / 64u * 64u);
    assert_int_equal(cr_servo_init(&fresh, memory, size, crt_loop_scene(), &l->config), CR_OK);
    assert_int_equal(cr_servo_rerun(fresh, records, count / 2u, &result, out), CR_OK); /* in two pieces */
    assert_int_equal(
        cr_servo_rerun(fresh, records + count / 2u, count - count / 2u, &result, out == NULL ? NULL : out + count / 2u),
        CR_OK);
    free(memory);
    return result;
}

static void recording_runs_again_to_the_bit(void **state) {
    (void)state;
    for (int what = -1; what < DO_COUNT; what++) {
        if (what == DO_NOT_FINITE) {
            continue; /* reaches into the servo, which no input can */
        }
        crt_loop l = crt_loop_make();
        crt_loop_press(&l);
        for (int k = 0; k < 20; k++) {
            if (what >= 0 && crt_loop_mode(&l) != CR_MODE_FAULT) {
                commit(&l, (deed)what, 1u, k > 0);
            }
            crt_loop_period(&l);
        }
        const cr_rerun result = rerun(&l, l.records, l.record_count, NULL);
        assert_int_equal(result.records, l.record_count);
        assert_int_equal(result.different, 0);
        crt_loop_free(&l);
    }
}

static void re_run_notices_a_changed_bit_and_a_gap(void **state) {
    (void)state;
    crt_loop l = crt_loop_make();
    crt_loop_press(&l);
    l.records[1200].frames[1].data[0] ^= 1u; /* one count of Y */
    cr_rerun result = rerun(&l, l.records, l.record_count, NULL);
    assert_true(result.different > 0u && result.first == 1200u && result.gap == 0u);
    l.records[1200].frames[1].data[0] ^= 1u;
    memmove(&l.records[1300], &l.records[1301], (l.record_count - 1301u) * sizeof *l.records);
    result = rerun(&l, l.records, l.record_count - 1u, NULL);
    assert_true(result.records == 1300u && result.gap == 1u && result.different == 0u);
    crt_loop_free(&l);
}

static void record_holds_what_was_sent(void **state) {
    (void)state;
    crt_loop l = crt_loop_make();
    crt_loop_press(&l);
    crt_loop_period(&l);
    const cr_record *r = cr_servo_get_record(l.servo);
    const uint8_t *data = l.tx.frames[0].data;
    for (int a = 0; a < 3; a++) {
        assert_int_equal(r->target[a], (int16_t)(data[2 * a] | data[2 * a + 1] << 8));
        assert_true(fabsf((float)r->target[a] - r->torque[a] / l.config.axis[a].rated * 1000.0f) <= 0.5001f);
    }
    assert_true((r->fresh & 7u) == 7u && r->frame_count >= 3u && r->period_s == 1e-3f);
    crt_loop_free(&l);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(late_ticks_hold_the_torque_then_halve_it_then_are_a_fault),
        cmocka_unit_test(no_state_in_time_for_long_is_a_fault_whatever_kept_it),
        cmocka_unit_test(every_fault_zeroes_in_its_tick_latches_and_clears),
        cmocka_unit_test(joint_that_rests_in_contact_is_no_fault),
        cmocka_unit_test(stuck_encoder_is_noticed_when_the_torque_swings),
        cmocka_unit_test(stuck_encoder_is_not_watched_when_told_so),
        cmocka_unit_test(recording_runs_again_to_the_bit),
        cmocka_unit_test(re_run_notices_a_changed_bit_and_a_gap),
        cmocka_unit_test(record_holds_what_was_sent),
    };
    return cmocka_run_group_tests(tests, crt_loop_build_scene, crt_loop_free_scene);
}
