/* The FDCAN driver of the Cortex-M port against plain memory in place of the registers. Expected words are written out by hand from the
 * reference manual's bit tables (RM0433, 56.3 and 56.5). */
#include "fdcan.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

static uint32_t registers[FDCAN_REGISTER_WORDS], ram[FDCAN_RAM_WORDS + 1u];

static fdcan started(void) {
    fdcan can = {registers, ram, 7u};
    for (size_t i = 0; i < FDCAN_REGISTER_WORDS; i++) {
        registers[i] = 0u;
    }
    for (size_t i = 0; i <= FDCAN_RAM_WORDS; i++) {
        ram[i] = 0xdeadbeefu;
    }
    assert_int_equal(fdcan_start(&can, 80000000u, 1000000u), 0);
    return can;
}

static void bit_timing_of_80_MHz_is_16_quanta_sampled_at_87_percent(void **state) {
    (void)state;
    /* 80 MHz / 5 = 16 MHz: 1 + 13 + 2 quanta; prescaler 5, jump 2. Fields hold one less. */
    assert_int_equal(fdcan_bit_timing(80000000u, 1000000u), 1u << 25 | 4u << 16 | 12u << 8 | 1u);
    /* 8 MHz: 1 + 6 + 1. */
    assert_int_equal(fdcan_bit_timing(8000000u, 1000000u), 0u << 25 | 0u << 16 | 5u << 8 | 0u);
}

static void bit_timing_refuses_a_clock_that_is_no_multiple(void **state) {
    (void)state;
    assert_int_equal(fdcan_bit_timing(7000000u, 1000000u), 0u);
    assert_int_equal(fdcan_bit_timing(80000001u, 1000000u), 0u);
    assert_int_equal(fdcan_bit_timing(80000000u, 0u), 0u);
    fdcan can = {registers, ram, 0u};
    assert_int_equal(fdcan_start(&can, 7000000u, 1000000u), -1);
}

static void bit_timing_is_the_bit_rate_for_every_clock_it_takes(void **state) {
    (void)state;
    static const uint32_t rates[] = {125000u, 250000u, 500000u, 1000000u};
    for (size_t r = 0; r < 4u; r++) {
        for (uint32_t clock = 8000000u; clock <= 120000000u; clock += 1000000u) {
            const uint32_t t = fdcan_bit_timing(clock, rates[r]);
            if (t == 0u) {
                continue;
            }
            const uint32_t before = (t >> 8 & 0xffu) + 1u, after = (t & 0x7fu) + 1u, quanta = 1u + before + after;
            assert_int_equal(clock, rates[r] * quanta * ((t >> 16 & 0x1ffu) + 1u));
            /* Within half a quantum of 87.5 %. */
            assert_in_range(8u * (1u + before) + 4u - 7u * quanta, 0u, 8u);
        }
    }
}

static void start_lays_out_64_frames_in_and_32_out(void **state) {
    (void)state;
    started();
    assert_int_equal(registers[FDCAN_RXF0C], 64u << 16);
    assert_int_equal(registers[FDCAN_TXBC], 32u << 24 | 1024u);
    assert_int_equal(registers[FDCAN_GFC], 0x0bu);
    assert_int_equal(registers[FDCAN_CCCR], 0u);
    for (size_t i = 0; i < FDCAN_RAM_WORDS; i++) {
        assert_int_equal(ram[i], 0u);
    }
    assert_int_equal(ram[FDCAN_RAM_WORDS], 0xdeadbeefu);
}

static void frame_goes_into_the_slot_the_block_offers(void **state) {
    (void)state;
    fdcan can = started();
    const cr_frame frame = {0x201u, 6u, 0u, {0x11u, 0x22u, 0x33u, 0x44u, 0x55u, 0x66u, 0u, 0u}};
    registers[FDCAN_TXFQS] = 29u | 3u << 16;
    assert_int_equal(fdcan_send(&can, &frame), 0);
    const uint32_t *at = ram + 256u + 3u * 4u;
    assert_int_equal(at[0], 0x201u << 18);
    assert_int_equal(at[1], 6u << 16);
    assert_int_equal(at[2], 0x44332211u);
    assert_int_equal(at[3], 0x6655u);
    assert_int_equal(registers[FDCAN_TXBAR], 1u << 3);
}

static void full_queue_refuses_a_frame(void **state) {
    (void)state;
    fdcan can = started();
    const cr_frame frame = {0x80u, 0u, 0u, {0}}, too_long = {0x80u, 9u, 0u, {0}};
    registers[FDCAN_TXFQS] = 1u << 21;
    assert_int_equal(fdcan_send(&can, &frame), -1);
    assert_int_equal(registers[FDCAN_TXBAR], 0u);
    registers[FDCAN_TXFQS] = 32u;
    assert_int_equal(fdcan_send(&can, &too_long), -1);
}

static void frame_that_came_is_read_and_acknowledged(void **state) {
    (void)state;
    fdcan can = started();
    cr_frame frame;
    assert_int_equal(fdcan_receive(&can, &frame), 0);
    registers[FDCAN_RXF0S] = 1u | 5u << 8;
    ram[20] = 0x193u << 18;
    ram[21] = 8u << 16 | 0x1234u; /* and a time stamp */
    ram[22] = 0x04030201u;
    ram[23] = 0x08070605u;
    assert_int_equal(fdcan_receive(&can, &frame), 1);
    assert_int_equal(frame.id, 0x193u);
    assert_int_equal(frame.size, 8u);
    for (uint8_t i = 0; i < 8u; i++) {
        assert_int_equal(frame.data[i], i + 1u);
    }
    assert_int_equal(registers[FDCAN_RXF0A], 5u);
}

static void length_code_above_8_means_8(void **state) {
    (void)state;
    fdcan can = started();
    cr_frame frame;
    registers[FDCAN_RXF0S] = 1u;
    ram[1] = 15u << 16;
    assert_int_equal(fdcan_receive(&can, &frame), 1);
    assert_int_equal(frame.size, 8u);
}

static void remote_and_long_frames_are_never_handed_out(void **state) {
    (void)state;
    fdcan can = started();
    cr_frame frame;
    registers[FDCAN_RXF0S] = 1u; /* plain memory goes on offering it: the driver gives up after as many as fit */
    ram[0] = 1u << 29;
    assert_int_equal(fdcan_receive(&can, &frame), 0);
    ram[0] = 1u << 30;
    assert_int_equal(fdcan_receive(&can, &frame), 0);
}

static void lost_frames_are_counted(void **state) {
    (void)state;
    fdcan can = started();
    cr_frame frame;
    assert_int_equal(can.lost, 0u);
    registers[FDCAN_IR] = 1u << 3;
    fdcan_receive(&can, &frame);
    assert_int_equal(can.lost, 1u);
    assert_int_equal(registers[FDCAN_IR], 1u << 3); /* written as one, which clears it in the block */
}

static void bus_off_is_told_once_and_left(void **state) {
    (void)state;
    fdcan can = started();
    assert_int_equal(fdcan_was_off(&can), 0);
    registers[FDCAN_PSR] = 1u << 7;
    registers[FDCAN_CCCR] = 1u;
    assert_int_equal(fdcan_was_off(&can), 1);
    assert_int_equal(registers[FDCAN_CCCR], 0u);
    assert_int_equal(fdcan_was_off(&can), 0);
}

static void nothing_of_before_bus_off_or_during_it_is_sent(void **state) {
    (void)state;
    fdcan can = started();
    const cr_frame torque = {0x181u, 6u, 0u, {0xe8u, 0x03u, 0u, 0u, 0u, 0u, 0u, 0u}};
    registers[FDCAN_TXFQS] = 31u | 1u << 16;
    assert_int_equal(fdcan_send(&can, &torque), 0);
    registers[FDCAN_TXBAR] = 0u;
    registers[FDCAN_PSR] = 1u << 7;
    registers[FDCAN_CCCR] = 1u;
    assert_int_equal(fdcan_send(&can, &torque), -1);
    assert_int_equal(fdcan_was_off(&can), 1);
    assert_int_equal(registers[0xD4 / 4], 0xffffffffu); /* TXBCR: every request is cancelled */
    assert_int_equal(fdcan_send(&can, &torque), -1);    /* on its way back: PSR.BO still stands */
    assert_int_equal(registers[FDCAN_TXBAR], 0u);
    registers[FDCAN_PSR] = 0u;
    assert_int_equal(fdcan_send(&can, &torque), 0);
    assert_int_equal(registers[FDCAN_TXBAR], 2u);
}

static void stop_leaves_the_bus(void **state) {
    (void)state;
    fdcan can = started();
    fdcan_stop(&can);
    assert_int_equal(registers[FDCAN_CCCR] & 1u, 1u);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bit_timing_of_80_MHz_is_16_quanta_sampled_at_87_percent),
        cmocka_unit_test(bit_timing_refuses_a_clock_that_is_no_multiple),
        cmocka_unit_test(bit_timing_is_the_bit_rate_for_every_clock_it_takes),
        cmocka_unit_test(start_lays_out_64_frames_in_and_32_out),
        cmocka_unit_test(frame_goes_into_the_slot_the_block_offers),
        cmocka_unit_test(full_queue_refuses_a_frame),
        cmocka_unit_test(frame_that_came_is_read_and_acknowledged),
        cmocka_unit_test(length_code_above_8_means_8),
        cmocka_unit_test(remote_and_long_frames_are_never_handed_out),
        cmocka_unit_test(lost_frames_are_counted),
        cmocka_unit_test(bus_off_is_told_once_and_left),
        cmocka_unit_test(nothing_of_before_bus_off_or_during_it_is_sent),
        cmocka_unit_test(stop_leaves_the_bus),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
