/* servo: one period of the device. The only file that knows all stages of the servo; reads as the list of them. */
#include "contact/world.h"
#include "servo/servo_stages.h"

#include <string.h>

#define ALIGN 64u
/* The joints rest while no count leaves this distance of where the rest began. */
#define REST_COUNTS 3
/* The wrist turns by hand, and is told every second period: 100 rad/s is no hand. */
#define WRIST_JUMP_RAD 0.2f

_Static_assert(sizeof(cr_record) == CR_RECORD_BYTES, "the record of SPEC.md");

static size_t round_up(size_t n) { return (n + ALIGN - 1u) / ALIGN * ALIGN; }

size_t cr_servo_size(const cr_scene *scene, const cr_servo_config *config) {
    if (scene == NULL || config == NULL || cr_servo_config_error(config) != NULL) {
        return 0u;
    }
    size_t world = cr_world_size(scene, &config->world);
    return world == 0u ? 0u : round_up(sizeof(cr_servo)) + world;
}

cr_err cr_servo_init(cr_servo **servo, void *memory, size_t size_bytes, const cr_scene *scene,
                     const cr_servo_config *config) {
    if (servo == NULL || memory == NULL || scene == NULL || config == NULL) {
        return CR_ERR_NULL;
    }
    if ((uintptr_t)memory % ALIGN != 0u) {
        return CR_ERR_ALIGN;
    }
    size_t need = cr_servo_size(scene, config);
    if (need == 0u) {
        return CR_ERR_CONFIG;
    }
    if (size_bytes < need) {
        return CR_ERR_SIZE;
    }
    cr_servo *s = memory;
    memset(s, 0, sizeof *s);
    size_t own = round_up(sizeof *s);
    /* Cannot fail: cr_servo_size asked for all that it checks. */
    (void)cr_world_init(&s->world, (uint8_t *)memory + own, size_bytes - own, scene, &config->world);
    s->config = *config;
    s->world->late_max = config->late_max_ticks > 0u ? config->late_max_ticks : CR_LATE_MOST;
    cr_bus_reset(&s->bus, s->config.axis);
    cr_control_reset(&s->control);
    *servo = s;
    return CR_OK;
}

/* ------------------------------------------------------------------------------------------------------- inputs */

void cr_servo_input(cr_servo *servo, uint32_t bits) { servo->inputs |= bits; }
void cr_servo_rx_drops(cr_servo *servo, uint32_t total) { servo->rx_drops = total; }

void cr_servo_rx(cr_servo *s, const cr_frame *frame) {
    if (frame->size > 8u || !cr_bus_is_of_interest(frame->id)) {
        return;
    }
    if (s->frame_count >= CR_RX_MAX) {
        s->rx_babbled++;
        return;
    }
    cr_frame *kept = &s->frames[s->frame_count++];
    *kept = *frame;
    kept->flags = (uint8_t)(s->synced ? 0u : CR_FRAME_EARLY);
}

void cr_servo_sync(cr_servo *s, uint64_t now_ns, cr_tx *tx) {
    tx->count = 0u;
    if (s->synced && now_ns < s->sync_ns) {
        s->sync_ns = UINT64_MAX; /* time went back: later than any tick, which tells so */
        return;
    }
    s->sync_ns = now_ns;
    s->synced = 1u;
    cr_bus_sync(&s->bus, tx);
}

/* ------------------------------------------------------------------------------------------------------- stages */

static float seconds(uint64_t late_ns, uint64_t early_ns) {
    uint64_t ns = late_ns - early_ns;
    return ns > 1000000000ull ? 1.0f : (float)(uint32_t)ns * 1e-9f;
}

/* Ticks are not what counts: one may come long after its SYNC, and a SYNC may be late. */
static uint32_t periods_since(const cr_servo *s, uint64_t ns) {
    return (uint32_t)max_f(1.0f, seconds(s->sync_ns, ns) / s->config.period_s + 0.5f);
}

/* The drives hold the last torque until the next. Where none flows, a late tick does no harm. */
static uint32_t check_time(cr_servo *s, uint64_t now_ns, float period_s) {
    int in_order = s->synced && now_ns >= s->sync_ns && (s->ticks == 0u || s->sync_ns >= s->last_now_ns);
    s->slept = 0u;
    if (!in_order || !(period_s > 0.0f && period_s <= 1.0f)) {
        return CR_FAULT_BAD_STATE;
    }
    const float late_s = s->ticks > 0u ? seconds(now_ns, s->last_now_ns) - s->config.overrun_s : 0.0f;
    if (late_s <= 0.0f) {
        s->overrun = 0u;
        return 0u;
    }
    s->slept = 1u + (uint32_t)(late_s / s->config.period_s);
    s->overrun += s->slept;
    s->counters.overruns++;
    const int most = s->overrun > s->config.bus.missing_max;
    return most && cr_mode_is_rendering(s->mode) ? (uint32_t)CR_FAULT_OVERRUN : 0u;
}

static uint32_t take_inputs(cr_servo *s, uint32_t inputs) {
    uint32_t faults = (inputs & CR_INPUT_BUS_OFF) != 0u ? (uint32_t)CR_FAULT_BUS_OFF : 0u;
    if ((inputs & CR_INPUT_SEND_FAILED) != 0u) {
        s->counters.send_failed++;
        faults |= cr_mode_is_rendering(s->mode) ? (uint32_t)CR_FAULT_BUS_OFF : 0u;
    }
    s->counters.rx_drops = s->rx_drops;
    s->counters.babbled += s->rx_babbled;
    return faults | (s->rx_babbled > 0u ? (uint32_t)CR_FAULT_BABBLE : 0u);
}

static uint32_t take_frames(cr_servo *s, uint64_t now_ns) {
    for (uint32_t i = 0; i < s->frame_count; i++) {
        cr_bus_receive(&s->config.bus, &s->bus, &s->frames[i], now_ns, &s->counters);
    }
    cr_bus_check(&s->config.bus, &s->bus, now_ns, &s->counters);
    uint32_t faults = s->bus.faults;
    s->bus.faults = 0u;
    return faults;
}

/* Counts between two samples, without overflow. */
static float counts_between(int32_t now, int32_t before) { return abs_f((float)((int64_t)now - (int64_t)before)); }

/* A mechanical stop can hold a joint against any torque. */
static int is_at_stop(const cr_servo *s, int a) {
    const cr_arm_config *arm = &s->config.arm;
    float q = s->joints.joint[a], room = s->config.axis[a].jump_max;
    float elbow = s->joints.joint[1] - s->joints.joint[2];
    int bent = a > 0 && (elbow < arm->elbow_min_rad + room || elbow > arm->elbow_max_rad - room);
    return bent || q < arm->joint_min[a] + room || q > arm->joint_max[a] - room;
}

/* A joint that rests under one torque and still rests, to the bit, when the torque has changed by more than friction can
 * hold and the other joints have carried the tip away: a stuck encoder looks like that. A hand that leans on a wall does not,
 * nothing changes while nothing moves; nor does a joint that turns round, which rests while the tip moves some mm. */
static uint32_t check_still(cr_servo *s, int a) {
    cr_still *still = &s->still[a];
    const float most = s->config.axis[a].stuck, torque = s->control.torque[a];
    if (s->counts[a] != still->counts || !cr_mode_is_rendering(s->mode) || is_at_stop(s, a)) {
        *still = (cr_still){s->counts[a], 0u, 0.0f, {0.0f, 0.0f, 0.0f}, 0u};
        return 0u;
    }
    still->ticks++;
    if (still->ticks <= s->config.bus.stuck_ticks) {
        still->torque = torque;
        still->tip_m = s->kinematics.tip_world_m;
        return 0u;
    }
    int away = v3_norm(v3_sub(s->kinematics.tip_world_m, still->tip_m)) > s->config.stuck_travel_m;
    int pushed = most > 0.0f && away && abs_f(torque - still->torque) > most;
    still->pushed = pushed ? still->pushed + 1u : 0u;
    return still->pushed > s->config.bus.stuck_ticks ? (uint32_t)CR_FAULT_STUCK : 0u;
}

static uint32_t read_axis(cr_servo *s, int a) {
    const cr_axis_config *axis = &s->config.axis[a];
    const cr_drive *drive = &s->bus.drive[a];
    if (drive->state_count == 0u || s->slept > 0u) {
        s->stale = 1u;
        /* Late ticks and missing states may follow each other, each as many as it may be. */
        const uint32_t most = 3u * s->config.bus.missing_max;
        s->missed[a] += 1u + s->slept;
        s->gap[a] = 0u;
        return s->missed[a] > most && cr_mode_is_rendering(s->mode) ? (uint32_t)CR_FAULT_SILENT : 0u;
    }
    /* Through bridged periods the joint may have moved on. */
    float moved = counts_between(drive->counts, s->counts[a]) * abs_f(axis->step);
    s->gap[a] = s->missed[a] > 0u ? periods_since(s, s->sampled_ns[a]) : 1u;
    float most = axis->jump_max * (float)s->gap[a];
    s->missed[a] = 0u;
    s->sampled_ns[a] = s->sync_ns;
    s->counts[a] = drive->counts;
    s->joints.joint[a] = axis->offset + axis->step * (float)drive->counts;
    return (s->has_counts && moved > most ? (uint32_t)CR_FAULT_JUMP : 0u) | check_still(s, a);
}

/* In periods without it the last angles hold. */
static uint32_t read_wrist(cr_servo *s) {
    uint32_t faults = 0u;
    for (int i = 0; i < 3 && s->bus.wrist.fresh; i++) {
        float angle = s->config.wrist_step_rad * (float)s->bus.wrist.counts[i];
        int jumped = s->has_wrist && abs_f(angle - s->joints.wrist_rad[i]) > WRIST_JUMP_RAD;
        faults |= jumped ? (uint32_t)CR_FAULT_JUMP : 0u;
        s->joints.wrist_rad[i] = angle;
    }
    s->has_wrist |= s->bus.wrist.fresh;
    return faults;
}

/* Where a joint cannot be, the encoder or its zero is wrong. */
static uint32_t check_range(const cr_arm_config *arm, const cr_joints *joints) {
    for (int a = 0; a < CR_AXES; a++) {
        float q = joints->joint[a];
        if (!(q >= arm->joint_min[a] - arm->range_slack && q <= arm->joint_max[a] + arm->range_slack)) {
            return CR_FAULT_RANGE;
        }
    }
    float elbow = joints->joint[1] - joints->joint[2];
    int in = elbow >= arm->elbow_min_rad - arm->range_slack && elbow <= arm->elbow_max_rad + arm->range_slack;
    return in ? 0u : (uint32_t)CR_FAULT_RANGE;
}

/* Frames to joints to pose. */
static uint32_t sense(cr_servo *s) {
    uint32_t faults = 0u;
    s->stale = 0u;
    for (int a = 0; a < CR_AXES; a++) {
        faults |= read_axis(s, a);
    }
    faults |= read_wrist(s);
    s->has_counts = s->has_counts || !s->stale ? 1u : 0u;
    faults |= s->has_counts ? check_range(&s->config.arm, &s->joints) : 0u;
    cr_kinematics_solve(&s->config.arm, &s->joints, &s->kinematics);
    return faults;
}

static int is_resting(cr_servo *s) {
    int moved = 0;
    for (int a = 0; a < CR_AXES; a++) {
        moved |= counts_between(s->counts[a], s->rest_counts[a]) > (float)REST_COUNTS;
    }
    if (moved) {
        memcpy(s->rest_counts, s->counts, sizeof s->rest_counts);
        s->rest_ticks = 0u;
    } else {
        s->rest_ticks++;
    }
    return s->rest_ticks > s->config.bus.rest_ticks;
}

static void feel_nothing(cr_servo *s) {
    s->output.force_world_N = s->output.torque_world_Nm = v3(0.0f, 0.0f, 0.0f);
    s->output.depth_m = 0.0f;
    s->output.area_count = s->output.zone_count = 0u;
}

/* Contact that was searched for beside the ticks, and is not too old to be felt. */
static uint32_t feel_contact(cr_servo *s, float since_s) {
    const uint32_t late_max = s->config.late_max_ticks;
    cr_feel(s->world, &s->kinematics.world_from_tool, since_s, &s->output);
    s->late = s->output.stats.late_ticks;
    if (s->late <= late_max) {
        return 0u;
    }
    s->late = late_max + 1u;
    cr_drop_hand(s->world);
    feel_nothing(s);
    return cr_mode_is_rendering(s->mode) ? (uint32_t)CR_FAULT_LATE : 0u;
}

/* Pose to wrench. */
static uint32_t touch(cr_servo *s, float period_s) {
    const float since_s = s->untouched ? seconds(s->sync_ns, s->asked_ns) : period_s;
    uint32_t faults = 0u;
    s->untouched = 0u;
    s->asked_ns = s->sync_ns;
    if (s->config.late_max_ticks > 0u) {
        faults = feel_contact(s, since_s);
    } else {
        cr_tick(s->world, &s->kinematics.world_from_tool, since_s, &s->output);
        s->late = s->output.stats.late_ticks;
    }
    return faults | (s->output.faults == 0u ? 0u : (uint32_t)CR_FAULT_NOT_FINITE);
}

uint32_t cr_servo_search(cr_servo *servo, uint32_t work) {
    return servo->config.late_max_ticks > 0u ? cr_search(servo->world, work) : 0u;
}

static uint32_t find_events(cr_servo *s, uint32_t inputs, uint32_t faults) {
    uint32_t events = faults != 0u ? (uint32_t)CR_EVENT_FAULT : 0u;
    events |= s->bus.phase >= CR_PHASE_SET_UP ? (uint32_t)CR_EVENT_DRIVES_SEEN : 0u;
    events |= s->bus.phase == CR_PHASE_RUN ? (uint32_t)CR_EVENT_DRIVES_ENABLED : 0u;
    int sensed = s->has_wrist && !s->stale;
    events |= s->mode == CR_MODE_CALIBRATING && sensed && is_resting(s) ? (uint32_t)CR_EVENT_RESTED : 0u;
    events |= (inputs & CR_COMMAND_START) != 0u ? (uint32_t)CR_EVENT_START : 0u;
    events |= (inputs & (CR_COMMAND_STOP | CR_COMMAND_OFF)) != 0u ? (uint32_t)CR_EVENT_STOP : 0u;
    return events;
}

/* Everything from the start, drives included: what made a fault may have reset them. */
static void restart(cr_servo *s) {
    cr_bus_reset(&s->bus, s->config.axis);
    cr_control_reset(&s->control);
    cr_world_clear_fault(s->world);
    s->faults = s->first_fault = 0u;
    s->has_counts = s->has_wrist = s->rest_ticks = 0u;
    memset(s->missed, 0, sizeof s->missed);
    s->untouched = 0u;
    s->mode = CR_MODE_INIT;
}

static void fail(cr_servo *s, uint32_t faults) {
    s->mode = CR_MODE_FAULT;
    s->faults = s->first_fault = faults;
    s->counters.faults++;
    cr_control_reset(&s->control);
    cr_bus_refuse(&s->bus);
}

static void step_mode(cr_servo *s, uint32_t inputs, uint32_t faults) {
    uint32_t before = s->mode;
    if (before == CR_MODE_FAULT) {
        /* Switched off, no drive is enabled: that is not news. */
        s->faults |= faults & ~(uint32_t)CR_FAULT_DRIVE_STATE;
        if (cr_mode_next(before, (inputs & CR_COMMAND_CLEAR) != 0u ? (uint32_t)CR_EVENT_CLEAR : 0u) == CR_MODE_INIT) {
            restart(s);
        }
        return;
    }
    s->mode = cr_mode_next(before, find_events(s, inputs, faults));
    if (s->mode == CR_MODE_FAULT) {
        fail(s, faults);
    } else if (!cr_mode_is_rendering(before) && cr_mode_is_rendering(s->mode)) {
        cr_control_reset(&s->control);
    }
}

static void count_limits(cr_servo *s, uint32_t limits) {
    s->counters.ticks_rendering++;
    s->counters.ticks_limited += limits != 0u ? 1u : 0u;
    for (uint32_t i = 0; i < CR_LIMIT_COUNT; i++) {
        s->counters.limits[i] += limits >> i & 1u;
    }
}

/* Wrench to joint torques. */
static void render(cr_servo *s, float period_s, cr_control_output *out) {
    cr_control_input in = {&s->kinematics, s->output.force_world_N, {0}, {0}, period_s};
    memcpy(in.joint, s->joints.joint, sizeof in.joint);
    cr_control_speeds(&s->config, &s->control, s->counts, s->gap, in.speed);
    if (s->stale) {
        cr_control_bridge(&s->control, s->overrun == 1u ? 1.0f : 0.5f, out);
    } else {
        cr_control_step(&s->config, &s->control, &in, out);
    }
    if (!out->finite) {
        fail(s, CR_FAULT_NOT_FINITE);
        memset(out, 0, sizeof *out);
        return;
    }
    count_limits(s, out->limits);
    s->mode = cr_mode_next(s->mode, out->limits != 0u ? (uint32_t)CR_EVENT_LIMIT : 0u);
}

/* ------------------------------------------------------------------------------------------------------- record */

static void record_inputs(cr_servo *s, uint32_t inputs, uint64_t now_ns, float period_s) {
    cr_record *r = &s->record;
    memset(r, 0, sizeof *r);
    r->tick = s->ticks;
    r->inputs = inputs;
    r->sync_ns = s->sync_ns;
    r->now_ns = now_ns;
    r->period_s = period_s > 0.0f && period_s <= 1.0f ? period_s : 0.0f; /* out of range it is a fault: as 0 is */
    r->rx_drops = s->rx_drops;
    r->rx_babbled = s->rx_babbled;
    r->frame_count = s->frame_count;
    memcpy(r->frames, s->frames, s->frame_count * sizeof *r->frames);
}

static void record_outputs(cr_servo *s, const cr_control_output *out, const int16_t target[CR_AXES]) {
    cr_record *r = &s->record;
    r->mode = s->mode;
    r->faults = s->faults;
    r->limits = out->limits;
    for (uint32_t a = 0; a < CR_AXES; a++) {
        const cr_drive *drive = &s->bus.drive[a];
        r->counts[a] = drive->counts;
        r->status[a] = drive->status;
        r->actual[a] = drive->actual;
        r->target[a] = target[a];
        r->torque[a] = out->torque[a];
        r->fresh |= (uint16_t)(drive->state_count > 0u ? 1u << a : 0u);
        r->wrist_counts[a] = s->bus.wrist.counts[a];
    }
    r->fresh |= (uint16_t)(s->bus.wrist.fresh << CR_AXES);
    r->joints = s->joints;
    r->world_from_tool = s->kinematics.world_from_tool;
    r->velocity_world_m_s = out->velocity_m_s;
    r->contact_force_world_N = s->output.force_world_N;
    r->contact_torque_world_Nm = s->output.torque_world_Nm;
    r->force_world_N = out->force_N;
    r->energy_J = out->energy_J;
    r->depth_m = s->output.depth_m;
    r->margin = s->kinematics.margin;
    r->area_count = s->output.area_count;
    r->zone_count = s->output.zone_count;
    r->counters = s->counters;
    r->trouble_axis = s->bus.trouble_axis;
    r->sdo_object = s->bus.sdo_object;
    r->sdo_found = s->bus.sdo_found;
    r->sdo_wanted = s->bus.sdo_wanted;
    r->sdo_abort = s->bus.sdo_abort;
    r->contact_late_ticks = s->late;
}

/* --------------------------------------------------------------------------------------------------------- tick */

/* From a servo that is not in fault: what the samples say, and what the scene answers. */
static uint32_t sense_and_touch(cr_servo *s, uint32_t faults, float period_s) {
    feel_nothing(s);
    s->late = CR_NOT_FELT;
    if (s->mode == CR_MODE_FAULT || s->bus.phase != CR_PHASE_RUN) {
        return faults;
    }
    faults |= sense(s);
    if (faults == 0u && !s->stale && s->has_counts && s->has_wrist) {
        faults |= touch(s, period_s);
    } else {
        s->untouched = 1u;
    }
    return faults;
}

void cr_servo_tick(cr_servo *s, uint64_t now_ns, float period_s, cr_tx *tx) {
    uint32_t inputs = (s->inputs & ~(uint32_t)CR_INPUT_NO_SYNC) | (s->synced ? 0u : (uint32_t)CR_INPUT_NO_SYNC);
    cr_control_output out;
    int16_t target[CR_AXES];
    tx->count = 0u;
    memset(&out, 0, sizeof out);
    record_inputs(s, inputs, now_ns, period_s);
    uint32_t faults = check_time(s, now_ns, period_s) | take_inputs(s, inputs) | take_frames(s, now_ns);
    float period =
        period_s > 0.0f ? clamp_f(period_s, 0.5f * s->config.period_s, 2.0f * s->config.period_s) : s->config.period_s;
    faults = sense_and_touch(s, faults, period);
    step_mode(s, inputs, faults);
    if (cr_mode_is_rendering(s->mode)) {
        render(s, period, &out);
    }
    for (int a = 0; a < CR_AXES; a++) {
        target[a] = cr_per_mille(out.torque[a], s->config.axis[a].rated, s->config.axis[a].torque_max);
    }
    int off = s->mode == CR_MODE_FAULT || (inputs & CR_COMMAND_OFF) != 0u;
    cr_bus_transmit(&s->config.bus, &s->bus, target, off, now_ns, &s->counters, tx);
    if (off && s->mode != CR_MODE_FAULT) {
        restart(s);
    }
    record_outputs(s, &out, target);
    s->last_now_ns = now_ns;
    s->synced = s->inputs = s->frame_count = s->rx_babbled = 0u;
    s->ticks += s->ticks == UINT32_MAX ? 2u : 1u; /* 0 is the first tick alone */
}

/* ------------------------------------------------------------------------------------------------------- status */

/* Whether every drive's answer to this SYNC lies in the frames not yet taken. */
static uint16_t is_ready(const cr_servo *s) {
    uint32_t fresh = 0u;
    for (uint32_t i = 0; i < s->frame_count; i++) {
        uint32_t axis = s->frames[i].id - 0x191u;
        fresh |= axis < CR_AXES && (s->frames[i].flags & CR_FRAME_EARLY) == 0u ? 1u << axis : 0u;
    }
    return fresh == (1u << CR_AXES) - 1u ? 1u : 0u;
}

cr_servo_status cr_servo_get_status(const cr_servo *s) {
    cr_servo_status status = {s->mode,          s->faults,           s->record.limits, s->first_fault, 0u,
                              s->bus.sdo_abort, s->bus.trouble_axis, s->bus.emcy_code, is_ready(s),    s->counters};
    for (uint32_t a = 0; a < CR_AXES; a++) {
        status.axes_seen |= s->bus.drive[a].seen ? 1u << a : 0u;
    }
    return status;
}

const cr_record *cr_servo_get_record(const cr_servo *s) { return &s->record; }
const cr_output *cr_servo_get_output(const cr_servo *s) { return &s->output; }
