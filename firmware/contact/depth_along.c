/* depth_along: how deep each half-space is: the way of the deepest tool surface along its normal to the first exit. WAY_OUT.md "Depth". */
#include "contact/way_out.h"

/* No way out is longer than this many times the depth of the deepest sample, and half a sample. */
#define FAR_MAX 4.0f
/* Most steps of a march, each as long as the distance. Without it a case of tests/property/test_found_by_stress.py jumps by 7.1 mm; with 6, 52 of 92 random poses
 * deep inside are cleared instead of 59. */
#define MARCH_STEPS 12
/* A march ends this near the surface, as a share of the sample's reach. Without it marches take 44,000 lookups on 576 random poses instead of 28,000. */
#define MARCH_END 0.02f

#define NEVER_M 3.0e38f

/* Work, in parts of a unit: a side of a surface; a zone that may be that of its lanes, or related to it, and one more; a half-space
 * that they may count for, and again where they do; there the rows of planes that bound them; a lane of a side, one that is asked for a half-space, and twice
 * where it is near another zone, finds its way through a row, or through all, and half of it to be above a row; a plane that is known, one of the half-space,
 * and a row that is gone through, or asked how far it is trusted, or the end of all; a lane that may be above a row that surely ends; one that is, or that asks;
 * an exit of a lane that waits, a place on its piece that is looked at, and each exit from there; a step of a march, and each lane that marches. */
#define PARTS_OF_SIDE 32u
#define PARTS_OF_ZONE 4u
#define PARTS_OF_HALF 24u
#define PARTS_OF_WAYS 32u
#define PARTS_OF_LANE 4u
#define PARTS_OF_ROW 8u
#define PARTS_OF_HIGH 1u
#define PARTS_OF_MEETS 11u
#define PARTS_OF_EXIT 13u
#define PARTS_OF_PLACE 23u
#define PARTS_OF_FIRST 2u
#define PARTS_OF_MARCH 64u
#define PARTS_OF_MARCHING 4u

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
            at->deep_m[i] = cr_way_rise(c, i, piece_width(c, i, n)) - height_m[i];
        }
        return;
    }
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const cr_vec3 m = own->curved ? lane_of(at->normal, i) : n;
        at->deep_m[i] = at->count > 0u ? cr_way_rise(c, i, piece_width(c, i, m)) - height_m[i] : NEVER_M;
    }
}

/* Lanes whose way may be longer than what is known, by the plane that they are inside of. */
static uint32_t find_longer(const cr_way_spots *at, uint32_t lanes, const float *part, const cr_way_half *half) {
    const cr_way_known *own = &at->planes[0];
    const float known_m = half->depth_m + CR_WAY_SLACK_M, far = FAR_MAX * half->deep_m;
    const float flat_leaves = v3_dot(own->normal, half->normal);
    uint32_t known = 0u;
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const float leaves = own->curved ? v3_dot(lane_of(at->normal, i), half->normal) : flat_leaves;
        /* deep / leaves or far, without a division */
        const int by_own = (leaves > CR_WAY_LEAVES_MIN) & (part[i] * at->deep_m[i] <= known_m * leaves);
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
    w->row = w->asking = w->asked = 0u;
    w->parts = 2u * PARTS_OF_LANE * cr_count_lanes(lanes);
}

/* How far the piece of a lane reaches along the plane of a row. */
static inline float reach_along(const cr_way_rest *r, int i, const cr_way_rows *e, uint32_t k) {
    const float width = piece_width(r->c, i, e->curved[k] ? lane_of(r->normal, i) : e->normal[k]);
    return 0.5f * CR_WAY_REACH * width + r->c->reach[i];
}

/* Ways through one row of planes: the next of those that bound the lanes. With vectors the reach is a loop of its own, or neither would be vector code. */
static void find_ways(const cr_way_rest *r, uint32_t lanes, const cr_way_rows *e, cr_way_ways *w) {
    float reach_m[CR_LANES];
    const uint32_t k = w->row++;
    const float trusted = k < e->own ? 1.0f : 0.0f;
    for (int i = 0; i < CR_LANES && !CR_SCALAR; i++) {
        reach_m[i] = reach_along(r, i, e, k);
    }
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const float leaves = e->leaves[k][i], h = e->height_m[k][i];
        const float reach = CR_SCALAR ? reach_along(r, i, e, k) : reach_m[i];
        const float per = 1.0f / higher_f(leaves, CR_WAY_LEAVES_MIN);
        const int there = leaves > CR_WAY_NO_PLANE, bounds = there & ((leaves > CR_WAY_LEAVES_MIN) | (h > 0.0f));
        const float least = there ? -(h + reach) * per : NEVER_M;
        w->middle_m[i] = bounds ? lower_f(w->middle_m[i], -h * per) : w->middle_m[i];
        w->most_m[i] = bounds ? lower_f(w->most_m[i], (reach - h) * per) : w->most_m[i];
        w->steep[i] = higher_f(w->steep[i], trusted * leaves);
        w->second_m[i] = lower_f(w->second_m[i], higher_f(w->first_m[i], least));
        w->first_m[i] = lower_f(w->first_m[i], least);
    }
}

/* May a lane be, by all rows, deeper than what is known? */
static inline int lane_is_deeper(const cr_way_rest *r, const cr_way_ways *w, int i) {
    const float far = FAR_MAX * r->half->deep_m + r->c->ramp[i];
    return r->part[i] * lower_f(far, w->most_m[i]) > r->half->depth_m;
}

/* The way of a lane that leaves through planes alone, which are the exits of all lanes. */
static float way_by_planes(cr_way_rest *r, int i, float most_m, float known_m, uint32_t *places) {
    for (uint32_t k = 0; k < r->exits.count; k++) {
        r->exits.height_m[k] = r->height_m[k][i];
    }
    return min_f(most_m, cr_way_longest(r->c, i, &r->exits, known_m, places));
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

/* All rows are known: lanes with but one exit count; those that may be longer wait for all of their exits. Where no plane that is trusted leads out of them
 * steeply enough they first ask how far those are that bound them, and then march. */
static void end_ways(const cr_way_survey *s) {
    cr_way_rest *r = &s->scratch->rest;
    const cr_way_rows *e = &s->scratch->rows;
    cr_way_half *half = r->half;
    cr_way_ways *w = &s->scratch->ways;
    const uint32_t lanes = s->work->left, smooth = lanes & ~(uint32_t)r->c->crease_mask;
    const float trusted = cr_way_trusted(half);
    uint32_t steep = 0u, left = 0u, plain = 0u;
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const float far = FAR_MAX * half->deep_m + r->c->ramp[i];
        const float way = r->part[i] * lower_f(far, higher_f(0.0f, w->middle_m[i]));
        const int alone = (w->second_m[i] > w->most_m[i]) & (w->steep[i] >= trusted) & has_lane(smooth, i);
        half->depth_m = alone ? higher_f(half->depth_m, way) : half->depth_m;
        plain |= (uint32_t)alone << i;
    }
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        left |= (uint32_t)lane_is_deeper(r, w, i) << i;
        steep |= (uint32_t)(w->steep[i] >= trusted) << i;
    }
    left &= lanes & ~plain;
    s->work->spent += w->parts;
    s->work->left = left;
    if ((left & ~steep) != 0u && w->asking == 0u && e->own < e->count) {
        w->asking = left & ~steep;
        w->asked = e->own;
        return;
    }
    r->looks = CR_WAY_LANE_BY_LANE;
    if ((left & ~steep) != 0u) {
        begin_march(s, lanes, left & ~steep);
    }
}

/* The next row of planes for all lanes; or how far the next one that bounds them is trusted, by those that ask; or the end of all. */
static void take_row(const cr_way_survey *s) {
    cr_way_scratch *scratch = s->scratch;
    const cr_way_rows *e = &scratch->rows;
    cr_way_ways *w = &scratch->ways;
    s->work->spent += PARTS_OF_ROW;
    if (w->row < e->count) {
        if (!(w->row < e->own)) {
            const uint32_t lanes = s->work->left, high = cr_way_find_ends(s->in, lanes, w->row, scratch);
            s->work->spent += PARTS_OF_HIGH * cr_count_lanes(lanes) + PARTS_OF_MEETS * high;
        }
        find_ways(&scratch->rest, s->work->left, e, w);
        s->work->spent += w->parts;
    } else if (w->asking != 0u && w->asked < e->count) {
        s->work->spent += PARTS_OF_MEETS * cr_count_lanes(w->asking);
        cr_way_trust(s->in, w->asking, w->asked++, scratch);
    } else {
        end_ways(s);
    }
}

/* The next lane, by all of its exits. */
static void take_lane_left(const cr_way_survey *s) {
    cr_way_work *w = s->work;
    cr_way_rest *r = &s->scratch->rest;
    const uint32_t planes = r->exits.count, exits = planes > 0u ? planes : s->scratch->rows.count;
    const int i = take_lane(&w->left);
    uint32_t places = 1u;
    const float most_m = FAR_MAX * r->half->deep_m + r->c->ramp[i], known_m = r->half->depth_m / r->part[i];
    const float way_m = planes > 0u ? way_by_planes(r, i, most_m, known_m, &places)
                                    : cr_way_of_lane(s->scratch, i, most_m, known_m, &places);
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
    if (!cr_way_find_exits(half, at, rest)) {
        rest->looks = CR_WAY_ROW_BY_ROW;
        cr_way_find_rows(half, at, lanes, &scratch->rows);
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
        if (has_lane(s->work->shallow, (int)r->half_of[b]) || !is_next(s, parts)) {
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
