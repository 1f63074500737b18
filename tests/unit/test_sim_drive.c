/* The simulated drive by itself: state machine of CiA 402, heartbeat, deadlines, identifiers. */
#include "drive.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

static cr_drive drive;

static void send(uint32_t id, uint8_t len, const uint8_t *data, uint64_t now_us) {
    cr_sim_frame frame = {.id = id, .len = len};
    memcpy(frame.data, data, len);
    (void)cr_drive_receive(&drive, &frame, now_us);
}

static void write_object(uint16_t index, uint8_t sub, uint32_t value, uint8_t bytes, uint64_t now_us) {
    const uint8_t data[8] = {(uint8_t)(0x23u | (4u - bytes) << 2),
                             (uint8_t)index,
                             (uint8_t)(index >> 8),
                             sub,
                             (uint8_t)value,
                             (uint8_t)(value >> 8),
                             (uint8_t)(value >> 16),
                             (uint8_t)(value >> 24)};
    drive.node.out_count = 0;
    send(0x611, 8, data, now_us);
    assert_int_equal(drive.node.out_count, 1);
    assert_int_equal(drive.node.out[0].data[0], 0x60);
    drive.node.out_count = 0;
}

static void control(uint16_t word) { write_object(0x6040, 0, word, 2, 0); }

static void power_on(void) {
    cr_drive_init(&drive, 0, 0);
    drive.node.out_count = 0;
}

/* To operation enabled in cyclic synchronous torque, 10 % of rated. */
static void enable(void) {
    power_on();
    send(0, 2, (const uint8_t[]){0x01, 0x11}, 0);
    write_object(0x6060, 0, 10, 1, 0);
    control(0x06);
    control(0x07);
    control(0x0F);
    write_object(0x6071, 0, 100, 2, 0);
}

static void drive_boots_into_switch_on_disabled_and_pre_operational(void **state) {
    (void)state;
    cr_drive_init(&drive, 2, 0);
    assert_int_equal(drive.state, CR_DRIVE_SWITCH_ON_DISABLED);
    assert_int_equal(drive.node.nmt, CR_NMT_PRE_OPERATIONAL);
    assert_int_equal(drive.node.out_count, 1);
    assert_int_equal(drive.node.out[0].id, 0x713);
    assert_int_equal(drive.node.out[0].data[0], 0);
}

/* Every state x every command of CiA 402: rows are states, columns shutdown, switch on, enable, quick stop, disable voltage. */
static void drive_moves_only_where_the_standard_lets_it(void **state) {
    (void)state;
    static const uint16_t commands[5] = {0x06, 0x07, 0x0F, 0x02, 0x00};
    static const uint8_t next[8][5] = {
        {0}, /* not ready: never seen from outside */
        {CR_DRIVE_READY, CR_DRIVE_SWITCH_ON_DISABLED, CR_DRIVE_SWITCH_ON_DISABLED, CR_DRIVE_SWITCH_ON_DISABLED,
         CR_DRIVE_SWITCH_ON_DISABLED},
        {CR_DRIVE_READY, CR_DRIVE_SWITCHED_ON, CR_DRIVE_SWITCHED_ON, CR_DRIVE_SWITCH_ON_DISABLED,
         CR_DRIVE_SWITCH_ON_DISABLED},
        {CR_DRIVE_READY, CR_DRIVE_SWITCHED_ON, CR_DRIVE_ENABLED, CR_DRIVE_SWITCH_ON_DISABLED,
         CR_DRIVE_SWITCH_ON_DISABLED},
        {CR_DRIVE_READY, CR_DRIVE_SWITCHED_ON, CR_DRIVE_ENABLED, CR_DRIVE_QUICK_STOP, CR_DRIVE_SWITCH_ON_DISABLED},
        {CR_DRIVE_QUICK_STOP, CR_DRIVE_QUICK_STOP, CR_DRIVE_ENABLED, CR_DRIVE_QUICK_STOP, CR_DRIVE_SWITCH_ON_DISABLED},
        {CR_DRIVE_FAULT_REACTION, CR_DRIVE_FAULT_REACTION, CR_DRIVE_FAULT_REACTION, CR_DRIVE_FAULT_REACTION,
         CR_DRIVE_FAULT_REACTION},
        {CR_DRIVE_FAULT, CR_DRIVE_FAULT, CR_DRIVE_FAULT, CR_DRIVE_FAULT, CR_DRIVE_FAULT}};
    for (int from = CR_DRIVE_SWITCH_ON_DISABLED; from <= CR_DRIVE_FAULT; from++) {
        for (size_t c = 0; c < sizeof commands / sizeof *commands; c++) {
            enable();
            drive.state = (cr_drive_state)from;
            control(commands[c]);
            assert_int_equal(drive.state, next[from][c]);
        }
    }
}

static void drive_statusword_has_the_bits_of_each_state(void **state) {
    (void)state;
    static const uint16_t masks[8] = {0x4F, 0x4F, 0x6F, 0x6F, 0x6F, 0x6F, 0x4F, 0x4F};
    static const uint16_t bits[8] = {0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08};
    for (int at = CR_DRIVE_SWITCH_ON_DISABLED; at <= CR_DRIVE_FAULT; at++) {
        enable();
        drive.state = (cr_drive_state)at;
        write_object(0x6071, 0, 0, 2, 0);
        if (at != CR_DRIVE_FAULT && at != CR_DRIVE_FAULT_REACTION) {
            continue; /* the controlword that stands moves it on: seen in the test above */
        }
        assert_int_equal(cr_node_get(&drive.node, 0x6041, 0) & masks[at], bits[at]);
    }
    enable();
    assert_int_equal(cr_node_get(&drive.node, 0x6041, 0) & 0x6F, 0x27);
}

static void drive_gives_torque_only_when_enabled_operational_and_in_its_mode(void **state) {
    (void)state;
    enable();
    assert_int_equal(cr_drive_torque(&drive), 100);
    write_object(0x6060, 0, 0, 1, 0);
    assert_int_equal(cr_drive_torque(&drive), 0);
    enable();
    send(0, 2, (const uint8_t[]){0x02, 0x00}, 0);
    assert_int_equal(cr_drive_torque(&drive), 0);
    enable();
    cr_drive_fault(&drive, 0x7300);
    assert_int_equal(cr_drive_torque(&drive), 0);
    assert_int_equal(cr_node_get(&drive.node, 0x603F, 0), 0x7300);
}

static void drive_leaves_fault_on_a_rising_edge_only(void **state) {
    (void)state;
    enable();
    control(0x8F);
    cr_drive_fault(&drive, 0x7300);
    cr_drive_poll(&drive, 1000);
    assert_int_equal(drive.state, CR_DRIVE_FAULT);
    control(0x80);
    assert_int_equal(drive.state, CR_DRIVE_FAULT);
    control(0x00);
    control(0x80);
    assert_int_equal(drive.state, CR_DRIVE_SWITCH_ON_DISABLED);
    assert_int_equal(cr_node_get(&drive.node, 0x1001, 0), 0);
    assert_int_equal(cr_drive_torque(&drive), 0);
}

static void drive_misses_the_host_after_the_configured_time_not_before(void **state) {
    (void)state;
    const uint8_t operational = 5;
    enable();
    write_object(0x1016, 1, 0x10032, 4, 0); /* node 1, 50 ms */
    cr_drive_poll(&drive, 1000000);
    assert_int_equal(drive.state, CR_DRIVE_ENABLED); /* watching starts with the first heartbeat */
    send(0x701, 1, &operational, 1000000);
    cr_drive_poll(&drive, 1050000);
    assert_int_equal(cr_drive_torque(&drive), 100);
    cr_drive_poll(&drive, 1050001);
    assert_int_equal(cr_drive_torque(&drive), 0);
    assert_int_equal(cr_node_get(&drive.node, 0x603F, 0), CR_EMCY_HEARTBEAT);
}

static void node_sends_its_heartbeat_every_period(void **state) {
    (void)state;
    power_on();
    write_object(0x1017, 0, 100, 2, 0);
    int beats = 0;
    for (uint64_t now_us = 0; now_us < 1000000; now_us += 1000) {
        drive.node.out_count = 0;
        cr_drive_poll(&drive, now_us);
        for (int i = 0; i < drive.node.out_count; i++) {
            beats += drive.node.out[i].id == 0x711 && drive.node.out[i].data[0] == CR_NMT_PRE_OPERATIONAL;
        }
    }
    assert_int_equal(beats, 10);
}

static void node_outbox_never_overflows(void **state) {
    (void)state;
    power_on();
    const uint8_t read[8] = {0x40, 0x00, 0x10, 0};
    for (int i = 0; i < 500; i++) {
        send(0x611, 8, read, 0);
    }
    assert_int_equal(drive.node.out_count, CR_OUTBOX_MAX);
    assert_int_equal(drive.node.out_dropped, 500 - CR_OUTBOX_MAX);
}

static void frame_bits_are_those_of_the_worst_stuffing(void **state) {
    (void)state;
    assert_int_equal(cr_frame_bits(0), 55);
    assert_int_equal(cr_frame_bits(8), 135);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(drive_boots_into_switch_on_disabled_and_pre_operational),
        cmocka_unit_test(drive_moves_only_where_the_standard_lets_it),
        cmocka_unit_test(drive_statusword_has_the_bits_of_each_state),
        cmocka_unit_test(drive_gives_torque_only_when_enabled_operational_and_in_its_mode),
        cmocka_unit_test(drive_leaves_fault_on_a_rising_edge_only),
        cmocka_unit_test(drive_misses_the_host_after_the_configured_time_not_before),
        cmocka_unit_test(node_sends_its_heartbeat_every_period),
        cmocka_unit_test(node_outbox_never_overflows),
        cmocka_unit_test(frame_bits_are_those_of_the_worst_stuffing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
