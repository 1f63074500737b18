/* feel: the contact in hand at a pose -> wrench, and a pose for the eye. */
#include "contact/world.h"

#include <string.h>

#define POSITION_MAX_M 1e4f
#define QUATERNION_TOLERANCE 0.01f

uint32_t cr_check_pose(const cr_pose *in, cr_pose *out) {
    cr_quat q = in->rot;
    float n2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    /* not a number fails each */
    if (!(abs_f(n2 - 1.0f) < 2.0f * QUATERNION_TOLERANCE) || !(abs_f(in->pos_m.x) <= POSITION_MAX_M) ||
        !(abs_f(in->pos_m.y) <= POSITION_MAX_M) || !(abs_f(in->pos_m.z) <= POSITION_MAX_M)) {
        return CR_FAULT_POSE;
    }
    float s = 1.0f / sqrtf(n2);
    out->pos_m = in->pos_m;
    out->rot.w = q.w * s;
    out->rot.x = q.x * s;
    out->rot.y = q.y * s;
    out->rot.z = q.z * s;
    return 0u;
}

/* Member by member: a call that clears 52 bytes takes as long as all else here. */
static void clear_stats(cr_stats *s) {
    _Static_assert(sizeof *s == 13u * sizeof(uint32_t), "a member each");
    s->points = s->contacts = s->clusters = s->nodes = 0u;
    s->clusters_inside = s->nodes_coherent = s->late_ticks = s->clusters_dropped = 0u;
    s->touches_dropped = s->areas_merged = s->zones_dropped = s->force_limited = s->work = 0u;
}

static void clear_output(cr_output *out) {
    out->force_world_N = out->torque_world_Nm = out->normal_world = v3(0.0f, 0.0f, 0.0f);
    out->depth_m = 0.0f;
    out->area_count = out->zone_count = 0u;
    clear_stats(&out->stats);
}

/* Shorter periods are no clock's: velocities stay finite for any two poses that are allowed. */
#define PERIOD_MIN_S 1e-9f

/* A tick as its areas are felt: where the tool is and was before, and one over the time between, 1/s; 0 when it was nowhere. */
typedef struct {
    const cr_world *w;
    xform now, before;
    float per_s;
} instant;

/* How fast the point of the tool that is there moves, m/s. */
static cr_vec3 velocity_at(const instant *m, cr_vec3 p_world) {
    const cr_vec3 p_tool = xform_unrotate(&m->now, v3_sub(p_world, m->now.t));
    return v3_scale(v3_sub(p_world, cr_xform_point(&m->before, p_tool)), m->per_s);
}

/* Spring and damper along the normal of an area that is felt to a share; it pushes or does nothing. */
static void push(const instant *m, float share, cr_area *area) {
    const cr_config *config = &m->w->config;
    float force = config->stiffness_N_m * area->depth_m;
    if (config->damping_Ns_m > 0.0f && m->per_s > 0.0f) {
        force -= config->damping_Ns_m * share * v3_dot(velocity_at(m, area->point_world_m), area->normal_world);
    }
    area->force_world_N = v3_scale(area->normal_world, max_f(0.0f, force));
}

/* Do areas that push one way share what is deep there? Those of rivals/ each know it whole. */
static int areas_share(const cr_config *config) {
#ifdef CR_RIVALS
    return config->response == CR_RESPONSE_WAY_OUT;
#else
    (void)config;
    return 1;
#endif
}

/* How deep each area is along its normal: by what it pushes, and by what those on its side push along it. */
static void find_depths(const cr_config *config, const cr_output *out, float *depth_m) {
    for (uint32_t i = 0; i < out->area_count; i++) {
        const cr_area *a = &out->areas[i];
        depth_m[i] = a->depth_m;
        for (uint32_t j = 0; j < i && areas_share(config); j++) {
            const cr_area *b = &out->areas[j];
            const float along = max_f(0.0f, v3_dot(a->normal_world, b->normal_world));
            depth_m[i] += b->depth_m * along;
            depth_m[j] += a->depth_m * along;
        }
    }
}

static void sum_wrench(const cr_config *config, cr_vec3 origin, const float *depth_m, cr_output *out) {
    for (uint32_t i = 0; i < out->area_count; i++) {
        const cr_area *a = &out->areas[i];
        cr_vec3 arm = v3_sub(a->point_world_m, origin);
        out->force_world_N = v3_add(out->force_world_N, a->force_world_N);
        out->torque_world_Nm = v3_add(out->torque_world_Nm, v3_cross(arm, a->force_world_N));
        out->zone_count += a->zone_count;
        if (depth_m[i] > out->depth_m) {
            out->depth_m = depth_m[i];
            out->normal_world = a->normal_world;
        }
    }
    float norm = v3_norm(out->force_world_N);
    if (norm > config->force_max_N) {
        float scale = config->force_max_N / norm;
        out->force_world_N = v3_scale(out->force_world_N, scale);
        out->torque_world_Nm = v3_scale(out->torque_world_Nm, scale);
        out->stats.force_limited = 1u;
    }
}

#ifdef CR_RIVALS
/* Smallest shift that satisfies every contact plane, by relaxation over the areas: 16 sweeps, or until none lacks 0.1 um. */
static cr_vec3 relaxed_shift(const cr_output *out, const float *depth_m) {
    cr_vec3 u = v3(0.0f, 0.0f, 0.0f);
    for (int sweep = 0; sweep < 16; sweep++) {
        float worst = 0.0f;
        for (uint32_t i = 0; i < out->area_count; i++) {
            const cr_area *a = &out->areas[i];
            float lack = depth_m[i] - v3_dot(u, a->normal_world);
            if (lack > 0.0f) {
                u = v3_mad(u, a->normal_world, lack);
                worst = max_f(worst, lack);
            }
        }
        if (worst <= 1e-7f) {
            break;
        }
    }
    return u;
}
#endif

/* By what the contacts push: the force of the springs alone, over their stiffness. */
static cr_vec3 display_shift(const cr_config *config, const cr_output *out, const float *depth_m) {
    cr_vec3 u = v3(0.0f, 0.0f, 0.0f);
#ifdef CR_RIVALS
    if (!areas_share(config)) {
        return relaxed_shift(out, depth_m);
    }
#else
    (void)config;
    (void)depth_m;
#endif
    for (uint32_t i = 0; i < out->area_count; i++) {
        u = v3_mad(u, out->areas[i].normal_world, out->areas[i].depth_m);
    }
    return u;
}

/* Not a number anywhere in the answer: nothing is felt, nothing is moved for the eye, and it stays so. */
static void fault_when_not_finite(cr_world *w, cr_vec3 pos_m, cr_output *out) {
    if (v3_is_finite(out->force_world_N) && v3_is_finite(out->torque_world_Nm) && is_finite_f(out->depth_m) &&
        v3_is_finite(out->display_pose.pos_m)) {
        return;
    }
    out->force_world_N = out->torque_world_Nm = out->normal_world = v3(0.0f, 0.0f, 0.0f);
    out->depth_m = 0.0f;
    out->display_pose.pos_m = pos_m;
    out->area_count = out->zone_count = 0u;
    w->faults |= CR_FAULT_NUMBER;
    out->faults = w->faults;
}

void cr_drop_hand(cr_world *w) { w->hand.count = w->behind.count = w->in_hand = 0u; }

/* Contact found for poses before this one is not this one's. */
CR_OUT_OF_LINE void forget_contact(cr_world *w) {
    w->felt.memory++;
    cr_drop_hand(w);
    w->hand.stamp = w->felt.stamp;
}

/* How much of the contact in hand is felt at the feel with this stamp. */
CR_OUT_OF_LINE float share_of_hand(const cr_world *w, uint32_t stamp) {
    const uint32_t risen = stamp - w->taken + 1u;
    return risen < w->rises ? (float)risen / (float)w->rises : 1.0f;
}

CR_OUT_OF_LINE void put_behind(cr_behind *behind, const cr_held *held, float share) {
    behind->held[behind->count] = *held;
    behind->share[behind->count++] = share;
}

/* What was felt last falls from now on: the contact in hand, and what was falling behind it. Where there is no room for both, the contact in hand falls as if
 * all of it had been felt: the shares are one in sum, and a tool at rest feels no dip. */
static void move_behind(cr_world *w, uint32_t room) {
    const cr_behind before = w->behind;
    const int both = w->hand.count + before.count <= room;
    const float share = both || w->hand.count == 0u ? share_of_hand(w, w->felt.stamp - 1u) : 1.0f;
    w->behind.count = 0u;
    for (uint32_t i = 0; i < w->hand.count; i++) {
        put_behind(&w->behind, &w->hand.held[i], share);
    }
    for (uint32_t i = 0; w->behind.count < room && i < before.count && share < 1.0f; i++) {
        put_behind(&w->behind, &before.held[i], before.share[i] * (1.0f - share));
    }
}

/* Feels over which an answer rises: as many as it is old. What was felt before one of the last feel has as long to fall as it was not corrected, or has begun to; that of this feel stands by itself. */
static uint32_t rises_over(const cr_world *w, const cr_hand *answer) {
    const uint32_t age = w->felt.stamp - answer->stamp + answer->ahead, apart = answer->stamp - w->hand.stamp;
    const uint32_t risen = w->felt.stamp - w->taken, left = w->rises > risen ? w->rises - risen : 0u;
    return age != 1u || w->in_hand == 0u ? age : apart > left ? apart : left;
}

void cr_take_hand(cr_world *w, const cr_hand *answer) {
    const uint32_t room = CR_AREAS_MAX - answer->count; /* of areas, for what falls beside it */
    const uint32_t over = rises_over(w, answer);
    if (over > 1u && w->hand.count <= room) {
        move_behind(w, room);
        w->rises = over;
    } else {
        w->behind.count = w->rises = 0u;
    }
    w->taken = w->felt.stamp;
    w->hand.stamp = answer->stamp;
    w->hand.ahead = answer->ahead;
    w->hand.count = answer->count;
    if (answer->count > 0u) {
        memcpy(w->hand.held, answer->held, answer->count * sizeof *answer->held);
    }
    w->in_hand = w->hand.count + w->behind.count;
}

void cr_world_clear_fault(cr_world *world) {
    world->faults = 0u;
    world->has_previous = 0u;
    forget_contact(world);
}

/* Cosine of a half-space and the facet that weighs most in it from which on they are one. */
#define FLAT 0.9999f

/* How deep it is felt with its point at p: not as a plane that goes on where its facet has ended, nor as one over an edge, which is no surface, where the tool has come below the facet
 * beside it by less. Not a number stays one. */
static float felt_depth(const cr_scene *s, const cr_held *h, cr_vec3 p) {
    const float depth_m = cr_held_depth(h, p);
    if (h->facet == CR_FACET_NONE || !(depth_m > 0.0f)) {
        return depth_m;
    }
    const struct cr_img_facet *f = &s->facets[h->facet];
    const float most_m = h->beyond_m + cr_way_margin(f, p);
    const float felt_m = most_m < depth_m ? most_m : depth_m;
    if (h->leaves > FLAT) {
        return felt_m; /* its plane is the facet's */
    }
    const float below_m = (h->below_m - v3_dot(v3_from(f->normal), p)) / h->leaves;
    return below_m < felt_m ? below_m : felt_m;
}

/* A half-space that was found earlier as it is felt at this pose, to a share: the plane stays where it is, the point moves with the tool. Where that is out of
 * its plane, or has left its facet, there is no area in this tick; the next one may be in it again. */
static void push_held(const instant *m, const cr_held *h, float share, cr_output *out) {
    const cr_vec3 p = cr_xform_point(&m->now, h->point_tool_m);
    const float depth_m = h->share * felt_depth(&m->w->scene, h, p);
    if (depth_m <= 0.0f) {
        return;
    }
    if (out->area_count == CR_AREAS_MAX) {
        out->stats.areas_merged++;
        return;
    }
    cr_area *a = &out->areas[out->area_count++];
    a->normal_world = h->normal_world;
    a->point_world_m = p;
    a->depth_m = share * depth_m; /* not a number too: a fault */
    a->offset_m = v3_dot(h->normal_world, p) + depth_m;
    a->area_m2 = h->area_m2;
    a->zone_count = 0u;
    push(m, share * h->share, a);
}

/* The contact in hand, and what falls behind it. */
static void push_late(const instant *m, cr_output *out) {
    const cr_world *w = m->w;
    const float share = share_of_hand(w, w->felt.stamp);
    for (uint32_t i = 0; i < w->hand.count; i++) {
        push_held(m, &w->hand.held[i], share, out);
    }
    for (uint32_t i = 0; i < w->behind.count && share < 1.0f; i++) {
        push_held(m, &w->behind.held[i], w->behind.share[i] * (1.0f - share), out);
    }
}

/* The contact of this pose: out->areas hold it. */
static void push_whole(const instant *m, cr_output *out) {
    out->area_count = m->w->hand.count;
    for (uint32_t i = 0; i < out->area_count; i++) {
        push(m, m->w->hand.held[i].share, &out->areas[i]);
    }
}

static void sum_areas(cr_world *w, const xform *now, cr_output *out) {
    float depth_m[CR_AREAS_MAX];
    find_depths(&w->config, out, depth_m);
    sum_wrench(&w->config, now->t, depth_m, out);
    cr_vec3 pos_m = out->display_pose.pos_m;
    out->display_pose.pos_m = v3_add(pos_m, display_shift(&w->config, out, depth_m));
    fault_when_not_finite(w, pos_m, out);
}

int cr_accept(cr_world *w, const cr_pose *world_from_tool, float period_s, cr_output *out) {
    clear_output(out);
    w->faults |= cr_check_pose(world_from_tool, &out->display_pose);
    w->faults |= period_s > 0.0f && period_s <= 1.0f ? 0u : (uint32_t)CR_FAULT_PERIOD;
    out->faults = w->faults;
    if (w->faults != 0u) {
        static const cr_pose origin = {{0.0f, 0.0f, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}};
        out->display_pose = w->has_previous ? w->previous : origin;
        forget_contact(w);
        return 0;
    }
    w->felt.stamp++;
    w->felt.pose = out->display_pose;
    return 1;
}

/* What the contact in hand does at this pose. */
static void feel(cr_world *w, float period_s, cr_output *out) {
    instant m;
    m.w = w;
    m.now = cr_xform_from_pose(&w->felt.pose);
    m.before = cr_xform_from_pose(&w->previous);
    m.per_s = w->has_previous != 0u ? 1.0f / max_f(period_s, PERIOD_MIN_S) : 0.0f;
    if (out->stats.late_ticks > 0u) {
        push_late(&m, out);
    } else {
        push_whole(&m, out);
    }
    if (out->area_count > 0u) {
        sum_areas(w, &m.now, out);
    }
}

void cr_render(cr_world *w, float period_s, cr_output *out) {
    out->stats.late_ticks = w->felt.stamp - w->hand.stamp;
    if (w->in_hand > 0u) {
        feel(w, period_s, out);
    }
    w->previous = w->felt.pose;
    w->has_previous = 1u;
}
