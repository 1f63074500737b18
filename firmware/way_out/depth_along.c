/* depth_along: how deep each half-space is: the way of the deepest tool surface along its normal to the first exit. README.md "Depth". */
#include "way_out/way_out.h"

/* How much deeper than what is nearest to a plane a sample elsewhere may be below it. */
#define BEYOND 2.0f
/* No way out is longer than this many times the depth of the deepest sample, and half a sample. */
#define FAR_MAX 4.0f
/* Share of a half-space's weight from which on a plane is seen well enough to say so. */
#define SEEN 0.05f
/* Cosine of normal and plane from which on the exit through the plane is trusted; below the least one it is looked for along the normal. */
#define STEEP 0.5f
#define STEEP_MIN 0.3f
#define MARCH_STEPS 12
/* A march ends this near the surface, as a share of the sample's reach. */
#define MARCH_END 0.02f
/* A sample of a curved surface counts in full for a side from this share on; one side at least has a third. */
#define SIDE_FULL 0.25f

/* What is measured. */
typedef struct {
    const cr_respond_input *in;
    const cr_way_zones *zones;
    const cr_way_relations *relations;
    cr_way_half *half;
} survey;

/* A sample and the planes known there: the first is the one it is inside of. */
typedef struct {
    const struct cr_img_cluster *c;
    int lane;
    cr_vec3 p; /* tool frame */
    uint32_t count;
    uint32_t facet[CR_KIND_FACETS_MAX];
    cr_vec3 normal[CR_KIND_FACETS_MAX];
    float height_m[CR_KIND_FACETS_MAX];
} spot;

/* How far along the normal a sample has to go until it is outside: steps as long as the distance. */
static float march(const survey *s, const spot *at, cr_vec3 way, float most_m) {
    const cr_vec3 from = xform_point(s->in->world_from_tool, at->p), to = xform_rotate(s->in->world_from_tool, way);
    cr_lanes3 place;
    cr_lookup found;
    float gone = 0.0f;
    for (int step = 0; step < MARCH_STEPS && gone < most_m; step++) {
        const cr_vec3 p = v3_mad(from, to, gone);
        for (int k = 0; k < CR_LANES; k++) {
            place.x[k] = p.x;
            place.y[k] = p.y;
            place.z[k] = p.z;
        }
        cr_field_look_up_lanes(s->in->field, &place, 1u, &found);
        if (!(found.phi_m[0] < -MARCH_END * at->c->ramp[at->lane])) {
            break;
        }
        gone -= found.phi_m[0];
    }
    return min_f(gone, most_m);
}

/* The planes that bound a half-space, but for those that are known at the sample. One that the sample is above does not bound it. */
static void add_bounds(const cr_way_half *half, const spot *at, cr_way_exits *e) {
    for (uint32_t b = 0; b < half->bound_count; b++) {
        const cr_way_bound *q = &half->bounds[b];
        uint32_t k = 0u;
        while (k < at->count && at->facet[k] != q->facet) {
            k++;
        }
        const float height = v3_dot(q->normal, at->p) + q->offset_m, leaves = v3_dot(q->normal, half->normal) * q->part;
        if (k == at->count && height < 0.0f && leaves > CR_WAY_LEAVES_MIN) {
            /* A plane that is hardly touched yet says nothing of how deep one may be below it. */
            const float seen = max_f(1e-6f, min_f(1.0f, q->weight_m3 / (SEEN * half->weight_m3)));
            e->normal[e->count] = q->normal;
            e->height_m[e->count] = max_f(height, -(BEYOND * q->deep_m + at->c->ramp[at->lane]) / seen);
            e->leaves[e->count++] = leaves;
        }
    }
}

/* A sample counts for a half-space by its exit. Where the normal hardly leaves through the planes it is looked for along the normal, if the
 * half-space holds most of the weight. */
static void count_for(const survey *s, const spot *at, cr_way_half *half, float part) {
    cr_way_exits e;
    float leaves = 0.0f;
    e.count = at->count;
    for (uint32_t k = 0; k < at->count; k++) {
        e.normal[k] = at->normal[k];
        e.height_m[k] = at->height_m[k];
        e.leaves[k] = v3_dot(at->normal[k], half->normal);
    }
    add_bounds(half, at, &e);
    for (uint32_t k = 0; k < e.count; k++) {
        leaves = max_f(leaves, e.leaves[k]);
    }
    const float most_m = FAR_MAX * half->deep_m + at->c->ramp[at->lane];
    float way_m = min_f(most_m, cr_way_longest(at->c, at->lane, &e));
    if (!(way_m * part > half->depth_m)) {
        return;
    }
    const float sure = clamp_f((leaves - STEEP_MIN) / (STEEP - STEEP_MIN), 0.0f, 1.0f);
    if (sure < 1.0f) {
        const float gone_m = half->rules > 0.0f ? march(s, at, half->normal, way_m) : 0.0f;
        way_m = sure * way_m + (1.0f - sure) * half->rules * gone_m;
    }
    half->depth_m = max_f(half->depth_m, part * way_m);
}

/* How near a sample is to another zone: 1 where it is no deeper below that one's mean plane than it is in its own, 0 from twice that on or above. */
static float nearness(const spot *at, const cr_way_zone *other) {
    const cr_vec3 n = v3_unit(v3_scale(other->normal_m3, 1.0f / other->weight_m3), 0.0f),
                  touched = v3_scale(other->touched_m4, 1.0f / other->weight_m3);
    const float mine = max_f(0.0f, -at->height_m[0]), its = v3_dot(n, v3_sub(touched, at->p)),
                ramp = at->c->ramp[at->lane];
    return clamp_f((2.0f * mine + ramp - its) / (mine + ramp), 0.0f, 1.0f) * clamp_f(its / ramp, 0.0f, 1.0f);
}

/* A sample counts for its zone; where that does not lead, for those that it is related to and near to. */
static void count_in_zone(const survey *s, const spot *at, uint32_t z, float part) {
    const cr_way_relations *r = s->relations;
    if (r->lead[z] > 0.0f) {
        count_for(s, at, &s->half[r->half_of[z]], part * r->lead[z]);
    }
    for (uint32_t b = 0; b < s->zones->count && r->lead[z] < 1.0f; b++) {
        const float share = b == z ? 0.0f : (1.0f - r->lead[z]) * r->part[z][b] * r->lead[b];
        const float near = share > 0.0f ? nearness(at, &s->zones->zones[b]) : 0.0f;
        if (near > 0.0f) {
            count_for(s, at, &s->half[r->half_of[b]], part * share * near);
        }
    }
}

static void count_spot(const survey *s, const spot *at, uint32_t surface, uint32_t side, float part) {
    for (int slot = 0; slot < CR_PIECES; slot++) {
        const cr_way_key key = {surface, side, at->c->piece[slot]};
        const uint32_t z = key.piece == CR_PIECE_NONE ? CR_WAY_NONE : cr_way_find(s->zones, key);
        if (z != CR_WAY_NONE) {
            count_in_zone(s, at, z, part);
        }
    }
}

/* A sample where the static object is convex, bounded by planes: it is inside of the nearest, and knows the others. */
static void over_solid(const survey *s, const cr_planes *p, spot *at) {
    uint32_t top = 0u;
    for (uint32_t k = 0; k < p->count; k++) {
        at->facet[k] = p->facet[k];
        at->normal[k] = p->normal_tool[k];
        at->height_m[k] = v3_dot(p->normal_tool[k], at->p) + p->offset_m[k];
        top = at->height_m[k] > at->height_m[top] ? k : top;
    }
    at->count = p->count;
    const uint32_t facet = at->facet[top];
    const cr_vec3 normal = at->normal[top];
    const float height_m = at->height_m[top];
    at->facet[top] = at->facet[0];
    at->normal[top] = at->normal[0];
    at->height_m[top] = at->height_m[0];
    at->facet[0] = facet;
    at->normal[0] = normal;
    at->height_m[0] = height_m;
    count_spot(s, at, facet, 0u, 1.0f);
}

/* A sample behind walls that meet concavely: each wall on its own, as far as the piece reaches behind it. */
static void behind_walls(const survey *s, const cr_planes *p, spot *at) {
    at->count = 1u;
    for (uint32_t k = 0; k < p->count; k++) {
        at->facet[0] = p->facet[k];
        at->normal[0] = v3_scale(p->normal_tool[k], -1.0f);
        at->height_m[0] = -(v3_dot(p->normal_tool[k], at->p) + p->offset_m[k]);
        if (at->height_m[0] < at->c->ramp[at->lane]) {
            count_spot(s, at, p->facet[k], 0u, 1.0f);
        }
    }
}

static void over_planes(const survey *s, const cr_planes *p, spot *at) {
    if (p->sign < 0.0f) {
        behind_walls(s, p, at);
    } else {
        over_solid(s, p, at);
    }
}

/* A sample that was looked up, over a facet or a curved surface: by one plane. */
static void over_one(const survey *s, const cr_lookup *look, cr_vec3 p_world, const cr_way_facets *on, uint32_t k,
                     spot *at) {
    const struct cr_img_facet *facet =
        on->facet[k] == CR_FACET_NONE ? NULL : &s->in->field->scene->facets[on->facet[k]];
    const cr_vec3 g = v3_unit(v3(look->gx[at->lane], look->gy[at->lane], look->gz[at->lane]), 1e-3f);
    at->count = 1u;
    at->facet[0] = on->facet[k];
    if (facet != NULL && !facet->curved) {
        at->normal[0] = xform_unrotate(s->in->world_from_tool, v3_from(facet->normal));
        at->height_m[0] = v3_dot(v3_from(facet->normal), p_world) - facet->offset_m;
        count_spot(s, at, on->facet[k], 0u, on->share[k] > 0.0f ? min_f(1.0f, on->share[k] / SIDE_FULL) : 0.0f);
        return;
    }
    at->normal[0] = xform_unrotate(s->in->world_from_tool, g);
    at->height_m[0] = look->phi_m[at->lane];
    for (uint32_t side = 0; side < CR_WAY_SIDES; side++) {
        const float part = on->share[k] * cr_way_share(g, side);
        if (part > 0.0f) {
            count_spot(s, at, facet == NULL ? CR_WAY_DEEP : CR_WAY_CURVED | facet->patch, side,
                       min_f(1.0f, part / SIDE_FULL));
        }
    }
}

static void looked_up(const survey *s, const cr_lookup *look, const cr_lanes3 *world, cr_planes *cell, spot *at) {
    const int i = at->lane;
    cr_way_facets on;
    if ((look->entry[i] & CR_TOP_FAR) != 0u) {
        return;
    }
    if (((look->from_facet >> i) & 1u) != 0u) {
        if (cell->kind != look->kind[i]) {
            cr_planes_turn(s->in->field->scene, s->in->world_from_tool, look->kind[i], cell);
        }
        over_planes(s, cell, at);
        return;
    }
    const cr_vec3 p_world = v3(world->x[i], world->y[i], world->z[i]);
    cr_way_facets_of(s->in->field, look, i, p_world, &on);
    if (on.count == 0u) {
        on.count = 1u;
        on.share[0] = 1.0f;
        on.facet[0] = CR_FACET_NONE;
    }
    for (uint32_t k = 0; k < on.count; k++) {
        over_one(s, look, p_world, &on, k, at);
    }
}

void cr_way_measure(const cr_respond_input *in, const cr_way_zones *zones, const cr_way_relations *relations,
                    cr_way_half *half) {
    const survey s = {in, zones, relations, half};
    cr_planes planes = {0}, cell = {0};
    for (uint32_t h = 0; h < in->set->hit_count; h++) {
        const cr_hit *hit = &in->set->hits[h];
        const struct cr_img_cluster *c = &in->field->scene->clusters[hit->cluster];
        cr_lanes3 world;
        cr_lookup look;
        const int known = cr_way_planes(in, hit, &planes, &world, &look);
        for (uint32_t left = (uint32_t)(hit->covered | hit->near) & ((1u << c->count) - 1u); left != 0u;) {
            spot at = {.c = c, .lane = take_lane(&left)};
            at.p = v3(c->x[at.lane], c->y[at.lane], c->z[at.lane]);
            if (known) {
                over_planes(&s, &planes, &at);
            } else {
                looked_up(&s, &look, &world, &cell, &at);
            }
        }
    }
}
