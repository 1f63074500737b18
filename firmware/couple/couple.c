/* The held tool and the spring to the hand: DESIGN.md. */
#include "couple/couple_parts.h"

#define QUATERNION_OFF_MAX 0.01f
#define NORMAL_OFF_MAX 1e-3f
#define POSITION_MAX 1e4f
#define OFFSET_MAX 1e5f
/* Shorter periods are no clock's. */
#define CLOCK_MIN_S 1e-6f

/* Points move on straight lines in one round: rounds follow until what a turn adds to that is below ROUND_ENOUGH_M. */
#define ROUNDS_MAX 4u
#define ROUND_ENOUGH_M 2e-7f

cr_couple_config cr_couple_config_default(void) {
    const cr_couple_config c = {1000.0f, 5.0f, 0.0f, 0.0f, 0.0f, {0.0f, 0.0f, 0.0f}};
    return c;
}

static int is_near(cr_vec3 v, float most) {
    return cr_in_range(v.x, -most, most) && cr_in_range(v.y, -most, most) && cr_in_range(v.z, -most, most);
}

const char *cr_couple_config_error(const cr_couple_config *c) {
    if (!cr_in_range(c->stiffness_N_m, 1.0f, 1e6f)) {
        return "stiffness_N_m must be in 1..1e6 N/m";
    }
    if (!cr_in_range(c->stiffness_Nm_rad, 1e-3f, 1e4f)) {
        return "stiffness_Nm_rad must be in 1e-3..1e4 N m/rad";
    }
    if (!cr_in_range(c->damping_Ns_m, 0.0f, 1e4f)) {
        return "damping_Ns_m must be in 0..1e4 N s/m";
    }
    if (!cr_in_range(c->damping_Nms_rad, 0.0f, 1e2f)) {
        return "damping_Nms_rad must be in 0..1e2 N m s/rad";
    }
    if (!cr_in_range(c->friction, 0.0f, 1.0f)) {
        return "friction must be in 0..1";
    }
    if (!is_near(c->centre_tool_m, POSITION_MAX)) {
        return "centre_tool_m must be within 1e4 m";
    }
    return NULL;
}

void cr_couple_reset(cr_couple *couple) {
    couple->begun = couple->faults = 0u;
    couple->anchor_count = couple->point_count = 0u;
    couple->turning = 0.0f;
}

cr_err cr_couple_init(cr_couple *couple, const cr_couple_config *config) {
    static const cr_quat level = {1.0f, 0.0f, 0.0f, 0.0f};
    if (couple == NULL || config == NULL) {
        return CR_ERR_NULL;
    }
    if (cr_couple_config_error(config) != NULL) {
        return CR_ERR_CONFIG;
    }
    couple->config = *config;
    couple->held.pos_m = config->centre_tool_m;
    couple->held.rot = level;
    couple->hand = couple->held;
    cr_couple_reset(couple);
    return CR_OK;
}

/* ------------------------------------------------------------------------------------------------------- inputs */

/* The pose with a quaternion of unit length, or a fault. Comparisons are such that not-a-number fails them. */
static uint32_t accept_pose(const cr_pose *in, cr_pose *out) {
    const cr_quat q = in->rot;
    const float n2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    if (!(abs_f(n2 - 1.0f) < 2.0f * QUATERNION_OFF_MAX) || !is_near(in->pos_m, POSITION_MAX)) {
        return CR_FAULT_POSE;
    }
    const float s = 1.0f / sqrtf(n2);
    const cr_quat unit = {s * q.w, s * q.x, s * q.y, s * q.z};
    out->pos_m = in->pos_m;
    out->rot = unit;
    return 0u;
}

static int is_contact(const cr_couple_contact *c) {
    if (c->point_count > CR_COUPLE_POINTS_MAX || !cr_in_range(c->offset_m, -OFFSET_MAX, OFFSET_MAX) ||
        !(abs_f(v3_dot(c->normal_world, c->normal_world) - 1.0f) <= 2.0f * NORMAL_OFF_MAX)) {
        return 0;
    }
    for (uint32_t i = 0; i < c->point_count; i++) {
        if (!is_near(c->point_tool_m[i], POSITION_MAX)) {
            return 0;
        }
    }
    return 1;
}

static uint32_t check_contacts(const cr_couple_contact *contacts, uint32_t count) {
    if (count > CR_COUPLE_CONTACTS_MAX || (contacts == NULL && count > 0u)) {
        return CR_COUPLE_FAULT_CONTACT;
    }
    for (uint32_t i = 0; i < count; i++) {
        if (!is_contact(&contacts[i])) {
            return CR_COUPLE_FAULT_CONTACT;
        }
    }
    return 0u;
}

/* --------------------------------------------------------------------------------------------- where it is going */

/* A pose of the tool as one of the centre, and back. */
static cr_pose pose_of_centre(const cr_pose *tool, cr_vec3 centre_tool_m) {
    const xform m = cr_xform_from_pose(tool);
    cr_pose p = *tool;
    p.pos_m = cr_xform_point(&m, centre_tool_m);
    return p;
}
static cr_pose pose_of_tool(const cr_pose *centre, cr_vec3 centre_tool_m) {
    const xform m = cr_xform_from_pose(centre);
    cr_pose p = *centre;
    p.pos_m = v3_sub(centre->pos_m, xform_rotate(&m, centre_tool_m));
    return p;
}

static void tie(cr_couple *couple, const cr_pose *hand, float period_s, cr_couple_tie *k) {
    const cr_couple_config *c = &couple->config;
    const float rate = 1.0f / max_f(period_s, CLOCK_MIN_S);
    if (!couple->begun) {
        couple->held = couple->hand = *hand;
        couple->begun = 1u;
    }
    k->damper_N_m = c->damping_Ns_m * rate;
    k->damper_Nm_rad = c->damping_Nms_rad * rate;
    k->along_N_m = c->stiffness_N_m + k->damper_N_m;
    k->turn_Nm_rad = c->stiffness_Nm_rad + k->damper_Nm_rad;
    k->reach_m = sqrtf(k->turn_Nm_rad / k->along_N_m);
    k->hand = *hand;
    k->before = couple->held;
    k->hand_moved_m = v3_sub(hand->pos_m, couple->hand.pos_m);
    k->hand_turned_rad = cr_couple_turn_between(couple->hand.rot, hand->rot);
    couple->hand = *hand;
}

/* ------------------------------------------------------------------------------------------------------- the step */

/* No contact: the held tool goes where the damper lets it, at once when there is none. */
static void go_free(cr_couple *couple, const cr_couple_tie *k) {
    cr_vec3 force, torque;
    cr_couple_pull(couple, k, &force, &torque);
    couple->held.pos_m = v3_mad(couple->held.pos_m, force, 1.0f / k->along_N_m);
    couple->held.rot = cr_couple_turned(couple->held.rot, v3_scale(torque, 1.0f / k->turn_Nm_rad));
    couple->turning = 0.0f;
}

/* What is no number presses: a fault of the answer. */
uint32_t cr_couple_pressing(const cr_couple *couple) {
    uint32_t pressing = 0u;
    for (uint32_t i = 0; i < couple->point_count; i++) {
        pressing += couple->points[i].gap_m >= 0.0f ? 0u : 1u;
    }
    return pressing;
}

void cr_couple_try(cr_couple *couple, const cr_couple_tie *k, const cr_couple_contact *contacts, uint32_t count,
                   cr_couple_output *out) {
    float off_m = 1.0f;
    cr_couple_lay_out(couple, contacts, count);
    out->iterations = 0u;
    out->unsettled_m = 0.0f;
    if (couple->point_count == 0u) {
        go_free(couple, k);
    }
    for (uint32_t i = 0; i < ROUNDS_MAX && couple->point_count > 0u && off_m > ROUND_ENOUGH_M; i++) {
        off_m = cr_couple_round(couple, k, contacts, count, out);
    }
    out->pressing = cr_couple_pressing(couple);
}

void cr_couple_settle(cr_couple *couple, const cr_couple_tie *k, const cr_couple_contact *contacts, uint32_t count,
                      cr_couple_output *out) {
    (void)cr_couple_look(couple, contacts, count, k->reach_m);
    out->inside_m = cr_couple_keep(couple, contacts, count);
}

/* The wrench on the hand: opposite to what the held tool is pulled with, about the tool's origin. */
static void feel_pull(cr_couple *couple, const cr_couple_tie *k, cr_couple_output *out) {
    cr_vec3 force, torque;
    cr_couple_pull(couple, k, &force, &torque);
    const xform hand = cr_xform_from_pose(&k->hand);
    const cr_vec3 arm = xform_rotate(&hand, couple->config.centre_tool_m);
    out->force_world_N = v3_scale(force, -1.0f);
    out->torque_world_Nm = v3_sub(v3_cross(arm, out->force_world_N), torque);
}

static int is_output_finite(const cr_couple_output *out) {
    const cr_quat q = out->held.rot;
    return v3_is_finite(out->force_world_N) && v3_is_finite(out->torque_world_Nm) && v3_is_finite(out->held.pos_m) &&
           is_finite_f(q.w + q.x + q.y + q.z);
}

static void show_held(const cr_couple *couple, cr_couple_output *out) {
    out->held = pose_of_tool(&couple->held, couple->config.centre_tool_m);
    out->faults = couple->faults;
}

int cr_couple_accept(cr_couple *couple, const cr_pose *world_from_tool, float period_s, uint32_t faults,
                     cr_couple_tie *k, cr_couple_output *out) {
    static const cr_couple_output nothing = {
        {0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, {{0.0f, 0.0f, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}}, 0.0f, 0.0f, 0u, 0u, 0u};
    cr_pose hand = couple->hand;
    *out = nothing;
    couple->faults |= accept_pose(world_from_tool, &hand) | faults;
    couple->faults |= period_s > 0.0f && period_s <= 1.0f ? 0u : (uint32_t)CR_FAULT_PERIOD;
    if (couple->faults == 0u) {
        hand = pose_of_centre(&hand, couple->config.centre_tool_m);
        tie(couple, &hand, period_s, k);
        return 1;
    }
    show_held(couple, out);
    return 0;
}

void cr_couple_answer(cr_couple *couple, const cr_couple_tie *k, const cr_pose *last, cr_couple_output *out) {
    static const cr_vec3 zero = {0.0f, 0.0f, 0.0f};
    if (out->pressing > 0u) { /* else nothing is felt */
        feel_pull(couple, k, out);
    }
    show_held(couple, out);
    if (!is_output_finite(out)) {
        out->force_world_N = out->torque_world_Nm = zero;
        out->inside_m = out->unsettled_m = 0.0f;
        out->pressing = out->iterations = 0u;
        couple->held = *last;
        couple->faults |= (uint32_t)CR_FAULT_NUMBER;
        show_held(couple, out);
    }
}

void cr_couple_step(cr_couple *couple, const cr_pose *world_from_tool, float period_s,
                    const cr_couple_contact *contacts, uint32_t count, cr_couple_output *out) {
    cr_couple_tie k;
    const cr_pose last = couple->held;
    if (cr_couple_accept(couple, world_from_tool, period_s, check_contacts(contacts, count), &k, out)) {
        cr_couple_try(couple, &k, contacts, count, out);
        cr_couple_settle(couple, &k, contacts, count, out);
        cr_couple_answer(couple, &k, &last, out);
    }
}
