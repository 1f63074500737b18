/* One tick of a coupling that looks for its contacts: DESIGN.md "The tick". */
#include "contact/world.h"
#include "couple/follow_parts.h"

/* A step no point of the tool goes farther in than this share of a voxel, while samples are near. */
#define STEP_VOXELS 0.5f
/* Where the margin has too many samples it is halved, so often; then every second is left out, every fourth, and so on. */
#define HALVINGS 3u
#define GATHERS_MAX 10u
/* A step that moves no point farther ends the tick: planes are what they were, m. */
#define STEP_ENOUGH_M 2e-5f
/* Looks for the least in one step: each is given the samples that passed their planes in the one before. */
#define TRIES_MAX 6u
/* And in a tick: no step begins after so many. */
#define DESCENTS_MAX 12u
/* A contact is kept to the next step while it is nearer, m. */
#define KEEP_M 5e-5f
/* A sample has passed its plane where it is deeper than this, and than what presses by half, m. */
#define PASSED_M 2e-6f
#define PASSED_SHARE 1.5f
/* Halvings of a step that is cut short. */
#define SHARES_MAX 6u
/* One sample at a time from each of the corners of the tool. */
#define CORNERS 8

/* How the held tool got from one pose to another. */
typedef struct {
    cr_vec3 middle_m; /* of the tool */
    cr_vec3 turn_rad;
    float most_m; /* no point of it moved farther */
} tool_motion;

static cr_vec3 middle_of_tool(const cr_scene *s, const cr_couple *couple, const cr_pose *centre) {
    const xform m = xform_from_pose(centre);
    return v3_add(m.t, xform_rotate(&m, v3_sub(v3_from(s->meta->root_centre_m), couple->config.centre_tool_m)));
}

static tool_motion motion_between(const cr_scene *s, const cr_couple *couple, const cr_pose *from) {
    tool_motion m;
    m.middle_m = v3_sub(middle_of_tool(s, couple, &couple->held), middle_of_tool(s, couple, from));
    m.turn_rad = cr_couple_turn_between(from->rot, couple->held.rot);
    m.most_m = v3_norm(m.middle_m) + v3_norm(m.turn_rad) * s->meta->root_radius_m;
    return m;
}

static void view_from(const cr_couple *couple, cr_couple_view *v) {
    cr_pose tool = couple->held;
    const xform m = xform_from_pose(&couple->held);
    tool.pos_m = v3_sub(m.t, xform_rotate(&m, couple->config.centre_tool_m));
    v->pose = xform_from_pose(&tool);
    v->middle = middle_of_tool(v->field->scene, couple, &couple->held);
}

/* A sample as a contact of its own. */
static void make_contact(const cr_couple_view *v, const cr_couple_near *n, cr_couple_contact *c) {
    const cr_vec3 place = v3_add(v->middle, n->arm_m);
    c->key = n->key;
    c->normal_world = n->normal;
    c->offset_m = v3_dot(n->normal, place) - n->gap_m;
    c->point_count = 1u;
    c->point_tool_m[0] = xform_unrotate(&v->pose, v3_sub(place, v->pose.t));
}

static const cr_couple_near *near_of_key(const cr_couple_view *v, uint32_t key) {
    for (uint32_t i = 0; i < v->count; i++) {
        if (v->near[i].key == key) {
            return &v->near[i];
        }
    }
    return NULL;
}

/* Contacts of the step before that are still near, in their order. */
static void keep_contacts(cr_coupled *c, const cr_couple_view *v) {
    uint32_t kept = 0u;
    for (uint32_t i = 0; i < c->contact_count; i++) {
        const cr_couple_near *n = near_of_key(v, c->contacts[i].key);
        if (n != NULL && n->gap_m < KEEP_M) {
            make_contact(v, n, &c->contacts[kept++]);
        }
    }
    c->contact_count = kept;
}

/* Gap of a near sample after a motion of the tool. */
static float gap_after(const cr_couple_near *n, const cr_vec3 *turned, const tool_motion *m) {
    const cr_vec3 arm = v3(v3_dot(turned[0], n->arm_m), v3_dot(turned[1], n->arm_m), v3_dot(turned[2], n->arm_m));
    return n->gap_m + v3_dot(n->normal, v3_add(m->middle_m, arm));
}

/* Rows of rotation less identity. */
static void turn_less_one(const tool_motion *m, cr_vec3 *rows) {
    static const cr_quat level = {1.0f, 0.0f, 0.0f, 0.0f};
    const cr_quat q = cr_couple_turned(level, m->turn_rad);
    const float xx = q.x * q.x, yy = q.y * q.y, zz = q.z * q.z, xy = q.x * q.y, xz = q.x * q.z, yz = q.y * q.z;
    const float wx = q.w * q.x, wy = q.w * q.y, wz = q.w * q.z;
    rows[0] = v3(-2.0f * (yy + zz), 2.0f * (xy - wz), 2.0f * (xz + wy));
    rows[1] = v3(2.0f * (xy + wz), -2.0f * (xx + zz), 2.0f * (yz - wx));
    rows[2] = v3(2.0f * (xz - wy), 2.0f * (yz + wx), -2.0f * (xx + yy));
}

static int is_contact_of(const cr_coupled *c, uint32_t key) {
    for (uint32_t i = 0; i < c->contact_count; i++) {
        if (c->contacts[i].key == key) {
            return 1;
        }
    }
    return 0;
}

static float deepest_contact(const cr_coupled *c) {
    float deep = 0.0f;
    for (uint32_t i = 0; i < c->couple.point_count; i++) {
        deep = max_f(deep, -c->couple.points[i].gap_m);
    }
    return deep;
}

/* The contact that is farthest from pressing, or CR_COUPLE_CONTACTS_MAX where all press. Points are those of the last try, one of each contact. */
static uint32_t find_idle(const cr_coupled *c) {
    uint32_t idle = CR_COUPLE_CONTACTS_MAX;
    float most = 0.0f;
    for (uint32_t i = 0; i < c->couple.point_count; i++) {
        if (c->couple.points[i].gap_m > most) {
            most = c->couple.points[i].gap_m;
            idle = i;
        }
    }
    return idle;
}

/* Samples that pass their planes become contacts: of each corner of the tool the one that is deepest.   Output  how far the motion may be made: 1 where none
 * passes. *added: contacts that are new. */
static float ask_passed(cr_coupled *c, const cr_couple_view *v, const tool_motion *m, int may_add, uint32_t *added) {
    const float limit = -max_f(PASSED_M, PASSED_SHARE * deepest_contact(c));
    const cr_couple_near *worst[CORNERS] = {NULL};
    float gap_of[CORNERS], share = 1.0f;
    cr_vec3 turned[3];
    turn_less_one(m, turned);
    for (uint32_t i = 0; i < v->count; i++) {
        const cr_couple_near *n = &v->near[i];
        const float gap = gap_after(n, turned, m);
        if (gap < limit && !is_contact_of(c, n->key)) {
            const int corner = (n->arm_m.x > 0.0f) + 2 * (n->arm_m.y > 0.0f) + 4 * (n->arm_m.z > 0.0f);
            if (gap < n->gap_m - PASSED_M) { /* it is not so deep yet */
                share = min_f(share, max_f(0.0f, n->gap_m - limit) / (n->gap_m - gap));
            }
            if (worst[corner] == NULL || gap < gap_of[corner]) {
                worst[corner] = n;
                gap_of[corner] = gap;
            }
        }
    }
    *added = 0u;
    for (int k = 0; k < CORNERS && may_add; k++) {
        if (worst[k] != NULL) {
            const uint32_t at = c->contact_count < CR_COUPLE_CONTACTS_MAX ? c->contact_count++ : find_idle(c);
            if (at < CR_COUPLE_CONTACTS_MAX) {
                make_contact(v, worst[k], &c->contacts[at]);
                if (at < c->couple.point_count) {
                    c->couple.points[at].gap_m = -1.0f; /* taken: not idle any more */
                }
                (*added)++;
            }
        }
    }
    return share;
}

/* Back towards where the step began: the tool's middle on a straight line, so that no point moves farther than that share of most_m. */
static void make_share(const cr_scene *s, cr_couple *couple, const cr_pose *from, const tool_motion *m) {
    const cr_vec3 middle = v3_add(middle_of_tool(s, couple, from), m->middle_m);
    couple->held.rot = cr_couple_turned(from->rot, m->turn_rad);
    const xform turned = xform_from_pose(&couple->held);
    const cr_vec3 arm = v3_sub(v3_from(s->meta->root_centre_m), couple->config.centre_tool_m);
    couple->held.pos_m = v3_sub(middle, xform_rotate(&turned, arm));
}

static tool_motion share_of_motion(const tool_motion *m, float share) {
    tool_motion part;
    part.middle_m = v3_scale(m->middle_m, share);
    part.turn_rad = v3_scale(m->turn_rad, share);
    part.most_m = share * m->most_m;
    return part;
}

/* How deep near samples are behind their planes after a motion, at most, m: all, or those that it carries deeper. */
static float deepest_near(const cr_couple_view *v, const tool_motion *m, int carried) {
    cr_vec3 turned[3];
    float deep = 0.0f;
    turn_less_one(m, turned);
    for (uint32_t i = 0; i < v->count; i++) {
        const float gap = gap_after(&v->near[i], turned, m);
        deep = !carried || gap < v->near[i].gap_m - PASSED_M ? max_f(deep, -gap) : deep;
    }
    return deep;
}

/* The share of a motion that is made. What turns goes on circles: halved until no sample is carried deeper than what passes. */
static float shorten(const cr_coupled *c, const cr_couple_view *v, const tool_motion *m, float share) {
    const float limit = PASSED_M + max_f(PASSED_M, PASSED_SHARE * deepest_contact(c));
    for (uint32_t i = 0; i < SHARES_MAX; i++) {
        const tool_motion part = share_of_motion(m, share);
        if (deepest_near(v, &part, 1) <= limit) {
            break;
        }
        share *= 0.5f;
    }
    return share;
}

/* One step.   Output  how far a point of the tool may have moved at most, m. */
static float step_held(cr_coupled *c, cr_couple_view *v, const cr_couple_tie *k, float step_m, cr_couple_output *out) {
    const cr_scene *s = v->field->scene;
    const cr_pose from = c->couple.held;
    const float turning = c->couple.turning;
    tool_motion m = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f};
    uint32_t added = 1u;
    float share = 1.0f;
    c->stats.left_m = 0.0f;
    view_from(&c->couple, v);
    v->margin_m = step_m;
    v->every = 1u;
    cr_couple_gather(v);
    for (uint32_t i = 1u; i < GATHERS_MAX && v->dropped > 0u; i++) {
        v->margin_m *= i <= HALVINGS ? 0.5f : 1.0f;
        v->every *= i <= HALVINGS ? 1u : 2u;
        cr_couple_gather(v);
    }
    keep_contacts(c, v);
    for (uint32_t i = 0; i < TRIES_MAX && added > 0u; i++) {
        c->couple.held = from;
        c->couple.turning = turning;
        cr_couple_try(&c->couple, k, c->contacts, c->contact_count, out);
        c->stats.descents++;
        m = motion_between(s, &c->couple, &from);
        share = ask_passed(c, v, &m, i + 1u < TRIES_MAX, &added);
    }
    c->stats.refused += share < 1.0f ? 1u : 0u;
    c->stats.dropped += v->dropped + v->left_out;
    const float safe_m = max_f(v->free_m, 0.0f), may_m = v->count > 0u ? min_f(safe_m, v->margin_m) : safe_m;
    share = m.most_m > may_m ? min_f(share, may_m / m.most_m) : share;
    if (share < 1.0f) {
        share = shorten(c, v, &m, share);
        c->stats.left_m = (1.0f - share) * m.most_m;
        m = share_of_motion(&m, share);
        make_share(s, &c->couple, &from, &m);
    }
    cr_couple_settle(&c->couple, k, c->contacts, c->contact_count, out);
    out->inside_m = max_f(out->inside_m, deepest_near(v, &m, 0));
    if (share < 1.0f) {
        out->pressing = cr_couple_pressing(&c->couple);
    }
    return m.most_m;
}

cr_err cr_coupled_init(cr_coupled *coupled, const cr_couple_config *config) {
    const cr_err err = coupled == NULL ? CR_ERR_NULL : cr_couple_init(&coupled->couple, config);
    if (err == CR_OK) {
        cr_coupled_reset(coupled);
    }
    return err;
}

void cr_coupled_reset(cr_coupled *coupled) {
    static const cr_couple_stats none = {0};
    cr_couple_reset(&coupled->couple);
    coupled->contact_count = coupled->near_count = 0u;
    coupled->stats = none;
}

void cr_couple_tick(cr_coupled *c, const cr_world *world, const cr_pose *world_from_tool, float period_s,
                    cr_couple_output *out) {
    static const cr_couple_stats none = {0};
    const cr_pose last = c->couple.held;
    cr_couple_tie k;
    c->stats = none;
    const uint32_t none_to_look_in = world == NULL ? CR_COUPLE_FAULT_CONTACT : 0u;
    if (!cr_couple_accept(&c->couple, world_from_tool, period_s, none_to_look_in, &k, out) || world == NULL) {
        c->contact_count = c->near_count = 0u;
        return;
    }
    cr_couple_view v = {.field = &world->field, .near = c->near};
    const float step_m = STEP_VOXELS * world->scene.meta->voxel_m;
    float moved = 1.0f;
    for (uint32_t i = 0; i < CR_COUPLE_STEPS_MAX && moved > STEP_ENOUGH_M && c->stats.descents < DESCENTS_MAX; i++) {
        moved = step_held(c, &v, &k, step_m, out);
        c->stats.steps++;
    }
    c->stats.left_m = moved > STEP_ENOUGH_M ? max_f(c->stats.left_m, moved) : c->stats.left_m;
    c->stats.lookups = v.lookups;
    c->stats.near = c->near_count = v.count;
    c->stats.contacts = c->contact_count;
    cr_couple_answer(&c->couple, &k, &last, out);
}
