/* Drives, mechanism and faults together, through the public header only. */
#include "sim.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define FRAMES 64

static uint32_t random_state = 1;
static uint32_t next_random(void) {
    random_state = random_state * 1664525u + 1013904223u;
    return random_state >> 8;
}

static size_t tick(cr_sim *sim, uint64_t *now_us, cr_sim_frame *frames) {
    const cr_sim_frame sync = {.id = 0x80};
    *now_us += 1000;
    cr_sim_receive(sim, &sync, *now_us);
    cr_sim_poll(sim, *now_us);
    return cr_sim_send(sim, frames, FRAMES);
}

static void sim_refuses_parameters_out_of_range(void **state) {
    (void)state;
    cr_sim_params p = cr_sim_params_default();
    p.axes[1].mass_kg = NAN;
    assert_null(cr_sim_create(&p, 0, 0));
    p = cr_sim_params_default();
    p.substeps = 0;
    assert_null(cr_mech_create(&p));
    p = cr_sim_params_default();
    p.axes[0].mass_kg = 0.5; /* less than the arm that it carries */
    assert_null(cr_mech_create(&p));
    assert_null(cr_mech_create(NULL));
}

static void sim_boots_three_drives_in_bus_order(void **state) {
    (void)state;
    const cr_sim_params p = cr_sim_params_default();
    cr_sim *sim = cr_sim_create(&p, 0, 0);
    cr_sim_frame frames[FRAMES];
    assert_int_equal(cr_sim_send(sim, frames, 2), 2);
    assert_int_equal(frames[0].id, 0x711);
    assert_int_equal(frames[1].id, 0x712);
    assert_int_equal(cr_sim_send(sim, frames, FRAMES), 1);
    assert_int_equal(frames[0].id, 0x713);
    assert_int_equal(cr_sim_send(sim, frames, FRAMES), 0);
    cr_sim_destroy(sim);
    cr_sim_destroy(NULL);
}

/* Anything at all on the bus: the drives stay within their limits, the mechanism finite, the counters whole. */
static void sim_survives_a_million_random_bytes(void **state) {
    (void)state;
    const cr_sim_params p = cr_sim_params_default();
    cr_sim *sim = cr_sim_create(&p, 0, 0);
    cr_sim_frame frames[FRAMES];
    static const uint32_t ids[] = {0x000, 0x080, 0x181, 0x200, 0x211, 0x212, 0x311, 0x611, 0x612, 0x613, 0x701, 0x7FF};
    uint64_t now_us = 0;
    for (int i = 0; i < 100000; i++) {
        cr_sim_frame frame = {.id = ids[next_random() % (sizeof ids / sizeof *ids)],
                              .len = (uint8_t)(next_random() % 9u)};
        for (int b = 0; b < 8; b++) {
            frame.data[b] = (uint8_t)next_random();
        }
        if (frame.id >= 0x611u && frame.id <= 0x613u && next_random() % 2u != 0u) {
            frame.data[0] = (uint8_t)(next_random() % 2u != 0u ? 0x23u : 0x40u);
            frame.data[2] = (uint8_t)(next_random() % 2u != 0u ? 0x16u : 0x60u);
        }
        cr_sim_receive(sim, &frame, now_us);
        if (i % 20 == 0) {
            (void)tick(sim, &now_us, frames);
        }
        while (cr_sim_send(sim, frames, FRAMES) > 0u) {
            assert_true(frames[0].id <= 0x7FFu && frames[0].len <= 8u);
        }
    }
    cr_sim_state mechanism;
    cr_sim_read(sim, &mechanism);
    for (int i = 0; i < CR_SIM_AXES; i++) {
        cr_sim_drive drive;
        cr_sim_read_drive(sim, (uint32_t)i, &drive);
        assert_true(abs(drive.torque_permille) <= 2500);
        assert_true(isfinite(mechanism.joint[i]) && isfinite(mechanism.tip_pos_m[i]));
    }
    cr_sim_destroy(sim);
}

static void sim_fault_table_refuses_and_keeps_the_old_one(void **state) {
    (void)state;
    const cr_sim_params p = cr_sim_params_default();
    cr_sim *sim = cr_sim_create(&p, 0, 0);
    const cr_sim_fault good = {.kind = CR_SIM_FAULT_DRIVE_RESET, .tick = 2, .axis = 1};
    const cr_sim_fault bad = {.kind = CR_SIM_FAULT_COUNT, .tick = 1};
    cr_sim_frame frames[FRAMES];
    uint64_t now_us = 0;
    assert_int_equal(cr_sim_set_faults(sim, &good, 1), 0);
    assert_int_equal(cr_sim_set_faults(sim, &bad, 1), -1);
    while (cr_sim_send(sim, frames, FRAMES) > 0u) {
    }
    assert_int_equal(tick(sim, &now_us, frames), 0);
    assert_int_equal(tick(sim, &now_us, frames), 1);
    assert_int_equal(frames[0].id, 0x712);
    assert_int_equal(cr_sim_count(sim).faults_done, 1);
    cr_sim_destroy(sim);
}

static void sim_queue_counts_what_does_not_fit(void **state) {
    (void)state;
    const cr_sim_params p = cr_sim_params_default();
    cr_sim *sim = cr_sim_create(&p, 0, 0);
    const cr_sim_fault flood = {.kind = CR_SIM_FAULT_BABBLE, .tick = 1, .axis = 0, .id = 0x081, .value = 10000};
    const cr_sim_frame sync = {.id = 0x80};
    assert_int_equal(cr_sim_set_faults(sim, &flood, 1), 0);
    cr_sim_receive(sim, &sync, 1000);
    assert_int_equal(cr_sim_count(sim).frames_dropped, 10000 - (CR_SIM_QUEUE_MAX - 3));
    cr_sim_destroy(sim);
}

static void write_object(cr_sim *sim, uint32_t axis, uint16_t index, uint8_t sub, uint32_t value, uint8_t size) {
    const cr_sim_frame frame = {.id = 0x611u + axis,
                                .len = 8,
                                .data = {(uint8_t)(0x23u | (4u - size) << 2), (uint8_t)index, (uint8_t)(index >> 8),
                                         sub, (uint8_t)value, (uint8_t)(value >> 8), (uint8_t)(value >> 16),
                                         (uint8_t)(value >> 24)}};
    cr_sim_receive(sim, &frame, 0);
}

/* 0x1016 names the node to watch: the host, a node that is none of ours, or another drive, whose silence a third one may be. */
static void drive_watches_the_heartbeat_of_any_node(void **state) {
    (void)state;
    static const uint32_t watched[] = {0x01, 0x22, 0x12};
    for (size_t i = 0; i < sizeof watched / sizeof *watched; i++) {
        const cr_sim_params p = cr_sim_params_default();
        cr_sim *sim = cr_sim_create(&p, 0, 0);
        const cr_sim_fault mute = {.kind = CR_SIM_FAULT_SILENT, .tick = 100, .ticks = 400, .axis = 1};
        cr_sim_frame frames[FRAMES];
        cr_sim_drive drive;
        uint64_t now_us = 0;
        write_object(sim, 0, 0x1016, 1, watched[i] << 16 | 50u, 4);
        write_object(sim, 1, 0x1017, 0, 20u, 2);
        assert_int_equal(cr_sim_set_faults(sim, &mute, 1), 0);
        uint64_t faulted_us = 0;
        for (int k = 1; k < 400 && faulted_us == 0; k++) {
            const cr_sim_frame beat = {.id = 0x700u + watched[i], .len = 1, .data = {0x05}};
            if (watched[i] != 0x12u && k <= 100 && k % 20 == 0) {
                cr_sim_receive(sim, &beat, now_us);
            }
            (void)tick(sim, &now_us, frames);
            cr_sim_read_drive(sim, 0, &drive);
            faulted_us = drive.error_code == 0x8130 ? now_us : 0;
        }
        /* The last beat at 100 ms, or up to 20 ms before the silence; 50 ms later, to a tick. */
        assert_in_range(faulted_us, 130000, 152000);
        assert_int_equal(cr_sim_count(sim).frames_ignored, 0);
        cr_sim_destroy(sim);
    }
}

static void mechanism_at_rest_stays_at_rest(void **state) {
    (void)state;
    const cr_sim_params p = cr_sim_params_default();
    cr_mech *mech = cr_mech_create(&p);
    cr_sim_state before, after;
    cr_mech_read(mech, &before);
    cr_mech_advance(mech, 50000);
    cr_mech_read(mech, &after);
    for (int i = 0; i < CR_SIM_AXES; i++) {
        assert_true(fabs(after.tip_pos_m[i] - before.tip_pos_m[i]) < 1e-3);
        assert_true(fabs(after.tip_vel_m_s[i]) < 1e-6);
    }
    cr_mech_destroy(mech);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sim_refuses_parameters_out_of_range),
        cmocka_unit_test(sim_boots_three_drives_in_bus_order),
        cmocka_unit_test(sim_survives_a_million_random_bytes),
        cmocka_unit_test(sim_fault_table_refuses_and_keeps_the_old_one),
        cmocka_unit_test(sim_queue_counts_what_does_not_fit),
        cmocka_unit_test(drive_watches_the_heartbeat_of_any_node),
        cmocka_unit_test(mechanism_at_rest_stays_at_rest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
