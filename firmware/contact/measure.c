/* measure: hit by hit the surfaces that the lanes are over, for depth_along to count; over as many ticks as the work takes. WAY_OUT.md "Depth". */
#include "contact/way_out.h"

/* A sample of a curved surface counts in full for a side from this share on; one side at least has a third. */
#define SIDE_FULL 0.25f

/* Work, in parts of a unit: a hit that is looked up again, beside its lookup; a step, whatever it does; a zone that a hit is asked for, a half-space that
 * it may be deeper in, and a pair of zones; where it is asked whether it is, that, twice, each plane of the half-space and each lane; a lane that is told what it is over; a surface that is met, twice for a cell, and that is begun, beside zones that might be of it; a
 * side of it, if it is curved, and each lane there; a facet of a lane in a cell, beside surfaces that are told already, two a part, and one more of these; a
 * normal that is turned; of a cell where planes meet, and of a hit whose planes are known, each of them; of lanes above such, the same and one more, or
 * above one of a round surface. */
#define PARTS_OF_LOOKUP 96u
#define PARTS_OF_STEP 12u
#define PARTS_OF_ASKED 3u
#define PARTS_OF_DEEPER 3u
#define PARTS_OF_STEEP 5u
#define PARTS_OF_PAIR 2u
#define PARTS_OF_TOLD 12u
#define PARTS_OF_MET 6u
#define PARTS_OF_SURFACE 12u
#define PARTS_OF_SHARE 5u
#define PARTS_OF_FACET 37u
#define PARTS_OF_MADE 16u
#define PARTS_OF_TURNED 3u
#define PARTS_OF_PLANE 10u
#define PARTS_OF_ABOVE 30u
/* The same, of zones: one that is taken up, in each pass; a pair of them that is related, and whose ends are asked for; that leads, for each zone that both are related to; in a sweep of a
 * half-space that is made, and one more; of its sides, each compared with each; compared with another, or that may bound it, and once it is known; a pair of half-spaces. */
#define PARTS_OF_TAKEN 48u
#define PARTS_OF_RELATED 42u
#define PARTS_OF_ENDED 32u
#define PARTS_OF_LED 6u
#define PARTS_OF_SWEEP 7u
#define PARTS_OF_SIDES 2u
#define PARTS_OF_SAME 1u
#define PARTS_OF_AGREED 2u
#define PARTS_OF_HALVES 4u

/* Lanes that are told in a step what they are over. */
#define LANES_OF_STEP 4

/* Beside sides of a surface, as bits. */
#define FELT_ROUND (1u << CR_WAY_SIDES)

/* Not filled with zeros: there is one for each plane of each hit. */
static void set_spots(cr_way_spots *at, const struct cr_img_cluster *c, uint32_t lanes, uint32_t count) {
    at->c = c;
    at->lanes = lanes;
    at->count = count;
    at->normal = NULL;
}

static const float whole[CR_LANES] = {1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f,
                                      1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f};

/* Are the next surfaces of the hit in hand passed over? Those that are done, and when the work of this tick is, the rest. */
static int is_passed(const cr_way_survey *s, uint32_t count) {
    cr_way_work *w = s->work;
    const int passed = w->surfaces + count <= w->surfaces_done || cr_way_waits(s);
    w->surfaces += passed ? count : 0u;
    w->spent += PARTS_OF_MET;
    return passed;
}

/* What was begun is done, but for a half-space that waits. */
static void end_surface(const cr_way_survey *s) {
    cr_way_work *w = s->work;
    if (w->seen == w->done) {
        w->surfaces_done = w->surfaces;
        w->done = 0u;
        w->moved = 1u;
    }
}

/* The next surface. Returns the sides of it that have a zone, as bits, with FELT_ROUND where it is a facet that is felt as sides: none, when it is passed over. */
static uint32_t begin_surface(const cr_way_survey *s, uint32_t surface) {
    const uint32_t felt = cr_way_felt(s->in->field->scene, surface);
    cr_way_work *w = s->work;
    uint32_t sides = 0u;
    if (is_passed(s, 1u)) {
        return 0u;
    }
    w->surfaces++;
    w->seen = 0u;
    for (uint32_t z = 0; z < s->zones->count; z++) {
        const cr_way_key *k = &s->zones->zones[z].key;
        sides |= (uint32_t)(k->surface == felt) << k->side;
    }
    w->spent += PARTS_OF_SURFACE + s->zones->count / 2u;
    if (sides == 0u) {
        end_surface(s);
    }
    return sides != 0u && felt != surface ? sides | FELT_ROUND : sides;
}

/* When the work of this tick is done the rest of the sides wait, as half-spaces do. */
static int ends_at_side(const cr_way_survey *s) {
    const int waits = cr_way_waits(s);
    s->work->seen += (uint32_t)waits;
    return waits;
}

/* Lanes over a round surface, by their share, for those sides that have a zone and their normals a part of. */
static void count_sides(const cr_way_survey *s, cr_way_spots *at, uint32_t surface, uint32_t sides,
                        const cr_lanes3 *world, const float *share) {
    const uint32_t lanes = at->lanes, count = cr_count_lanes(lanes);
    float part[CR_LANES];
    while (sides != 0u && !ends_at_side(s)) {
        const uint32_t side = (uint32_t)take_lane(&sides);
        uint32_t on = 0u;
        s->work->spent += PARTS_OF_SHARE * (1u + count);
        for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
            const float its = share[i] * cr_way_share(lane_of(world, i), side);
            part[i] = lower_f(1.0f, its / SIDE_FULL);
            on |= (uint32_t)(its > 0.0f) << i;
        }
        at->lanes = lanes & on;
        if (at->lanes != 0u) {
            cr_way_count(s, at, surface, side, part);
        }
    }
    end_surface(s);
}

/* Lanes over a facet, or where no surface is near, each by its part; over a facet of a round surface for its sides, by their share. */
static void count_facet(const cr_way_survey *s, cr_way_spots *at, uint32_t index, uint32_t sides, const float *share,
                        const float *part) {
    if ((sides & FELT_ROUND) != 0u) {
        const cr_scene *scene = s->in->field->scene;
        cr_lanes3 *world = &s->scratch->beside;
        const cr_vec3 n = v3_from(scene->facets[index].normal);
        s->work->spent += PARTS_OF_ABOVE;
        for (int i = 0; i < CR_LANES; i++) {
            world->x[i] = n.x;
            world->y[i] = n.y;
            world->z[i] = n.z;
        }
        count_sides(s, at, cr_way_felt(scene, index), sides & ~FELT_ROUND, world, share);
        return;
    }
    cr_way_count(s, at, index, 0u, part);
    end_surface(s);
}

/* Lanes where the static object is convex, bounded by planes: each is inside of the nearest, and knows the others. */
static void over_solid(const cr_way_survey *s, const struct cr_img_cluster *c, uint32_t lanes, const cr_planes *p,
                       const cr_heights *h) {
    for (uint32_t top = 0; top < p->count; top++) {
        const uint32_t its = lanes & h->highest[top], sides = its != 0u ? begin_surface(s, p->facet[top]) : 0u;
        if (sides == 0u) {
            continue;
        }
        cr_way_spots at;
        set_spots(&at, c, its, p->count);
        for (uint32_t k = 0; k < p->count; k++) {
            const uint32_t to = k == top ? 0u : k == 0u ? top : k;
            at.planes[to] = (cr_way_known){p->facet[k], 0, p->normal_tool[k], h->height_m[k]};
        }
        count_facet(s, &at, p->facet[top], sides, whole, whole);
    }
}

/* Lanes behind walls that meet concavely: each wall on its own, as far as the piece reaches behind it. */
static void behind_walls(const cr_way_survey *s, const struct cr_img_cluster *c, uint32_t lanes, const cr_planes *p,
                         const cr_heights *h) {
    float height_m[CR_LANES] = {0.0f};
    for (uint32_t k = 0; k < p->count; k++) {
        const uint32_t sides = begin_surface(s, p->facet[k]);
        if (sides == 0u) {
            continue;
        }
        cr_way_spots at;
        set_spots(&at, c, 0u, 1u);
        for (int i = 0; i < CR_LANES; i++) {
            height_m[i] = -h->height_m[k][i];
            at.lanes |= (uint32_t)(height_m[i] < c->ramp[i]) << i;
        }
        at.lanes &= lanes;
        at.planes[0] = (cr_way_known){p->facet[k], 0, v3_scale(p->normal_tool[k], -1.0f), height_m};
        count_facet(s, &at, p->facet[k], sides, whole, whole);
    }
}

static void over_planes(const cr_way_survey *s, const struct cr_img_cluster *c, uint32_t lanes, const cr_planes *all) {
    cr_heights *h = &s->scratch->heights;
    cr_planes *one = &s->scratch->alone;
    const cr_planes *p = cr_way_alone(s->in->field->scene, c, all, one);
    cr_planes_measure(p, c, h);
    s->work->spent += PARTS_OF_ABOVE * (1u + p->count);
    if (p->sign < 0.0f) {
        behind_walls(s, c, lanes, p, h);
    } else {
        over_solid(s, c, lanes, p, h);
    }
}

/* Lanes over a curved surface, each by its own plane. */
static void over_curved(const cr_way_survey *s, cr_way_spots *at, uint32_t surface, uint32_t sides,
                        const cr_lanes3 *world, const float *share) {
    at->planes[0] = (cr_way_known){CR_FACET_NONE, 1, v3(0.0f, 0.0f, 0.0f), s->scratch->look.phi_m};
    at->normal = &s->scratch->beside;
    cr_way_normals(s->in->world_from_tool, world->x, world->y, world->z, at->lanes, &s->scratch->beside);
    s->work->spent += PARTS_OF_TURNED * cr_count_lanes(at->lanes);
    count_sides(s, at, surface, sides, world, share);
}

/* Lanes over a facet that is not curved. */
static void over_flat(const cr_way_survey *s, cr_way_spots *at, uint32_t index, uint32_t sides, const float *share) {
    float height_m[CR_LANES], part[CR_LANES];
    const cr_vec3 n = cr_way_heights(s->in->field->scene, s->in->world_from_tool, at->c, index, height_m);
    for (int i = 0; i < CR_LANES; i++) {
        part[i] = lower_f(1.0f, share[i] / SIDE_FULL);
    }
    at->planes[0] = (cr_way_known){index, 0, n, height_m};
    count_facet(s, at, index, sides, share, part);
}

/* Lanes that were looked up, on one surface, by their share. */
static void over_surface(const cr_way_survey *s, const struct cr_img_cluster *c, uint32_t lanes, uint32_t surface,
                         const cr_lanes3 *world, const float *share) {
    cr_way_spots at;
    const uint32_t sides = begin_surface(s, surface);
    if (sides == 0u) {
        return;
    }
    set_spots(&at, c, lanes, 1u);
    if (surface < CR_WAY_CURVED) {
        over_flat(s, &at, surface, sides, share);
    } else {
        over_curved(s, &at, surface, sides, world, share);
    }
}

static void share_lane(cr_way_shares *out, uint32_t surface, int i, float share, cr_vec3 n) {
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
            out->share[k][j] = out->normal[k].x[j] = out->normal[k].y[j] = out->normal[k].z[j] = 0.0f;
        }
    }
    out->lanes[k] |= 1u << i;
    out->share[k][i] += share;
    out->normal[k].x[i] += share * n.x;
    out->normal[k].y[i] += share * n.y;
    out->normal[k].z[i] += share * n.z;
}

/* Lanes far inside, where no surface is near: what bounds their half-spaces bounds them. */
static void over_nothing(const cr_way_survey *s, const struct cr_img_cluster *c, uint32_t lanes,
                         const cr_lookup *look) {
    const cr_vec3 none = {0.0f, 0.0f, 0.0f};
    cr_way_spots at;
    set_spots(&at, c, lanes, 0u);
    at.planes[0] = (cr_way_known){CR_FACET_NONE, 0, none, look->phi_m};
    const uint32_t sides = begin_surface(s, CR_WAY_NONE);
    if (sides != 0u) {
        count_facet(s, &at, CR_WAY_NONE, sides, whole, whole);
    }
}

/* What the next lanes in cells whose distances are not from planes are over. */
static void share_cells(const cr_way_survey *s) {
    const cr_field *f = s->in->field;
    const cr_lookup *look = &s->scratch->look;
    cr_way_shares *on = &s->scratch->shares;
    const uint32_t before = on->count;
    for (int told = 0; told < LANES_OF_STEP && on->left != 0u; told++) {
        const int i = take_lane(&on->left);
        cr_way_facets its;
        if ((look->entry[i] & CR_TOP_FAR) != 0u) {
            on->far |= 1u << i;
            continue;
        }
        cr_way_facets_of(f, look, i, lane_of(&s->scratch->world, i), &its);
        if (its.count == 0u) {
            share_lane(on, CR_WAY_DEEP, i, 1.0f, v3(look->gx[i], look->gy[i], look->gz[i]));
        }
        for (uint32_t k = 0; k < its.count; k++) {
            const struct cr_img_facet *facet = &f->scene->facets[its.facet[k]];
            share_lane(on, facet->curved == CR_FACET_CURVED ? CR_WAY_CURVED | facet->patch : its.facet[k], i,
                       its.share[k], its.normal[k]);
        }
        s->work->spent += its.count * (2u * PARTS_OF_FACET + on->count) / 2u;
    }
    s->work->spent += PARTS_OF_MADE * (on->count - before);
}

/* Lanes over one surface, or which of them are to be told, each by itself. */
static void tell(const cr_way_survey *s, uint32_t lanes) {
    const cr_lookup *look = &s->scratch->look;
    cr_way_shares *on = &s->scratch->shares;
    on->far = on->count = on->left = 0u;
    on->common = cr_way_common(s->in->field, look, lanes);
    s->work->spent += PARTS_OF_TOLD * cr_count_lanes(lanes);
    if (on->common == CR_WAY_NONE) {
        on->left = lanes & ~look->on_planes;
        return;
    }
    for (int i = 0; i < CR_LANES; i++) {
        on->normal[0].x[i] = look->gx[i];
        on->normal[0].y[i] = look->gy[i];
        on->normal[0].z[i] = look->gz[i];
    }
}

static void over_looked_up(const cr_way_survey *s, const struct cr_img_cluster *c, uint32_t lanes, cr_planes *cell) {
    const cr_lookup *look = &s->scratch->look;
    const cr_way_shares *on = &s->scratch->shares;
    cr_way_work *w = s->work;
    if (on->common != CR_WAY_NONE) {
        over_surface(s, c, lanes, on->common, &on->normal[0], whole);
        return;
    }
    if (on->far != 0u) {
        over_nothing(s, c, on->far, look);
    }
    for (uint32_t k = 0; k < on->count; k++) {
        over_surface(s, c, on->lanes[k], on->surface[k], &on->normal[k], on->share[k]);
    }
    lanes &= look->on_planes;
    while (lanes != 0u) {
        const uint32_t same = cr_way_same_cell(look, lanes);
        uint32_t first = same;
        const int i = take_lane(&first);
        lanes &= ~same;
        w->spent += PARTS_OF_MET;
        if (is_passed(s, CR_KIND_FACETS_MAX)) {
            continue;
        }
        const uint32_t after = w->surfaces + CR_KIND_FACETS_MAX;
        if (cell->kind != look->kind[i]) {
            cr_planes_turn(s->in->field->scene, s->in->world_from_tool, look->kind[i], cell);
        }
        w->spent += PARTS_OF_PLANE * cell->count;
        over_planes(s, c, same, cell);
        w->surfaces_done = w->surfaces_done == w->surfaces ? after : w->surfaces_done;
        w->surfaces = after;
        w->moved = 1u;
    }
}

/* A step of a hit: it is looked up, where its planes are not known; it is told what it is over; and that counts. Returns whether all of it is done. */
static int measure_hit(const cr_way_survey *s, const cr_hit *hit, cr_planes *planes, cr_planes *cell) {
    const struct cr_img_cluster *c = &s->in->field->scene->clusters[hit->cluster];
    const uint32_t lanes = (uint32_t)(hit->covered | hit->near) & first_lanes(c->count);
    cr_way_work *w = s->work;
    cr_way_scratch *scratch = s->scratch;
    w->surfaces = w->moved = 0u;
    if (hit->planes != 0u) {
        if (planes->kind != hit->planes) {
            cr_planes_turn(s->in->field->scene, s->in->world_from_tool, hit->planes, planes);
        }
        w->spent += PARTS_OF_PLANE * planes->count;
        over_planes(s, c, lanes, planes);
    } else if (hit->facet != CR_FACET_NONE) {
        over_surface(s, c, lanes, hit->facet, &scratch->world, whole);
    } else if (w->known == CR_WAY_ASKED) {
        w->known = CR_WAY_LOOKED_UP;
        cr_lanes_to_world(s->in->world_from_tool, c->x, c->y, c->z, &scratch->world);
        cr_field_look_up_lanes(s->in->field, &scratch->world, lanes, &scratch->look);
        w->spent += PARTS_OF_LOOKUP + scratch->look.parts;
        return 0;
    } else if (w->known == CR_WAY_LOOKED_UP) {
        w->known = CR_WAY_TOLD;
        tell(s, lanes);
        return 0;
    } else if (scratch->shares.left != 0u) {
        share_cells(s);
        return 0;
    } else {
        over_looked_up(s, c, lanes, cell);
    }
    return w->surfaces_done == w->surfaces;
}

/* Half-spaces that the samples of a hit may count for: those of its zones; any, where some are near that are in no zone yet and over more than one surface, or over a
 * round one, whose mean normal tells the zones. */
static uint32_t halves_of(const cr_way_survey *s, const cr_hit *hit, const cr_way_reach *reach) {
    const cr_way_relations *r = s->relations;
    const uint32_t all = (1u << r->half_count) - 1u;
    if ((hit->near & ~hit->covered) != 0u && reach->spread >= CR_WAY_NO_SPREAD) {
        return all;
    }
    uint32_t halves = 0u, pairs = 0u;
    for (uint32_t left = reach->zones; left != 0u;) {
        const uint32_t z = (uint32_t)take_lane(&left);
        CR_ASSERT(z < s->zones->count && r->half_of[z] < r->half_count);
        pairs += PARTS_OF_ASKED;
        if (s->zones->zones[z].flat == 0u) {
            halves = all;
            break;
        }
        for (uint32_t those = r->counts_for[z]; those != 0u;) {
            halves |= 1u << r->half_of[take_lane(&those)];
            pairs += PARTS_OF_PAIR;
        }
    }
    s->work->spent += pairs;
    return halves;
}

/* Half-spaces that a hit may be deeper in than what is known: those to be asked for. It is no deeper than its bound below a plane that it is inside of; the way
 * through that is longer by the cosine. */
static void bound_hit(const cr_way_survey *s, const cr_hit *hit, const cr_way_reach *reach) {
    cr_way_work *w = s->work;
    for (uint32_t left = halves_of(s, hit, reach); left != 0u;) {
        const uint32_t h = (uint32_t)take_lane(&left);
        const cr_way_half *half = &s->half[h];
        const float leaves = v3_dot(half->normal, reach->toward) - reach->spread;
        const int is_shallow =
            leaves > CR_WAY_LEAVES_MIN && reach->bound_m <= leaves * (half->depth_m + CR_WAY_SLACK_M);
        w->spent += PARTS_OF_DEEPER;
        w->asks |= (uint32_t)!is_shallow << h;
        w->shallow |= (uint32_t)is_shallow << h;
    }
}

/* The plane of a half-space that it leaves most steeply, and how steeply; null where none bounds it. */
static const cr_way_bound *steepest(const cr_way_half *half, float *leaves) {
    const cr_way_bound *best = NULL;
    *leaves = CR_WAY_LEAVES_MIN;
    for (uint32_t b = 0; b < half->bound_count; b++) {
        const float its = cr_way_leaves(half, &half->bounds[b]);
        if (its > *leaves) {
            best = &half->bounds[b];
            *leaves = its;
        }
    }
    return best;
}

/* May a hit be deeper in a half-space than what is known? Its lanes leave that, if not before, through the plane that is left most steeply: no later than from
 * anywhere on their pieces; where that plane is all there is, from their middles and the ends of creases. What is above it is out where they are over it, too. */
static int is_deeper(const cr_way_survey *s, const cr_hit *hit, const cr_way_half *half) {
    const cr_scene *scene = s->in->field->scene;
    const struct cr_img_cluster *c = &scene->clusters[hit->cluster];
    const uint32_t lanes = (uint32_t)(hit->covered | hit->near) & first_lanes(c->count);
    float leaves;
    const cr_way_bound *q = steepest(half, &leaves);
    uint32_t deeper = 0u;
    s->work->spent += PARTS_OF_STEEP * (2u + half->bound_count + cr_count_lanes(lanes));
    if (q == NULL) {
        return 1;
    }
    const struct cr_img_kind *kind = &scene->kinds[hit->planes];
    const uint32_t over = kind->count == 1u ? kind->facet[0] : hit->facet;
    const uint32_t rising = half->bound_count == 1u && over == q->facet ? c->crease_mask : 0xffffu;
    const float most_m = leaves * (half->depth_m + CR_WAY_SLACK_M);
    uint32_t at = 0u;
    while (at < kind->count && kind->facet[at] != q->facet) {
        at++;
    }
    const int ends = q->sure != 0u && at < kind->count;
    for (int i = lane_at(lanes, 0); i < CR_LANES && !(CR_SCALAR && deeper != 0u); i = lane_at(lanes, i + 1)) {
        const float h = height_above(c, i, q->normal, q->offset_m);
        const float rise = (float)((rising >> i) & 1u) * cr_way_rise(c, i, piece_width(c, i, q->normal));
        deeper |= (uint32_t) !(((h < 0.0f) | ends) & (rise - h <= most_m)) << i;
    }
    return (deeper & lanes) != 0u;
}

/* A step of a hit: half-spaces that it may be deeper in, by what is known of it, and then whether it is, one by one. Returns whether it is in none. */
static int ask_hit(const cr_way_survey *s, uint32_t hit) {
    cr_way_work *w = s->work;
    if (w->known == CR_WAY_UNKNOWN) {
        w->known = CR_WAY_BOUNDED;
        w->asks = w->shallow = 0u;
        w->deeper = (uint32_t)(s->zones->dropped + s->zones->layers.dropped > 0u);
        if (w->deeper == 0u) {
            bound_hit(s, &s->in->set->hits[hit], &s->zones->reach[hit]);
        }
    } else {
        const uint32_t h = (uint32_t)take_lane(&w->asks);
        const uint32_t is = (uint32_t)is_deeper(s, &s->in->set->hits[hit], &s->half[h]);
        w->deeper |= is;
        w->shallow |= (1u - is) << h;
    }
    w->known = w->asks == 0u && w->deeper != 0u ? CR_WAY_ASKED : w->known;
    return w->asks == 0u && w->deeper == 0u;
}

/* Where the zones are deepest first: most others are then known not to be deeper. Returns whether the hit is done. */
static int measure_step(const cr_way_survey *s, uint32_t step, cr_planes *planes, cr_planes *cell) {
    cr_way_work *w = s->work;
    const uint32_t hit = step < s->zones->count ? s->zones->zones[step].deep_hit : step - s->zones->count;
    uint32_t *measured = &w->measured[hit >> 5], bit = 1u << (hit & 31u);
    CR_ASSERT(hit < s->in->set->hit_count);
    /* what has been begun is ended: the answer is the same however it is cut */
    if ((*measured & bit) == 0u &&
        !(w->known < CR_WAY_ASKED ? ask_hit(s, hit) : measure_hit(s, &s->in->set->hits[hit], planes, cell))) {
        return 0;
    }
    *measured |= bit;
    w->known = CR_WAY_UNKNOWN;
    w->done = w->surfaces_done = 0u;
    return 1;
}

/* Passes over the zones before their half-spaces are known. */
enum { RELATE, LEAD, JOIN, ZONE_PASSES };
/* And over these before hits are measured. */
enum { AGREE, SHARE, HALF_PASSES };

/* A zone joins: step by step where its half-space is made. */
static uint32_t join_zone(const cr_scene *scene, const cr_way_zones *zones, cr_way_work *w, uint32_t z) {
    cr_way_relations *r = &w->relations;
    if (w->left == 0u) {
        const uint32_t halves = r->half_count;
        w->left = cr_way_join(scene, zones, z, r, w->half, &w->cone);
        w->next += (uint32_t)(w->left == 0u);
        return PARTS_OF_TAKEN + zones->count * (PARTS_OF_RELATED + PARTS_OF_SAME * (1u + halves));
    }
    const uint32_t related = cr_count_lanes(w->left);
    if (cr_way_turn(zones, z, r, w->half, &w->cone)) {
        w->left = 0u;
        w->next++;
        return PARTS_OF_SIDES * related * (2u + related);
    }
    return PARTS_OF_SWEEP * (4u + related);
}

/* A step of a pass over the zones. Returns its work, in parts. */
static uint32_t take_zone(const cr_respond_input *in, cr_way_work *w) {
    const cr_way_zones *zones = &in->set->way;
    cr_way_relations *r = &w->relations;
    const uint32_t n = zones->count, pass = w->next / n, z = w->next % n;
    if (pass == JOIN) {
        return join_zone(in->field->scene, zones, w, z);
    }
    w->next++;
    if (pass == RELATE) {
        const uint32_t asked = cr_way_relate(in->field->scene, in->world_from_tool, zones, z, r);
        return PARTS_OF_TAKEN + PARTS_OF_RELATED * z + PARTS_OF_ENDED * asked;
    }
    return PARTS_OF_TAKEN + PARTS_OF_LED * n * cr_way_lead(zones, z, r);
}

/* One half-space of a pass. */
static uint32_t take_half(const cr_way_zones *zones, cr_way_work *w, uint32_t step) {
    const cr_way_relations *r = &w->relations;
    const uint32_t pass = step / r->half_count, h = step % r->half_count;
    if (pass == AGREE) {
        return PARTS_OF_TAKEN + PARTS_OF_AGREED * zones->count * cr_way_agree(zones, r, h, w->half);
    }
    cr_way_share_arm(r->half_count, h, w->half);
    return PARTS_OF_TAKEN + PARTS_OF_HALVES * r->half_count;
}

void cr_way_begin(const cr_respond_input *in, cr_way_work *work) {
    CR_ASSERT(in->set->way.count <= CR_WAY_ZONES_MAX);
    work->next = work->resolving = work->left = 0u;
    work->known = CR_WAY_UNKNOWN;
    work->done = work->surfaces_done = 0u;
    work->spent = 0u;
    work->relations.half_count = 0u;
    work->relations.all_m3 = 0.0f;
    for (uint32_t i = 0; i < CR_WAY_MEASURED; i++) {
        work->measured[i] = 0u;
    }
}

int cr_way_measure(const cr_respond_input *in, cr_way_work *work, uint32_t lookups_max) {
    const cr_way_zones *zones = &in->set->way;
    const cr_way_survey s = {in, zones, &work->relations, work->half, &work->scratch, work, lookups_max};
    const uint32_t joined = ZONE_PASSES * zones->count;
    int is_whole = 0;
    cr_planes planes, cell;
    planes.kind = cell.kind = 0u;
    planes.count = cell.count = 0u;
    while (!is_whole && work->spent / CR_WORK_PARTS < lookups_max) {
        work->spent += PARTS_OF_STEP;
        const uint32_t agreed = joined + HALF_PASSES * work->relations.half_count; /* once they have joined */
        const uint32_t told = agreed + zones->count;
        if (work->next < joined) {
            work->spent += take_zone(in, work);
        } else if (work->left != 0u) {
            cr_way_go_on(&s);
        } else if (work->next < agreed) {
            work->spent += take_half(zones, work, work->next++ - joined);
        } else if (work->next < told) {
            work->spent += PARTS_OF_PAIR * cr_way_tell_counts(zones->count, work->next++ - agreed, &work->relations);
        } else if (work->next < told + zones->count + in->set->hit_count) {
            work->next += (uint32_t)measure_step(&s, work->next - told, &planes, &cell);
        } else {
            is_whole = 1;
        }
    }
    return is_whole;
}
