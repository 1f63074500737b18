/* Points of the contacts: where they are, what holds them by friction. */
#include "couple/couple_parts.h"

static const cr_couple_anchor *find_anchor(const cr_couple *couple, uint32_t key) {
    for (uint32_t i = 0; i < couple->anchor_count; i++) {
        if (couple->anchors[i].key == key) {
            return &couple->anchors[i];
        }
    }
    return NULL;
}

/* A point of the tool from the centre, world frame. */
static cr_vec3 arm_of(const cr_couple *couple, const xform *held, cr_vec3 point_tool_m) {
    return xform_rotate(held, v3_sub(point_tool_m, couple->config.centre_tool_m));
}

void cr_couple_lay_out(cr_couple *couple, const cr_couple_contact *contacts, uint32_t count) {
    const xform held = cr_xform_from_pose(&couple->held);
    couple->point_count = 0u;
    for (uint32_t i = 0; i < count; i++) {
        const cr_couple_contact *c = &contacts[i];
        const cr_couple_anchor *a = find_anchor(couple, c->key);
        for (uint32_t j = 0; j < c->point_count; j++) {
            cr_couple_point *p = &couple->points[couple->point_count++];
            p->normal = c->normal_world;
            if (a != NULL && j < a->count) { /* a point that moved on the tool has slipped as far as it had */
                const cr_vec3 moved = xform_rotate(&held, v3_sub(c->point_tool_m[j], a->tool_m[j]));
                p->anchor_world_m = v3_add(a->world_m[j], moved);
            } else {
                p->anchor_world_m = v3_add(held.t, arm_of(couple, &held, c->point_tool_m[j]));
            }
        }
    }
}

float cr_couple_look(cr_couple *couple, const cr_couple_contact *contacts, uint32_t count, float reach_m) {
    const xform held = cr_xform_from_pose(&couple->held);
    const float shrink = 1.0f / reach_m;
    float longest2 = 0.0f;
    cr_couple_point *p = couple->points;
    for (uint32_t i = 0; i < count; i++) {
        const cr_couple_contact *c = &contacts[i];
        /* The large numbers first, and alike for all its points: what they lose does not set one point against another. */
        const float centre_m = v3_dot(c->normal_world, held.t) - c->offset_m;
        for (uint32_t j = 0; j < c->point_count; j++, p++) {
            const cr_vec3 arm = arm_of(couple, &held, c->point_tool_m[j]);
            const cr_vec3 from = v3_add(v3_sub(held.t, p->anchor_world_m), arm);
            p->arm = v3_scale(arm, shrink);
            p->gap_m = centre_m + v3_dot(c->normal_world, arm);
            p->slip_m = v3_mad(from, c->normal_world, -v3_dot(from, c->normal_world));
            longest2 = max_f(longest2, v3_dot(arm, arm));
        }
    }
    return sqrtf(longest2);
}

float cr_couple_keep(cr_couple *couple, const cr_couple_contact *contacts, uint32_t count) {
    float deepest = 0.0f;
    const cr_couple_point *p = couple->points;
    couple->anchor_count = count;
    for (uint32_t i = 0; i < count; i++) {
        const cr_couple_contact *c = &contacts[i];
        cr_couple_anchor *a = &couple->anchors[i];
        a->key = c->key;
        a->count = c->point_count;
        for (uint32_t j = 0; j < c->point_count; j++, p++) {
            const float slip = v3_norm(p->slip_m), held = p->hold_m * (1.0f / CR_COUPLE_GRIP);
            const float follow = slip > held ? (slip - held) / slip : 0.0f;
            a->tool_m[j] = c->point_tool_m[j];
            a->world_m[j] = v3_mad(p->anchor_world_m, p->slip_m, follow);
            deepest = max_f(deepest, -p->gap_m);
        }
    }
    return deepest;
}
