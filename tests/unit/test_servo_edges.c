/* What a servo meets seldom: calls out of order, frames that are none, commands at odd times, hostile records. */
#include "contact/image.h"
#include "servo/servo_stages.h"
#include "servo_rig.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define MS 1000000u

static crt_servo_rig rig;

static cr_servo_config config_of(void) {
    cr_servo_config config = cr_servo_config_default();
    config.control.contact_damping_Ns_m = 2.0f;
    return config;
}

static int power_on(void **state) {
    (void)state;
    const cr_servo_config config = config_of();
    return crt_servo_start(&rig, &config) ? 0 : -1;
}

static int in_contact(void **state) { return power_on(state) == 0 && crt_servo_bring_up(&rig, MS, 3000u) ? 0 : -1; }

static int power_off(void **state) {
    (void)state;
    crt_servo_stop(&rig);
    return 0;
}

static uint32_t mode(void) { return cr_servo_get_status(rig.servo).mode; }

static int torque_is_zero(void) {
    static const uint8_t zero[6] = {0};
    return rig.tx.count > 0u && memcmp(rig.tx.frames[0].data, zero, sizeof zero) == 0;
}

/* A period whose SYNC and tick come when they like. */
static void period_at(uint64_t sync_ns, uint64_t tick_ns, float period_s) {
    cr_tx tx;
    cr_servo_sync(rig.servo, sync_ns, &tx);
    crt_drives_speak(&rig);
    crt_servo_tick(&rig, tick_ns, period_s);
}

static void size_and_init_refuse_nothing_at_all(void **state) {
    (void)state;
    const cr_servo_config config = config_of();
    const cr_scene empty = {0};
    const size_t size = cr_servo_size(crt_plate_scene(), &config);
    cr_servo *servo = NULL;
    assert_int_equal(cr_servo_size(NULL, &config), 0);
    assert_int_equal(cr_servo_size(crt_plate_scene(), NULL), 0);
    assert_int_equal(cr_servo_size(&empty, &config), 0);
    assert_int_equal(cr_servo_init(NULL, rig.memory, size, crt_plate_scene(), &config), CR_ERR_NULL);
    assert_int_equal(cr_servo_init(&servo, rig.memory, size, NULL, &config), CR_ERR_NULL);
    assert_int_equal(cr_servo_init(&servo, rig.memory, size, crt_plate_scene(), NULL), CR_ERR_NULL);
    assert_null(servo);
}

static void frames_too_long_or_of_no_interest_are_not_kept(void **state) {
    (void)state;
    const cr_frame longer = {0x191u, 9u, 0u, {0}}, other = {0x7ffu, 8u, 0u, {0}}, babble = {0x691u, 8u, 0u, {0}};
    crt_servo_period(&rig, MS);
    cr_servo_rx(rig.servo, &longer);
    for (int i = 0; i < 100; i++) {
        cr_servo_rx(rig.servo, &other);
    }
    crt_servo_period(&rig, MS);
    assert_true(cr_mode_is_rendering(mode()));
    assert_int_equal(cr_servo_get_record(rig.servo)->rx_babbled, 0);
    for (int i = 0; i < CR_RX_MAX + 5; i++) {
        cr_servo_rx(rig.servo, &babble);
    }
    crt_servo_period(&rig, MS);
    /* The five beyond, and what the drives said after them. */
    assert_true(cr_servo_get_record(rig.servo)->rx_babbled >= 5u);
    assert_true((cr_servo_get_status(rig.servo).first_fault & CR_FAULT_BABBLE) != 0u && torque_is_zero());
}

/* 2 counts of 60 um a period on the guide: 120 mm/s, also in the tick after two states of another or of its own drive were lost. */
static void speed_after_lost_states_is_the_one_it_has(void **state) {
    (void)state;
    for (int k = 0; k < 120; k++) {
        const int lost = k == 60 || k == 61, own = k == 90 || k == 91;
        rig.drives[0].counts += 2;
        rig.drives[2].mute = lost;
        rig.drives[0].mute = own;
        crt_servo_period(&rig, MS);
        const cr_record *r = cr_servo_get_record(rig.servo);
        assert_true(cr_mode_is_rendering(mode()));
        assert_true(((r->limits & CR_LIMIT_STALE) != 0u) == (lost || own));
        if (k > 20 && !lost && !own) {
            assert_true(fabsf(r->velocity_world_m_s.x - 0.120f) < 1e-5f);
        }
    }
}

/* The scene's own damping sees the way since the world was last asked, and the time. */
static void damping_of_the_world_after_a_hole_is_that_of_the_speed(void **state) {
    float force_N[3] = {0.0f, 0.0f, 0.0f};
    for (int hole = 0; hole < 3; hole++) { /* none, two lost states, a tick that is held up */
        cr_servo_config config = config_of();
        config.world.damping_Ns_m = 50.0f;
        assert_true(crt_servo_start(&rig, &config) && crt_servo_bring_up(&rig, MS, 3000u));
        for (int k = 0; k < 30; k++) {
            rig.drives[1].counts -= 1; /* down into the block: 40 um a period across the link */
            rig.drives[2].mute = hole == 1 && (k == 27 || k == 28);
            if (hole == 2 && k == 28) {
                rig.now_ns += MS;
                period_at(rig.now_ns, rig.now_ns + 9u * MS / 10u, 1e-3f);
            } else {
                crt_servo_period(&rig, MS);
            }
        }
        force_N[hole] = v3_norm(cr_servo_get_record(rig.servo)->contact_force_world_N);
        power_off(state);
    }
    assert_int_equal(in_contact(state), 0); /* for power_off after the test */
    assert_true(force_N[0] > 0.5f && fabsf(force_N[1] - force_N[0]) < 1e-3f * force_N[0]);
    assert_true(fabsf(force_N[2] - force_N[0]) < 1e-3f * force_N[0]);
}

static void time_that_goes_back_or_jumps_is_a_fault(void **state) {
    const struct {
        int64_t sync, tick; /* after the last SYNC, ns */
        float period_s;
        uint32_t fault;
    } wrong[] = {{MS, MS - 1000, 1e-3f, CR_FAULT_BAD_STATE},
                 {-5 * (int64_t)MS, MS, 1e-3f, CR_FAULT_BAD_STATE},
                 {MS, MS + 1000, 0.0f, CR_FAULT_BAD_STATE},
                 {MS, MS + 1000, 1.5f, CR_FAULT_BAD_STATE},
                 {MS, MS + 1000, -1.0f, CR_FAULT_BAD_STATE},
                 {5 * (int64_t)MS, 5 * (int64_t)MS + 1000, 5e-3f, CR_FAULT_OVERRUN},
                 {MS, 5 * (int64_t)MS, 1e-3f, CR_FAULT_OVERRUN},
                 {2000 * (int64_t)MS, 2000 * (int64_t)MS, 1e-3f, CR_FAULT_OVERRUN}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        assert_int_equal(in_contact(state), 0);
        period_at(rig.now_ns + (uint64_t)wrong[i].sync, rig.now_ns + (uint64_t)wrong[i].tick, wrong[i].period_s);
        assert_int_equal(mode(), CR_MODE_FAULT);
        assert_true((cr_servo_get_status(rig.servo).first_fault & wrong[i].fault) != 0u && torque_is_zero());
        power_off(state);
    }
    assert_int_equal(in_contact(state), 0); /* for power_off after the test */
}

/* Of two SYNCs before one tick the second is of an earlier time: no frame leaves, and the tick is a fault. The next period is like any. */
static void a_second_sync_may_not_be_earlier(void **state) {
    cr_tx tx;
    assert_int_equal(in_contact(state), 0);
    rig.now_ns += MS;
    cr_servo_sync(rig.servo, rig.now_ns, &tx);
    assert_int_equal(tx.count, 1);
    cr_servo_sync(rig.servo, rig.now_ns - 1u, &tx);
    assert_int_equal(tx.count, 0);
    crt_servo_tick(&rig, rig.now_ns + 1000u, 1e-3f);
    assert_int_equal(mode(), CR_MODE_FAULT);
    assert_true((cr_servo_get_status(rig.servo).first_fault & CR_FAULT_BAD_STATE) != 0u && torque_is_zero());
    power_off(state);
    assert_int_equal(in_contact(state), 0); /* for power_off after the test */
}

/* What is recorded of a period that is no number is one. */
static void a_period_that_is_no_number_is_recorded_as_none(void **state) {
    assert_int_equal(in_contact(state), 0);
    period_at(rig.now_ns + MS, rig.now_ns + MS + 1000u, NAN);
    assert_int_equal(mode(), CR_MODE_FAULT);
    assert_true(cr_servo_get_record(rig.servo)->period_s == 0.0f);
    power_off(state);
    assert_int_equal(in_contact(state), 0); /* for power_off after the test */
}

/* After 49.7 days at 1 kHz the count of ticks begins anew: that tick is no first one, and time that goes back in it a fault as in any. */
static void ticks_that_begin_anew_are_no_first_tick(void **state) {
    assert_int_equal(in_contact(state), 0);
    rig.servo->ticks = UINT32_MAX;
    period_at(rig.now_ns + MS, rig.now_ns + MS + 1000u, 1e-3f);
    assert_true(cr_mode_is_rendering(mode()));
    period_at(rig.now_ns - MS, rig.now_ns + MS, 1e-3f);
    assert_int_equal(mode(), CR_MODE_FAULT);
    assert_true((cr_servo_get_status(rig.servo).first_fault & CR_FAULT_BAD_STATE) != 0u && torque_is_zero());
    power_off(state);
    assert_int_equal(in_contact(state), 0); /* for power_off after the test */
}

/* Held up before SYNC or before the tick: one late tick, and the next one is in time. */
static void a_tick_that_is_held_up_counts_once(void **state) {
    for (int before_sync = 0; before_sync < 2; before_sync++) {
        assert_int_equal(in_contact(state), 0);
        const uint64_t now_ns = rig.now_ns, tick_ns = now_ns + 5u * MS / 2u;
        period_at(before_sync ? tick_ns - 1000u : now_ns + MS, tick_ns, 1e-3f);
        assert_true((cr_servo_get_record(rig.servo)->limits & CR_LIMIT_STALE) != 0u);
        period_at(tick_ns + MS - 1000u, tick_ns + MS, 1e-3f);
        const cr_record *r = cr_servo_get_record(rig.servo);
        assert_true(cr_mode_is_rendering(mode()) && (r->limits & CR_LIMIT_STALE) == 0u && !torque_is_zero());
        assert_int_equal(r->counters.overruns, 1);
        power_off(state);
    }
    assert_int_equal(in_contact(state), 0); /* for power_off after the test */
}

/* 20 counts of 60 um a period on the guide: 1.2 m/s, also after ticks that came late, with their SYNC or after it, and where the
 * SYNC after a late one is on the grid again. */
static void speed_after_a_late_tick_is_the_one_it_has(void **state) {
    (void)state;
    const uint64_t us = 1000u, start_ns = rig.now_ns;
    uint64_t due_us = 0u, last_us = 0u;
    const int32_t counts = rig.drives[0].counts;
    for (uint32_t k = 0; k < 180u; k++) {
        const uint64_t held_us = k == 60u ? 900u : k == 90u ? 2000u : 0u;
        const uint64_t sync_late_us = k == 120u ? 600u : k == 150u ? 850u : 0u;
        due_us += k == 30u || k == 91u ? 3000u : 1000u;
        const uint64_t sync_us = due_us + sync_late_us;
        rig.drives[0].counts = counts + (int32_t)(sync_us / 50u);
        rig.drives[0].mute = k == 120u;
        period_at(start_ns + sync_us * us, start_ns + (sync_us + held_us) * us, (float)(sync_us - last_us) * 1e-6f);
        last_us = sync_us;
        const cr_record *r = cr_servo_get_record(rig.servo);
        const int hole = k == 30u || held_us > 0u || sync_late_us > 0u;
        assert_true(cr_mode_is_rendering(mode()) && ((r->limits & CR_LIMIT_STALE) != 0u) == hole);
        if (k > 20u && !hole) {
            assert_true(fabsf(r->velocity_world_m_s.x - 1.2f) < 0.01f);
        }
    }
}

static void off_switches_the_drives_off_in_its_tick(void **state) {
    (void)state;
    crt_servo_input(&rig, CR_COMMAND_OFF);
    crt_servo_period(&rig, MS);
    assert_true(torque_is_zero() && mode() == CR_MODE_INIT);
    for (int a = 0; a < CR_AXES; a++) {
        assert_int_equal(rig.drives[a].control, 0x00); /* disable voltage */
        assert_int_equal(rig.drives[a].status, 0x0240);
    }
    assert_true(crt_servo_bring_up(&rig, MS, 3000u));
    crt_servo_input(&rig, CR_COMMAND_STOP | CR_COMMAND_START); /* stop wins */
    crt_servo_period(&rig, MS);
    assert_int_equal(mode(), CR_MODE_IDLE);
}

static void status_is_ready_once_every_drive_has_answered_this_sync(void **state) {
    (void)state;
    cr_tx tx;
    const cr_frame beat = {0x711u, 1u, 0u, {0x05}};
    crt_drives_speak(&rig); /* before the SYNC: the answers to another one */
    assert_int_equal(cr_servo_get_status(rig.servo).ready, 0);
    rig.now_ns += MS;
    cr_servo_sync(rig.servo, rig.now_ns, &tx);
    cr_servo_rx(rig.servo, &beat);
    assert_int_equal(cr_servo_get_status(rig.servo).ready, 0);
    crt_drives_speak(&rig);
    assert_int_equal(cr_servo_get_status(rig.servo).ready, 1);
    assert_int_equal(cr_servo_get_status(rig.servo).axes_seen, 7);
    crt_servo_tick(&rig, rig.now_ns + 1000u, 1e-3f);
    assert_true(cr_mode_is_rendering(mode()));
    assert_int_equal(cr_servo_get_status(rig.servo).counters.late, 3);
}

static void send_that_fails_matters_only_while_rendering(void **state) {
    (void)state;
    crt_servo_input(&rig, CR_COMMAND_STOP);
    crt_servo_period(&rig, MS);
    crt_servo_input(&rig, CR_INPUT_SEND_FAILED);
    crt_servo_period(&rig, MS);
    assert_int_equal(mode(), CR_MODE_IDLE);
    assert_int_equal(cr_servo_get_status(rig.servo).counters.send_failed, 1);
    crt_servo_input(&rig, CR_COMMAND_START);
    crt_servo_period(&rig, MS);
    crt_servo_input(&rig, CR_INPUT_SEND_FAILED);
    crt_servo_period(&rig, MS);
    assert_int_equal(cr_servo_get_status(rig.servo).first_fault, CR_FAULT_BUS_OFF);
}

/* Both arm joints inside their own limits, the elbow between them not: u = f + 0.3 rad. */
static void elbow_beyond_its_range_is_a_fault(void **state) {
    (void)state;
    for (int folded = 0; folded < 2; folded++) {
        cr_servo_config config = config_of();
        assert_int_equal(power_on(state), 0);
        const float fore = folded ? -1.9f : 0.2f, upper = folded ? 1.9f : 0.5f;
        rig.drives[1].counts = (int32_t)(upper / config.axis[1].step);
        rig.drives[2].counts = (int32_t)(fore / config.axis[2].step);
        for (int k = 0; k < 3000 && mode() != CR_MODE_FAULT; k++) {
            crt_servo_period(&rig, MS);
        }
        assert_int_equal(cr_servo_get_status(rig.servo).first_fault, CR_FAULT_RANGE);
        power_off(state);
    }
    assert_int_equal(power_on(state), 0);
}

static void calibration_waits_for_drives_that_answer_and_rest(void **state) {
    (void)state;
    for (int k = 0; k < 3000 && mode() != CR_MODE_CALIBRATING; k++) {
        crt_servo_period(&rig, MS);
    }
    assert_int_equal(mode(), CR_MODE_CALIBRATING);
    for (int k = 0; k < 300; k++) { /* a joint that creeps, and every third period no answer at all */
        cr_tx tx;
        rig.drives[0].counts += 1;
        if (k % 3 == 0) {
            rig.now_ns += MS;
            cr_servo_sync(rig.servo, rig.now_ns, &tx);
            crt_servo_tick(&rig, rig.now_ns + 1000u, 1e-3f);
        } else {
            crt_servo_period(&rig, MS);
        }
        assert_int_equal(mode(), CR_MODE_CALIBRATING);
    }
    for (uint32_t k = 0; k < rig.servo->config.bus.rest_ticks + 3u; k++) {
        crt_servo_period(&rig, MS);
    }
    assert_int_equal(mode(), CR_MODE_IDLE);
}

/* What the world answers goes on as it is; when the memory of its image fails, the servo stops. */
static void world_that_faults_stops_the_servo(void **state) {
    (void)state;
    const cr_record *r = cr_servo_get_record(rig.servo);
    const cr_output *output = cr_servo_get_output(rig.servo);
    assert_true(output->area_count == 1u && output->depth_m == r->depth_m);
    struct cr_img_cluster *c = (struct cr_img_cluster *)(uintptr_t)crt_plate_scene()->clusters;
    struct cr_img_cluster kept[3];
    assert_int_equal(crt_plate_scene()->cluster_count, 3);
    memcpy(kept, c, sizeof kept);
    for (int i = 0; i < 3; i++) {
        c[i].area[1] = NAN;
    }
    crt_servo_period(&rig, MS);
    memcpy(c, kept, sizeof kept);
    assert_int_equal(cr_servo_get_status(rig.servo).first_fault, CR_FAULT_NOT_FINITE);
    assert_true(torque_is_zero());
}

static void names_of_bits_that_do_not_exist_are_unknown(void **state) {
    (void)state;
    assert_string_equal(cr_limit_text(1u << CR_LIMIT_COUNT), "unknown");
    assert_string_equal(cr_limit_text(3u), "unknown");
    assert_string_equal(cr_servo_fault_text(0u), "unknown");
}

static void re_run_takes_early_frames_and_stops_at_a_gap_for_good(void **state) {
    (void)state;
    const cr_servo_config config = config_of();
    cr_tx tx;
    for (int k = 0; k < 200; k++) { /* drives that speak before their SYNC in every other period */
        rig.now_ns += MS;
        if (k % 2 == 0) {
            crt_drives_speak(&rig);
            cr_servo_sync(rig.servo, rig.now_ns, &tx);
        } else {
            cr_servo_sync(rig.servo, rig.now_ns, &tx);
            crt_drives_speak(&rig);
        }
        crt_servo_tick(&rig, rig.now_ns + 1000u, 1e-3f);
    }
    static crt_servo_rig again;
    cr_rerun result = {0};
    assert_true(crt_servo_start(&again, &config));
    assert_int_equal(cr_servo_rerun(NULL, rig.records, 1u, &result, NULL), CR_ERR_NULL);
    assert_int_equal(cr_servo_rerun(again.servo, NULL, 1u, &result, NULL), CR_ERR_NULL);
    assert_int_equal(cr_servo_rerun(again.servo, rig.records, 1u, NULL, NULL), CR_ERR_NULL);
    assert_int_equal(cr_servo_rerun(again.servo, rig.records, 200u, &result, NULL), CR_OK);
    assert_true(result.records == 200u && result.different == 0u && result.gap == 0u);
    cr_servo_rerun(again.servo, rig.records, 1u, &result, NULL);
    assert_true(result.gap == 1u && result.records == 200u);
    cr_servo_rerun(again.servo, rig.records, 200u, &result, NULL);
    assert_int_equal(result.records, 200);
    crt_servo_stop(&again);
}

static void record_that_claims_more_frames_than_it_has_is_cut(void **state) {
    (void)state;
    const cr_servo_config config = config_of();
    cr_rerun result = {0};
    cr_record out[3], hostile[3];
    memset(hostile, 0, sizeof hostile);
    for (uint32_t i = 0; i < 3u; i++) {
        hostile[i].tick = i;
        hostile[i].frame_count = 0xffffffffu;
        hostile[i].sync_ns = hostile[i].now_ns = i * (uint64_t)MS;
        hostile[i].period_s = NAN;
    }
    assert_int_equal(cr_servo_rerun(rig.servo, hostile, 3u, &result, out), CR_OK);
    assert_true(result.records == 3u && result.different == 3u && result.first == 0u);
    for (int i = 0; i < 3; i++) {
        crt_check_record(&config, &out[i]);
    }
}

static void record_head_tells_the_scene_it_was_made_with(void **state) {
    (void)state;
    static _Alignas(64) uint8_t bytes[CR_RECORDS_AT], image[64];
    const cr_servo_config config = config_of();
    cr_record_head head;
    cr_servo_config back;
    const uint32_t crc = 0x12345678u;
    memcpy(image + 16, &crc, sizeof crc); /* where the image has it: SPEC.md */
    cr_record_head_write(&config, image, sizeof image, bytes);
    assert_int_equal(cr_record_head_read(bytes, &head, &back), CR_OK);
    assert_true(head.scene_crc32 == crc && head.scene_bytes == sizeof image);
    assert_memory_equal(&back, &config, sizeof back);
    cr_record_head_write(&config, image, sizeof image - 1u, bytes); /* no image is so short */
    assert_int_equal(cr_record_head_read(bytes, &head, &back), CR_OK);
    assert_true(head.scene_crc32 == 0u && head.scene_bytes == 0u);
    assert_int_equal(cr_record_ring_init(NULL, bytes, sizeof bytes, 2u), CR_ERR_NULL);
}

static void config_refuses_what_lies_beyond_its_ranges(void **state) {
    (void)state;
    const struct {
        size_t at;
        float value; /* of a number */
        uint32_t whole;
        const char *named;
    } wrong[] = {
        {offsetof(cr_servo_config, arm.world_from_base.pos_m.x), 200.0f, 0u, "world_from_base"},
        {offsetof(cr_servo_config, arm.world_from_base.pos_m.y), INFINITY, 0u, "world_from_base"},
        {offsetof(cr_servo_config, arm.tip_from_tool.rot.w), 0.9f, 0u, "tip_from_tool"},
        {offsetof(cr_servo_config, control.ramp_s), 11.0f, 0u, "ramp_s"},
        {offsetof(cr_servo_config, control.window), 0.0f, 1u, "window"},
        {offsetof(cr_servo_config, control.window), 0.0f, CR_WINDOW_MAX + 1u, "window"},
        {offsetof(cr_servo_config, bus.heartbeat_ms), 0.0f, 9u, "heartbeat_ms"},
        {offsetof(cr_servo_config, bus.heartbeat_ms), 0.0f, 1001u, "heartbeat_ms"},
        {offsetof(cr_servo_config, bus.host_timeout_ms), 0.0f, 10001u, "host_timeout_ms"},
        {offsetof(cr_servo_config, bus.drive_timeout_ms), 0.0f, 50u, "drive_timeout_ms"},
        {offsetof(cr_servo_config, bus.drive_timeout_ms), 0.0f, 10001u, "drive_timeout_ms"},
        {offsetof(cr_servo_config, bus.sdo_timeout_ms), 0.0f, 9u, "sdo_timeout_ms"},
        {offsetof(cr_servo_config, bus.sdo_timeout_ms), 0.0f, 10001u, "sdo_timeout_ms"},
        {offsetof(cr_servo_config, bus.enable_timeout_ms), 0.0f, 49u, "enable_timeout_ms"},
        {offsetof(cr_servo_config, bus.enable_timeout_ms), 0.0f, 60001u, "enable_timeout_ms"},
        {offsetof(cr_servo_config, world.coverage), 0.0f, CR_COVERAGE_HARD, "coverage"},
        {offsetof(cr_servo_config, world.vertices_only), 0.0f, 1u, "vertices_only"},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        cr_servo_config config = config_of();
        const void *value = wrong[i].whole != 0u ? (const void *)&wrong[i].whole : (const void *)&wrong[i].value;
        memcpy((uint8_t *)&config + wrong[i].at, value, 4u);
        const char *error = cr_servo_config_error(&config);
        assert_non_null(error);
        assert_non_null(strstr(error, wrong[i].named));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(size_and_init_refuse_nothing_at_all, power_on, power_off),
        cmocka_unit_test_setup_teardown(frames_too_long_or_of_no_interest_are_not_kept, in_contact, power_off),
        cmocka_unit_test_setup_teardown(speed_after_lost_states_is_the_one_it_has, in_contact, power_off),
        cmocka_unit_test_teardown(damping_of_the_world_after_a_hole_is_that_of_the_speed, power_off),
        cmocka_unit_test_teardown(time_that_goes_back_or_jumps_is_a_fault, power_off),
        cmocka_unit_test_teardown(a_second_sync_may_not_be_earlier, power_off),
        cmocka_unit_test_teardown(a_period_that_is_no_number_is_recorded_as_none, power_off),
        cmocka_unit_test_teardown(ticks_that_begin_anew_are_no_first_tick, power_off),
        cmocka_unit_test_teardown(a_tick_that_is_held_up_counts_once, power_off),
        cmocka_unit_test_setup_teardown(speed_after_a_late_tick_is_the_one_it_has, in_contact, power_off),
        cmocka_unit_test_setup_teardown(off_switches_the_drives_off_in_its_tick, in_contact, power_off),
        cmocka_unit_test_setup_teardown(status_is_ready_once_every_drive_has_answered_this_sync, in_contact, power_off),
        cmocka_unit_test_setup_teardown(send_that_fails_matters_only_while_rendering, in_contact, power_off),
        cmocka_unit_test_teardown(elbow_beyond_its_range_is_a_fault, power_off),
        cmocka_unit_test_setup_teardown(calibration_waits_for_drives_that_answer_and_rest, power_on, power_off),
        cmocka_unit_test_setup_teardown(world_that_faults_stops_the_servo, in_contact, power_off),
        cmocka_unit_test(names_of_bits_that_do_not_exist_are_unknown),
        cmocka_unit_test_setup_teardown(re_run_takes_early_frames_and_stops_at_a_gap_for_good, power_on, power_off),
        cmocka_unit_test_setup_teardown(record_that_claims_more_frames_than_it_has_is_cut, power_on, power_off),
        cmocka_unit_test(record_head_tells_the_scene_it_was_made_with),
        cmocka_unit_test(config_refuses_what_lies_beyond_its_ranges),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
