/* split: concave creases part the zones of an area into groups that answer with a plane each. EXTENT.md "Concave creases". */
#include "rivals/extent.h"

/* Zones of one area that meet each zone, as bits. The label of their crease decides. Where they share creases of both kinds it is
 * concave when each lies above the plane of the other; zones that share none are beside each other when each lies below. */
typedef struct {
    uint32_t convex[CR_ZONES_MAX], concave[CR_ZONES_MAX], beside[CR_ZONES_MAX];
} relations;

static void relate(const cr_scene *s, const cr_area_work *a, uint32_t i, uint32_t j, relations *r) {
    uint32_t label = cr_pair_label(s, a->zones[i].patch, a->zones[j].patch);
    cr_vec3 d = v3_sub(a->zones[j].centre_world_m, a->zones[i].centre_world_m);
    float j_above_i = dot_zone(a, i, d), i_above_j = -dot_zone(a, j, d);
    int convex = label == CR_PAIR_CONVEX, concave = label == CR_PAIR_CONCAVE, beside = 0;
    if (label == (CR_PAIR_CONVEX | CR_PAIR_CONCAVE)) {
        concave = j_above_i > 0.0f && i_above_j > 0.0f;
        convex = !concave;
    } else if (label == 0u) {
        beside = j_above_i <= 0.0f && i_above_j <= 0.0f;
    }
    r->convex[i] |= (uint32_t)convex << j;
    r->concave[i] |= (uint32_t)concave << j;
    r->beside[i] |= (uint32_t)beside << j;
}

static relations relate_zones(const cr_scene *s, const cr_area_work *a) {
    relations r = {{0u}, {0u}, {0u}};
    for (uint32_t i = 0; i < a->zone_count; i++) {
        for (uint32_t j = 0; j < a->zone_count; j++) {
            if (i != j) {
                relate(s, a, i, j, &r);
            }
        }
    }
    return r;
}

/* Zones that hang together with zone i round the outside. */
static uint32_t component_of(const relations *r, uint32_t i) {
    uint32_t found = 1u << i, fresh = found;
    while (fresh != 0u) {
        int z = take_lane(&fresh);
        uint32_t next = (r->convex[z] | r->beside[z]) & ~found;
        found |= next;
        fresh |= next;
    }
    return found;
}

/* Shares of one zone that leads nothing: those of the zones it meets, by their weight. */
static void share_zone(const float *alpha, uint32_t meets, uint32_t z, cr_group *groups, uint32_t count) {
    float total = 0.0f;
    for (uint32_t left = meets; left != 0u;) {
        total += alpha[take_lane(&left)];
    }
    float even = 1.0f / (float)cr_count_lanes(meets);
    for (uint32_t g = 0; g < count; g++) {
        for (uint32_t left = meets; left != 0u;) {
            int j = take_lane(&left);
            groups[g].share[z] += groups[g].share[j] * (total > 0.0f ? alpha[j] / total : even);
        }
    }
}

/* The zones of a mixed corner that lead nothing, ring by ring: first over convex creases, then to what is beside. */
static void share_out(const relations *r, const float *alpha, uint32_t members, uint32_t leaders, cr_group *groups,
                      uint32_t count) {
    uint32_t known = leaders, ring = 1u;
    while (ring != 0u) {
        ring = 0u;
        for (int how = 0; how < 2 && ring == 0u; how++) {
            for (uint32_t left = members & ~known; left != 0u;) {
                uint32_t z = (uint32_t)take_lane(&left);
                uint32_t meets = (how == 0 ? r->convex[z] : r->beside[z]) & known;
                if (meets != 0u) {
                    share_zone(alpha, meets, z, groups, count);
                    ring |= 1u << z;
                }
            }
        }
        known |= ring;
    }
}

/* Concave creases split an area: zones joined by convex ones answer together, unless a concave crease lies within such a set (a
 * mixed corner). Then every zone at it leads a group of its own, and the others are shared among those they meet. Returns the
 * number of groups. */
uint32_t cr_split(const cr_scene *s, const cr_area_work *a, const float *alpha, cr_group *groups) {
    const relations r = relate_zones(s, a);
    static const cr_group none = {{0.0f}, 0u, 0u};
    uint32_t count = 0u, left = (1u << a->zone_count) - 1u;
    while (left != 0u) {
        uint32_t first = left & (~left + 1u), seed = first, leaders = 0u;
        uint32_t members = component_of(&r, (uint32_t)take_lane(&seed)), base = count;
        for (uint32_t m = members; m != 0u;) {
            int z = take_lane(&m);
            leaders |= (r.concave[z] & members) != 0u ? 1u << z : 0u;
        }
        for (uint32_t m = leaders != 0u ? leaders : first; m != 0u;) {
            groups[count] = none;
            groups[count++].share[take_lane(&m)] = 1.0f;
        }
        share_out(&r, alpha, members, leaders != 0u ? leaders : first, &groups[base], count - base);
        left &= ~members;
    }
    for (uint32_t g = 0; g < count; g++) {
        for (uint32_t z = 0; z < a->zone_count; z++) {
            groups[g].own |= (uint32_t)(groups[g].share[z] > 0.0f) << z;
        }
        for (uint32_t own = groups[g].own; own != 0u;) {
            int z = take_lane(&own);
            groups[g].behind |= (r.concave[z] & ~groups[g].own) != 0u ? 1u << z : 0u;
        }
    }
    return count;
}
