/* The CANopen manager from power-on to drives that run: what it says and asks, against byte vectors written by hand from the tables of
 * CiA 301, CiA 402 and servo/SPEC.md. */
#include "bus_rig.h"

#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <cmocka.h>

#define MS 1000000ull

static void host_listens_before_it_speaks(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    for (uint32_t ms = 0; ms < r.config.listen_ms; ms++) {
        crt_bus_period(&r);
        assert_int_equal(r.tx.count, 0);
        assert_int_equal(r.bus.phase, CR_PHASE_LISTEN);
    }
    crt_bus_period(&r);
    assert_true(CRT_IS_SENT(&r, 0x000, 0x82, 0x00)); /* NMT: reset communication, all nodes */
    assert_true(CRT_IS_SENT(&r, 0x701, 0x05));
    cr_tx sync = {0};
    cr_bus_sync(&r.bus, &sync);
    assert_true(sync.count == 1u && sync.frames[0].id == 0x080 && sync.frames[0].size == 0u);
}

static void host_that_hears_another_while_listening_stays_silent(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    uint32_t frames = 0u;
    for (uint32_t ms = 0; ms < 700u; ms++) {
        if (ms == 5u) {
            crt_bus_receive(&r, 0x080, 0u, (const uint8_t *)"");
        }
        cr_tx sync = {0};
        cr_bus_sync(&r.bus, &sync);
        crt_bus_period(&r);
        frames += r.tx.count + sync.count;
    }
    assert_int_equal(r.faults, CR_FAULT_ALIEN);
    assert_int_equal(frames, 0);
    cr_bus_reset(&r.bus, cr_servo_config_default().axis); /* a clear: it listens again, and this time nobody speaks */
    r.off = 0;
    for (uint32_t ms = 0; ms <= r.config.listen_ms; ms++) {
        crt_bus_period(&r);
    }
    assert_true(CRT_IS_SENT(&r, 0x000, 0x82, 0x00));
}

static void reset_is_repeated_while_a_drive_is_missing(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    uint32_t resets = 0u;
    for (int k = 0; k < 4000; k++) { /* at 0, 0.5, 1.5 and 3.5 s, from the end of listening on */
        CRT_RECEIVE(&r, 0x711, 0x7f);
        CRT_RECEIVE(&r, 0x712, 0x7f);
        CRT_RECEIVE(&r, 0x713, 0x05); /* still operational: has not heard the reset */
        crt_bus_period(&r);
        resets += crt_bus_sent(&r, 0x000) != NULL ? 1u : 0u;
    }
    assert_int_equal(resets, 4);
    assert_int_equal(r.bus.phase, CR_PHASE_RESET);
    assert_int_equal(r.faults, 0);
}

/* Reset every half second it would never have come up. */
static void drive_that_takes_its_time_to_boot_comes_up(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    int silent = 0;
    for (int k = 0; k < 9000 && r.bus.phase <= CR_PHASE_RESET; k++) {
        silent = crt_bus_sent(&r, 0x000) != NULL ? 2500 : silent - 1;
        CRT_RECEIVE(&r, 0x711, 0x7f);
        CRT_RECEIVE(&r, 0x712, 0x7f);
        if (silent <= 0) {
            CRT_RECEIVE(&r, 0x713, 0x00);
        }
        crt_bus_period(&r);
    }
    assert_int_equal(r.bus.phase, CR_PHASE_SET_UP);
}

static void heartbeat_of_before_the_reset_does_not_count(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    while (r.bus.phase != CR_PHASE_RESET) {
        crt_bus_period(&r);
    }
    for (uint16_t id = 0x711; id <= 0x713; id++) {
        CRT_RECEIVE(&r, id, 0x7f); /* was on its way when the reset went out */
    }
    crt_bus_period(&r);
    assert_int_equal(r.bus.phase, CR_PHASE_RESET);
    r.now_ns += 30u * MS;
    for (uint16_t id = 0x711; id <= 0x713; id++) {
        CRT_RECEIVE(&r, id, 0x7f); /* the boot-up message was lost, this is after it */
    }
    crt_bus_period(&r);
    assert_int_equal(r.bus.phase, CR_PHASE_SET_UP);
}

static void set_up_writes_what_the_frame_table_says(void **state) {
    (void)state;
    static cr_frame got[400];
    static const uint8_t want[][8] = {
        /* drive Y, node 0x12 */
        {0x2b, 0x72, 0x60, 0x00, 0xc4, 0x09, 0x00, 0x00}, /* 2500 per mille of rated, no more */
        {0x2b, 0x17, 0x10, 0x00, 0x64, 0x00, 0x00, 0x00}, /* heartbeat 100 ms */
        {0x23, 0x16, 0x10, 0x01, 0x96, 0x00, 0x01, 0x00}, /* node 1 is missed after 150 ms */
        {0x23, 0x14, 0x10, 0x00, 0x92, 0x06, 0x00, 0x80}, /* EMCY off */
        {0x2b, 0x15, 0x10, 0x00, 0x64, 0x00, 0x00, 0x00}, /* 100 x 100 us */
        {0x23, 0x14, 0x10, 0x00, 0x92, 0x06, 0x00, 0x00}, /* EMCY 0x692 */
        {0x23, 0x00, 0x14, 0x01, 0x12, 0x02, 0x00, 0x80}, /* RPDO1 off */
        {0x2f, 0x00, 0x14, 0x02, 0xff, 0x00, 0x00, 0x00}, /* event */
        {0x2f, 0x00, 0x16, 0x00, 0x00, 0x00, 0x00, 0x00},
        {0x23, 0x00, 0x16, 0x01, 0x10, 0x00, 0x40, 0x60}, /* control word */
        {0x23, 0x00, 0x16, 0x02, 0x08, 0x00, 0x60, 0x60}, /* mode */
        {0x2f, 0x00, 0x16, 0x00, 0x02, 0x00, 0x00, 0x00},
        {0x23, 0x00, 0x14, 0x01, 0x12, 0x02, 0x00, 0x00}, /* 0x212 */
        {0x23, 0x01, 0x14, 0x01, 0x81, 0x01, 0x00, 0x80}, /* RPDO2 off */
        {0x2f, 0x01, 0x14, 0x02, 0x01, 0x00, 0x00, 0x00}, /* every SYNC */
        {0x2b, 0x01, 0x14, 0x05, 0x03, 0x00, 0x00, 0x00}, /* missed after 3 ms */
        {0x2f, 0x01, 0x16, 0x00, 0x00, 0x00, 0x00, 0x00},
        {0x23, 0x01, 0x16, 0x01, 0x10, 0x00, 0x03, 0x00}, /* dummy: X's word */
        {0x23, 0x01, 0x16, 0x02, 0x10, 0x00, 0x71, 0x60}, /* target torque */
        {0x23, 0x01, 0x16, 0x03, 0x10, 0x00, 0x03, 0x00}, /* dummy: Z's word */
        {0x2f, 0x01, 0x16, 0x00, 0x03, 0x00, 0x00, 0x00},
        {0x23, 0x01, 0x14, 0x01, 0x81, 0x01, 0x00, 0x00}, /* 0x181 */
        {0x23, 0x00, 0x18, 0x01, 0x92, 0x01, 0x00, 0xc0}, /* TPDO1 off, no RTR */
        {0x2f, 0x00, 0x18, 0x02, 0x01, 0x00, 0x00, 0x00}, /* every SYNC */
        {0x2f, 0x00, 0x1a, 0x00, 0x00, 0x00, 0x00, 0x00},
        {0x23, 0x00, 0x1a, 0x01, 0x20, 0x00, 0x64, 0x60}, /* position */
        {0x23, 0x00, 0x1a, 0x02, 0x10, 0x00, 0x77, 0x60}, /* torque */
        {0x23, 0x00, 0x1a, 0x03, 0x10, 0x00, 0x41, 0x60}, /* status word */
        {0x2f, 0x00, 0x1a, 0x00, 0x03, 0x00, 0x00, 0x00},
        {0x23, 0x00, 0x18, 0x01, 0x92, 0x01, 0x00, 0x40}, /* 0x192 */
        {0x2f, 0x60, 0x60, 0x00, 0x0a, 0x00, 0x00, 0x00}, /* cyclic synchronous torque */
    };
    static const uint8_t wrist[][8] = {
        /* drive Z, node 0x13, besides */
        {0x23, 0x01, 0x18, 0x01, 0x94, 0x01, 0x00, 0xc0}, /* TPDO2 off, no RTR */
        {0x2f, 0x01, 0x18, 0x02, 0x02, 0x00, 0x00, 0x00}, /* every second SYNC */
        {0x2f, 0x01, 0x1a, 0x00, 0x00, 0x00, 0x00, 0x00}, {0x23, 0x01, 0x1a, 0x01, 0x10, 0x01, 0x00, 0x21}, /* yaw */
        {0x23, 0x01, 0x1a, 0x02, 0x10, 0x02, 0x00, 0x21},                                                   /* pitch */
        {0x23, 0x01, 0x1a, 0x03, 0x10, 0x03, 0x00, 0x21},                                                   /* roll */
        {0x2f, 0x01, 0x1a, 0x00, 0x03, 0x00, 0x00, 0x00}, {0x23, 0x01, 0x18, 0x01, 0x94, 0x01, 0x00, 0x40}, /* 0x194 */
    };
    static const uint8_t asked[][4] = {{0x40, 0x18, 0x10, 0x01},  /* vendor */
                                       {0x40, 0x18, 0x10, 0x02},  /* product */
                                       {0x40, 0x18, 0x10, 0x03},  /* revision */
                                       {0x40, 0x76, 0x60, 0x00},  /* rated torque */
                                       {0x40, 0x72, 0x60, 0x00}}; /* limit */
    const uint32_t steps = (uint32_t)(sizeof want / sizeof *want), more = (uint32_t)(sizeof wrist / sizeof *wrist);
    const uint32_t asks = 5u, each = asks + 2u * steps;
    crt_bus_rig r = crt_bus_make();
    crt_bus_boot_all(&r);
    assert_int_equal(crt_bus_answer_all(&r, got, 400u), 3u * each + 2u * more);
    for (uint32_t i = 0; i < more; i++) {
        const cr_frame *f = &got[3u * each + 2u * i];
        assert_true(f[0].id == 0x613 && f[1].id == 0x613);
        assert_memory_equal(f[0].data, wrist[i], 8);
        assert_true(f[1].data[0] == 0x40 && memcmp(f[1].data + 1, wrist[i] + 1, 3) == 0);
    }
    for (uint32_t i = 0; i < asks; i++) {
        assert_memory_equal(got[each + i].data, asked[i], 4);
    }
    for (uint32_t i = 0; i < steps; i++) { /* written, then read back */
        const cr_frame *f = &got[each + asks + 2u * i];
        assert_true(f[0].id == 0x612 && f[1].id == 0x612);
        assert_memory_equal(f[0].data, want[i], 8);
        assert_true(f[1].data[0] == 0x40 && memcmp(f[1].data + 1, want[i] + 1, 3) == 0);
    }
    assert_true(got[0].id == 0x611 && got[2u * each].id == 0x613);
    assert_memory_equal(got[asks + 2u * 17u].data, ((uint8_t[]){0x23, 0x01, 0x16, 0x01, 0x10, 0x00, 0x71, 0x60}),
                        8); /* X: word 1 */
    assert_int_equal(r.faults, 0);
}

static void sdo_goes_out_at_most_every_5_ms_and_after_the_torque(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    uint64_t last_ns = 0u;
    uint32_t requests = 0u;
    crt_bus_boot_all(&r);
    for (int k = 0; k < 200; k++) {
        const uint64_t at_ns = r.now_ns;
        crt_bus_period(&r);
        assert_int_equal(r.tx.frames[0].id, 0x181);
        const cr_frame *f = crt_bus_sent(&r, 0x611);
        if (f != NULL) {
            assert_true(requests == 0u || at_ns - last_ns >= 5u * MS);
            last_ns = at_ns;
            requests++;
            const cr_frame answer = crt_sdo_serve(&r.sdo[0], 0u, f);
            crt_bus_receive(&r, answer.id, 8u, answer.data);
        }
    }
    assert_int_equal(requests, 40);
}

static void sdo_abort_is_a_fault_that_keeps_the_code(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_boot_all(&r);
    crt_bus_period(&r);
    CRT_RECEIVE(&r, 0x591, 0x80, 0x18, 0x10, 0x01, 0x00, 0x00, 0x02, 0x06);
    crt_bus_period(&r);
    assert_int_equal(r.faults, CR_FAULT_SDO);
    assert_int_equal(r.bus.sdo_object, 0x101801);
    assert_int_equal(r.bus.sdo_abort, 0x06020000);
    assert_int_equal(r.bus.trouble_axis, 0);
}

static void sdo_without_an_answer_is_asked_three_times(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    uint32_t requests = 0u;
    crt_bus_boot_all(&r);
    for (int k = 0; k < 1000 && r.faults == 0u; k++) {
        crt_bus_period(&r);
        requests += crt_bus_sent(&r, 0x611) != NULL ? 1u : 0u;
    }
    assert_int_equal(r.faults, CR_FAULT_SDO);
    assert_int_equal(requests, 3);
    assert_int_equal(r.bus.sdo_abort, 0xffffffffu);
    assert_int_equal(r.counters.sdo_retries, 2);
}

static void stray_sdo_answers_move_nothing(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_boot_all(&r);
    crt_bus_period(&r);
    CRT_RECEIVE(&r, 0x592, 0x43, 0x18, 0x10, 0x01, 0, 0, 0, 0); /* of another drive */
    CRT_RECEIVE(&r, 0x591, 0x43, 0x18, 0x10, 0x02, 0, 0, 0, 0); /* of another object */
    CRT_RECEIVE(&r, 0x591, 0x60, 0x18, 0x10, 0x01, 0, 0, 0, 0); /* of a download */
    CRT_RECEIVE(&r, 0x591, 0x43, 0x18, 0x10, 0x01);             /* short */
    assert_int_equal(r.bus.sdo_step, 0);
    assert_int_equal(r.counters.malformed, 4);
}

/* A drive that says yes and keeps something else. */
static void written_object_that_reads_back_otherwise_is_a_mismatch(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_boot_all(&r);
    while (r.faults == 0u && r.bus.phase <= CR_PHASE_SET_UP) {
        crt_bus_period(&r);
        const cr_frame *f = crt_bus_sent(&r, 0x611);
        if (f != NULL) {
            cr_frame answer = crt_sdo_serve(&r.sdo[0], 0u, f);
            answer.data[4] ^= f->data[0] == 0x40 && f->data[1] == 0x01 && f->data[2] == 0x14 && f->data[3] == 0x05;
            crt_bus_receive(&r, answer.id, 8u, answer.data);
        }
    }
    assert_int_equal(r.faults, CR_FAULT_MISMATCH);
    assert_true(r.bus.sdo_object == 0x140105u && r.bus.sdo_found == 2u && r.bus.sdo_wanted == 3u);
    assert_int_equal(r.bus.trouble_axis, 0);
    for (int k = 0; k < 500; k++) { /* and nothing more is asked */
        crt_bus_period(&r);
        assert_null(crt_bus_sent(&r, 0x611));
    }
    assert_int_equal(r.faults, CR_FAULT_MISMATCH);
}

static void answers_of_all_sizes_that_say_so_are_taken(void **state) {
    (void)state;
    static const struct {
        uint8_t command;
        uint32_t faults;
    } table[] = {{0x43, 0u}, {0x42, 0u}, {0x4b, CR_FAULT_MISMATCH}, {0x4f, CR_FAULT_MISMATCH}};
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        crt_bus_rig r = crt_bus_make();
        crt_bus_boot_all(&r);
        crt_bus_period(&r);
        CRT_RECEIVE(&r, 0x591, table[i].command, 0x18, 0x10, 0x01, 0, 0, 0, 0); /* vendor 0, four bytes */
        crt_bus_period(&r);
        assert_int_equal(r.faults, table[i].faults);
        assert_int_equal(r.bus.sdo_step, table[i].faults == 0u ? 1 : 0);
    }
}

static void control_words_climb_to_operation_enabled(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_boot_all(&r);
    crt_bus_answer_all(&r, NULL, 1000u);
    assert_true(CRT_IS_SENT(&r, 0x000, 0x01, 0x00)); /* NMT start, all */
    static const struct {
        uint16_t status;
        uint8_t control;
    } climb[] = {{0x0250, 0x06}, {0x0231, 0x07}, {0x0233, 0x0f}};
    for (size_t i = 0; i < 3u; i++) {
        crt_bus_send_states(&r, climb[i].status);
        crt_bus_period(&r);
        assert_true(CRT_IS_SENT(&r, 0x211, climb[i].control, 0x00, 0x0a));
        assert_true(CRT_IS_SENT(&r, 0x213, climb[i].control, 0x00, 0x0a));
    }
    crt_bus_send_states(&r, 0x0237);
    crt_bus_period(&r);
    assert_int_equal(r.bus.phase, CR_PHASE_RUN);
    assert_int_equal(r.faults, 0);
}

static void fault_of_before_the_start_is_reset_by_an_edge(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    uint32_t edges = 0u;
    uint8_t last = 0u;
    crt_bus_boot_all(&r);
    crt_bus_answer_all(&r, NULL, 1000u);
    for (int k = 0; k < 200; k++) {
        crt_bus_send_states(&r, 0x0208);
        crt_bus_period(&r);
        const cr_frame *f = crt_bus_sent(&r, 0x212);
        if (f != NULL) {
            edges += (f->data[0] & 0x80u) != 0u && (last & 0x80u) == 0u ? 1u : 0u;
            last = f->data[0];
        }
    }
    assert_true(edges >= 2u);
}

static void drive_that_does_not_enable_in_time_is_a_fault(void **state) {
    (void)state;
    crt_bus_rig r = crt_bus_make();
    crt_bus_boot_all(&r);
    crt_bus_answer_all(&r, NULL, 1000u);
    for (uint32_t k = 0; k < r.config.enable_timeout_ms + 3u; k++) {
        if (k % 100u == 0u) {
            CRT_RECEIVE(&r, 0x711, 0x05);
            CRT_RECEIVE(&r, 0x712, 0x05);
            CRT_RECEIVE(&r, 0x713, 0x05);
        }
        crt_bus_send_states(&r, 0x0250);
        crt_bus_period(&r);
    }
    assert_int_equal(r.faults, CR_FAULT_DRIVE_STATE);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(host_listens_before_it_speaks),
        cmocka_unit_test(host_that_hears_another_while_listening_stays_silent),
        cmocka_unit_test(reset_is_repeated_while_a_drive_is_missing),
        cmocka_unit_test(drive_that_takes_its_time_to_boot_comes_up),
        cmocka_unit_test(heartbeat_of_before_the_reset_does_not_count),
        cmocka_unit_test(set_up_writes_what_the_frame_table_says),
        cmocka_unit_test(sdo_goes_out_at_most_every_5_ms_and_after_the_torque),
        cmocka_unit_test(sdo_abort_is_a_fault_that_keeps_the_code),
        cmocka_unit_test(sdo_without_an_answer_is_asked_three_times),
        cmocka_unit_test(stray_sdo_answers_move_nothing),
        cmocka_unit_test(written_object_that_reads_back_otherwise_is_a_mismatch),
        cmocka_unit_test(answers_of_all_sizes_that_say_so_are_taken),
        cmocka_unit_test(control_words_climb_to_operation_enabled),
        cmocka_unit_test(fault_of_before_the_start_is_reset_by_an_edge),
        cmocka_unit_test(drive_that_does_not_enable_in_time_is_a_fault),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
