/* gather: what each piece of the tool is inside of. README.md "Zones". */
#include "way_out/way_out.h"

/* In a cell of many facets a sample counts for those whose planes explain its distance nearly as well as the best does: to this share of a voxel. */
#define EXPLAINS 0.5f
/* Least share of the full width over which a piece fades in. */
#define WIDTH_MIN 0.25f

/* Part of a piece that is inside, and the mean depth of all of it, what is outside counting as zero. */
typedef struct {
    float share, depth_m;
} part;

/* Of a piece over one plane. Across it the height varies evenly by sqrt(n W n), as the coverage has it. */
static part part_below(const struct cr_img_cluster *c, int i, cr_vec3 n, float height_m) {
    const float cross = c->wxy[i] * n.x * n.y + c->wyz[i] * n.y * n.z + c->wzx[i] * n.z * n.x, most = 2.0f * c->ramp[i];
    const float width2 = c->wxx[i] * n.x * n.x + c->wyy[i] * n.y * n.y + c->wzz[i] * n.z * n.z + 2.0f * cross;
    const float width = clamp_f(sqrtf(max_f(0.0f, width2)), WIDTH_MIN * most, most);
    part p = {clamp_f(0.5f - height_m / width, 0.0f, 1.0f), 0.0f};
    p.depth_m = p.share < 1.0f ? 0.5f * width * p.share * p.share : -height_m;
    return p;
}

/* The same where other planes cut the piece too: by what they leave of it. */
static float depth_left(part of_nearest, float coverage) {
    return of_nearest.share > 0.0f ? of_nearest.depth_m * min_f(1.0f, coverage / of_nearest.share) : 0.0f;
}

uint32_t cr_way_find(const cr_way_zones *zones, cr_way_key key) {
    for (uint32_t z = 0; z < zones->count; z++) {
        const cr_way_key *k = &zones->zones[z].key;
        if (k->surface == key.surface && k->side == key.side && k->piece == key.piece) {
            return z;
        }
    }
    return CR_WAY_NONE;
}

float cr_way_share(cr_vec3 g, uint32_t side) {
    const float parts[3] = {g.x, g.y, g.z}, length2 = v3_dot(g, g);
    const float along = parts[side >> 1] * ((side & 1u) != 0u ? -1.0f : 1.0f);
    return along > 0.0f && length2 > 0.0f ? along * along / length2 : 0.0f;
}

static cr_way_zone *zone_at(cr_way_zones *zones, cr_way_key key, uint32_t patch) {
    static const cr_way_zone none = {0};
    const uint32_t found = cr_way_find(zones, key);
    if (found != CR_WAY_NONE) {
        return &zones->zones[found];
    }
    if (zones->count == CR_WAY_ZONES_MAX) {
        zones->dropped++;
        return NULL;
    }
    cr_way_zone *z = &zones->zones[zones->count++];
    *z = none;
    z->key = key;
    z->patch = patch;
    return z;
}

/* One sample, tool frame: inside of a surface with this normal. */
typedef struct {
    cr_vec3 p, area_m2, normal;
    float coverage, depth_m, size_m2;
} sample;

static void add_sample(cr_way_zones *zones, cr_way_key key, uint32_t patch, const sample *q, float share) {
    const float depth = q->depth_m * share, weight = depth * q->size_m2;
    cr_way_zone *z = weight > 0.0f ? zone_at(zones, key, patch) : NULL;
    if (z == NULL) {
        return;
    }
    const cr_vec3 push = v3_scale(q->area_m2, -depth);
    z->area_m2 += q->coverage * share * q->size_m2;
    z->deep_m = max_f(z->deep_m, depth);
    z->weight_m3 += weight;
    z->push_m3 = v3_add(z->push_m3, push);
    z->turn_m4 = v3_add(z->turn_m4, v3_cross(q->p, push));
    z->centre_m4 = v3_mad(z->centre_m4, q->p, weight);
    z->normal_m3 = v3_mad(z->normal_m3, q->normal, weight);
    z->touched_m4 = v3_mad(z->touched_m4, v3_mad(q->p, q->normal, q->depth_m), weight);
}

/* A sample inside of a curved surface: to the sides by its normal. */
static void add_curved(cr_way_zones *zones, cr_way_key key, uint32_t patch, const sample *q, float share,
                       cr_vec3 g_world) {
    for (key.side = 0u; key.side < CR_WAY_SIDES; key.side++) {
        add_sample(zones, key, patch, q, share * cr_way_share(g_world, key.side));
    }
}

static sample sample_of(const struct cr_img_cluster *c, int i) {
    const sample q = {
        v3(c->x[i], c->y[i], c->z[i]), v3(c->ax[i], c->ay[i], c->az[i]), v3(0.0f, 0.0f, 0.0f), 0.0f, 0.0f, c->area[i]};
    return q;
}

/* How much a sample counts for plane k: as its nearest, shared with those that are nearly as near, within half the width of its piece. */
static float share_of_plane(const cr_planes *p, const float *height_m, float near_m, uint32_t k) {
    float total = 0.0f;
    for (uint32_t j = 0; j < p->count; j++) {
        total += max_f(0.0f, height_m[j] - near_m);
    }
    return max_f(0.0f, height_m[k] - near_m) / total;
}

/* A sample over planes that meet convexly. */
static void add_over_solid(cr_way_zones *zones, const cr_scene *s, const struct cr_img_cluster *c, int i,
                           uint32_t piece, const cr_planes *p, const float *height_m) {
    uint32_t top = 0u;
    for (uint32_t k = 1; k < p->count; k++) {
        top = height_m[k] > height_m[top] ? k : top;
    }
    sample q = sample_of(c, i);
    q.coverage = cr_cover_by_planes(p, c, i, height_m, height_m[top], cr_planes_distance(p, height_m, height_m[top]));
    q.depth_m = depth_left(part_below(c, i, p->normal_tool[top], height_m[top]), q.coverage);
    for (uint32_t k = 0; k < p->count; k++) {
        const cr_way_key key = {p->facet[k], 0u, piece};
        q.normal = p->normal_tool[k];
        add_sample(zones, key, s->facets[p->facet[k]].patch, &q,
                   share_of_plane(p, height_m, height_m[top] - c->ramp[i], k));
    }
}

/* A sample behind walls that meet concavely: inside of each by its own height. Their planes are turned inside out. */
static void add_behind_walls(cr_way_zones *zones, const cr_scene *s, const struct cr_img_cluster *c, int i,
                             uint32_t piece, const cr_planes *p, const float *height_m) {
    for (uint32_t k = 0; k < p->count; k++) {
        const cr_way_key key = {p->facet[k], 0u, piece};
        const part wall = part_below(c, i, p->normal_tool[k], -height_m[k]);
        sample q = sample_of(c, i);
        q.normal = v3_scale(p->normal_tool[k], -1.0f);
        q.coverage = wall.share;
        q.depth_m = wall.depth_m;
        add_sample(zones, key, s->facets[p->facet[k]].patch, &q, 1.0f);
    }
}

static void add_over_planes(cr_way_zones *zones, const cr_scene *s, const struct cr_img_cluster *c, int i,
                            const cr_planes *p) {
    float height_m[CR_KIND_FACETS_MAX];
    for (uint32_t k = 0; k < p->count; k++) {
        height_m[k] = v3_dot(p->normal_tool[k], v3(c->x[i], c->y[i], c->z[i])) + p->offset_m[k];
    }
    for (int slot = 0; slot < CR_PIECES; slot++) {
        if (c->piece[slot] == CR_PIECE_NONE) {
            continue;
        }
        if (p->sign < 0.0f) {
            add_behind_walls(zones, s, c, i, c->piece[slot], p, height_m);
        } else {
            add_over_solid(zones, s, c, i, c->piece[slot], p, height_m);
        }
    }
}

/* In a cell of many facets: those whose plane passes nearest and faces the way the distance grows. */
static void weigh_facets(const cr_scene *s, const struct cr_img_kind *kind, cr_vec3 g, float phi_m, cr_vec3 p,
                         cr_way_facets *out) {
    float best = 3.4e38f, total = 0.0f;
    out->count = kind->count;
    for (uint32_t k = 0; k < kind->count; k++) {
        const struct cr_img_facet *plane = &s->facets[kind->facet[k]];
        const cr_vec3 n = v3_from(plane->normal);
        out->facet[k] = kind->facet[k];
        out->share[k] = abs_f(v3_dot(n, p) - plane->offset_m - phi_m) + (1.0f - v3_dot(n, g)) * s->meta->voxel_m;
        best = min_f(best, out->share[k]);
    }
    for (uint32_t k = 0; k < kind->count; k++) {
        out->share[k] = max_f(0.0f, 1.0f - (out->share[k] - best) / (EXPLAINS * s->meta->voxel_m));
        total += out->share[k];
    }
    for (uint32_t k = 0; k < kind->count; k++) {
        out->share[k] /= total;
    }
}

void cr_way_facets_of(const cr_field *f, const cr_lookup *at, int lane, cr_vec3 p, cr_way_facets *out) {
    const cr_scene *s = f->scene;
    out->count = out->apart = 0u;
    if ((at->entry[lane] & CR_TOP_FAR) != 0u) {
        return;
    }
    const int over_planes = (int)((at->from_facet >> lane) & 1u);
    const struct cr_img_kind *kind = &s->kinds[over_planes ? at->kind[lane] : cr_field_kind(f, at, lane)];
    if (over_planes && kind->kind == CR_KIND_CONVEX) {
        out->facet[0] = at->facet[lane];
        out->share[0] = 1.0f;
        out->count = 1u;
        return;
    }
    out->apart = (uint32_t)(over_planes && kind->kind == CR_KIND_CONCAVE);
    weigh_facets(s, kind, v3(at->gx[lane], at->gy[lane], at->gz[lane]), at->phi_m[lane], p, out);
}

/* A looked-up sample whose facets are known, or only the direction of the distance, or nothing. */
static void add_looked_up(cr_way_zones *zones, const cr_respond_input *in, const struct cr_img_cluster *c, int i,
                          uint32_t piece, const cr_way_facets *on, cr_vec3 g_world, sample *q) {
    const cr_scene *s = in->field->scene;
    if (on->count == 0u) {
        const int known = v3_dot(g_world, g_world) > 0.5f;
        const cr_way_key key = {known ? CR_WAY_DEEP : CR_WAY_NONE, 0u, piece};
        if (known) {
            add_curved(zones, key, CR_FACET_NONE, q, 1.0f, g_world);
        } else {
            add_sample(zones, key, CR_FACET_NONE, q, 1.0f);
        }
    }
    for (uint32_t k = 0; k < on->count; k++) {
        const struct cr_img_facet *facet = &s->facets[on->facet[k]];
        cr_way_key key = {facet->curved ? CR_WAY_CURVED | facet->patch : on->facet[k], 0u, piece};
        if (facet->curved) {
            add_curved(zones, key, facet->patch, q, on->share[k], g_world);
            continue;
        }
        sample r = *q;
        r.normal = xform_unrotate(in->world_from_tool, v3_from(facet->normal));
        if (on->apart) {
            const cr_vec3 p_world = xform_point(in->world_from_tool, q->p);
            const part wall = part_below(c, i, r.normal, v3_dot(v3_from(facet->normal), p_world) - facet->offset_m);
            r.coverage = wall.share;
            r.depth_m = wall.depth_m;
        }
        add_sample(zones, key, facet->patch, &r, on->apart ? 1.0f : on->share[k]);
    }
}

static void gather_looked_up(cr_way_zones *zones, const cr_respond_input *in, const struct cr_img_cluster *c,
                             const cr_lookup *at, const cr_lanes3 *world, uint32_t lanes) {
    float coverage[CR_LANES];
    cr_cover(in->field->scene, in->world_from_tool, CR_COVERAGE_SOFT, c, at, coverage);
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        const cr_vec3 g = v3_unit(v3(at->gx[i], at->gy[i], at->gz[i]), 1e-3f);
        cr_way_facets on;
        sample q = sample_of(c, i);
        q.normal = xform_unrotate(in->world_from_tool, g);
        q.coverage = coverage[i];
        q.depth_m = depth_left(part_below(c, i, q.normal, at->phi_m[i]), coverage[i]);
        cr_way_facets_of(in->field, at, i, v3(world->x[i], world->y[i], world->z[i]), &on);
        for (int slot = 0; slot < CR_PIECES; slot++) {
            if (c->piece[slot] != CR_PIECE_NONE) {
                add_looked_up(zones, in, c, i, c->piece[slot], &on, g, &q);
            }
        }
    }
}

int cr_way_planes(const cr_respond_input *in, const cr_hit *hit, cr_planes *planes, cr_lanes3 *world, cr_lookup *at) {
    const struct cr_img_cluster *c = &in->field->scene->clusters[hit->cluster];
    uint32_t kind = hit->planes;
    if (kind == 0u) {
        cr_lanes_to_world(in->world_from_tool, c->x, c->y, c->z, world);
        cr_field_look_up(in->field, world, at);
    }
    if (kind == 0u && hit->whole != 0u) {
        kind = cr_planes_around(in->field, at->entry[0], v3(world->x[0], world->y[0], world->z[0]), 2.0f * c->radius_m);
    }
    if (kind != 0u && planes->kind != kind) {
        cr_planes_turn(in->field->scene, in->world_from_tool, kind, planes);
    }
    return kind != 0u;
}

void cr_way_gather(const cr_respond_input *in, cr_way_zones *zones) {
    cr_planes planes;
    planes.kind = 0u;
    zones->count = zones->dropped = 0u;
    for (uint32_t h = 0; h < in->set->hit_count; h++) {
        const cr_hit *hit = &in->set->hits[h];
        const struct cr_img_cluster *c = &in->field->scene->clusters[hit->cluster];
        uint32_t lanes = hit->covered & ((1u << c->count) - 1u);
        cr_lanes3 world;
        cr_lookup at;
        if (!cr_way_planes(in, hit, &planes, &world, &at)) {
            gather_looked_up(zones, in, c, &at, &world, lanes);
            continue;
        }
        while (lanes != 0u) {
            add_over_planes(zones, in->field->scene, c, take_lane(&lanes), &planes);
        }
    }
}
