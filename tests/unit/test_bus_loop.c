/* The CANopen manager while drives run: its frames, byte by byte as CiA 301, CiA 402 and servo/SPEC.md have them, and what makes it stop. */
#include "bus_rig.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>

#include <cmocka.h>

/* ------------------------------------------------------------------------------------------------------- packing */

static void torque_frame_is_three_little_endian_words(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_run_all(&r);
    r.target[0] = 1000;
    r.target[1] = -2;
    r.target[2] = -32767;
    crt_bus_send_states(&r, 0x0627);
    crt_bus_period(&r);
    assert_int_equal(r.tx.frames[0].id, 0x181);
    assert_true(CRT_IS_SENT(&r, 0x181, 0xe8, 0x03, 0xfe, 0xff, 0x01, 0x80));
}

static void state_frame_is_position_torque_status(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    CRT_RECEIVE(&r, 0x192, 0xfe, 0xff, 0xff, 0xff, 0x9c, 0xff, 0x37, 0x06);
    assert_int_equal(r.bus.drive[1].counts, -2);
    assert_int_equal(r.bus.drive[1].actual, -100);
    assert_int_equal(r.bus.drive[1].status, 0x0637);
    CRT_RECEIVE(&r, 0x191, 0x00, 0x00, 0x00, 0x80, 0x00, 0x80, 0x00, 0x00);
    assert_int_equal(r.bus.drive[0].counts, INT32_MIN);
    assert_int_equal(r.bus.drive[0].actual, INT16_MIN);
    CRT_RECEIVE(&r, 0x193, 0xff, 0xff, 0xff, 0x7f, 0xff, 0x7f, 0xff, 0xff);
    assert_int_equal(r.bus.drive[2].counts, INT32_MAX);
    assert_true(r.bus.drive[2].actual == 32767 && r.bus.drive[2].status == 0xffff);
}

static void wrist_frame_is_three_angles(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    CRT_RECEIVE(&r, 0x194, 0x01, 0x00, 0xfe, 0xff, 0x10, 0x0e);
    assert_true(r.bus.wrist.counts[0] == 1 && r.bus.wrist.counts[1] == -2 && r.bus.wrist.counts[2] == 3600);
    CRT_RECEIVE(&r, 0x194, 0x00, 0x80, 0xff, 0x7f, 0, 0);
    assert_true(r.bus.wrist.counts[0] == INT16_MIN && r.bus.wrist.counts[1] == INT16_MAX);
    CRT_RECEIVE(&r, 0x194, 0x05, 0x00, 0x05, 0x00, 0x05);
    assert_true(r.bus.wrist.counts[0] == INT16_MIN && r.counters.malformed == 1u);
}

static void wrist_is_bridged_and_then_a_fault(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_run_all(&r);
    for (int k = 0; k < 100; k++) { /* every second period is what is asked for */
        crt_bus_send_states(&r, 0x0627);
        if (k % 2 == 1) {
            crt_bus_send_wrist(&r);
        }
        crt_bus_period(&r);
        assert_true(r.faults == 0u && r.counters.wrist_missing == 0u);
    }
    for (uint32_t k = 0; k < 2u * r.config.missing_max + 1u; k++) {
        crt_bus_send_states(&r, 0x0627);
        crt_bus_period(&r);
        assert_int_equal(r.faults, 0);
    }
    crt_bus_send_states(&r, 0x0627);
    crt_bus_period(&r);
    assert_int_equal(r.faults, CR_FAULT_SILENT);
    assert_true(r.counters.wrist_missing == r.config.missing_max + 1u && r.bus.trouble_axis == 2u);
}

static void per_mille_rounds_and_saturates(void **state) {
    (void)state;
    const struct {
        float torque, rated, limit;
        int want;
    } table[] = {
        {10.0f, 10.0f, 20.0f, 1000},   {-3.6f, 3.6f, 9.0f, -1000},    {0.00501f, 10.0f, 20.0f, 1},
        {0.0049f, 10.0f, 20.0f, 0},    {-0.00501f, 10.0f, 20.0f, -1}, {25.0f, 10.0f, 20.0f, 2000},
        {-1e30f, 10.0f, 20.0f, -2000}, {1e30f, 1e-3f, 1e30f, 32767},  {-1e30f, 1e-3f, 1e30f, -32767},
        {NAN, 10.0f, 20.0f, 0},        {INFINITY, 10.0f, 20.0f, 0},   {1.0f, 0.0f, 20.0f, 0},
        {1.0f, NAN, 20.0f, 0},         {1.0f, 10.0f, NAN, 0},         {7.0f, 7.0f, 6.9999f, 999},
    };
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        assert_int_equal(cr_per_mille(table[i].torque, table[i].rated, table[i].limit), table[i].want);
    }
}

/* ------------------------------------------------------------------------------------------------------- running */

static void heartbeat_goes_out_every_100_ms_after_the_torque(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    uint32_t beats = 0u;
    crt_bus_run_all(&r);
    for (int k = 0; k < 1000; k++) {
        if (k % 100 == 0) {
            CRT_RECEIVE(&r, 0x711, 0x05);
            CRT_RECEIVE(&r, 0x712, 0x05);
            CRT_RECEIVE(&r, 0x713, 0x05);
        }
        crt_bus_send_states(&r, 0x0627);
        crt_bus_send_wrist(&r);
        crt_bus_period(&r);
        assert_int_equal(r.tx.frames[0].id, 0x181);
        beats += CRT_IS_SENT(&r, 0x701, 0x05) ? 1u : 0u;
    }
    assert_int_equal(beats, 10);
    assert_int_equal(r.faults, 0);
}

static void drive_without_heartbeat_is_a_fault(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_run_all(&r);
    uint32_t k = 0u;
    for (; k < 1000u && r.faults == 0u; k++) {
        crt_bus_send_states(&r, 0x0627);
        crt_bus_send_wrist(&r);
        crt_bus_period(&r);
    }
    assert_int_equal(r.faults, CR_FAULT_HEARTBEAT);
    assert_true(k >= r.config.drive_timeout_ms - 5u && k <= r.config.drive_timeout_ms + 2u);
}

static void silent_drive_is_bridged_and_then_a_fault(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_run_all(&r);
    for (uint32_t k = 0; k < r.config.missing_max; k++) {
        CRT_RECEIVE(&r, 0x191, 0x10, 0, 0, 0, 0, 0, 0x27, 0x06);
        CRT_RECEIVE(&r, 0x193, 0x10, 0, 0, 0, 0, 0, 0x27, 0x06);
        crt_bus_period(&r);
        assert_int_equal(r.faults, 0);
    }
    crt_bus_period(&r);
    assert_int_equal(r.faults, CR_FAULT_SILENT);
    assert_int_equal(r.counters.missing[1], 3);
    assert_int_equal(r.counters.missing[0], 1);
}

static void late_state_is_counted_and_is_not_this_periods(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_run_all(&r);
    const cr_frame late = {0x191, 8u, CR_FRAME_EARLY, {0x20, 0, 0, 0, 0, 0, 0x27, 0x06}};
    cr_bus_receive(&r.config, &r.bus, &late, r.now_ns, &r.counters);
    assert_int_equal(r.counters.late, 1);
    assert_int_equal(r.bus.drive[0].state_count, 0);
    assert_int_equal(r.bus.drive[0].counts, 0x20);
}

static void one_frame_can_fault_the_running_bus(void **state) {
    (void)state;
    static const struct {
        cr_frame frame;
        uint32_t fault;
    } table[] = {
        {{0x691, 8u, 0u, {0x10, 0x23, 0x03, 0, 0, 0, 0, 0}}, CR_FAULT_EMCY}, /* overcurrent */
        {{0x693, 8u, 0u, {0x05, 0x73, 0x81, 0, 0, 0, 0, 0}}, CR_FAULT_EMCY}, /* encoder */
        {{0x092, 8u, 0u, {0x30, 0x81, 0x11, 0, 0, 0, 0, 0}}, CR_FAULT_EMCY}, /* under the default identifier */
        {{0x692, 8u, 0u, {0x00, 0x00, 0x00, 0, 0, 0, 0, 0}}, 0u},            /* error reset */
        {{0x711, 1u, 0u, {0x00}}, CR_FAULT_RESET},
        {{0x712, 1u, 0u, {0x7f}}, CR_FAULT_RESET},
        {{0x713, 1u, 0u, {0x04}}, CR_FAULT_RESET},
        {{0x713, 1u, 0u, {0x05}}, 0u},
        {{0x000, 2u, 0u, {0x01, 0x00}}, CR_FAULT_ALIEN},
        {{0x080, 0u, 0u, {0}}, CR_FAULT_ALIEN},
        {{0x181, 6u, 0u, {0}}, CR_FAULT_ALIEN},
        {{0x211, 3u, 0u, {0x0f, 0, 0x0a}}, CR_FAULT_ALIEN},
        {{0x613, 8u, 0u, {0x40, 0x41, 0x60}}, CR_FAULT_ALIEN},
        {{0x701, 1u, 0u, {0x05}}, CR_FAULT_ALIEN},
        {{0x123, 8u, 0u, {0}}, 0u},
        {{0x7ff, 8u, 0u, {0}}, 0u},
    };
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        crt_bus_rig r = crt_bus_make();
        crt_bus_run_all(&r);
        cr_bus_receive(&r.config, &r.bus, &table[i].frame, r.now_ns, &r.counters);
        crt_bus_send_states(&r, 0x0627);
        crt_bus_period(&r);
        assert_int_equal(r.faults, table[i].fault);
    }
}

static void status_word_of_a_running_drive_must_say_enabled(void **state) {
    (void)state;
    static const struct {
        uint16_t status;
        uint32_t fault;
    } table[] = {{0x0627, 0u},
                 {0x1637, 0u},
                 {0x0608, CR_FAULT_DRIVE},
                 {0x060f, CR_FAULT_DRIVE},
                 {0x0250, CR_FAULT_DRIVE_STATE},
                 {0x0231, CR_FAULT_DRIVE_STATE},
                 {0x0233, CR_FAULT_DRIVE_STATE},
                 {0x0207, CR_FAULT_DRIVE_STATE}, /* quick stop */
                 {0x0000, CR_FAULT_DRIVE_STATE}};
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        crt_bus_rig r = crt_bus_make();
        crt_bus_run_all(&r);
        crt_bus_send_states(&r, table[i].status);
        crt_bus_period(&r);
        assert_int_equal(r.faults, table[i].fault);
    }
}

static void two_drives_of_one_number_are_noticed(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_run_all(&r);
    crt_bus_send_states(&r, 0x0627);
    crt_bus_send_states(&r, 0x0627);
    crt_bus_period(&r);
    assert_true(r.faults == 0u && r.counters.twice == 3u); /* once may be a repeat of the wire */
    for (int k = 0; k < 2; k++) {
        crt_bus_send_states(&r, 0x0627);
        crt_bus_send_states(&r, 0x0627);
        crt_bus_period(&r);
    }
    assert_int_equal(r.faults, CR_FAULT_ALIEN);
}

static void drive_that_talks_more_than_it_may_is_babbling(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_run_all(&r);
    for (int k = 0; k < 3; k++) {
        CRT_RECEIVE(&r, 0x692, 0, 0, 0, 0, 0, 0, 0, 0);
    }
    crt_bus_send_states(&r, 0x0627);
    crt_bus_period(&r);
    assert_int_equal(r.faults, 0);
    for (int k = 0; k < 4; k++) {
        CRT_RECEIVE(&r, 0x692, 0, 0, 0, 0, 0, 0, 0, 0);
    }
    crt_bus_send_states(&r, 0x0627);
    crt_bus_period(&r);
    assert_int_equal(r.faults, CR_FAULT_BABBLE);
    assert_true(r.bus.trouble_axis == 1u && r.counters.babbled == 1u);
}

static void off_is_said_at_once_and_every_20_ms(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_run_all(&r);
    r.off = 1;
    crt_bus_send_states(&r, 0x0627);
    crt_bus_period(&r);
    for (uint16_t id = 0x211; id <= 0x213; id++) {
        assert_true(CRT_IS_SENT(&r, id, 0x00, 0x00, 0x0a));
    }
    uint32_t words = 0u;
    for (int k = 0; k < 200; k++) {
        crt_bus_send_states(&r, 0x0250);
        crt_bus_period(&r);
        const int said = crt_bus_sent(&r, 0x211) != NULL;
        assert_true(!said || (CRT_IS_SENT(&r, 0x211, 0x00, 0x00, 0x0a) && CRT_IS_SENT(&r, 0x213, 0x00, 0x00, 0x0a)));
        words += said ? 1u : 0u;
        assert_int_equal(r.tx.frames[0].id, 0x181);
    }
    assert_in_range(words, 9, 11);
}

/* Any bytes under any identifier: nothing but counters, faults and states changes, and no frame is malformed on the way out. */
static void noise_never_breaks_the_manager(void **state) {
    (void)state;
    static const uint16_t ids[] = {0x000, 0x080, 0x181, 0x191, 0x192, 0x193, 0x194, 0x211, 0x591, 0x592,
                                   0x593, 0x611, 0x691, 0x092, 0x701, 0x711, 0x712, 0x713, 0x7ff};
    uint32_t seed = 7u;
    crt_bus_rig r = crt_bus_make();
    crt_bus_boot_all(&r);
    for (int k = 0; k < 200000; k++) {
        cr_frame frame = {0};
        uint8_t *bytes = frame.data;
        for (int i = 0; i < 8; i++) {
            seed = seed * 1664525u + 1013904223u;
            bytes[i] = (uint8_t)(seed >> 24);
        }
        frame.id = ids[(seed >> 8) % (sizeof ids / sizeof *ids)];
        frame.size = (uint8_t)((seed >> 16) % 9u);
        frame.flags = (uint8_t)(seed >> 20 & 1u);
        cr_bus_receive(&r.config, &r.bus, &frame, r.now_ns, &r.counters);
        if (k % 5 == 0) {
            crt_bus_period(&r);
            assert_true(r.tx.count >= 1u && r.tx.count <= CR_TX_MAX && r.tx.frames[0].id == 0x181);
            for (uint32_t i = 0; i < r.tx.count; i++) {
                assert_true(r.tx.frames[i].id <= 0x7ffu && r.tx.frames[i].size <= 8u);
            }
        }
    }
    assert_true(r.bus.sdo_axis <= CR_AXES);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(torque_frame_is_three_little_endian_words),
        cmocka_unit_test(state_frame_is_position_torque_status),
        cmocka_unit_test(wrist_frame_is_three_angles),
        cmocka_unit_test(wrist_is_bridged_and_then_a_fault),
        cmocka_unit_test(per_mille_rounds_and_saturates),
        cmocka_unit_test(heartbeat_goes_out_every_100_ms_after_the_torque),
        cmocka_unit_test(drive_without_heartbeat_is_a_fault),
        cmocka_unit_test(silent_drive_is_bridged_and_then_a_fault),
        cmocka_unit_test(late_state_is_counted_and_is_not_this_periods),
        cmocka_unit_test(one_frame_can_fault_the_running_bus),
        cmocka_unit_test(status_word_of_a_running_drive_must_say_enabled),
        cmocka_unit_test(two_drives_of_one_number_are_noticed),
        cmocka_unit_test(drive_that_talks_more_than_it_may_is_babbling),
        cmocka_unit_test(off_is_said_at_once_and_every_20_ms),
        cmocka_unit_test(noise_never_breaks_the_manager),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
