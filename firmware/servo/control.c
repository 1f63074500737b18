/* control: contact force in, joint torques out. */
#include "servo/servo_stages.h"

#include <string.h>

/* Part of a joint's range, at either end, over which force fades to nothing. */
#define RANGE_BAND 0.02f
/* The contact is over, and its energy account closed, after so many free ticks: the last force has acted by then. */
#define FREE_TICKS 4u
/* Below this speed the passivity controller waits: dividing by v would give noise, and there is no work to undo. */
#define STILL_M_S 1e-3f
/* The passivity controller spreads its work over so many periods. All at once, as [7] has it, it multiplies the noise of the
 * speed by its largest damping. A mass that a wall of 3000 N/m throws back with 1.057 of its speed comes back with 1.034
 * (test_control_force). */
#define DISSIPATE_PERIODS 10.0f
#define TINY_N 1e-6f

void cr_control_reset(cr_control *control) { memset(control, 0, sizeof *control); }

void cr_control_speeds(const cr_servo_config *config, cr_control *control, const int32_t counts[CR_AXES],
                       const uint32_t periods[CR_AXES], float speed[CR_AXES]) {
    for (int a = 0; a < CR_AXES; a++) {
        speed[a] = 0.0f;
        if (periods[a] > 0u) {
            float slope = cr_velocity_step(&control->velocity[a], counts[a], periods[a], config->control.window);
            /* Samples are of SYNCs, which keep to their grid: a late one makes the next period short, not the window. */
            speed[a] = slope * config->axis[a].step / config->period_s;
        }
    }
}

/* Work of the force that was held since the sample before, on the way the tip made [7]. With positions, not with
 * speeds: the sum telescopes, so neither quantisation nor the velocity filter adds or loses energy. */
static void observe(const cr_control_config *config, cr_control *c, const cr_control_input *in, cr_vec3 velocity) {
    cr_vec3 tip = in->kinematics->tip_world_m;
    float steps = (float)(c->bridged + 1u);
    if (c->has_before) {
        /* Over a gap the way is known, not its parts: the mean of the forces is exact for a tip that moves evenly. */
        cr_vec3 mean_N = v3_scale(v3_add(c->applied_N[CR_FORCE_DELAY - 1], c->bridged_N), 1.0f / steps);
        c->energy_J += v3_dot(mean_N, v3_sub(tip, c->tip_before_m));
    }
    c->bridged = 0u;
    c->bridged_N = v3(0.0f, 0.0f, 0.0f);
    if (c->energy_J > 0.0f) {
        /* The mechanism's own viscous friction burns part of an excess. Without it the little that a turning force gives on its way over a
         * corner (0.04 mW at 20 mm/s, of 0.6 mW that friction takes) keeps the controller on: buzz 0.095 m/s^2 instead of 0.015. */
        float burnt_J = config->own_damping_Ns_m * in->period_s * steps * v3_dot(velocity, velocity);
        c->energy_J = max_f(0.0f, c->energy_J - burnt_J);
    }
    c->tip_before_m = tip;
    c->has_before = 1u;
    int free = v3_norm(in->contact_force_N) <= TINY_N;
    c->free_ticks = free ? c->free_ticks + (c->free_ticks < FREE_TICKS ? 1u : 0u) : 0u;
    c->energy_J = c->free_ticks >= FREE_TICKS ? 0.0f : c->energy_J;
}

/* Damping along the contact force, and everywhere; the contact does not pull. */
static cr_vec3 damp(const cr_control_config *config, cr_vec3 contact_N, cr_vec3 velocity) {
    float norm = v3_norm(contact_N);
    cr_vec3 force = contact_N;
    if (norm > TINY_N && config->contact_damping_Ns_m > 0.0f) {
        cr_vec3 along = v3_scale(contact_N, 1.0f / norm);
        force = v3_scale(along, max_f(0.0f, norm - config->contact_damping_Ns_m * v3_dot(velocity, along)));
    }
    return v3_mad(force, velocity, -config->free_damping_Ns_m);
}

/* Passivity controller [7]: as much damping as takes the excess energy back within DISSIPATE_PERIODS, within its bound. Along
 * the contact force only: that is where the energy flows, and the force keeps its direction. */
static cr_vec3 dissipate(const cr_control_config *config, const cr_control *c, const cr_control_input *in,
                         cr_vec3 velocity, cr_vec3 force, uint32_t *limits) {
    float contact = v3_norm(in->contact_force_N), most = config->passivity_damping_max_Ns_m;
    if (!(c->energy_J > 0.0f) || contact <= TINY_N || most <= 0.0f) {
        return force;
    }
    cr_vec3 along = v3_scale(in->contact_force_N, 1.0f / contact);
    float speed = v3_dot(velocity, along), before = v3_dot(force, along);
    if (abs_f(speed) < STILL_M_S) {
        return force;
    }
    float damping = min_f(c->energy_J / (DISSIPATE_PERIODS * in->period_s * speed * speed), most);
    float after = max_f(before - damping * speed, min_f(0.0f, before)); /* pushes or does nothing, never pulls */
    *limits |= CR_LIMIT_PASSIVITY;
    return v3_mad(force, along, after - before);
}

/* Keep `share` of the force's component along the motion, when that speeds it up. */
static cr_vec3 hold_back(cr_vec3 force, cr_vec3 velocity, float share) {
    float speed2 = v3_dot(velocity, velocity);
    CR_ASSERT(!(speed2 <= 0.0f)); /* there is power, so there is motion */
    return v3_mad(force, velocity, -(1.0f - share) * v3_dot(force, velocity) / speed2);
}

static cr_vec3 limit_speed(const cr_control_config *config, cr_vec3 velocity, cr_vec3 force, uint32_t *limits) {
    float speed = v3_norm(velocity), power = v3_dot(force, velocity);
    if (speed > config->speed_max_m_s && power > 0.0f) {
        force = hold_back(force, velocity, max_f(0.0f, 2.0f - speed / config->speed_max_m_s));
        *limits |= CR_LIMIT_SPEED;
        power = v3_dot(force, velocity);
    }
    if (power > config->power_max_W) {
        force = hold_back(force, velocity, config->power_max_W / power);
        *limits |= CR_LIMIT_POWER;
    }
    return force;
}

static cr_vec3 limit_force(const cr_control_config *config, cr_vec3 force, uint32_t *limits) {
    float norm = v3_norm(force);
    if (norm <= config->force_max_N) {
        return force;
    }
    *limits |= CR_LIMIT_FORCE;
    return v3_scale(force, config->force_max_N / norm);
}

/* From the part of the last force that points the new way, which costs nothing to keep, the force may grow by one step.
 * The result has the new direction always: a limit on |dF| itself would hold a force that the contact has let go. */
static cr_vec3 limit_rate(const cr_control_config *config, cr_vec3 before, float period_s, cr_vec3 force,
                          uint32_t *limits) {
    float norm2 = v3_dot(force, force);
    if (norm2 <= TINY_N * TINY_N) {
        return force;
    }
    float kept = clamp_f(v3_dot(before, force) / norm2, 0.0f, 1.0f);
    float share = kept + config->force_rate_max_N_s * period_s / sqrtf(norm2);
    if (share >= 1.0f) {
        return force;
    }
    *limits |= CR_LIMIT_RATE;
    return v3_scale(force, share);
}

/* 1 inside, falling to 0 over the band before either end. */
static float fade(float value, float low, float high) {
    CR_ASSERT(low < high);
    float band = RANGE_BAND * (high - low);
    return clamp_f(min_f(value - low, high - value) / band, 0.0f, 1.0f);
}

static cr_vec3 limit_workspace(const cr_arm_config *arm, const cr_control_input *in, cr_vec3 force, uint32_t *limits) {
    float share = fade(in->joint[1] - in->joint[2], arm->elbow_min_rad, arm->elbow_max_rad);
    for (int a = 0; a < CR_AXES; a++) {
        share = min_f(share, fade(in->joint[a], arm->joint_min[a], arm->joint_max[a]));
    }
    if (in->kinematics->margin < arm->margin_min) {
        share = min_f(share, in->kinematics->margin / arm->margin_min);
    }
    *limits |= share < 1.0f ? (uint32_t)CR_LIMIT_WORKSPACE : 0u;
    return v3_scale(force, share);
}

/* What holds the links up, and part of what dry friction takes: never as much, else the compensation would drive. */
static float compensate(const cr_servo_config *config, const cr_control_input *in, int a) {
    const cr_axis_config *axis = &config->axis[a];
    float sine, cosine, speed = in->speed[a];
    cr_sincos(a == 0 ? 0.0f : in->joint[a], &sine, &cosine); /* the guide is level everywhere */
    return axis->gravity * cosine +
           config->control.friction_share * axis->coulomb * speed / (abs_f(speed) + axis->friction_speed);
}

static void push_applied(cr_control *c, cr_vec3 force) {
    for (int i = CR_FORCE_DELAY - 1; i > 0; i--) {
        c->applied_N[i] = c->applied_N[i - 1];
    }
    c->applied_N[0] = force;
    c->force_N = force;
}

static void to_torques(const cr_servo_config *config, cr_control *c, const cr_control_input *in, cr_vec3 force,
                       cr_control_output *out) {
    float scale = 1.0f;
    for (int a = 0; a < CR_AXES; a++) {
        float torque = v3_dot(in->kinematics->column[a], force) + c->ramp * compensate(config, in, a);
        out->torque[a] = torque;
        scale = min_f(scale, config->axis[a].torque_max / max_f(abs_f(torque), TINY_N));
    }
    out->limits |= scale < 1.0f ? (uint32_t)CR_LIMIT_TORQUE : 0u;
    for (int a = 0; a < CR_AXES; a++) {
        out->torque[a] *= scale;
        CR_ASSERT(!(abs_f(out->torque[a]) > 1.000001f * config->axis[a].torque_max));
    }
    out->force_N = v3_scale(force, scale);
}

static void finish(cr_control *c, cr_control_output *out) {
    int finite = v3_is_finite(out->force_N) && is_finite_f(out->torque[0]) && is_finite_f(out->torque[1]) &&
                 is_finite_f(out->torque[2]) && v3_is_finite(out->velocity_m_s) && is_finite_f(c->energy_J);
    out->finite = finite ? 1u : 0u;
    if (!finite) {
        cr_control_reset(c);
        memset(out, 0, sizeof *out);
    }
    push_applied(c, out->force_N);
    memcpy(c->torque, out->torque, sizeof c->torque);
    out->energy_J = c->energy_J;
}

void cr_control_step(const cr_servo_config *config, cr_control *c, const cr_control_input *in, cr_control_output *out) {
    const cr_control_config *limit = &config->control;
    memset(out, 0, sizeof *out);
    for (int a = 0; a < CR_AXES; a++) {
        out->velocity_m_s = v3_mad(out->velocity_m_s, in->kinematics->column[a], in->speed[a]);
    }
    c->ramp = limit->ramp_s > 0.0f ? min_f(1.0f, c->ramp + in->period_s / limit->ramp_s) : 1.0f;
    CR_ASSERT(!(c->ramp < 0.0f || c->ramp > 1.0f));
    observe(limit, c, in, out->velocity_m_s);
    cr_vec3 force = damp(limit, in->contact_force_N, out->velocity_m_s);
    force = dissipate(limit, c, in, out->velocity_m_s, force, &out->limits);
    force = limit_force(limit, v3_scale(force, c->ramp), &out->limits);
    force = limit_speed(limit, out->velocity_m_s, force, &out->limits);
    force = limit_workspace(&config->arm, in, force, &out->limits);
    force = limit_rate(limit, c->force_N, in->period_s, force, &out->limits);
    to_torques(config, c, in, force, out);
    finish(c, out);
}

void cr_control_bridge(cr_control *c, float share, cr_control_output *out) {
    memset(out, 0, sizeof *out);
    c->bridged_N = v3_add(c->bridged_N, c->applied_N[CR_FORCE_DELAY - 1]);
    c->bridged++;
    for (int a = 0; a < CR_AXES; a++) {
        out->torque[a] = share * c->torque[a];
    }
    out->force_N = v3_scale(c->force_N, share);
    out->limits = CR_LIMIT_STALE;
    finish(c, out);
}
