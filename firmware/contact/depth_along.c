/* depth_along: how deep each half-space is: the way of the deepest tool surface along its normal to the first exit. WAY_OUT.md "Depth". */
#include "contact/way_out.h"

/* No way out is longer than this many times the depth of the deepest sample, and half a sample. */
#define FAR_MAX 4.0f
/* Share of a half-space's weight from which on a plane bounds it in full. */
#define SEEN 0.02f
/* Cosine of normal and plane from which on the exit through the plane is trusted; below the least one it is looked for along the normal. Where planes are all
 * there is they are trusted longer than beside a curved surface, whose exit no plane tells. */
#define STEEP 0.5f
#define STEEP_MIN 0.3f
#define STEEP_CURVED 0.95f
#define STEEP_MIN_CURVED 0.7f
/* Share of curved zones in a half-space from which on they count in full. */
#define CURVED 0.25f
/* Most steps of a march, each as long as the distance. */
#define MARCH_STEPS 12
/* A march ends this near the surface, as a share of the sample's reach. */
#define MARCH_END 0.02f
/* A sample of a curved surface counts in full for a side from this share on; one side at least has a third. */
#define SIDE_FULL 0.25f

#define NEVER_M 3.0e38f
/* Less than any cosine: no plane of this lane. */
#define NO_PLANE (-2.0f)
/* A way that is longer than another by less than this is as long, m: on a face that lies flat no sample is looked at twice. */
#define SLACK_M 1e-7f

/* What is measured. */
typedef struct {
    const cr_respond_input *in;
    const cr_way_zones *zones;
    const cr_way_relations *relations;
    cr_way_half *half;
    cr_way_scratch *scratch;
    cr_way_work *work;
    uint32_t lookups_max;
} survey;

/* Work, in lookups of 16 points: of a hit whose planes are known, and of one to be looked up again; of lanes whose longest way is looked for on their
 * pieces, and of those where it takes all exits, one in so many; of half-spaces that lanes may count for; of a zone that joins others, a pair of them in so
 * many; of pairs of half-spaces. */
#define WORK_OF_HIT 2u
#define WORK_OF_LOOKUP 4u
#define LANES_OF_WORK 4u
#define FULL_OF_WORK 2u
#define HALVES_OF_WORK 2u
#define ZONES_OF_WORK 16u
#define PAIRS_OF_WORK 64u

/* Planes that are known at the lanes of a cluster. */
typedef struct {
    uint32_t facet;
    int curved;            /* 1: the normal is each lane's own */
    cr_vec3 normal;        /* tool frame */
    const float *height_m; /* [CR_LANES] */
} known;

/* Lanes of a cluster and the planes there: the first is the one they are inside of. Far from any surface none is known; the first has the distance
 * then, and no normal. */
typedef struct {
    const struct cr_img_cluster *c;
    uint32_t lanes;
    uint32_t count;
    known planes[CR_KIND_FACETS_MAX];
    const cr_lanes3 *normal; /* of the lanes, where a plane is curved */
    float deep_m[CR_LANES];  /* how deep each piece reaches below the first at most; NEVER_M where none is known */
} spots;

/* How far along the normal each of some lanes has to go until it is outside: steps as long as the distance. */
static void march(const survey *s, const struct cr_img_cluster *c, uint32_t lanes, cr_vec3 way, float most_m,
                  float *gone_m) {
    const cr_vec3 to = xform_rotate(s->in->world_from_tool, way);
    cr_lanes3 *place = &s->scratch->march_world, *from = &s->scratch->march_from;
    cr_lookup *found = &s->scratch->march;
    cr_lanes_to_world(s->in->world_from_tool, c->x, c->y, c->z, from);
    for (int i = 0; i < CR_LANES; i++) {
        gone_m[i] = 0.0f;
    }
    for (int step = 0; step < MARCH_STEPS && lanes != 0u; step++) {
        for (int i = 0; i < CR_LANES; i++) {
            place->x[i] = from->x[i] + to.x * gone_m[i];
            place->y[i] = from->y[i] + to.y * gone_m[i];
            place->z[i] = from->z[i] + to.z * gone_m[i];
        }
        cr_field_look_up_lanes(s->in->field, place, lanes, found);
        s->work->spent += 1u;
        for (uint32_t left = lanes; left != 0u;) {
            const int i = take_lane(&left);
            if (found->phi_m[i] < -MARCH_END * c->ramp[i]) {
                gone_m[i] -= found->phi_m[i];
            } else {
                lanes &= ~(1u << i);
            }
            lanes &= gone_m[i] < most_m ? 0xffffffffu : ~(1u << i);
        }
    }
}

/* Is a plane among those that are known at some lanes? */
static int is_known(const spots *at, uint32_t facet) {
    uint32_t k = 0u;
    while (k < at->count && at->planes[k].facet != facet) {
        k++;
    }
    return k < at->count;
}

/* The planes that bound a half-space, but for those that are known. One that a lane is above does not bound it, unless the static object surely
 * ends there. */
static void add_bounds(const cr_way_half *half, const spots *at, uint32_t lanes, cr_way_rows *e) {
    for (uint32_t b = 0; b < half->bound_count; b++) {
        const cr_way_bound *q = &half->bounds[b];
        /* A plane that is hardly touched yet is hardly left through: it comes from afar. */
        const float seen = min_f(1.0f, q->weight_m3 / (SEEN * half->weight_m3));
        const float leaves = v3_dot(q->normal, half->normal) * q->part * seen;
        if (is_known(at, q->facet) || !(leaves > CR_WAY_LEAVES_MIN)) {
            continue;
        }
        const struct cr_img_cluster *c = at->c;
        float *height = e->height_m[e->count], *steep = e->leaves[e->count];
        for (int i = 0; i < CR_LANES; i++) {
            if (CR_SCALAR && !has_lane(lanes, i)) {
                continue;
            }
            const float h = q->normal.x * c->x[i] + q->normal.y * c->y[i] + q->normal.z * c->z[i] + q->offset_m;
            height[i] = h;
            steep[i] = h < 0.0f || q->sure != 0u ? leaves : NO_PLANE;
        }
        e->curved[e->count] = 0;
        e->normal[e->count++] = q->normal;
    }
}

static void find_own(const cr_way_half *half, const spots *at, uint32_t lanes, cr_way_rows *e) {
    e->count = at->count;
    for (uint32_t k = 0; k < at->count; k++) {
        const known *p = &at->planes[k];
        const float leaves = p->curved ? 0.0f : v3_dot(p->normal, half->normal);
        e->normal[k] = p->normal;
        e->curved[k] = p->curved;
        for (int i = 0; i < CR_LANES; i++) {
            if (CR_SCALAR && !has_lane(lanes, i)) {
                continue;
            }
            e->height_m[k][i] = p->height_m[i];
            e->leaves[k][i] = p->curved ? v3_dot(lane_of(at->normal, i), half->normal) : leaves;
        }
    }
}

/* Of each lane: the way to the first exit from its middle, the most it may be from anywhere on its piece, how steep the steepest exit is, and
 * whether but one exit can be the first. */
typedef struct {
    float middle_m[CR_LANES], most_m[CR_LANES], steep[CR_LANES];
    uint32_t plain;
} ways;

static void find_reach(const spots *at, uint32_t lanes, const cr_way_rows *e, uint32_t k, float *reach_m) {
    const struct cr_img_cluster *c = at->c;
    const cr_lanes3 *normal = at->normal;
    for (int i = 0; i < CR_LANES; i++) {
        if (CR_SCALAR && !has_lane(lanes, i)) {
            continue;
        }
        reach_m[i] = cr_way_half_width(c, i, e->curved[k] ? lane_of(normal, i) : e->normal[k]);
    }
}

/* Not filled with zeros: there is one for each plane of each hit. */
static void set_spots(spots *at, const struct cr_img_cluster *c, uint32_t lanes, uint32_t count) {
    at->c = c;
    at->lanes = lanes;
    at->count = count;
    at->normal = NULL;
}

/* How deep below the plane that they are inside of the pieces of the lanes reach. */
static void find_deep(spots *at) {
    const known *own = &at->planes[0];
    for (int i = 0; i < CR_LANES; i++) {
        if (CR_SCALAR && !has_lane(at->lanes, i)) {
            continue;
        }
        const cr_vec3 n = own->curved ? lane_of(at->normal, i) : own->normal;
        at->deep_m[i] = at->count > 0u ? cr_way_half_width(at->c, i, n) - own->height_m[i] : NEVER_M;
    }
}

/* Lanes whose way may be longer than what is known, by the plane that they are inside of. */
static uint32_t find_longer(const spots *at, uint32_t lanes, const float *part, const cr_way_half *half) {
    const known *own = &at->planes[0];
    const float far = FAR_MAX * half->deep_m, flat_leaves = v3_dot(own->normal, half->normal);
    uint32_t longer = 0u;
    for (int i = 0; i < CR_LANES; i++) {
        if (CR_SCALAR && !has_lane(lanes, i)) {
            continue;
        }
        const float leaves = own->curved ? v3_dot(lane_of(at->normal, i), half->normal) : flat_leaves;
        /* deep / leaves or far, without a division */
        const int by_own = (leaves > CR_WAY_LEAVES_MIN) & (part[i] * at->deep_m[i] <= half->depth_m * leaves + SLACK_M);
        const int by_far = part[i] * (far + at->c->ramp[i]) <= half->depth_m;
        longer |= (uint32_t)(!(by_own | by_far)) << i;
    }
    return longer & lanes;
}

static void find_ways(const spots *at, uint32_t lanes, const cr_way_rows *e, float trusted, ways *w) {
    const struct cr_img_cluster *c = at->c;
    float first[CR_LANES], second[CR_LANES]; /* the two least that exits may be anywhere on a piece */
    for (int i = 0; i < CR_LANES; i++) {
        w->middle_m[i] = w->most_m[i] = first[i] = second[i] = NEVER_M;
        w->steep[i] = 0.0f;
    }
    for (uint32_t k = 0; k < e->count; k++) {
        float reach[CR_LANES];
        find_reach(at, lanes, e, k, reach);
        for (int i = 0; i < CR_LANES; i++) {
            if (CR_SCALAR && !has_lane(lanes, i)) {
                continue;
            }
            const float leaves = e->leaves[k][i], h = e->height_m[k][i];
            const float per = 1.0f / higher_f(leaves, CR_WAY_LEAVES_MIN);
            const int there = leaves > NO_PLANE, bounds = there & ((leaves > CR_WAY_LEAVES_MIN) | (h > 0.0f));
            const float least = there ? -(h + reach[i]) * per : NEVER_M;
            w->middle_m[i] = bounds ? lower_f(w->middle_m[i], -h * per) : w->middle_m[i];
            w->most_m[i] = bounds ? lower_f(w->most_m[i], (reach[i] - h) * per) : w->most_m[i];
            w->steep[i] = higher_f(w->steep[i], leaves);
            second[i] = lower_f(second[i], higher_f(first[i], least));
            first[i] = lower_f(first[i], least);
        }
    }
    w->plain = 0u;
    for (int i = 0; i < CR_LANES; i++) {
        if (CR_SCALAR && !has_lane(lanes, i)) {
            continue;
        }
        w->plain |= (uint32_t)((second[i] > w->most_m[i]) & (w->steep[i] >= trusted)) << i;
    }
    w->plain &= ~(uint32_t)c->crease_mask;
}

/* How far the exit through planes is trusted, the steepest of them so steep. */
static float sure_of(const cr_way_half *half, float steep) {
    const float curved = min_f(1.0f, half->curved_m3 / (CURVED * half->weight_m3));
    const float flat = clamp_f((steep - STEEP_MIN) / (STEEP - STEEP_MIN), 0.0f, 1.0f);
    const float beside = clamp_f((steep - STEEP_MIN_CURVED) / (STEEP_CURVED - STEEP_MIN_CURVED), 0.0f, 1.0f);
    return flat + curved * (beside - flat);
}

/* One lane in full: anywhere on its piece; where the normal hardly leaves through the planes by what a march found. */
static float way_of_lane(const spots *at, const cr_way_half *half, const cr_way_rows *e, int i, float steep,
                         const float *gone_m) {
    cr_way_exits exits;
    exits.count = 0u;
    for (uint32_t k = 0; k < e->count; k++) {
        if (e->leaves[k][i] > NO_PLANE) {
            exits.normal[exits.count] = e->curved[k] ? lane_of(at->normal, i) : e->normal[k];
            exits.height_m[exits.count] = e->height_m[k][i];
            exits.leaves[exits.count++] = e->leaves[k][i];
        }
    }
    const float most_m = FAR_MAX * half->deep_m + at->c->ramp[i],
                way_m = exits.count > 0u ? min_f(most_m, cr_way_longest(at->c, i, &exits)) : most_m;
    const float sure = sure_of(half, steep);
    return sure < 1.0f ? sure * way_m + (1.0f - sure) * min_f(gone_m[i], way_m) : way_m;
}

/* Some flat planes and no other bound what the lanes leave, and one of them steeply enough: the exits, but for the heights of a lane. */
static int exits_of_planes(const spots *at, const cr_way_half *half, cr_way_exits *out) {
    float steep = 0.0f;
    for (uint32_t b = 0; b < half->bound_count; b++) {
        if (!is_known(at, half->bounds[b].facet)) {
            return 0;
        }
    }
    out->count = at->count;
    for (uint32_t k = 0; k < at->count; k++) {
        out->normal[k] = at->planes[k].normal;
        out->leaves[k] = v3_dot(at->planes[k].normal, half->normal);
        steep = max_f(steep, out->leaves[k]);
    }
    return at->count > 1u && half->curved_m3 <= 0.0f && steep >= STEEP;
}

/* Lanes count by the exits through planes alone. */
static void count_by_planes(const spots *at, uint32_t lanes, const float *part, cr_way_exits *e, cr_way_half *half) {
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        for (uint32_t k = 0; k < e->count; k++) {
            e->height_m[k] = at->planes[k].height_m[i];
        }
        const float way_m = min_f(FAR_MAX * half->deep_m + at->c->ramp[i], cr_way_longest(at->c, i, e));
        half->depth_m = max_f(half->depth_m, part[i] * way_m);
    }
}

/* Lanes count for a half-space by their exits, each by its part. */
static void count_for(const survey *s, const spots *at, uint32_t lanes, const float *part, cr_way_half *half) {
    cr_way_rows *e = &s->scratch->rows;
    cr_way_exits exits;
    ways w;
    float gone[CR_LANES], most = 0.0f;
    const float trusted = half->curved_m3 > 0.0f ? STEEP_CURVED : STEEP;
    uint32_t steep = 0u, left = 0u;
    s->work->spent += (count_lanes(lanes) + LANES_OF_WORK - 1u) / LANES_OF_WORK;
    if (lanes == 0u) {
        return;
    }
    if (exits_of_planes(at, half, &exits)) {
        count_by_planes(at, lanes, part, &exits, half);
        return;
    }
    find_own(half, at, lanes, e);
    add_bounds(half, at, lanes, e);
    find_ways(at, lanes, e, trusted, &w);
    for (int i = 0; i < CR_LANES; i++) {
        if (CR_SCALAR && !has_lane(lanes, i)) {
            continue;
        }
        const float far = FAR_MAX * half->deep_m + at->c->ramp[i];
        const float way = part[i] * lower_f(far, higher_f(0.0f, w.middle_m[i]));
        half->depth_m = ((lanes & w.plain) >> i) & 1u ? higher_f(half->depth_m, way) : half->depth_m;
    }
    for (int i = 0; i < CR_LANES; i++) {
        if (CR_SCALAR && !has_lane(lanes, i)) {
            continue;
        }
        const float far = FAR_MAX * half->deep_m + at->c->ramp[i];
        most = ((lanes >> i) & 1u) != 0u ? higher_f(most, far) : most;
        left |= (uint32_t)(part[i] * lower_f(far, w.most_m[i]) > half->depth_m) << i;
        steep |= (uint32_t)(w.steep[i] >= trusted) << i;
    }
    left &= lanes & ~w.plain;
    s->work->spent += count_lanes(left) / FULL_OF_WORK;
    if ((left & ~steep) != 0u) {
        march(s, at->c, left & ~steep, half->normal, most, gone);
    }
    while (left != 0u) {
        const int i = take_lane(&left);
        half->depth_m = max_f(half->depth_m, part[i] * way_of_lane(at, half, e, i, w.steep[i], gone));
    }
}

/* How near a lane is to another zone: 1 where it is no deeper below that one's mean plane than it is in its own, 0 from twice that on or above. */
static float nearness(const survey *s, const spots *at, int i, uint32_t other) {
    const struct cr_img_cluster *c = at->c;
    const cr_vec3 p = v3(c->x[i], c->y[i], c->z[i]);
    const float mine = higher_f(0.0f, -at->planes[0].height_m[i]), ramp = c->ramp[i],
                its = v3_dot(s->relations->unit[other], v3_sub(s->relations->touched[other], p));
    return clamp_f((2.0f * mine + ramp - its) / (mine + ramp), 0.0f, 1.0f) * clamp_f(its / ramp, 0.0f, 1.0f);
}

/* Is it the turn of the next half-space that lanes of the hit in hand count for? Those of an earlier tick are passed over; when the work of this one is
 * done the rest waits. One at least has its turn. */
static int is_next(const survey *s) {
    cr_way_work *w = s->work;
    if (w->seen++ < w->done || (w->spent >= s->lookups_max && w->done > w->begun)) {
        return 0;
    }
    w->done++;
    w->spent += w->done % HALVES_OF_WORK == 0u;
    return 1;
}

/* Lanes count for their zone; where that does not lead, for those that it is related to and they are near to. */
static void count_in_zone(const survey *s, const spots *at, uint32_t lanes, uint32_t z, const float *part) {
    const cr_way_relations *r = s->relations;
    for (uint32_t b = 0; b < s->zones->count; b++) {
        const float most = b == z ? r->lead[z] : (1.0f - r->lead[z]) * r->part[z][b] * r->lead[b];
        cr_way_half *half = &s->half[r->half_of[b]];
        float share[CR_LANES];
        if (!(most > 0.0f && is_next(s))) {
            continue;
        }
        for (int i = 0; i < CR_LANES; i++) {
            share[i] = part[i] * most;
        }
        const uint32_t longer = find_longer(at, lanes, share, half);
        for (uint32_t left = b == z ? 0u : longer; left != 0u;) {
            const int i = take_lane(&left);
            share[i] *= nearness(s, at, i, b);
        }
        if (longer != 0u) {
            count_for(s, at, b == z ? longer : find_longer(at, longer, share, half), share, half);
        }
    }
}

static void count_lanes_for(const survey *s, spots *at, uint32_t surface, uint32_t side, const float *part) {
    find_deep(at);
    for (int slot = 0; slot < CR_PIECES; slot++) {
        const cr_way_key key = {surface, side, at->c->piece[slot]};
        const uint32_t lanes = at->lanes & at->c->piece_lanes[slot];
        const uint32_t z = key.piece == CR_PIECE_NONE || lanes == 0u ? CR_WAY_NONE : cr_way_find(s->zones, key);
        if (z != CR_WAY_NONE) {
            s->work->spent += 1u;
            count_in_zone(s, at, lanes, z, part);
        }
    }
}

static const float whole[CR_LANES] = {1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f,
                                      1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f};

/* Lanes where the static object is convex, bounded by planes: each is inside of the nearest, and knows the others. */
static void over_solid(const survey *s, const struct cr_img_cluster *c, uint32_t lanes, const cr_planes *p,
                       const cr_heights *h) {
    for (uint32_t top = 0; top < p->count; top++) {
        spots at;
        set_spots(&at, c, lanes & h->highest[top], p->count);
        for (uint32_t k = 0; k < p->count; k++) {
            const uint32_t to = k == top ? 0u : k == 0u ? top : k;
            at.planes[to] = (known){p->facet[k], 0, p->normal_tool[k], h->height_m[k]};
        }
        if (at.lanes != 0u) {
            count_lanes_for(s, &at, p->facet[top], 0u, whole);
        }
    }
}

/* Lanes behind walls that meet concavely: each wall on its own, as far as the piece reaches behind it. */
static void behind_walls(const survey *s, const struct cr_img_cluster *c, uint32_t lanes, const cr_planes *p,
                         const cr_heights *h) {
    float height_m[CR_LANES] = {0.0f};
    for (uint32_t k = 0; k < p->count; k++) {
        spots at;
        set_spots(&at, c, 0u, 1u);
        for (int i = 0; i < CR_LANES; i++) {
            height_m[i] = -h->height_m[k][i];
            at.lanes |= (uint32_t)(height_m[i] < c->ramp[i]) << i;
        }
        at.lanes &= lanes;
        at.planes[0] = (known){p->facet[k], 0, v3_scale(p->normal_tool[k], -1.0f), height_m};
        if (at.lanes != 0u) {
            count_lanes_for(s, &at, p->facet[k], 0u, whole);
        }
    }
}

static void over_planes(const survey *s, const struct cr_img_cluster *c, uint32_t lanes, const cr_planes *all) {
    cr_heights *h = &s->scratch->heights;
    cr_planes *one = &s->scratch->alone;
    const cr_planes *p = cr_way_alone(s->in->field->scene, c, all, one);
    cr_planes_measure(p, c, h);
    if (p->sign < 0.0f) {
        behind_walls(s, c, lanes, p, h);
    } else {
        over_solid(s, c, lanes, p, h);
    }
}

/* Lanes over a curved surface, each by its own plane, for the sides that their normals have a part of. */
static void over_curved(const survey *s, spots *at, uint32_t surface, const cr_lookup *look, const float *height_m,
                        const float *share) {
    float part[CR_LANES];
    at->planes[0] = (known){CR_FACET_NONE, 1, v3(0.0f, 0.0f, 0.0f), height_m};
    for (uint32_t side = 0; side < CR_WAY_SIDES; side++) {
        uint32_t on = 0u;
        for (int i = 0; i < CR_LANES; i++) {
            const float its = share[i] * cr_way_share(v3(look->gx[i], look->gy[i], look->gz[i]), side);
            part[i] = lower_f(1.0f, its / SIDE_FULL);
            on |= (uint32_t)(its > 0.0f) << i;
        }
        spots some;
        set_spots(&some, at->c, at->lanes & on, 1u);
        some.normal = at->normal;
        some.planes[0] = at->planes[0];
        if (some.lanes != 0u) {
            count_lanes_for(s, &some, surface, side, part);
        }
    }
}

/* Lanes over a facet that is not curved. */
static void over_flat(const survey *s, spots *at, uint32_t index, const float *share) {
    float height_m[CR_LANES], part[CR_LANES];
    const cr_vec3 n = cr_way_heights(s->in->field->scene, s->in->world_from_tool, at->c, index, height_m);
    for (int i = 0; i < CR_LANES; i++) {
        part[i] = lower_f(1.0f, share[i] / SIDE_FULL);
    }
    at->planes[0] = (known){index, 0, n, height_m};
    count_lanes_for(s, at, index, 0u, part);
}

/* Lanes that were looked up, on one surface, by their share. */
static void over_surface(const survey *s, const struct cr_img_cluster *c, uint32_t lanes, uint32_t surface,
                         const cr_lookup *look, const cr_lanes3 *normal, const float *share) {
    spots at;
    set_spots(&at, c, lanes, 1u);
    at.normal = normal;
    if (surface < CR_WAY_CURVED) {
        over_flat(s, &at, surface, share);
    } else {
        over_curved(s, &at, surface, look, look->phi_m, share);
    }
}

static void share_lane(cr_way_shares *out, uint32_t surface, int i, float share) {
    uint32_t k = 0u;
    while (k < out->count && out->surface[k] != surface) {
        k++;
    }
    if (k == CR_WAY_LAYERS_MAX || !(share > 0.0f)) {
        return;
    }
    if (k == out->count) {
        out->count++;
        out->surface[k] = surface;
        out->lanes[k] = 0u;
        for (int j = 0; j < CR_LANES; j++) {
            out->share[k][j] = 0.0f;
        }
    }
    out->lanes[k] |= 1u << i;
    out->share[k][i] += share;
}

/* Lanes far inside, where no surface is near: what bounds their half-spaces bounds them. */
static void over_nothing(const survey *s, const struct cr_img_cluster *c, uint32_t lanes, const cr_lookup *look) {
    const cr_vec3 none = {0.0f, 0.0f, 0.0f};
    spots at;
    set_spots(&at, c, lanes, 0u);
    at.planes[0] = (known){CR_FACET_NONE, 0, none, look->phi_m};
    count_lanes_for(s, &at, CR_WAY_NONE, 0u, whole);
}

/* Lanes in cells whose distances are not from planes. */
static void over_cells(const survey *s, const struct cr_img_cluster *c, uint32_t lanes, const cr_lookup *look,
                       const cr_lanes3 *world, const cr_lanes3 *normal) {
    const cr_field *f = s->in->field;
    uint32_t far = 0u;
    cr_way_shares *on = &s->scratch->shares;
    on->count = 0u;
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        cr_way_facets its;
        if ((look->entry[i] & CR_TOP_FAR) != 0u) {
            far |= 1u << i;
            continue;
        }
        cr_way_facets_of(f, look, i, lane_of(world, i), &its);
        if (its.count == 0u) {
            share_lane(on, CR_WAY_DEEP, i, 1.0f);
        }
        for (uint32_t k = 0; k < its.count; k++) {
            const struct cr_img_facet *facet = &f->scene->facets[its.facet[k]];
            share_lane(on, facet->curved ? CR_WAY_CURVED | facet->patch : its.facet[k], i, its.share[k]);
        }
    }
    if (far != 0u) {
        over_nothing(s, c, far, look);
    }
    for (uint32_t k = 0; k < on->count; k++) {
        over_surface(s, c, on->lanes[k], on->surface[k], look, normal, on->share[k]);
    }
}

static void looked_up(const survey *s, const struct cr_img_cluster *c, uint32_t lanes, const cr_lookup *look,
                      const cr_lanes3 *world, cr_planes *cell) {
    cr_lanes3 *normal = &s->scratch->normal;
    const uint32_t surface = cr_way_common(s->in->field, look, lanes);
    cr_way_normals(s->in->world_from_tool, look, normal);
    if (surface != CR_WAY_NONE) {
        over_surface(s, c, lanes, surface, look, normal, whole);
        return;
    }
    over_cells(s, c, lanes & ~look->on_planes, look, world, normal);
    lanes &= look->on_planes;
    while (lanes != 0u) {
        const uint32_t same = cr_way_same_cell(look, lanes);
        uint32_t first = same;
        const int i = take_lane(&first);
        lanes &= ~same;
        if (cell->kind != look->kind[i]) {
            cr_planes_turn(s->in->field->scene, s->in->world_from_tool, look->kind[i], cell);
        }
        over_planes(s, c, same, cell);
    }
}

/* Returns whether all of it is done. */
static int measure_hit(const survey *s, const cr_hit *hit, cr_planes *planes, cr_planes *cell) {
    const struct cr_img_cluster *c = &s->in->field->scene->clusters[hit->cluster];
    const uint32_t lanes = (uint32_t)(hit->covered | hit->near) & ((1u << c->count) - 1u);
    cr_lanes3 *world = &s->scratch->world;
    cr_lookup *look = &s->scratch->look;
    s->work->spent += hit->planes != 0u ? WORK_OF_HIT : WORK_OF_LOOKUP;
    s->work->begun = s->work->done;
    s->work->seen = 0u;
    if (cr_way_planes(s->in->field, s->in->world_from_tool, hit, planes, world, look)) {
        over_planes(s, c, lanes, planes);
    } else {
        looked_up(s, c, lanes, look, world, cell);
    }
    return s->work->seen == s->work->done;
}

/* Half-spaces that the samples of a hit may count for. */
static uint32_t halves_of(const survey *s, const cr_way_reach *reach) {
    const cr_way_relations *r = s->relations;
    uint32_t halves = 0u;
    for (uint32_t left = reach->zones; left != 0u;) {
        const uint32_t z = (uint32_t)take_lane(&left);
        halves |= 1u << r->half_of[z];
        for (uint32_t b = 0; b < s->zones->count && r->lead[z] < 1.0f; b++) {
            halves |= (uint32_t)(r->part[z][b] > 0.0f) << r->half_of[b];
        }
    }
    return halves;
}

/* May a hit be deeper than what is known? It is no deeper than its bound below a plane that it is inside of; the way through that is longer by the cosine. */
static int may_be_deeper(const survey *s, const cr_way_reach *reach) {
    for (uint32_t left = halves_of(s, reach); left != 0u;) {
        const cr_way_half *half = &s->half[take_lane(&left)];
        const float leaves = v3_dot(half->normal, reach->toward) - reach->spread;
        if (!(leaves > STEEP_MIN && reach->bound_m <= leaves * half->depth_m + SLACK_M)) {
            return 1;
        }
    }
    return 0;
}

/* Where the zones are deepest first: most others are then known not to be deeper. Returns whether the step is done. */
static int measure_step(const survey *s, uint32_t step, cr_planes *planes, cr_planes *cell) {
    const uint32_t hit = step < s->zones->count ? s->zones->zones[step].deep_hit : step - s->zones->count;
    uint32_t *measured = &s->work->measured[hit >> 5], bit = 1u << (hit & 31u);
    if ((*measured & bit) == 0u && may_be_deeper(s, &s->zones->reach[hit]) &&
        !measure_hit(s, &s->in->set->hits[hit], planes, cell)) {
        return 0;
    }
    *measured |= bit;
    s->work->done = 0u;
    return 1;
}

void cr_way_begin(const cr_respond_input *in, cr_way_work *work) {
    cr_way_relate(in->field->scene, &in->set->way, &work->relations);
    work->next = work->done = 0u;
    work->spent = in->set->way.count;
    for (uint32_t i = 0; i < CR_WAY_MEASURED; i++) {
        work->measured[i] = 0u;
    }
}

int cr_way_measure(const cr_respond_input *in, cr_way_work *work, uint32_t lookups_max) {
    const cr_way_zones *zones = &in->set->way;
    const survey s = {in, zones, &work->relations, work->half, &work->scratch, work, lookups_max};
    const uint32_t steps = 2u * zones->count + in->set->hit_count;
    cr_planes planes, cell;
    planes.kind = cell.kind = 0u;
    while (work->next < steps && work->spent < lookups_max) {
        const uint32_t step = work->next;
        if (step >= zones->count) {
            work->next += (uint32_t)measure_step(&s, step - zones->count, &planes, &cell);
            continue;
        }
        work->next++;
        cr_way_join(in->field->scene, zones, step, &work->relations, work->half);
        work->spent += 1u + zones->count * zones->count / ZONES_OF_WORK;
        if (step + 1u == zones->count) {
            cr_way_agree(&work->relations, work->half);
            work->spent += work->relations.half_count * work->relations.half_count / PAIRS_OF_WORK;
        }
    }
    return work->next == steps;
}
