/* config: the assumed device, and what a configuration may hold. */
#include "servo/servo_stages.h"

#define PI_F 3.14159265f
#define DEG_F (PI_F / 180.0f)

#define LINK_M 0.45f
#define TIP_STEP_M 40e-6f
/* Compensation rises with share * coulomb / this: it must not exceed the viscous friction (3.5 and 1.5 N s/m), else
 * compensation and friction together drive slow motion. */
#define FRICTION_SPEED_M_S 0.15f
#define TIP_JUMP_M 2.5e-3f /* 2.5 m/s */

static cr_arm_config default_arm(void) {
    cr_arm_config arm = {
        /* The reference posture (guide centred, upper link 45 deg up, fore link 45 deg down) has the tip at the world's
         * origin: the elbow is at 90 deg there, so that the arm is equally stiff in Y and Z. */
        {{0.0f, -1.41421356f * LINK_M, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}},
        {{0.0f, 0.0f, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}},
        LINK_M,
        LINK_M,
        {-0.75f, -20.0f * DEG_F, -120.0f * DEG_F},
        {0.75f, 120.0f * DEG_F, 20.0f * DEG_F},
        40.0f * DEG_F,
        140.0f * DEG_F,
        {-PI_F, -85.0f * DEG_F, -PI_F},
        {PI_F, 85.0f * DEG_F, PI_F},
        0.5f,
        0.02f,
    };
    return arm;
}

cr_servo_config cr_servo_config_default(void) {
    cr_axis_config guide = {60e-6f, 0.0f, 10.0f, 20.0f, TIP_JUMP_M, 0.0f, 1.0f, FRICTION_SPEED_M_S, 4.0f};
    cr_axis_config link = {TIP_STEP_M / LINK_M, 0.0f,          8.0f * LINK_M, 20.0f * LINK_M,
                           TIP_JUMP_M / LINK_M, 0.2f * LINK_M, 0.4f * LINK_M, FRICTION_SPEED_M_S / LINK_M,
                           2.0f * LINK_M};
    cr_servo_config c = {
        default_arm(),
        {guide, link, link},
        0.05f * DEG_F,
        {0.0f, 0.0f, 0.5f, 20.0f, 4000.0f, 20.0f, 1.0f, 10.0f, 1.0f, 0.2f, 16u},
        {100u, 150u, 250u, 2u, 100u, 1000u, 50u, 50u, 3u, 50u, 0u, 0x402u, 0x00010000u},
        cr_config_default(),
        1e-3f,
        1.8e-3f,
        0.02f,
        0u,
    };
    c.world.force_max_N = 40.0f;
    return c;
}

static int is_pose(const cr_pose *p) {
    cr_quat q = p->rot;
    float n2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    return v3_is_finite(p->pos_m) && v3_norm(p->pos_m) <= 100.0f && cr_in_range(n2, 0.999f, 1.001f);
}

static const char *arm_error(const cr_arm_config *arm) {
    if (!is_pose(&arm->world_from_base) || !is_pose(&arm->tip_from_tool)) {
        return "world_from_base, tip_from_tool: a unit quaternion and a position within 100 m";
    }
    if (!cr_in_range(arm->upper_m, 0.05f, 5.0f) || !cr_in_range(arm->fore_m, 0.05f, 5.0f)) {
        return "upper_m, fore_m: 0.05..5 m";
    }
    for (int a = 0; a < CR_AXES; a++) {
        if (!cr_in_range(arm->joint_min[a], -50.0f, 50.0f) ||
            !cr_in_range(arm->joint_max[a] - arm->joint_min[a], 1e-3f, 100.0f)) {
            return "joint_min, joint_max: min at least 0.001 below max, within -50..50 m or rad";
        }
        if (!cr_in_range(arm->wrist_min_rad[a], -10.0f, 10.0f) ||
            !cr_in_range(arm->wrist_max_rad[a] - arm->wrist_min_rad[a], 1e-3f, 20.0f)) {
            return "wrist_min_rad, wrist_max_rad: min at least 0.001 below max, within -10..10 rad";
        }
    }
    if (!cr_in_range(arm->elbow_min_rad, 0.0f, PI_F) ||
        !cr_in_range(arm->elbow_max_rad, arm->elbow_min_rad + 1e-3f, PI_F)) {
        return "elbow_min_rad, elbow_max_rad: min below max, within 0..pi";
    }
    if (!cr_in_range(arm->margin_min, 0.0f, 0.99f) || !cr_in_range(arm->range_slack, 0.0f, 1.0f)) {
        return "margin_min: 0..0.99; range_slack: 0..1 m or rad";
    }
    return NULL;
}

static const char *axis_error(const cr_axis_config *axis, float period_s) {
    if (!cr_in_range(abs_f(axis->step), 1e-9f, 1e-2f) || !cr_in_range(axis->offset, -50.0f, 50.0f)) {
        return "step: 1e-9..0.01 m or rad, or negative; offset: -50..50";
    }
    if (!cr_in_range(axis->rated, 1e-3f, 1e4f) || !cr_in_range(axis->torque_max / axis->rated, 1e-3f, 32.0f)) {
        return "rated: 0.001..10000 N or N m; torque_max: 0.001..32 times rated";
    }
    if (!cr_in_range(axis->jump_max, 2.0f * abs_f(axis->step), 100.0f * period_s)) {
        return "jump_max: from two steps to 100 m/s or rad/s";
    }
    if (!cr_in_range(abs_f(axis->gravity), 0.0f, axis->torque_max) ||
        !cr_in_range(axis->coulomb, 0.0f, axis->torque_max) || !cr_in_range(axis->friction_speed, 1e-6f, 100.0f)) {
        return "gravity, coulomb: up to torque_max; friction_speed: above 0";
    }
    if (axis->stuck != 0.0f && !cr_in_range(axis->stuck, 2.0f * axis->coulomb, 64.0f * axis->rated)) {
        return "stuck: 0, or from twice coulomb to 64 times rated";
    }
    return NULL;
}

static const char *control_error(const cr_control_config *c) {
    const float damping_Ns_m[] = {c->contact_damping_Ns_m, c->free_damping_Ns_m, c->passivity_damping_max_Ns_m,
                                  c->own_damping_Ns_m};
    for (uint32_t i = 0; i < sizeof damping_Ns_m / sizeof damping_Ns_m[0]; i++) {
        if (!cr_in_range(damping_Ns_m[i], 0.0f, 1e3f)) {
            return "damping: 0..1000 N s/m";
        }
    }
    if (!cr_in_range(c->friction_share, 0.0f, 0.95f)) {
        return "friction_share: 0..0.95";
    }
    if (!cr_in_range(c->force_max_N, 0.01f, 1e3f) || !cr_in_range(c->force_rate_max_N_s, 1.0f, 1e6f)) {
        return "force_max_N: 0.01..1000; force_rate_max_N_s: 1..1e6";
    }
    if (!cr_in_range(c->power_max_W, 0.01f, 1e4f) || !cr_in_range(c->speed_max_m_s, 0.01f, 100.0f)) {
        return "power_max_W: 0.01..10000; speed_max_m_s: 0.01..100";
    }
    if (!cr_in_range(c->ramp_s, 0.0f, 10.0f) || c->window < 2u || c->window > CR_WINDOW_MAX) {
        return "ramp_s: 0..10; window: 2..32 periods";
    }
    return NULL;
}

static const char *bus_error(const cr_bus_config *b) {
    if (b->heartbeat_ms < 10u || b->heartbeat_ms > 1000u) {
        return "heartbeat_ms: 10..1000";
    }
    if (b->host_timeout_ms <= b->heartbeat_ms || b->host_timeout_ms > 10000u ||
        b->drive_timeout_ms <= b->heartbeat_ms || b->drive_timeout_ms > 10000u) {
        return "host_timeout_ms, drive_timeout_ms: above heartbeat_ms, up to 10000";
    }
    if (b->missing_max > 10u) {
        return "missing_max: 0..10 periods";
    }
    if (b->sdo_timeout_ms < 10u || b->sdo_timeout_ms > 10000u || b->enable_timeout_ms < 50u ||
        b->enable_timeout_ms > 60000u) {
        return "sdo_timeout_ms: 10..10000; enable_timeout_ms: 50..60000";
    }
    if (b->listen_ms > 10000u || b->rest_ticks > 100000u) {
        return "listen_ms: 0..10000; rest_ticks: 0..100000";
    }
    if (b->torque_timeout_ms > 1000u || b->stuck_ticks < 1u || b->stuck_ticks > 10000u) {
        return "torque_timeout_ms: 0..1000; stuck_ticks: 1..10000";
    }
    return NULL;
}

const char *cr_servo_config_error(const cr_servo_config *config) {
    if (!cr_in_range(config->period_s, 0.2e-3f, 0.1f)) {
        return "period_s: 0.0002..0.1";
    }
    if (!cr_in_range(config->overrun_s, config->period_s, 2.0f * config->period_s)) {
        return "overrun_s: one to two periods";
    }
    if (!cr_in_range(config->stuck_travel_m, 0.0f, 1.0f)) {
        return "stuck_travel_m: 0..1";
    }
    if (config->late_max_ticks > CR_LATE_MAX) {
        return "late_max_ticks: 0..255";
    }
    if (!cr_in_range(config->wrist_step_rad, 1e-6f, 0.1f)) {
        return "wrist_step_rad: 1e-6..0.1";
    }
    const char *error = arm_error(&config->arm);
    for (int a = 0; a < CR_AXES && error == NULL; a++) {
        error = axis_error(&config->axis[a], config->period_s);
    }
    error = error != NULL ? error : control_error(&config->control);
    error = error != NULL ? error : bus_error(&config->bus);
    return error != NULL ? error : cr_config_error(&config->world);
}
