/* One tick of a coupling that looks for its contacts: DESIGN.md "The tick". */
#include "contact/world.h"
#include "couple/follow_parts.h"

/* A plane is taken for the surface for this share of a voxel: no point of the tool goes farther in one step while samples are near. */
#define STEP_VOXELS 0.5f
/* Samples are looked for as far as the tool is likely to go until the next look, by what it went before; no less than MARGIN_MIN_M. */
#define MARGIN_SHARE 1.5f
#define MARGIN_MIN_M 5e-5f
/* And a little more, so that what was found is not used up at once, m. */
#define MARGIN_MORE_M 3e-5f
/* What was found round the held tool holds while no point of it is farther from where it was then, m; */
#define SAME_PLACE_M 2e-6f
/* for a few ticks it holds a little farther, in shares of a voxel: planes are what they were, and at rest it is looked at anew. */
#define SAME_PLANES_VOXELS 0.05f
#define SAME_PLANES_M 5e-5f
#define SAME_PLANES_TICKS 4u
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
#define PASSED_M 2e-7f
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
    const xform m = cr_xform_from_pose(centre);
    return v3_add(m.t, xform_rotate(&m, v3_sub(v3_from(s->meta->root_centre_m), couple->config.centre_tool_m)));
}

/* From one pose of the centre to another. */
static tool_motion motion_between(const cr_scene *s, const cr_couple *couple, const cr_pose *from, const cr_pose *to) {
    tool_motion m;
    m.middle_m = v3_sub(middle_of_tool(s, couple, to), middle_of_tool(s, couple, from));
    m.turn_rad = cr_couple_turn_between(from->rot, to->rot);
    m.most_m = v3_norm(m.middle_m) + v3_norm(m.turn_rad) * s->meta->root_radius_m;
    return m;
}

static cr_pose view_from(const cr_couple *couple, const cr_pose *centre, cr_couple_view *v) {
    const xform m = cr_xform_from_pose(centre);
    cr_pose tool = *centre;
    tool.pos_m = v3_sub(m.t, xform_rotate(&m, couple->config.centre_tool_m));
    v->pose = cr_xform_from_pose(&tool);
    v->middle = middle_of_tool(v->field->scene, couple, centre);
    return tool;
}

/* A near sample: its block of sixteen, and its place in that. */
typedef struct {
    const cr_couple_near *block;
    uint32_t lane;
} near_sample;

static near_sample near_at(const cr_couple_found *f, uint32_t index) {
    const near_sample n = {&f->near[index / CR_LANES], index % CR_LANES};
    return n;
}

/* A sample as a contact of its own. */
static void make_contact(const cr_couple_view *v, near_sample at, cr_couple_contact *c) {
    const cr_couple_near *n = at.block;
    const uint32_t i = at.lane;
    const cr_vec3 place = v3_add(v->middle, v3(n->arm_x_m[i], n->arm_y_m[i], n->arm_z_m[i]));
    c->key = n->key[i];
    c->normal_world = v3(n->normal_x[i], n->normal_y[i], n->normal_z[i]);
    c->offset_m = v3_dot(c->normal_world, place) - n->gap_m[i];
    c->point_count = 1u;
    c->point_tool_m[0] = xform_unrotate(&v->pose, v3_sub(place, v->pose.t));
}

/* How many of the near samples have lower keys: where that key is, if it is there. */
static uint32_t find_key(const cr_couple_found *f, uint32_t key) {
    uint32_t low = 0u, high = f->near_count;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2u;
        const near_sample n = near_at(f, middle);
        low = n.block->key[n.lane] < key ? middle + 1u : low;
        high = n.block->key[n.lane] < key ? high : middle;
    }
    return low;
}

/* A motion as what it does to a point of the tool: rotation less identity, row by row, and the way of the middle. */
typedef struct {
    cr_vec3 row[3];
    cr_vec3 middle_m;
} carrier;

static carrier carrier_of(const tool_motion *m) {
    static const cr_quat level = {1.0f, 0.0f, 0.0f, 0.0f};
    const cr_quat q = cr_couple_turned(level, m->turn_rad);
    const float xx = q.x * q.x, yy = q.y * q.y, zz = q.z * q.z, xy = q.x * q.y, xz = q.x * q.z, yz = q.y * q.z;
    const float wx = q.w * q.x, wy = q.w * q.y, wz = q.w * q.z;
    const carrier c = {{v3(-2.0f * (yy + zz), 2.0f * (xy - wz), 2.0f * (xz + wy)),
                        v3(2.0f * (xy + wz), -2.0f * (xx + zz), 2.0f * (yz - wx)),
                        v3(2.0f * (xz - wy), 2.0f * (yz + wx), -2.0f * (xx + yy))},
                       m->middle_m};
    return c;
}

/* Gaps of sixteen near samples after a motion of the tool from where it was looked round. */
static void find_gaps(const cr_couple_near *n, const carrier *c, float *gap_m) {
    const cr_vec3 rx = c->row[0], ry = c->row[1], rz = c->row[2], m = c->middle_m;
    for (int i = 0; i < CR_LANES; i++) {
        const float ax = n->arm_x_m[i], ay = n->arm_y_m[i], az = n->arm_z_m[i];
        const float x = m.x + rx.x * ax + rx.y * ay + rx.z * az;
        const float y = m.y + ry.x * ax + ry.y * ay + ry.z * az;
        const float z = m.z + rz.x * ax + rz.y * ay + rz.z * az;
        gap_m[i] = n->gap_m[i] + n->normal_x[i] * x + n->normal_y[i] * y + n->normal_z[i] * z;
    }
}

static float find_gap(near_sample n, const carrier *c) {
    float gap_m[CR_LANES];
    find_gaps(n.block, c, gap_m);
    return gap_m[n.lane];
}

/* Contacts of the step before that are still near, in their order. */
static void keep_contacts(cr_coupled *c, const cr_couple_view *v, const carrier *before) {
    const cr_couple_found *f = &c->found;
    uint32_t kept = 0u;
    for (uint32_t i = 0; i < c->contact_count; i++) {
        const uint32_t at = find_key(f, c->contacts[i].key);
        const near_sample n = near_at(f, at < f->near_count ? at : 0u);
        if (f->near_count > 0u && n.block->key[n.lane] == c->contacts[i].key && find_gap(n, before) < KEEP_M) {
            make_contact(v, n, &c->contacts[kept++]);
        }
    }
    c->contact_count = kept;
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

/* The deepest sample of each corner of the tool of those that pass their planes. */
typedef struct {
    near_sample at[CORNERS]; /* without a block: none */
    float gap_m[CORNERS];
    float share; /* how far the motion may be made: 1 where none passes */
} passed_samples;

static void note_passed(const near_sample n, float gap_m, float before_m, float limit_m, passed_samples *p) {
    const int corner = (n.block->arm_x_m[n.lane] > 0.0f) + 2 * (n.block->arm_y_m[n.lane] > 0.0f) +
                       4 * (n.block->arm_z_m[n.lane] > 0.0f);
    if (gap_m < before_m - PASSED_M) { /* it is not so deep yet */
        p->share = min_f(p->share, max_f(0.0f, before_m - limit_m) / (before_m - gap_m));
    }
    if (gap_m <= p->gap_m[corner]) { /* of those that are as deep the last: creases and corners come after faces */
        p->at[corner] = n;
        p->gap_m[corner] = gap_m;
    }
}

static uint32_t lanes_below(const float *value, float limit) {
    uint32_t some = 0u, lanes = 0u;
    for (int i = 0; i < CR_LANES; i++) {
        some |= (uint32_t)(value[i] < limit);
    }
    for (int i = 0; i < CR_LANES && some != 0u; i++) {
        lanes |= (uint32_t)(value[i] < limit) << i;
    }
    return lanes;
}

static void find_passed(const cr_coupled *c, const carrier *before, const carrier *after, passed_samples *p) {
    const float limit_m = -max_f(PASSED_M, PASSED_SHARE * deepest_contact(c));
    float gap_m[CR_LANES];
    for (uint32_t first = 0u; first < c->found.near_count; first += CR_LANES) {
        near_sample n = near_at(&c->found, first);
        find_gaps(n.block, after, gap_m);
        for (uint32_t left = lanes_below(gap_m, limit_m); left != 0u;) {
            n.lane = (uint32_t)take_lane(&left);
            if (!is_contact_of(c, n.block->key[n.lane])) {
                note_passed(n, gap_m[n.lane], find_gap(n, before), limit_m, p);
            }
        }
    }
}

/* Samples that pass their planes become contacts.   Output  how far the motion may be made. *added: contacts that are new. */
static float ask_passed(cr_coupled *c, const cr_couple_view *v, const carrier *before, const carrier *after,
                        uint32_t *added) {
    passed_samples p = {{{NULL, 0u}}, {0.0f}, 1.0f};
    const int may_add = *added != 0u;
    find_passed(c, before, after, &p);
    *added = 0u;
    for (int k = 0; k < CORNERS && may_add; k++) {
        if (p.at[k].block != NULL) {
            const uint32_t at = c->contact_count < CR_COUPLE_CONTACTS_MAX ? c->contact_count++ : find_idle(c);
            if (at < CR_COUPLE_CONTACTS_MAX) {
                make_contact(v, p.at[k], &c->contacts[at]);
                if (at < c->couple.point_count) {
                    c->couple.points[at].gap_m = -1.0f; /* taken: not idle any more */
                }
                (*added)++;
            }
        }
    }
    return p.share;
}

/* Back towards where the step began: the tool's middle on a straight line, so that no point moves farther than that share of most_m. */
static void make_share(const cr_scene *s, cr_couple *couple, const cr_pose *from, const tool_motion *m) {
    const cr_vec3 middle = v3_add(middle_of_tool(s, couple, from), m->middle_m);
    couple->held.rot = cr_couple_turned(from->rot, m->turn_rad);
    const xform turned = cr_xform_from_pose(&couple->held);
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

/* How deep near samples are behind their planes after a motion, at most, m: all, or, where it is told what was before it, those that it carries deeper. */
static float deepest_near(const cr_couple_found *f, const carrier *before, const carrier *after) {
    float deep[CR_LANES] = {0.0f}, gap_m[CR_LANES], before_m[CR_LANES], deepest = 0.0f;
    for (uint32_t first = 0u; first < f->near_count; first += CR_LANES) {
        const cr_couple_near *n = &f->near[first / CR_LANES];
        find_gaps(n, after, gap_m);
        if (before != NULL) {
            find_gaps(n, before, before_m);
            for (int i = 0; i < CR_LANES; i++) {
                gap_m[i] = gap_m[i] < before_m[i] - PASSED_M ? gap_m[i] : 0.0f;
            }
        }
        for (int i = 0; i < CR_LANES; i++) {
            deep[i] = higher_f(deep[i], -gap_m[i]);
        }
    }
    for (int i = 0; i < CR_LANES; i++) {
        deepest = max_f(deepest, deep[i]);
    }
    return deepest;
}

/* Make the share of a step that may be made. What turns goes on circles: halved until no sample is carried deeper than what passes.
 * Output   the share. */
static float shorten(cr_coupled *c, const cr_scene *s, const cr_pose *from, const tool_motion *step, float share) {
    const float limit = PASSED_M + max_f(PASSED_M, PASSED_SHARE * deepest_contact(c));
    const tool_motion first = motion_between(s, &c->couple, &c->found.centre, from);
    const carrier before = carrier_of(&first);
    uint32_t halved = 0u;
    for (int deep = 1; deep;) {
        const tool_motion part = share_of_motion(step, share);
        make_share(s, &c->couple, from, &part);
        const tool_motion m = motion_between(s, &c->couple, &c->found.centre, &c->couple.held);
        const carrier after = carrier_of(&m);
        deep = halved++ < SHARES_MAX && deepest_near(&c->found, &before, &after) > limit;
        share *= deep ? 0.5f : 1.0f;
    }
    return share;
}

/* Samples near the held tool, where it is now. */
static void look_round(cr_coupled *c, cr_couple_view *v, float margin_m) {
    c->found.centre = c->couple.held;
    const cr_pose tool = view_from(&c->couple, &c->found.centre, v);
    c->found.ticks = 0u;
    v->margin_m = min_f(margin_m + MARGIN_MORE_M, v->trust_m);
    v->every = 1u;
    cr_couple_gather(v, &tool);
    for (uint32_t i = 1u; i < GATHERS_MAX && c->found.crowded != 0u; i++) {
        v->margin_m *= i <= HALVINGS ? 0.5f : 1.0f;
        v->every *= i <= HALVINGS ? 1u : 2u;
        cr_couple_gather(v, &tool);
    }
}

/* Whether what was found still holds at a motion from there, and for the way that samples are looked for now. */
static int still_holds(const cr_couple_found *f, const cr_couple_view *v, float most_m, float margin_m) {
    const float far_m = lower_f(SAME_PLANES_M, SAME_PLANES_VOXELS / STEP_VOXELS * v->trust_m);
    return f->image == v->field->scene->meta && f->free_m - most_m >= margin_m / MARGIN_SHARE &&
           (most_m <= SAME_PLACE_M || (most_m <= far_m && f->ticks < SAME_PLANES_TICKS));
}

/* One step.   Output  how far a point of the tool may have moved at most, m. */
static float step_held(cr_coupled *c, cr_couple_view *v, const cr_couple_tie *k, float margin_m,
                       cr_couple_output *out) {
    const cr_scene *s = v->field->scene;
    const cr_pose from = c->couple.held;
    const float turning = c->couple.turning;
    tool_motion m = motion_between(s, &c->couple, &c->found.centre, &from);
    uint32_t added = 1u;
    float share = 1.0f;
    if (!still_holds(&c->found, v, m.most_m, margin_m)) {
        look_round(c, v, margin_m);
        m = motion_between(s, &c->couple, &from, &from);
    }
    const float safe_m = max_f(c->found.free_m - m.most_m, 0.0f);
    const carrier before = carrier_of(&m);
    carrier after = before;
    c->stats.left_m = 0.0f;
    keep_contacts(c, v, &before);
    for (uint32_t i = 0; i < TRIES_MAX && added > 0u; i++) {
        c->couple.held = from;
        c->couple.turning = turning;
        cr_couple_try(&c->couple, k, c->contacts, c->contact_count, out);
        c->stats.descents++;
        m = motion_between(s, &c->couple, &c->found.centre, &c->couple.held);
        after = carrier_of(&m);
        added = i + 1u < TRIES_MAX ? 1u : 0u;
        share = ask_passed(c, v, &before, &after, &added);
    }
    c->stats.refused += share < 1.0f ? 1u : 0u;
    c->stats.dropped += c->found.dropped;
    tool_motion step = motion_between(s, &c->couple, &from, &c->couple.held);
    const float may_m = c->found.near_count > 0u ? min_f(safe_m, v->trust_m) : safe_m;
    share = step.most_m > may_m ? min_f(share, may_m / step.most_m) : share;
    if (share < 1.0f) {
        share = shorten(c, s, &from, &step, share);
        c->stats.left_m = (1.0f - share) * step.most_m;
        step.most_m *= share;
        m = motion_between(s, &c->couple, &c->found.centre, &c->couple.held);
        after = carrier_of(&m);
    }
    cr_couple_settle(&c->couple, k, c->contacts, c->contact_count, out);
    out->inside_m = max_f(out->inside_m, deepest_near(&c->found, NULL, &after));
    if (share < 1.0f) {
        out->pressing = cr_couple_pressing(&c->couple);
    }
    return step.most_m;
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
    cr_couple_found *f = &coupled->found;
    f->image = NULL;
    f->centre = f->tool = coupled->couple.held;
    f->pace_m = f->free_m = 0.0f;
    f->slide_m = f->slide_lost_m = f->turn_rad = f->turn_lost_rad = 0.0f;
    f->near_count = f->dropped = f->crowded = f->ticks = 0u;
    memset(f->by_points, 0, sizeof f->by_points);
    coupled->contact_count = coupled->pressed = 0u;
    coupled->stats = none;
}

/* How far samples are looked for where the tool is to go so far. */
static float margin_for(float way_m, float trust_m) {
    return min_f(max_f(MARGIN_SHARE * way_m, MARGIN_MIN_M), trust_m);
}

void cr_couple_tick(cr_coupled *c, const cr_world *world, const cr_pose *world_from_tool, float period_s,
                    cr_couple_output *out) {
    static const cr_couple_stats none = {0};
    const cr_pose last = c->couple.held;
    cr_couple_tie k;
    c->stats = none;
    const uint32_t none_to_look_in = world == NULL ? CR_COUPLE_FAULT_CONTACT : 0u;
    if (!cr_couple_accept(&c->couple, world_from_tool, period_s, none_to_look_in, &k, out) || world == NULL) {
        c->contact_count = c->found.near_count = c->pressed = 0u;
        c->found.image = NULL;
        return;
    }
    cr_couple_view v = {.field = &world->field, .found = &c->found};
    float moved = 1.0f, way_m = 0.0f, margin_m;
    v.trust_m = STEP_VOXELS * world->scene.meta->voxel_m;
    c->found.ticks++;
    (void)view_from(&c->couple, &c->found.centre, &v);
    margin_m = margin_for(c->found.pace_m, v.trust_m);
    for (uint32_t i = 0; i < CR_COUPLE_STEPS_MAX && moved > STEP_ENOUGH_M && c->stats.descents < DESCENTS_MAX; i++) {
        moved = step_held(c, &v, &k, margin_m, out);
        way_m += moved;
        margin_m = margin_for(max_f(way_m, c->stats.left_m), v.trust_m);
        c->stats.steps++;
    }
    c->found.pace_m = way_m + c->stats.left_m;
    c->stats.left_m = moved > STEP_ENOUGH_M ? max_f(c->stats.left_m, moved) : c->stats.left_m;
    c->stats.lookups = v.lookups;
    c->stats.near = c->found.near_count;
    c->stats.contacts = c->contact_count;
    /* On its way from contact to contact it is held as it was before, for as many ticks as that takes: what it comes to is not told yet. */
    out->pressing = out->pressing == 0u && c->stats.left_m > STEP_ENOUGH_M ? c->pressed : out->pressing;
    c->pressed = out->pressing;
    cr_couple_answer(&c->couple, &k, &last, out);
}
