/* The CANopen manager against byte vectors written by hand from the tables of CiA 301, CiA 402 and servo/SPEC.md. */
#include "sdo_server.h"
#include "servo/servo_stages.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define MS 1000000ull

typedef struct {
    cr_bus_config config;
    cr_bus bus;
    cr_servo_counters counters;
    cr_tx tx;
    uint64_t now_ns;
    int16_t target[CR_AXES];
    int off;
    uint32_t faults; /* of all periods */
    crt_sdo_server sdo[CR_AXES];
} rig;

static rig make_rig(void) {
    rig r;
    memset(&r, 0, sizeof r);
    r.config = cr_servo_config_default().bus;
    r.now_ns = 5u * MS;
    cr_bus_reset(&r.bus, cr_servo_config_default().axis);
    for (uint32_t a = 0; a < CR_AXES; a++) {
        crt_sdo_start(&r.sdo[a], a);
    }
    return r;
}

static void receive(rig *r, uint16_t id, uint8_t size, const uint8_t *data) {
    cr_frame frame = {id, size, 0u, {0}};
    memcpy(frame.data, data, size);
    cr_bus_receive(&r->config, &r->bus, &frame, r->now_ns, &r->counters);
}
#define RECEIVE(r, id, ...) receive(r, id, (uint8_t)sizeof((uint8_t[]){__VA_ARGS__}), (uint8_t[]){__VA_ARGS__})

/* The end of a period and the SYNC of the next. tx holds what the end sent. */
static void period(rig *r) {
    cr_tx sync = {0};
    r->tx.count = 0u;
    cr_bus_check(&r->config, &r->bus, r->now_ns, &r->counters);
    r->faults |= r->bus.faults;
    r->off |= r->bus.faults != 0u;
    r->bus.faults = 0u;
    cr_bus_transmit(&r->config, &r->bus, r->target, r->off, r->now_ns, &r->counters, &r->tx);
    r->now_ns += MS;
    cr_bus_sync(&r->bus, &sync);
}

static const cr_frame *sent(const rig *r, uint16_t id) {
    for (uint32_t i = 0; i < r->tx.count; i++) {
        if (r->tx.frames[i].id == id) {
            return &r->tx.frames[i];
        }
    }
    return NULL;
}

static int is_sent(const rig *r, uint16_t id, uint8_t size, const uint8_t *data) {
    const cr_frame *frame = sent(r, id);
    return frame != NULL && frame->size == size && memcmp(frame->data, data, size) == 0;
}
#define IS_SENT(r, id, ...) is_sent(r, id, (uint8_t)sizeof((uint8_t[]){__VA_ARGS__}), (uint8_t[]){__VA_ARGS__})

static void boot_all(rig *r) {
    while (r->bus.phase != CR_PHASE_RESET) {
        period(r);
    }
    RECEIVE(r, 0x711, 0x00);
    RECEIVE(r, 0x712, 0x00);
    RECEIVE(r, 0x713, 0x00);
}

static void send_states(rig *r, uint16_t status) {
    for (uint16_t a = 0; a < 3u; a++) {
        RECEIVE(r, (uint16_t)(0x191 + a), 0x10, 0, 0, 0, 0, 0, (uint8_t)(status & 0xffu), (uint8_t)(status >> 8));
    }
}

static void send_wrist(rig *r) { RECEIVE(r, 0x194, 0x01, 0x00, 0xfe, 0xff, 0x10, 0x0e); }

/* Answers every SDO; collects what was written. Stops when the phase ends or after `most` requests. */
static uint32_t answer_all(rig *r, cr_frame *requests, uint32_t most) {
    uint32_t count = 0u;
    while (r->bus.phase <= CR_PHASE_SET_UP && count < most) {
        period(r);
        for (uint32_t i = 0; i < r->tx.count; i++) {
            const cr_frame *f = &r->tx.frames[i];
            if ((f->id & 0x780u) == 0x600u) {
                if (requests != NULL) {
                    requests[count] = *f;
                }
                count++;
                const cr_frame answer = crt_sdo_serve(&r->sdo[f->id - 0x611u], f->id - 0x611u, f);
                receive(r, answer.id, 8u, answer.data);
            }
        }
    }
    return count;
}

static void run_all(rig *r) {
    boot_all(r);
    answer_all(r, NULL, 1000u);
    assert_int_equal(r->bus.phase, CR_PHASE_ENABLE);
    for (int k = 0; k < 3; k++) {
        send_states(r, 0x0627);
        send_wrist(r);
        period(r);
    }
    assert_int_equal(r->bus.phase, CR_PHASE_RUN);
    assert_int_equal(r->faults, 0);
}

/* ------------------------------------------------------------------------------------------------------- packing */

static void torque_frame_is_three_little_endian_words(void **state) {
    (void)state;
    rig r = make_rig();
    run_all(&r);
    r.target[0] = 1000;
    r.target[1] = -2;
    r.target[2] = -32767;
    send_states(&r, 0x0627);
    period(&r);
    assert_int_equal(r.tx.frames[0].id, 0x181);
    assert_true(IS_SENT(&r, 0x181, 0xe8, 0x03, 0xfe, 0xff, 0x01, 0x80));
}

static void state_frame_is_position_torque_status(void **state) {
    (void)state;
    rig r = make_rig();
    RECEIVE(&r, 0x192, 0xfe, 0xff, 0xff, 0xff, 0x9c, 0xff, 0x37, 0x06);
    assert_int_equal(r.bus.drive[1].counts, -2);
    assert_int_equal(r.bus.drive[1].actual, -100);
    assert_int_equal(r.bus.drive[1].status, 0x0637);
    RECEIVE(&r, 0x191, 0x00, 0x00, 0x00, 0x80, 0x00, 0x80, 0x00, 0x00);
    assert_int_equal(r.bus.drive[0].counts, INT32_MIN);
    assert_int_equal(r.bus.drive[0].actual, INT16_MIN);
    RECEIVE(&r, 0x193, 0xff, 0xff, 0xff, 0x7f, 0xff, 0x7f, 0xff, 0xff);
    assert_int_equal(r.bus.drive[2].counts, INT32_MAX);
    assert_true(r.bus.drive[2].actual == 32767 && r.bus.drive[2].status == 0xffff);
}

static void wrist_frame_is_three_angles(void **state) {
    (void)state;
    rig r = make_rig();
    RECEIVE(&r, 0x194, 0x01, 0x00, 0xfe, 0xff, 0x10, 0x0e);
    assert_true(r.bus.wrist.counts[0] == 1 && r.bus.wrist.counts[1] == -2 && r.bus.wrist.counts[2] == 3600);
    RECEIVE(&r, 0x194, 0x00, 0x80, 0xff, 0x7f, 0, 0);
    assert_true(r.bus.wrist.counts[0] == INT16_MIN && r.bus.wrist.counts[1] == INT16_MAX);
    RECEIVE(&r, 0x194, 0x05, 0x00, 0x05, 0x00, 0x05);
    assert_true(r.bus.wrist.counts[0] == INT16_MIN && r.counters.malformed == 1u);
}

static void wrist_is_bridged_and_then_a_fault(void **state) {
    (void)state;
    rig r = make_rig();
    run_all(&r);
    for (int k = 0; k < 100; k++) { /* every second period is what is asked for */
        send_states(&r, 0x0627);
        if (k % 2 == 1) {
            send_wrist(&r);
        }
        period(&r);
        assert_true(r.faults == 0u && r.counters.wrist_missing == 0u);
    }
    for (uint32_t k = 0; k < 2u * r.config.missing_max + 1u; k++) {
        send_states(&r, 0x0627);
        period(&r);
        assert_int_equal(r.faults, 0);
    }
    send_states(&r, 0x0627);
    period(&r);
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

/* ------------------------------------------------------------------------------------------------------ start-up */

static void host_listens_before_it_speaks(void **state) {
    (void)state;
    rig r = make_rig();
    for (uint32_t ms = 0; ms < r.config.listen_ms; ms++) {
        period(&r);
        assert_int_equal(r.tx.count, 0);
        assert_int_equal(r.bus.phase, CR_PHASE_LISTEN);
    }
    period(&r);
    assert_true(IS_SENT(&r, 0x000, 0x82, 0x00)); /* NMT: reset communication, all nodes */
    assert_true(IS_SENT(&r, 0x701, 0x05));
    cr_tx sync = {0};
    cr_bus_sync(&r.bus, &sync);
    assert_true(sync.count == 1u && sync.frames[0].id == 0x080 && sync.frames[0].size == 0u);
}

static void host_that_hears_another_while_listening_stays_silent(void **state) {
    (void)state;
    rig r = make_rig();
    uint32_t frames = 0u;
    for (uint32_t ms = 0; ms < 700u; ms++) {
        if (ms == 5u) {
            receive(&r, 0x080, 0u, (const uint8_t *)"");
        }
        cr_tx sync = {0};
        cr_bus_sync(&r.bus, &sync);
        period(&r);
        frames += r.tx.count + sync.count;
    }
    assert_int_equal(r.faults, CR_FAULT_ALIEN);
    assert_int_equal(frames, 0);
    cr_bus_reset(&r.bus, cr_servo_config_default().axis); /* a clear: it listens again, and this time nobody speaks */
    r.off = 0;
    for (uint32_t ms = 0; ms <= r.config.listen_ms; ms++) {
        period(&r);
    }
    assert_true(IS_SENT(&r, 0x000, 0x82, 0x00));
}

static void reset_is_repeated_while_a_drive_is_missing(void **state) {
    (void)state;
    rig r = make_rig();
    uint32_t resets = 0u;
    for (int k = 0; k < 1100; k++) {
        RECEIVE(&r, 0x711, 0x7f);
        RECEIVE(&r, 0x712, 0x7f);
        RECEIVE(&r, 0x713, 0x05); /* still operational: has not heard the reset */
        period(&r);
        resets += sent(&r, 0x000) != NULL ? 1u : 0u;
    }
    assert_int_equal(resets, 3);
    assert_int_equal(r.bus.phase, CR_PHASE_RESET);
    assert_int_equal(r.faults, 0);
}

static void heartbeat_of_before_the_reset_does_not_count(void **state) {
    (void)state;
    rig r = make_rig();
    while (r.bus.phase != CR_PHASE_RESET) {
        period(&r);
    }
    for (uint16_t id = 0x711; id <= 0x713; id++) {
        RECEIVE(&r, id, 0x7f); /* was on its way when the reset went out */
    }
    period(&r);
    assert_int_equal(r.bus.phase, CR_PHASE_RESET);
    r.now_ns += 30u * MS;
    for (uint16_t id = 0x711; id <= 0x713; id++) {
        RECEIVE(&r, id, 0x7f); /* the boot-up message was lost, this is after it */
    }
    period(&r);
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
    rig r = make_rig();
    boot_all(&r);
    assert_int_equal(answer_all(&r, got, 400u), 3u * each + 2u * more);
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
    rig r = make_rig();
    uint64_t last_ns = 0u;
    uint32_t requests = 0u;
    boot_all(&r);
    for (int k = 0; k < 200; k++) {
        const uint64_t at_ns = r.now_ns;
        period(&r);
        assert_int_equal(r.tx.frames[0].id, 0x181);
        const cr_frame *f = sent(&r, 0x611);
        if (f != NULL) {
            assert_true(requests == 0u || at_ns - last_ns >= 5u * MS);
            last_ns = at_ns;
            requests++;
            const cr_frame answer = crt_sdo_serve(&r.sdo[0], 0u, f);
            receive(&r, answer.id, 8u, answer.data);
        }
    }
    assert_int_equal(requests, 40);
}

static void sdo_abort_is_a_fault_that_keeps_the_code(void **state) {
    (void)state;
    rig r = make_rig();
    boot_all(&r);
    period(&r);
    RECEIVE(&r, 0x591, 0x80, 0x18, 0x10, 0x01, 0x00, 0x00, 0x02, 0x06);
    period(&r);
    assert_int_equal(r.faults, CR_FAULT_SDO);
    assert_int_equal(r.bus.sdo_object, 0x101801);
    assert_int_equal(r.bus.sdo_abort, 0x06020000);
    assert_int_equal(r.bus.trouble_axis, 0);
}

static void sdo_without_an_answer_is_asked_three_times(void **state) {
    (void)state;
    rig r = make_rig();
    uint32_t requests = 0u;
    boot_all(&r);
    for (int k = 0; k < 1000 && r.faults == 0u; k++) {
        period(&r);
        requests += sent(&r, 0x611) != NULL ? 1u : 0u;
    }
    assert_int_equal(r.faults, CR_FAULT_SDO);
    assert_int_equal(requests, 3);
    assert_int_equal(r.bus.sdo_abort, 0xffffffffu);
    assert_int_equal(r.counters.sdo_retries, 2);
}

static void stray_sdo_answers_move_nothing(void **state) {
    (void)state;
    rig r = make_rig();
    boot_all(&r);
    period(&r);
    RECEIVE(&r, 0x592, 0x43, 0x18, 0x10, 0x01, 0, 0, 0, 0); /* of another drive */
    RECEIVE(&r, 0x591, 0x43, 0x18, 0x10, 0x02, 0, 0, 0, 0); /* of another object */
    RECEIVE(&r, 0x591, 0x60, 0x18, 0x10, 0x01, 0, 0, 0, 0); /* of a download */
    RECEIVE(&r, 0x591, 0x43, 0x18, 0x10, 0x01);             /* short */
    assert_int_equal(r.bus.sdo_step, 0);
    assert_int_equal(r.counters.malformed, 4);
}

static void control_words_climb_to_operation_enabled(void **state) {
    (void)state;
    rig r = make_rig();
    boot_all(&r);
    answer_all(&r, NULL, 1000u);
    assert_true(IS_SENT(&r, 0x000, 0x01, 0x00)); /* NMT start, all */
    static const struct {
        uint16_t status;
        uint8_t control;
    } climb[] = {{0x0250, 0x06}, {0x0231, 0x07}, {0x0233, 0x0f}};
    for (size_t i = 0; i < 3u; i++) {
        send_states(&r, climb[i].status);
        period(&r);
        assert_true(IS_SENT(&r, 0x211, climb[i].control, 0x00, 0x0a));
        assert_true(IS_SENT(&r, 0x213, climb[i].control, 0x00, 0x0a));
    }
    send_states(&r, 0x0237);
    period(&r);
    assert_int_equal(r.bus.phase, CR_PHASE_RUN);
    assert_int_equal(r.faults, 0);
}

static void fault_of_before_the_start_is_reset_by_an_edge(void **state) {
    (void)state;
    rig r = make_rig();
    uint32_t edges = 0u;
    uint8_t last = 0u;
    boot_all(&r);
    answer_all(&r, NULL, 1000u);
    for (int k = 0; k < 200; k++) {
        send_states(&r, 0x0208);
        period(&r);
        const cr_frame *f = sent(&r, 0x212);
        if (f != NULL) {
            edges += (f->data[0] & 0x80u) != 0u && (last & 0x80u) == 0u ? 1u : 0u;
            last = f->data[0];
        }
    }
    assert_true(edges >= 2u);
}

static void drive_that_does_not_enable_in_time_is_a_fault(void **state) {
    (void)state;
    rig r = make_rig();
    boot_all(&r);
    answer_all(&r, NULL, 1000u);
    for (uint32_t k = 0; k < r.config.enable_timeout_ms + 3u; k++) {
        if (k % 100u == 0u) {
            RECEIVE(&r, 0x711, 0x05);
            RECEIVE(&r, 0x712, 0x05);
            RECEIVE(&r, 0x713, 0x05);
        }
        send_states(&r, 0x0250);
        period(&r);
    }
    assert_int_equal(r.faults, CR_FAULT_DRIVE_STATE);
}

/* ------------------------------------------------------------------------------------------------------- running */

static void heartbeat_goes_out_every_100_ms_after_the_torque(void **state) {
    (void)state;
    rig r = make_rig();
    uint32_t beats = 0u;
    run_all(&r);
    for (int k = 0; k < 1000; k++) {
        if (k % 100 == 0) {
            RECEIVE(&r, 0x711, 0x05);
            RECEIVE(&r, 0x712, 0x05);
            RECEIVE(&r, 0x713, 0x05);
        }
        send_states(&r, 0x0627);
        send_wrist(&r);
        period(&r);
        assert_int_equal(r.tx.frames[0].id, 0x181);
        beats += IS_SENT(&r, 0x701, 0x05) ? 1u : 0u;
    }
    assert_int_equal(beats, 10);
    assert_int_equal(r.faults, 0);
}

static void drive_without_heartbeat_is_a_fault(void **state) {
    (void)state;
    rig r = make_rig();
    run_all(&r);
    uint32_t k = 0u;
    for (; k < 1000u && r.faults == 0u; k++) {
        send_states(&r, 0x0627);
        send_wrist(&r);
        period(&r);
    }
    assert_int_equal(r.faults, CR_FAULT_HEARTBEAT);
    assert_true(k >= r.config.drive_timeout_ms - 5u && k <= r.config.drive_timeout_ms + 2u);
}

static void silent_drive_is_bridged_and_then_a_fault(void **state) {
    (void)state;
    rig r = make_rig();
    run_all(&r);
    for (uint32_t k = 0; k < r.config.missing_max; k++) {
        RECEIVE(&r, 0x191, 0x10, 0, 0, 0, 0, 0, 0x27, 0x06);
        RECEIVE(&r, 0x193, 0x10, 0, 0, 0, 0, 0, 0x27, 0x06);
        period(&r);
        assert_int_equal(r.faults, 0);
    }
    period(&r);
    assert_int_equal(r.faults, CR_FAULT_SILENT);
    assert_int_equal(r.counters.missing[1], 3);
    assert_int_equal(r.counters.missing[0], 1);
}

static void late_state_is_counted_and_is_not_this_periods(void **state) {
    (void)state;
    rig r = make_rig();
    run_all(&r);
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
        rig r = make_rig();
        run_all(&r);
        cr_bus_receive(&r.config, &r.bus, &table[i].frame, r.now_ns, &r.counters);
        send_states(&r, 0x0627);
        period(&r);
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
        rig r = make_rig();
        run_all(&r);
        send_states(&r, table[i].status);
        period(&r);
        assert_int_equal(r.faults, table[i].fault);
    }
}

static void two_drives_of_one_number_are_noticed(void **state) {
    (void)state;
    rig r = make_rig();
    run_all(&r);
    send_states(&r, 0x0627);
    send_states(&r, 0x0627);
    period(&r);
    assert_true(r.faults == 0u && r.counters.twice == 3u); /* once may be a repeat of the wire */
    for (int k = 0; k < 2; k++) {
        send_states(&r, 0x0627);
        send_states(&r, 0x0627);
        period(&r);
    }
    assert_int_equal(r.faults, CR_FAULT_ALIEN);
}

static void drive_that_talks_more_than_it_may_is_babbling(void **state) {
    (void)state;
    rig r = make_rig();
    run_all(&r);
    for (int k = 0; k < 3; k++) {
        RECEIVE(&r, 0x692, 0, 0, 0, 0, 0, 0, 0, 0);
    }
    send_states(&r, 0x0627);
    period(&r);
    assert_int_equal(r.faults, 0);
    for (int k = 0; k < 4; k++) {
        RECEIVE(&r, 0x692, 0, 0, 0, 0, 0, 0, 0, 0);
    }
    send_states(&r, 0x0627);
    period(&r);
    assert_int_equal(r.faults, CR_FAULT_BABBLE);
    assert_true(r.bus.trouble_axis == 1u && r.counters.babbled == 1u);
}

static void off_is_said_at_once_and_every_20_ms(void **state) {
    (void)state;
    rig r = make_rig();
    run_all(&r);
    r.off = 1;
    send_states(&r, 0x0627);
    period(&r);
    for (uint16_t id = 0x211; id <= 0x213; id++) {
        assert_true(IS_SENT(&r, id, 0x00, 0x00, 0x0a));
    }
    uint32_t words = 0u;
    for (int k = 0; k < 200; k++) {
        send_states(&r, 0x0250);
        period(&r);
        const int said = sent(&r, 0x211) != NULL;
        assert_true(!said || (IS_SENT(&r, 0x211, 0x00, 0x00, 0x0a) && IS_SENT(&r, 0x213, 0x00, 0x00, 0x0a)));
        words += said ? 1u : 0u;
        assert_int_equal(r.tx.frames[0].id, 0x181);
    }
    assert_in_range(words, 9, 11);
}

/* A drive that says yes and keeps something else. */
static void written_object_that_reads_back_otherwise_is_a_mismatch(void **state) {
    (void)state;
    rig r = make_rig();
    boot_all(&r);
    while (r.faults == 0u && r.bus.phase <= CR_PHASE_SET_UP) {
        period(&r);
        const cr_frame *f = sent(&r, 0x611);
        if (f != NULL) {
            cr_frame answer = crt_sdo_serve(&r.sdo[0], 0u, f);
            answer.data[4] ^= f->data[0] == 0x40 && f->data[1] == 0x01 && f->data[2] == 0x14 && f->data[3] == 0x05;
            receive(&r, answer.id, 8u, answer.data);
        }
    }
    assert_int_equal(r.faults, CR_FAULT_MISMATCH);
    assert_true(r.bus.sdo_object == 0x140105u && r.bus.sdo_found == 2u && r.bus.sdo_wanted == 3u);
    assert_int_equal(r.bus.trouble_axis, 0);
    for (int k = 0; k < 500; k++) { /* and nothing more is asked */
        period(&r);
        assert_null(sent(&r, 0x611));
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
        rig r = make_rig();
        boot_all(&r);
        period(&r);
        RECEIVE(&r, 0x591, table[i].command, 0x18, 0x10, 0x01, 0, 0, 0, 0); /* vendor 0, four bytes */
        period(&r);
        assert_int_equal(r.faults, table[i].faults);
        assert_int_equal(r.bus.sdo_step, table[i].faults == 0u ? 1 : 0);
    }
}

/* Any bytes under any identifier: nothing but counters, faults and states changes, and no frame is malformed on the way out. */
static void noise_never_breaks_the_manager(void **state) {
    (void)state;
    static const uint16_t ids[] = {0x000, 0x080, 0x181, 0x191, 0x192, 0x193, 0x194, 0x211, 0x591, 0x592,
                                   0x593, 0x611, 0x691, 0x092, 0x701, 0x711, 0x712, 0x713, 0x7ff};
    uint32_t seed = 7u;
    rig r = make_rig();
    boot_all(&r);
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
            period(&r);
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
        cmocka_unit_test(host_listens_before_it_speaks),
        cmocka_unit_test(host_that_hears_another_while_listening_stays_silent),
        cmocka_unit_test(reset_is_repeated_while_a_drive_is_missing),
        cmocka_unit_test(heartbeat_of_before_the_reset_does_not_count),
        cmocka_unit_test(set_up_writes_what_the_frame_table_says),
        cmocka_unit_test(sdo_goes_out_at_most_every_5_ms_and_after_the_torque),
        cmocka_unit_test(sdo_abort_is_a_fault_that_keeps_the_code),
        cmocka_unit_test(sdo_without_an_answer_is_asked_three_times),
        cmocka_unit_test(stray_sdo_answers_move_nothing),
        cmocka_unit_test(control_words_climb_to_operation_enabled),
        cmocka_unit_test(fault_of_before_the_start_is_reset_by_an_edge),
        cmocka_unit_test(drive_that_does_not_enable_in_time_is_a_fault),
        cmocka_unit_test(heartbeat_goes_out_every_100_ms_after_the_torque),
        cmocka_unit_test(drive_without_heartbeat_is_a_fault),
        cmocka_unit_test(silent_drive_is_bridged_and_then_a_fault),
        cmocka_unit_test(late_state_is_counted_and_is_not_this_periods),
        cmocka_unit_test(one_frame_can_fault_the_running_bus),
        cmocka_unit_test(status_word_of_a_running_drive_must_say_enabled),
        cmocka_unit_test(two_drives_of_one_number_are_noticed),
        cmocka_unit_test(drive_that_talks_more_than_it_may_is_babbling),
        cmocka_unit_test(off_is_said_at_once_and_every_20_ms),
        cmocka_unit_test(written_object_that_reads_back_otherwise_is_a_mismatch),
        cmocka_unit_test(answers_of_all_sizes_that_say_so_are_taken),
        cmocka_unit_test(noise_never_breaks_the_manager),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
