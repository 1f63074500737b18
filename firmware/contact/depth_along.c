/* depth_along: how deep each half-space is: the way of the deepest tool surface along its normal to the first exit. WAY_OUT.md "Depth". */
#include "contact/way_out.h"

/* No way out is longer than this many times the depth of the deepest sample, and half a sample. */
#define FAR_MAX 4.0f
/* Share of a half-space's weight from which on a plane bounds it in full. */
#define SEEN 0.02f
/* Cosine of normal and plane from which on the exit through the plane is trusted; up to CR_WAY_STEEP_MIN it is looked for along the normal. Where planes are
 * all there is they are trusted longer than beside a curved surface, whose exit no plane tells. */
#define STEEP 0.5f
#define STEEP_CURVED 0.95f
#define STEEP_MIN_CURVED 0.7f
/* Share of curved zones in a half-space from which on they count in full. By their share alone (1): 279 mm of jumps instead of 264 on 459 random slow paths;
 * at once (0): 149 instead of 154 of 175 random poses deep inside are cleared. */
#define CURVED 0.25f
/* Most steps of a march, each as long as the distance. Without it a case of tests/property/test_found_by_stress.py jumps by 7.1 mm; with 6, 52 of 92 random poses
 * deep inside are cleared instead of 59. */
#define MARCH_STEPS 12
/* A march ends this near the surface, as a share of the sample's reach. Without it marches take 44,000 lookups on 576 random poses instead of 28,000. */
#define MARCH_END 0.02f

#define NEVER_M 3.0e38f
/* Less than any cosine: no plane of this lane. */
#define NO_PLANE (-2.0f)

/* Work, in parts of a unit: a side of a surface; a zone that may be that of its lanes, or related to it, and one more; a half-space
 * that they may count for, and again where they do; there the rows of planes that bound them; a lane of a side, one that is asked for a half-space, and twice
 * where it is near another zone, finds its way through a row, or through all, once more where it has to meet a facet, and half of it to be above a row; a facet
 * that is turned for that; a plane that is known, one of the half-space,
 * and a row that is gone through; an exit of a lane that waits, a place on its piece that is looked at, and each exit from there; a step of a march, and each
 * lane that marches. */
#define PARTS_OF_SIDE 32u
#define PARTS_OF_ZONE 4u
#define PARTS_OF_HALF 24u
#define PARTS_OF_WAYS 32u
#define PARTS_OF_LANE 4u
#define PARTS_OF_ROW 6u
#define PARTS_OF_SHEET 8u
#define PARTS_OF_EXIT 11u
#define PARTS_OF_PLACE 20u
#define PARTS_OF_FIRST 2u
#define PARTS_OF_MARCH 64u
#define PARTS_OF_MARCHING 4u

/* Is a plane among those that are known at some lanes? */
static int is_known(const cr_way_spots *at, uint32_t facet) {
    uint32_t k = 0u;
    while (k < at->count && at->planes[k].facet != facet) {
        k++;
    }
    return k < at->count;
}

/* The planes that bound a half-space, but for those that are known. One that a lane is above does not bound it, unless the static object surely
 * ends there. */
static void add_bounds(const cr_way_half *half, const cr_way_spots *at, uint32_t lanes, cr_way_rows *e) {
    for (uint32_t b = 0; b < half->bound_count; b++) {
        const cr_way_bound *q = &half->bounds[b];
        /* A plane that is hardly touched yet is hardly left through: it comes from afar, and where no other is steep a march tells the way until it is there. */
        const float seen = q->weight_m3 / (SEEN * half->weight_m3);
        const float leaves = v3_dot(q->normal, half->normal) * q->part * min_f(1.0f, seen);
        if (is_known(at, q->facet) || !(leaves > CR_WAY_LEAVES_MIN)) {
            continue;
        }
        const struct cr_img_cluster *c = at->c;
        float *height = e->height_m[e->count], *steep = e->leaves[e->count];
        CR_ASSERT(e->count < CR_WAY_EXITS_MAX);
        for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
            const float h = height_above(c, i, q->normal, q->offset_m);
            height[i] = h;
            steep[i] = h < 0.0f || q->sure != 0u ? leaves : NO_PLANE;
        }
        e->bound[e->count] = q;
        e->curved[e->count] = 0;
        e->trusted[e->count] = clamp_f(seen - 1.0f, 0.0f, 1.0f);
        e->normal[e->count++] = q->normal;
    }
}

static void find_own(const cr_way_half *half, const cr_way_spots *at, uint32_t lanes, cr_way_rows *e) {
    e->count = at->count;
    for (uint32_t k = 0; k < at->count; k++) {
        const cr_way_known *p = &at->planes[k];
        const float leaves = p->curved ? 0.0f : v3_dot(p->normal, half->normal);
        e->normal[k] = p->normal;
        e->curved[k] = p->curved;
        e->bound[k] = NULL;
        e->trusted[k] = 1.0f;
        for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
            e->height_m[k][i] = p->height_m[i];
            e->leaves[k][i] = p->curved ? v3_dot(lane_of(at->normal, i), half->normal) : leaves;
        }
    }
}

/* How deep below the plane that they are inside of the pieces of the lanes reach. With vectors each kind of plane is a loop of its own, or neither would be
 * vector code. */
static void find_deep(cr_way_spots *at) {
    const struct cr_img_cluster *c = at->c;
    const cr_way_known *own = &at->planes[0];
    const float *height_m = own->height_m;
    const uint32_t lanes = at->lanes;
    const cr_vec3 n = own->normal;
    if (!CR_SCALAR && at->count > 0u && !own->curved) {
        for (int i = 0; i < CR_LANES; i++) {
            at->deep_m[i] = cr_way_half_width(c, i, n) - height_m[i];
        }
        return;
    }
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const cr_vec3 m = own->curved ? lane_of(at->normal, i) : n;
        at->deep_m[i] = at->count > 0u ? cr_way_half_width(c, i, m) - height_m[i] : NEVER_M;
    }
}

/* Lanes whose way may be longer than what is known, by the plane that they are inside of. */
static uint32_t find_longer(const cr_way_spots *at, uint32_t lanes, const float *part, const cr_way_half *half) {
    const cr_way_known *own = &at->planes[0];
    const float far = FAR_MAX * half->deep_m, flat_leaves = v3_dot(own->normal, half->normal);
    uint32_t known = 0u;
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const float leaves = own->curved ? v3_dot(lane_of(at->normal, i), half->normal) : flat_leaves;
        /* deep / leaves or far, without a division */
        const int by_own =
            (leaves > CR_WAY_LEAVES_MIN) & (part[i] * at->deep_m[i] <= half->depth_m * leaves + CR_WAY_SLACK_M);
        const int by_far = part[i] * (far + at->c->ramp[i]) <= half->depth_m;
        known |= (uint32_t)(by_own | by_far) << i;
    }
    return lanes & ~known;
}

/* No row is known yet. */
static void begin_ways(cr_way_ways *w, uint32_t lanes) {
    for (int i = 0; i < CR_LANES; i++) {
        w->middle_m[i] = w->most_m[i] = w->first_m[i] = w->second_m[i] = NEVER_M;
        w->steep[i] = 0.0f;
    }
    w->row = 0u;
    w->parts = 2u * PARTS_OF_LANE * cr_count_lanes(lanes);
}

/* How far the piece of a lane reaches along the plane of a row. */
static inline float reach_along(const cr_way_rest *r, int i, const cr_way_rows *e, uint32_t k) {
    return cr_way_half_width(r->c, i, e->curved[k] ? lane_of(r->normal, i) : e->normal[k]);
}

/* The rectangle that a facet lies in, seen from the tool: its axes, how far the tool's origin lies from its middle along them, and how far along them a way leads. */
typedef struct {
    cr_vec3 x, y;
    float from_x_m, from_y_m, to_x, to_y, half_x_m, half_y_m;
} sheet;

static sheet sheet_of(const cr_way_survey *s, const cr_way_bound *q, cr_vec3 way) {
    CR_ASSERT(q->facet < s->in->field->scene->facet_count);
    const struct cr_img_facet *f = &s->in->field->scene->facets[q->facet];
    const xform *pose = s->in->world_from_tool;
    const cr_vec3 x = xform_unrotate(pose, v3_from(f->along)), y = v3_cross(q->normal, x);
    const cr_vec3 from = xform_unrotate(pose, v3_sub(pose->t, v3_from(f->middle_m)));
    return (sheet){x, y, v3_dot(x, from), v3_dot(y, from), v3_dot(x, way), v3_dot(y, way), f->half_m[0], f->half_m[1]};
}

/* How far a lane meets a sheet after so long a way: 1 where its piece reaches it, 0 from twice as far beside it. */
static inline float meets(const sheet *f, const struct cr_img_cluster *c, int i, float way_m) {
    const cr_vec3 p = v3(c->x[i], c->y[i], c->z[i]);
    const float x_m = abs_f(v3_dot(f->x, p) + f->from_x_m + f->to_x * way_m) - f->half_x_m;
    const float y_m = abs_f(v3_dot(f->y, p) + f->from_y_m + f->to_y * way_m) - f->half_y_m;
    return clamp_f(2.0f - higher_f(x_m, y_m) / (CR_WAY_REACH * c->ramp[i] + c->reach[i]), 0.0f, 1.0f);
}

/* How far lanes trust a row of planes: where the plane goes on and its facet does not, a march tells whether the way ends before. */
static void find_trust(const cr_way_survey *s, uint32_t lanes, uint32_t k, float *trust) {
    const cr_way_rest *r = &s->scratch->rest;
    const cr_way_rows *e = &s->scratch->rows;
    if (e->bound[k] == NULL) {
        for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
            trust[i] = e->trusted[k];
        }
        return;
    }
    const sheet facet = sheet_of(s, e->bound[k], r->half->normal);
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const float way_m = higher_f(0.0f, -e->height_m[k][i]) / higher_f(e->leaves[k][i], CR_WAY_LEAVES_MIN);
        trust[i] = e->trusted[k] * meets(&facet, r->c, i, way_m);
    }
}

/* Ways through one row of planes: the next of those that bound the lanes. With vectors the reach is a loop of its own, or neither would be vector code. */
static void find_ways(const cr_way_survey *s, uint32_t lanes, cr_way_ways *w) {
    const cr_way_rest *r = &s->scratch->rest;
    const cr_way_rows *e = &s->scratch->rows;
    float reach_m[CR_LANES], trust[CR_LANES];
    const uint32_t k = w->row++;
    find_trust(s, lanes, k, trust);
    for (int i = 0; i < CR_LANES && !CR_SCALAR; i++) {
        reach_m[i] = reach_along(r, i, e, k);
    }
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const float leaves = e->leaves[k][i], h = e->height_m[k][i];
        const float reach = CR_SCALAR ? reach_along(r, i, e, k) : reach_m[i];
        const float per = 1.0f / higher_f(leaves, CR_WAY_LEAVES_MIN);
        const int there = leaves > NO_PLANE, bounds = there & ((leaves > CR_WAY_LEAVES_MIN) | (h > 0.0f));
        const float least = there ? -(h + reach) * per : NEVER_M;
        w->middle_m[i] = bounds ? lower_f(w->middle_m[i], -h * per) : w->middle_m[i];
        w->most_m[i] = bounds ? lower_f(w->most_m[i], (reach - h) * per) : w->most_m[i];
        w->steep[i] = higher_f(w->steep[i], trust[i] * leaves);
        w->second_m[i] = lower_f(w->second_m[i], higher_f(w->first_m[i], least));
        w->first_m[i] = lower_f(w->first_m[i], least);
    }
}

/* How far the exit through planes is trusted, the steepest of them so steep. */
static float sure_of(const cr_way_half *half, float steep) {
    const float curved = min_f(1.0f, half->curved_m3 / (CURVED * half->weight_m3));
    const float flat = clamp_f((steep - CR_WAY_STEEP_MIN) / (STEEP - CR_WAY_STEEP_MIN), 0.0f, 1.0f);
    const float beside = clamp_f((steep - STEEP_MIN_CURVED) / (STEEP_CURVED - STEEP_MIN_CURVED), 0.0f, 1.0f);
    return flat + curved * (beside - flat);
}

/* From which steepness on it is trusted in full. */
static float trusted_of(const cr_way_half *half) { return half->curved_m3 > 0.0f ? STEEP_CURVED : STEEP; }

/* One lane in full: anywhere on its piece; where the normal hardly leaves through the planes by what a march found. */
static float way_of_lane(const cr_way_scratch *scratch, int i, uint32_t *places) {
    const cr_way_rest *r = &scratch->rest;
    const cr_way_rows *e = &scratch->rows;
    cr_way_exits exits;
    exits.count = 0u;
    for (uint32_t k = 0; k < e->count; k++) {
        if (e->leaves[k][i] > NO_PLANE) {
            exits.normal[exits.count] = e->curved[k] ? lane_of(r->normal, i) : e->normal[k];
            exits.height_m[exits.count] = e->height_m[k][i];
            exits.leaves[exits.count++] = e->leaves[k][i];
        }
    }
    const float most_m = FAR_MAX * r->half->deep_m + r->c->ramp[i],
                way_m = exits.count > 0u ? min_f(most_m, cr_way_longest(r->c, i, &exits, places)) : most_m;
    const float sure = sure_of(r->half, scratch->ways.steep[i]);
    return sure < 1.0f ? sure * way_m + (1.0f - sure) * min_f(r->gone_m[i], way_m) : way_m;
}

/* The same of one that leaves through planes alone, which are the exits of all lanes. */
static float way_by_planes(cr_way_rest *r, int i, uint32_t *places) {
    for (uint32_t k = 0; k < r->exits.count; k++) {
        r->exits.height_m[k] = r->height_m[k][i];
    }
    return min_f(FAR_MAX * r->half->deep_m + r->c->ramp[i], cr_way_longest(r->c, i, &r->exits, places));
}

/* One step of a march: how far along the normal each of some lanes has to go until it is outside, in steps as long as the distance. */
static void march(const cr_way_survey *s) {
    cr_way_rest *r = &s->scratch->rest;
    const cr_vec3 to = xform_rotate(s->in->world_from_tool, r->half->normal);
    CR_ASSERT(v3_is_unit_or_zero(r->half->normal)); /* each step is as long as the distance */
    cr_lanes3 *place = &s->scratch->march_world;
    const cr_lanes3 *from = &s->scratch->march_from;
    cr_lookup *found = &s->scratch->march;
    for (int i = 0; i < CR_LANES; i++) {
        place->x[i] = from->x[i] + to.x * r->gone_m[i];
        place->y[i] = from->y[i] + to.y * r->gone_m[i];
        place->z[i] = from->z[i] + to.z * r->gone_m[i];
    }
    cr_field_look_up_lanes(s->in->field, place, r->marching, found);
    s->work->spent += PARTS_OF_MARCH + PARTS_OF_MARCHING * cr_count_lanes(r->marching) + found->parts;
    for (uint32_t left = r->marching; left != 0u;) {
        const int i = take_lane(&left);
        const int inside = found->phi_m[i] < -MARCH_END * r->c->ramp[i];
        r->gone_m[i] -= inside ? found->phi_m[i] : 0.0f;
        r->marching &= inside && r->gone_m[i] < r->most_m ? 0xffffffffu : ~(1u << i);
    }
    r->steps++;
    r->marching = r->steps < MARCH_STEPS ? r->marching : 0u;
}

/* Some of the lanes march, as far as any of them may have to go. */
static void begin_march(const cr_way_survey *s, uint32_t lanes, uint32_t marching) {
    cr_way_scratch *scratch = s->scratch;
    cr_way_rest *r = &scratch->rest;
    float most = 0.0f;
    for (int i = 0; i < CR_LANES; i++) {
        const float far = FAR_MAX * r->half->deep_m + r->c->ramp[i];
        most = has_lane(lanes, i) ? higher_f(most, far) : most;
        r->gone_m[i] = 0.0f;
    }
    r->most_m = most;
    r->marching = marching;
    r->steps = 0u;
    cr_lanes_to_world(s->in->world_from_tool, r->c->x, r->c->y, r->c->z, &scratch->march_from);
    s->work->spent += PARTS_OF_MARCH;
}

/* All rows are known: lanes with but one exit count; those that may be longer wait for all of their exits, and march first where no plane leads out of them
 * steeply enough. */
static void end_ways(const cr_way_survey *s) {
    cr_way_rest *r = &s->scratch->rest;
    cr_way_half *half = r->half;
    cr_way_ways *w = &s->scratch->ways;
    const uint32_t lanes = s->work->left, smooth = lanes & ~(uint32_t)r->c->crease_mask;
    const float trusted = trusted_of(half);
    uint32_t steep = 0u, left = 0u, plain = 0u;
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const float far = FAR_MAX * half->deep_m + r->c->ramp[i];
        const float way = r->part[i] * lower_f(far, higher_f(0.0f, w->middle_m[i]));
        const int alone = (w->second_m[i] > w->most_m[i]) & (w->steep[i] >= trusted) & has_lane(smooth, i);
        half->depth_m = alone ? higher_f(half->depth_m, way) : half->depth_m;
        plain |= (uint32_t)alone << i;
    }
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const float far = FAR_MAX * half->deep_m + r->c->ramp[i];
        left |= (uint32_t)(r->part[i] * lower_f(far, w->most_m[i]) > half->depth_m) << i;
        steep |= (uint32_t)(w->steep[i] >= trusted) << i;
    }
    left &= lanes & ~plain;
    s->work->spent += w->parts;
    s->work->left = left;
    r->looks = CR_WAY_LANE_BY_LANE;
    if ((left & ~steep) != 0u) {
        begin_march(s, lanes, left & ~steep);
    }
}

/* The next row of planes for all lanes, or the end of these. */
static void take_row(const cr_way_survey *s) {
    cr_way_scratch *scratch = s->scratch;
    if (scratch->ways.row == scratch->rows.count) {
        end_ways(s);
        return;
    }
    if (scratch->rows.bound[scratch->ways.row] != NULL) {
        s->work->spent += PARTS_OF_SHEET + PARTS_OF_LANE * cr_count_lanes(s->work->left);
    }
    find_ways(s, s->work->left, &scratch->ways);
    s->work->spent += PARTS_OF_ROW + scratch->ways.parts;
}

/* The next lane, by all of its exits. */
static void take_lane_left(const cr_way_survey *s) {
    cr_way_work *w = s->work;
    cr_way_rest *r = &s->scratch->rest;
    const uint32_t planes = r->exits.count, exits = planes > 0u ? planes : s->scratch->rows.count;
    const int i = take_lane(&w->left);
    uint32_t places = 1u;
    const float way_m = planes > 0u ? way_by_planes(r, i, &places) : way_of_lane(s->scratch, i, &places);
    r->half->depth_m = max_f(r->half->depth_m, r->part[i] * way_m);
    w->spent += PARTS_OF_EXIT * (1u + exits) + places * (PARTS_OF_PLACE + PARTS_OF_FIRST * exits);
}

void cr_way_go_on(const cr_way_survey *s) {
    const cr_way_rest *r = &s->scratch->rest;
    CR_ASSERT(s->work->left != 0u && (r->marching & ~s->work->left) == 0u);
    while (s->work->left != 0u && !cr_way_waits(s)) {
        if (r->looks == CR_WAY_ROW_BY_ROW) {
            take_row(s);
        } else if (r->marching != 0u) {
            march(s);
        } else {
            take_lane_left(s);
        }
    }
}

/* Some flat planes and no other bound what the lanes leave, and one of them steeply enough: the exits, but for the heights of a lane. */
static int exits_of_planes(const cr_way_spots *at, const cr_way_half *half, cr_way_rest *r) {
    float steep = 0.0f;
    for (uint32_t b = 0; b < half->bound_count; b++) {
        if (!is_known(at, half->bounds[b].facet)) {
            return 0;
        }
    }
    cr_way_exits *out = &r->exits;
    out->count = at->count;
    for (uint32_t k = 0; k < at->count; k++) {
        r->height_m[k] = at->planes[k].height_m;
        out->normal[k] = at->planes[k].normal;
        out->leaves[k] = v3_dot(at->planes[k].normal, half->normal);
        steep = max_f(steep, out->leaves[k]);
    }
    return at->count > 1u && half->curved_m3 <= 0.0f && steep >= STEEP;
}

/* Lanes count for a half-space by their exits, each by its part: that in scratch, where what waits finds it. */
static void count_for(const cr_way_survey *s, const cr_way_spots *at, uint32_t lanes, cr_way_half *half) {
    cr_way_scratch *scratch = s->scratch;
    cr_way_rest *rest = &scratch->rest;
    if (lanes == 0u) {
        return;
    }
    s->work->spent += PARTS_OF_HALF + PARTS_OF_ROW * half->bound_count;
    rest->c = at->c;
    rest->normal = at->normal;
    rest->half = half;
    rest->marching = 0u;
    rest->looks = CR_WAY_LANE_BY_LANE;
    s->work->left = lanes;
    if (!exits_of_planes(at, half, rest)) {
        rest->exits.count = 0u;
        rest->looks = CR_WAY_ROW_BY_ROW;
        find_own(half, at, lanes, &scratch->rows);
        add_bounds(half, at, lanes, &scratch->rows);
        begin_ways(&scratch->ways, lanes);
        s->work->spent += PARTS_OF_WAYS + PARTS_OF_ROW * at->count + scratch->rows.count * scratch->ways.parts / 4u;
    }
    cr_way_go_on(s);
}

/* How near a lane is to another zone: 1 where it is no deeper below that one's mean plane than it is in its own, 0 from twice that on or above. */
static float nearness(const cr_way_survey *s, const cr_way_spots *at, int i, uint32_t other) {
    const struct cr_img_cluster *c = at->c;
    const cr_vec3 p = v3(c->x[i], c->y[i], c->z[i]);
    const float mine = higher_f(0.0f, -at->planes[0].height_m[i]), ramp = c->ramp[i],
                its = v3_dot(s->relations->unit[other], v3_sub(s->relations->touched[other], p));
    return clamp_f((2.0f * mine + ramp - its) / (mine + ramp), 0.0f, 1.0f) * clamp_f(its / ramp, 0.0f, 1.0f);
}

/* Is it the turn of the next half-space that lanes over the surface in hand count for, by so much work? Those of an earlier tick are passed over. */
static int is_next(const cr_way_survey *s, uint32_t parts) {
    cr_way_work *w = s->work;
    if (w->seen++ < w->done || cr_way_waits(s)) {
        return 0;
    }
    w->done++;
    w->moved = 1u;
    w->spent += parts;
    return 1;
}

/* Lanes count for their zone; where that does not lead, for those that it is related to and they are near to. */
static void count_in_zone(const cr_way_survey *s, const cr_way_spots *at, uint32_t lanes, uint32_t z,
                          const float *part) {
    const cr_way_relations *r = s->relations;
    const uint32_t parts = PARTS_OF_HALF + PARTS_OF_LANE * cr_count_lanes(lanes);
    for (uint32_t those = r->counts_for[z]; those != 0u;) {
        const uint32_t b = (uint32_t)take_lane(&those);
        if (!is_next(s, parts)) {
            continue;
        }
        const float most = r->part[z][b];
        cr_way_half *half = &s->half[r->half_of[b]];
        float *share = s->scratch->rest.part;
        for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
            share[i] = part[i] * most;
        }
        uint32_t longer = find_longer(at, lanes, share, half);
        if (b != z && longer != 0u) {
            for (uint32_t left = longer; left != 0u;) {
                const int i = take_lane(&left);
                share[i] *= nearness(s, at, i, b);
            }
            s->work->spent += 2u * PARTS_OF_LANE * cr_count_lanes(longer);
            longer = find_longer(at, longer, share, half);
        }
        count_for(s, at, longer, half);
    }
}

void cr_way_count(const cr_way_survey *s, cr_way_spots *at, uint32_t surface, uint32_t side, const float *part) {
    find_deep(at);
    s->work->spent += PARTS_OF_SIDE + PARTS_OF_LANE * cr_count_lanes(at->lanes);
    for (int slot = 0; slot < CR_PIECES; slot++) {
        const cr_way_key key = {surface, side, at->c->piece[slot]};
        const uint32_t lanes = at->lanes & at->c->piece_lanes[slot];
        if (key.piece == CR_PIECE_NONE || lanes == 0u) {
            continue;
        }
        const uint32_t z = cr_way_find(s->zones, key);
        s->work->spent += PARTS_OF_ZONE * (1u + s->zones->count);
        if (z != CR_WAY_NONE) {
            count_in_zone(s, at, lanes, z, part);
        }
    }
}
