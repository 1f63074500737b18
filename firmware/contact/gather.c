/* gather: what each piece of the tool is inside of. WAY_OUT.md "Zones". */
#include "contact/way_out.h"

/* Work, in parts of a unit: of a layer that is added to the zones of one piece, each of its lanes, each of its sides, and each that asks for
 * room. */
#define PARTS_OF_LAYER 40u
#define PARTS_OF_LANE 5u
#define PARTS_OF_SIDE 34u
#define PARTS_OF_ROOM 20u

uint32_t cr_way_find(const cr_way_zones *zones, cr_way_key key) {
    for (uint32_t z = 0; z < zones->count; z++) {
        const cr_way_key *k = &zones->zones[z].key;
        if (k->surface == key.surface && k->side == key.side && k->piece == key.piece) {
            return z;
        }
    }
    return CR_WAY_NONE;
}

/* Room for one more zone of this weight: where there is none, that of the lightest. Null when none is lighter. */
static cr_way_zone *room_for(cr_way_zones *zones, float weight_m3) {
    zones->layers.parts += PARTS_OF_ROOM;
    if (zones->count < CR_WAY_ZONES_MAX) {
        return &zones->zones[zones->count++];
    }
    cr_way_zone *least = &zones->zones[0];
    for (uint32_t z = 1; z < CR_WAY_ZONES_MAX; z++) {
        least = zones->zones[z].weight_m3 < least->weight_m3 ? &zones->zones[z] : least;
    }
    zones->dropped++;
    zones->dropped_m3 = max_f(zones->dropped_m3, min_f(least->weight_m3, weight_m3));
    return least->weight_m3 < weight_m3 ? least : NULL;
}

static cr_way_zone *zone_at(const cr_scene *s, const xform *pose, cr_way_zones *zones, cr_way_key key, uint32_t patch,
                            float weight_m3) {
    static const cr_way_zone none = {0};
    const uint32_t found = cr_way_find(zones, key);
    if (found != CR_WAY_NONE) {
        return &zones->zones[found];
    }
    cr_way_zone *z = room_for(zones, weight_m3);
    if (z == NULL) {
        return NULL;
    }
    *z = none;
    z->key = key;
    z->patch = patch;
    if (key.surface < CR_WAY_CURVED) {
        z->flat = 1u;
        z->plane_offset_m = cr_way_plane(s, pose, key.surface, &z->plane_normal);
    }
    return z;
}

static void add_vector(cr_vec3 *sum, float w, float x, float y, float z) { *sum = v3_mad(*sum, v3(x, y, z), w); }

/* What some lanes of a layer add to a zone, one after the other: in one order on every target. Returns how many they are. */
static uint32_t sum_lanes(const struct cr_img_cluster *c, uint32_t lanes, const cr_way_layers *l,
                          const cr_way_layer *layer, cr_way_zone *z) {
    static const cr_way_zone none = {0};
    const int flat = layer->surface < CR_WAY_CURVED || layer->surface == CR_WAY_NONE; /* no normals of lanes */
    uint32_t count = 0u;
    *z = none;
    for (; lanes != 0u; count++) {
        const int i = take_lane(&lanes);
        const float depth = layer->depth_m[i], weight = depth * c->area[i];
        CR_ASSERT(!(depth < 0.0f || layer->coverage[i] < 0.0f));
        const float x = c->x[i], y = c->y[i], w = c->z[i], ax = c->ax[i], ay = c->ay[i], az = c->az[i];
        z->deep_m = max_f(z->deep_m, depth);
        z->area_m2 += layer->coverage[i] * c->area[i];
        z->weight_m3 += weight;
        add_vector(&z->push_m3, -depth, ax, ay, az);
        add_vector(&z->turn_m4, -depth, y * az - w * ay, w * ax - x * az, x * ay - y * ax);
        add_vector(&z->centre_m4, weight, x, y, w);
        if (!flat) {
            const cr_vec3 n_m = lane_of(&layer->normal_m, i);
            add_vector(&z->normal_m3, c->area[i], n_m.x, n_m.y, n_m.z);
            add_vector(&z->above_m4, c->area[i] * l->full_m[i], n_m.x, n_m.y, n_m.z);
        }
    }
    return count;
}

/* A flat zone has no sums of normals. */
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
    if (z->flat == 0u) {
        z->normal_m3 = v3_mad(z->normal_m3, more->normal_m3, part);
        z->above_m4 = v3_mad(z->above_m4, more->above_m4, part);
    }
}

/* Lanes over a plane of a round surface: what they know of it. */
static void turn_round(const cr_scene *s, const xform *pose, uint32_t facet, cr_way_zone *z) {
    cr_vec3 n;
    const float offset_m = cr_way_plane(s, pose, facet, &n);
    z->normal_m3 = v3_scale(n, z->weight_m3);
    z->above_m4 = v3_scale(n, -(v3_dot(n, z->centre_m4) + offset_m * z->weight_m3));
}

/* The lanes of a layer that belong to one piece of the tool. Returns the work, in parts, beside that for room. */
static uint32_t add_layer(const cr_scene *s, const xform *pose, const struct cr_img_cluster *c, int slot,
                          const cr_way_layers *l, uint32_t k, uint32_t hit, cr_way_zones *zones) {
    const cr_way_layer *layer = &l->layers[k];
    cr_way_zone sums;
    const uint32_t lanes = sum_lanes(c, layer->lanes & c->piece_lanes[slot], l, layer, &sums);
    const uint32_t felt = cr_way_felt(s, layer->surface);
    const int sided = felt >= CR_WAY_CURVED && felt != CR_WAY_NONE;
    if (felt != layer->surface) {
        turn_round(s, pose, layer->surface, &sums);
    }
    const cr_vec3 mean = sided ? xform_rotate(pose, sums.normal_m3) : v3(0.0f, 0.0f, 0.0f);
    for (uint32_t side = 0u; side < CR_WAY_SIDES; side++) {
        const float part = sided ? cr_way_share(mean, side) : 1.0f;
        const cr_way_key key = {felt, side, c->piece[slot]};
        /* not a number is kept: it is a fault in the end */
        const float weight_m3 = part * sums.weight_m3;
        cr_way_zone *z = weight_m3 <= 0.0f ? NULL : zone_at(s, pose, zones, key, layer->patch, weight_m3);
        if (z != NULL) {
            CR_ASSERT(z < &zones->zones[zones->count] && z->key.piece == c->piece[slot] && z->patch == layer->patch);
            add_part(z, &sums, part, hit);
            zones->reach[hit].zones |= 1u << (uint32_t)(z - zones->zones);
        }
        if (!sided) {
            break;
        }
    }
    return PARTS_OF_LAYER + PARTS_OF_LANE * lanes + PARTS_OF_SIDE * (sided ? CR_WAY_SIDES : 1u);
}

const cr_planes *cr_way_alone(const cr_scene *s, const struct cr_img_cluster *c, const cr_planes *p, cr_planes *one) {
    const float apart_m = apart_of(s->meta);
    return p->sign < 0.0f ? p : cr_planes_alone(p, v3(c->x[0], c->y[0], c->z[0]), 2.0f * c->radius_m, apart_m, one);
}

/* One layer of a hit, into the zones of its pieces. */
static void add_one_layer(const cr_scene *s, const xform *pose, cr_contact_set *set, uint32_t hit, uint32_t k) {
    const struct cr_img_cluster *c = &s->clusters[set->hits[hit].cluster];
    cr_way_layers *l = &set->way.layers;
    for (int slot = 0; slot < CR_PIECES && c->piece[slot] != CR_PIECE_NONE; slot++) {
        const uint32_t parts = add_layer(s, pose, c, slot, l, k, hit, &set->way); /* adds that for room itself */
        l->parts += parts;
    }
}

void cr_way_add(cr_contact_set *set, uint32_t hit, const cr_looked *looked) {
    static const cr_way_reach none = {0u, 0.0f, {0.0f, 0.0f, 0.0f}, CR_WAY_NO_SPREAD};
    const uint32_t used = first_lanes(looked->c->count);
    cr_way_layers *l = &set->way.layers;
    CR_ASSERT(hit < set->hit_count && set->hits[hit].cluster == looked->cluster);
    CR_ASSERT((looked->planes == NULL) == (looked->at != NULL)); /* by one of the two */
    l->count = 0u;
    l->near = (uint32_t)(set->hits[hit].covered | set->hits[hit].near) & used;
    l->left = set->hits[hit].covered & used;
    l->facet = CR_FACET_NONE;
    l->planes = looked->planes != NULL ? looked->planes->kind : 0u;
    l->deep_m = 0.0f;
    l->reach = none;
    l->step = looked->planes != NULL ? CR_WAY_PLANES : CR_WAY_COMMON;
}

int cr_way_add_more(const cr_field *f, const xform *pose, cr_contact_set *set, uint32_t hit, const cr_looked *looked) {
    cr_way_layers *l = &set->way.layers;
    l->parts = 0u;
    if (l->step == CR_WAY_PLANES) {
        cr_way_over_planes(f->scene, looked->c, l->left, looked->coverage, looked->planes, looked->heights, l);
        l->step = CR_WAY_FADE;
        return 0;
    }
    if (l->step < CR_WAY_FADE) {
        cr_way_over_lookup(f, pose, looked, l);
        return 0;
    }
    if (l->step == CR_WAY_FADE) {
        const int fade = cr_way_fade(f->scene, set->hits[hit].covered & first_lanes(looked->c->count), l);
        set->way.reach[hit] = l->reach;
        set->hits[hit].facet = l->facet;
        set->hits[hit].planes = (uint16_t)l->planes;
        l->step = CR_WAY_ADD;
        if (fade && l->count > 0u) {
            return 0;
        }
    }
    if (l->count > 0u) {
        add_one_layer(f->scene, pose, set, hit, l->step++ - CR_WAY_ADD);
    }
    return l->step == CR_WAY_ADD + l->count;
}
