/* gather: what each piece of the tool is inside of. WAY_OUT.md "Zones". */
#include "contact/lanes.h"
#include "contact/way_out.h"

uint32_t cr_way_find(const cr_way_zones *zones, cr_way_key key) {
    for (uint32_t z = 0; z < zones->count; z++) {
        const cr_way_key *k = &zones->zones[z].key;
        if (k->surface == key.surface && k->side == key.side && k->piece == key.piece) {
            return z;
        }
    }
    return CR_WAY_NONE;
}

static cr_way_zone *zone_at(const cr_scene *s, const xform *pose, cr_way_zones *zones, cr_way_key key, uint32_t patch) {
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
    if (key.surface < CR_WAY_CURVED) {
        z->flat = 1u;
        z->plane_offset_m = cr_way_plane(s, pose, key.surface, &z->plane_normal);
    }
    return z;
}

/* Sum of depth times a vector of the lanes. */
static cr_vec3 sum_vectors(const float *w, const float *x, const float *y, const float *z) {
    return v3(cr_sum_products(w, x), cr_sum_products(w, y), cr_sum_products(w, z));
}

/* Moment of the area vectors of the lanes, each times its depth. */
static cr_vec3 sum_moments(const struct cr_img_cluster *c, const float *depth_m) {
    float x[CR_LANES], y[CR_LANES], z[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        x[i] = c->y[i] * c->az[i] - c->z[i] * c->ay[i];
        y[i] = c->z[i] * c->ax[i] - c->x[i] * c->az[i];
        z[i] = c->x[i] * c->ay[i] - c->y[i] * c->ax[i];
    }
    return sum_vectors(depth_m, x, y, z);
}

/* What the lanes of a cluster add to a zone. */
static cr_way_zone sum_lanes(const struct cr_img_cluster *c, const float *depth_m, const float *coverage,
                             const cr_way_layers *l, int flat) {
    static const cr_way_zone none = {0};
    cr_way_zone z = none;
    float weight[CR_LANES], high[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        weight[i] = depth_m[i] * c->area[i];
        high[i] = weight[i] * l->full_m[i];
        z.deep_m = higher_f(z.deep_m, depth_m[i]);
    }
    z.area_m2 = cr_sum_products(coverage, c->area);
    z.weight_m3 = cr_sum_products(depth_m, c->area);
    z.push_m3 = v3_scale(sum_vectors(depth_m, c->ax, c->ay, c->az), -1.0f);
    z.turn_m4 = v3_scale(sum_moments(c, depth_m), -1.0f);
    z.centre_m4 = sum_vectors(weight, c->x, c->y, c->z);
    if (!flat) {
        z.normal_m3 = sum_vectors(weight, l->normal.x, l->normal.y, l->normal.z);
        z.above_m4 = sum_vectors(high, l->normal.x, l->normal.y, l->normal.z);
    }
    return z;
}

static void add_part(cr_way_zone *z, const cr_way_zone *more, float part, uint32_t hit) {
    if (part * more->deep_m > z->deep_m) {
        z->deep_m = part * more->deep_m;
        z->deep_hit = hit;
    }
    z->area_m2 += part * more->area_m2;
    z->weight_m3 += part * more->weight_m3;
    z->push_m3 = v3_mad(z->push_m3, more->push_m3, part);
    z->turn_m4 = v3_mad(z->turn_m4, more->turn_m4, part);
    z->centre_m4 = v3_mad(z->centre_m4, more->centre_m4, part);
    z->normal_m3 = v3_mad(z->normal_m3, more->normal_m3, part);
    z->above_m4 = v3_mad(z->above_m4, more->above_m4, part);
}

/* The lanes of a layer that belong to one piece of the tool. */
static void add_layer(const cr_scene *s, const xform *pose, const struct cr_img_cluster *c, int slot,
                      const cr_way_layers *l, uint32_t k, uint32_t hit, cr_way_zones *zones) {
    const cr_way_layer *layer = &l->layers[k];
    const uint32_t lanes = layer->lanes & c->piece_lanes[slot];
    float depth[CR_LANES], coverage[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        const float in = (float)((lanes >> i) & 1u);
        depth[i] = in * layer->depth_m[i];
        coverage[i] = in * layer->coverage[i];
    }
    const cr_way_zone sums = sum_lanes(c, depth, coverage, l, layer->surface < CR_WAY_CURVED);
    const int sided = layer->side == CR_WAY_SIDES;
    const cr_vec3 mean = sided ? xform_rotate(pose, sums.normal_m3) : v3(0.0f, 0.0f, 0.0f);
    for (uint32_t side = sided ? 0u : layer->side; side < CR_WAY_SIDES; side++) {
        const float part = sided ? cr_way_share(mean, side) : 1.0f;
        const cr_way_key key = {layer->surface, side, c->piece[slot]};
        cr_way_zone *z = part * sums.weight_m3 > 0.0f ? zone_at(s, pose, zones, key, layer->patch) : NULL;
        if (z != NULL) {
            add_part(z, &sums, part, hit);
            zones->reach[hit].zones |= 1u << (uint32_t)(z - zones->zones);
        }
        if (!sided) {
            break;
        }
    }
}

/* Entry of the brick of a point: nearest one in the grid. */
static uint32_t entry_at(const cr_field *f, cr_vec3 p) {
    const struct cr_img_meta *m = f->scene->meta;
    const int32_t x = (int32_t)clamp_f((p.x - m->origin_m[0]) * f->inv_brick, 0.0f, f->grid_max[0]);
    const int32_t y = (int32_t)clamp_f((p.y - m->origin_m[1]) * f->inv_brick, 0.0f, f->grid_max[1]);
    const int32_t z = (int32_t)clamp_f((p.z - m->origin_m[2]) * f->inv_brick, 0.0f, f->grid_max[2]);
    return f->scene->top[(z * f->dims[1] + y) * f->dims[0] + x];
}

int cr_way_planes(const cr_field *f, const xform *pose, const cr_hit *hit, cr_planes *planes, cr_lanes3 *world,
                  cr_lookup *at) {
    const struct cr_img_cluster *c = &f->scene->clusters[hit->cluster];
    uint32_t kind = hit->planes;
    if (kind == 0u && hit->whole != 0u) {
        const cr_vec3 p = xform_point(pose, v3(c->x[0], c->y[0], c->z[0]));
        kind = cr_planes_around(f, entry_at(f, p), p, 2.0f * c->radius_m);
    }
    if (kind == 0u) {
        cr_lanes_to_world(pose, c->x, c->y, c->z, world);
        cr_field_look_up(f, world, at);
    } else if (planes->kind != kind) {
        cr_planes_turn(f->scene, pose, kind, planes);
    }
    return kind != 0u;
}

const cr_planes *cr_way_alone(const cr_scene *s, const struct cr_img_cluster *c, const cr_planes *p, cr_planes *one) {
    const float apart_m = max_f(s->meta->crease_m, 2.0f * s->meta->ramp_max_m);
    return p->sign < 0.0f ? p : cr_planes_alone(p, v3(c->x[0], c->y[0], c->z[0]), 2.0f * c->radius_m, apart_m, one);
}

static uint32_t begin(const cr_scene *s, cr_contact_set *set, uint32_t hit) {
    static const cr_way_reach none = {0u, -1.0f, {0.0f, 0.0f, 0.0f}, 0.0f};
    const uint32_t used = (1u << s->clusters[set->hits[hit].cluster].count) - 1u;
    set->way.layers.count = 0u;
    set->way.layers.near = (uint32_t)(set->hits[hit].covered | set->hits[hit].near) & used;
    set->way.layers.reach = none;
    for (int i = 0; i < CR_LANES; i++) {
        set->way.layers.full_m[i] = 0.0f;
    }
    return set->hits[hit].covered & used;
}

static void add_layers(const cr_scene *s, const xform *pose, cr_contact_set *set, uint32_t hit) {
    const struct cr_img_cluster *c = &s->clusters[set->hits[hit].cluster];
    const cr_way_layers *l = &set->way.layers;
    set->way.reach[hit] = l->reach;
    for (uint32_t k = 0; k < l->count; k++) {
        for (int slot = 0; slot < CR_PIECES && c->piece[slot] != CR_PIECE_NONE; slot++) {
            add_layer(s, pose, c, slot, l, k, hit, &set->way);
        }
    }
}

void cr_way_add_over_planes(const cr_field *f, const xform *pose, cr_contact_set *set, uint32_t hit,
                            const cr_planes *planes, const cr_heights *heights) {
    const uint32_t lanes = begin(f->scene, set, hit);
    cr_way_over_planes(f->scene, &f->scene->clusters[set->hits[hit].cluster], lanes, planes, heights, &set->way.layers);
    add_layers(f->scene, pose, set, hit);
}

void cr_way_add_over_lookup(const cr_field *f, const xform *pose, cr_contact_set *set, uint32_t hit,
                            const cr_lookup *at, const cr_lanes3 *world) {
    const uint32_t lanes = begin(f->scene, set, hit);
    cr_way_over_lookup(f, pose, &f->scene->clusters[set->hits[hit].cluster], lanes, at, world, &set->way.layers);
    add_layers(f->scene, pose, set, hit);
}

void cr_way_add_whole(const cr_field *f, const xform *pose, cr_contact_set *set, uint32_t hit) {
    const struct cr_img_cluster *c = &f->scene->clusters[set->hits[hit].cluster];
    cr_lanes3 world;
    cr_lookup at;
    cr_planes planes, one;
    cr_heights heights;
    planes.kind = 0u;
    if (cr_way_planes(f, pose, &set->hits[hit], &planes, &world, &at)) {
        const cr_planes *p = cr_way_alone(f->scene, c, &planes, &one);
        cr_planes_measure(p, c, &heights);
        cr_way_add_over_planes(f, pose, set, hit, p, &heights);
    } else {
        cr_way_add_over_lookup(f, pose, set, hit, &at, &world);
    }
}
