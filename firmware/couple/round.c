/* One round of a step: where spring and damper pull, the least motion there on straight lines, and the motion made. */
#include "couple/couple_parts.h"

/* No round turns by more. */
#define TURN_MAX_RAD 0.25f
/* Contacts that resist turning by more than this, over the coupling's stiffness, slow it: half of what would make rounds swing. */
#define TURNING_FREE 0.5f

void cr_couple_pull(const cr_couple *couple, const cr_couple_tie *k, cr_vec3 *force_N, cr_vec3 *torque_Nm) {
    const cr_couple_config *c = &couple->config;
    const cr_vec3 apart = v3_sub(k->hand.pos_m, couple->held.pos_m);
    const cr_vec3 turned = cr_couple_turn_between(couple->held.rot, k->hand.rot);
    *force_N = v3_scale(apart, c->stiffness_N_m);
    *torque_Nm = v3_scale(turned, c->stiffness_Nm_rad);
    if (c->damping_Ns_m > 0.0f) {
        const cr_vec3 moved = v3_sub(couple->held.pos_m, k->before.pos_m);
        *force_N = v3_mad(*force_N, v3_sub(k->hand_moved_m, moved), k->damper_N_m);
    }
    if (c->damping_Nms_rad > 0.0f) {
        const cr_vec3 moved = cr_couple_turn_between(k->before.rot, couple->held.rot);
        *torque_Nm = v3_mad(*torque_Nm, v3_sub(k->hand_turned_rad, moved), k->damper_Nm_rad);
    }
}

/* How much the points that press resist a turn of the held tool, over the coupling's stiffness, at most: they are on circles, not on lines. */
static float find_turning(const cr_couple *couple, float reach_m) {
    float turning = 0.0f;
    for (uint32_t i = 0; i < couple->point_count; i++) {
        const cr_couple_point *p = &couple->points[i];
        const float press_m = CR_COUPLE_HARD * max_f(0.0f, -p->gap_m);
        turning += press_m * max_f(0.0f, v3_norm(p->arm) + v3_dot(p->arm, p->normal));
    }
    return 0.5f * turning / reach_m;
}

/* Move the held tool, and the gaps with it.   Output  how far a point on an arm of 1 m may be off the straight line, m. */
static float move_held(cr_couple *couple, const cr_motion6 *motion, float reach_m) {
    const float turn = v3_norm(motion->turn) / reach_m;
    const float share = turn > TURN_MAX_RAD ? TURN_MAX_RAD / turn : 1.0f;
    const cr_motion6 part = {v3_scale(motion->along, share), v3_scale(motion->turn, share)};
    couple->held.pos_m = v3_add(couple->held.pos_m, part.along);
    couple->held.rot = cr_couple_turned(couple->held.rot, v3_scale(part.turn, 1.0f / reach_m));
    for (uint32_t i = 0; i < couple->point_count; i++) {
        cr_couple_point *p = &couple->points[i];
        const cr_vec3 moved = point_motion(p, &part);
        const float rise = v3_dot(p->normal, moved);
        p->gap_m += rise;
        p->slip_m = v3_add(p->slip_m, v3_mad(moved, p->normal, -rise));
    }
    const float turned = share * turn;
    return 0.5f * turned * turned + (share < 1.0f ? 1.0f : 0.0f);
}

float cr_couple_round(cr_couple *couple, const cr_couple_tie *k, const cr_couple_contact *contacts, uint32_t count,
                      cr_couple_output *out) {
    cr_vec3 force, torque;
    cr_motion6 motion = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}};
    cr_couple_task task;
    const float longest_m = cr_couple_look(couple, contacts, count, k->reach_m);
    cr_couple_pull(couple, k, &force, &torque);
    task.goal.along = v3_scale(force, 1.0f / k->along_N_m);
    task.goal.turn = v3_scale(torque, k->reach_m / k->turn_Nm_rad);
    task.weight = 1.0f + max_f(0.0f, couple->turning - TURNING_FREE);
    task.friction = couple->config.friction;
    task.count = couple->point_count;
    out->iterations += cr_couple_descend(&task, couple->points, CR_COUPLE_ITERATIONS_MAX - out->iterations, &motion,
                                         &out->unsettled_m);
    const float off = move_held(couple, &motion, k->reach_m);
    couple->turning = find_turning(couple, k->reach_m);
    return off * longest_m;
}
