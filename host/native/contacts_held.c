#include "contacts.h"

#include "couple/couple_parts.h"
#include "replay_rows.h"

_Static_assert(CRV_HELD_MAX == CR_COUPLE_CONTACTS_MAX * CR_COUPLE_POINTS_MAX, "all points of all contacts");

/* Springs of a coupling with their dampers over a period, N/m, and how long a turn of 1 rad counts, m. */
static float along_of(const cr_couple_config *c, double period_s, float *reach_m) {
    const float along_N_m = c->stiffness_N_m + c->damping_Ns_m / (float)period_s;
    *reach_m = sqrtf((c->stiffness_Nm_rad + c->damping_Nms_rad / (float)period_s) / along_N_m);
    return along_N_m;
}

/* What a point carries over the spring's stiffness: along its normal, and as far as friction holds it. */
static cr_vec3 carried_m(const cr_couple_point *p) {
    const float slip_m = v3_norm(p->slip_m);
    const float grip = slip_m * CR_COUPLE_GRIP > p->hold_m ? p->hold_m / slip_m : CR_COUPLE_GRIP;
    const cr_vec3 push_m = v3_scale(p->normal, -CR_COUPLE_HARD * p->gap_m);
    return p->hold_m > 0.0f ? v3_mad(push_m, p->slip_m, -grip) : push_m;
}

/* The points that press.   Output  how many; where the force of all acts, weighted by their pushes. */
static uint32_t store_pressing(const cr_coupled *coupled, double period_s, crv_area *areas, float acts_m[3]) {
    const cr_couple *c = &coupled->couple;
    float reach_m, weight = 0.0f;
    const float along_N_m = along_of(&c->config, period_s, &reach_m);
    cr_vec3 sum = {0.0f, 0.0f, 0.0f};
    uint32_t count = 0u;
    for (uint32_t i = 0; i < c->point_count; i++) {
        const cr_couple_point *p = &c->points[i];
        if (p->gap_m < 0.0f) {
            crv_area *area = &areas[count++];
            const cr_vec3 at_m = v3_mad(c->held.pos_m, p->arm, reach_m);
            store_vec3(area->point_m, at_m);
            store_vec3(area->force_N, v3_scale(carried_m(p), along_N_m));
            store_vec3(area->normal, p->normal);
            area->depth_m = -p->gap_m;
            sum = v3_mad(sum, at_m, -p->gap_m);
            weight -= p->gap_m;
        }
    }
    store_vec3(acts_m, weight > 0.0f ? v3_scale(sum, 1.0f / weight) : c->held.pos_m);
    return count;
}

size_t crv_held_run(cr_coupled *coupled, const cr_world *world, const cr_path_row *path, size_t count,
                    double period_first_s, crv_tick *ticks, uint32_t *counts, crv_area *areas, size_t room) {
    static const crv_tick none;
    size_t stored = 0, i = 0;
    cr_couple_output out;
    for (; i < count && room - stored >= (size_t)CRV_HELD_MAX; i++) {
        const cr_pose pose = pose_from(path[i].pos_m, path[i].rot);
        const double period_s = i == 0 ? period_first_s : path[i].t_s - path[i - 1].t_s;
        cr_couple_tick(coupled, world, &pose, (float)period_s, &out);
        crv_tick *tick = &ticks[i];
        *tick = none;
        counts[i] = store_pressing(coupled, period_s, areas + stored, tick->point_m);
        tick->areas = tick->contacts = out.pressing;
        tick->zones = coupled->stats.contacts;
        stored += counts[i];
    }
    return i;
}
