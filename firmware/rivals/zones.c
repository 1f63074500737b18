/* zones: hits into contact areas, touches into contact zones.
 *
 * An area is a connected piece of tool surface in contact: neighbouring clusters that reach into the object with neighbouring
 * samples. A zone is what
 * the area touches of one smooth patch of the static surface [1]. */
#include "rivals/extent.h"

/* Touched areas below a square nanometre are rounding, and their means would not be numbers. */
#define AREA_MIN_M2 1e-18f

static uint32_t find_root(cr_hit *hits, uint32_t i) {
    while (hits[i].area != i) {
        hits[i].area = hits[hits[i].area].area;
        i = hits[i].area;
    }
    return i;
}

/* The smaller index stays root, so that labels do not depend on the order of unions. */
static void join(cr_hit *hits, uint32_t a, uint32_t b) {
    uint32_t ra = find_root(hits, a), rb = find_root(hits, b);
    if (ra < rb) {
        hits[rb].area = (uint16_t)ra;
    } else {
        hits[ra].area = (uint16_t)rb;
    }
}

/* Joins hit i with another hit when some of their lanes are beside each other: by the records from `beside` to `end`. */
static void join_beside(cr_hit *hits, uint32_t i, uint32_t other, const struct cr_img_neighbour *beside,
                        const struct cr_img_neighbour *end) {
    const uint32_t mine = hits[i].covered, theirs = hits[other].covered;
    if (hits[i].area == hits[other].area) {
        return;
    }
    for (; beside < end; beside++) {
        if ((mine & beside->mine) != 0u && (theirs & beside->theirs) != 0u) {
            join(hits, i, other);
            return;
        }
    }
}

static void connect_hits(const cr_scene *s, uint16_t *hit_of_cluster, cr_contact_set *set) {
    for (uint32_t i = 0; i < set->hit_count; i++) {
        uint32_t cluster = set->hits[i].cluster;
        set->hits[i].area = (uint16_t)i;
        if (hit_of_cluster[cluster] == CR_HIT_NONE) {
            hit_of_cluster[cluster] = (uint16_t)i;
        }
        /* Every pair is listed from both sides: the side that comes later sees both hits. */
        const struct cr_img_neighbour *beside = &s->adj[s->adj_start[cluster]],
                                      *end = &s->adj[s->adj_start[cluster + 1u]];
        while (beside < end && beside->cluster < cluster) {
            const struct cr_img_neighbour *next = beside + 1;
            while (next < end && next->cluster == beside->cluster) {
                next++;
            }
            uint32_t other = hit_of_cluster[beside->cluster];
            for (; other < i && set->hits[other].cluster == beside->cluster; other++) {
                join_beside(set->hits, i, other, beside, next);
            }
            beside = next;
        }
    }
    for (uint32_t i = 0; i < set->hit_count; i++) {
        hit_of_cluster[set->hits[i].cluster] = CR_HIT_NONE;
    }
}

static void add_sum(struct cr_img_sum *to, const struct cr_img_sum *from) {
    to->ax += from->ax;
    to->ay += from->ay;
    to->az += from->az;
    to->px += from->px;
    to->py += from->py;
    to->pz += from->pz;
    to->area += from->area;
    to->peak = max_f(to->peak, from->peak);
}

/* Roots become areas in order; beyond the capacity they join the last one. Parents come before children, so one pass does. */
static void label_areas(cr_contact_set *set, cr_area_set *areas, cr_stats *stats) {
    static const cr_area_work empty = {0};
    areas->count = 0u;
    for (uint32_t i = 0; i < set->hit_count; i++) {
        cr_hit *hit = &set->hits[i];
        if (hit->area == i) {
            if (areas->count < CR_AREAS_MAX) {
                areas->areas[areas->count++] = empty;
            } else {
                stats->areas_merged++;
            }
            hit->area = (uint16_t)(areas->count - 1u);
        } else {
            hit->area = set->hits[hit->area].area;
        }
        add_sum(&areas->areas[hit->area].sum, &hit->sum);
    }
}

/* Zone of the area on this patch; the least touched one makes room when all are taken. */
static uint32_t find_zone(cr_area_work *area, uint32_t patch, float area_m2, cr_stats *stats) {
    for (uint32_t z = 0; z < area->zone_count; z++) {
        if (area->zones[z].patch == patch) {
            return z;
        }
    }
    uint32_t at = area->zone_count;
    if (at == CR_ZONES_MAX) {
        stats->zones_dropped++;
        at = 0u;
        for (uint32_t z = 1; z < CR_ZONES_MAX; z++) {
            at = area->zones[z].area_m2 < area->zones[at].area_m2 ? z : at;
        }
        if (area->zones[at].area_m2 >= area_m2) {
            return CR_ZONES_MAX;
        }
    } else {
        area->zone_count++;
    }
    static const cr_zone none = {0};
    static const cr_zone_shape flat = {0};
    area->zones[at] = none;
    area->zones[at].patch = patch;
    area->shapes[at] = flat;
    area->shapes[at].facet = CR_FACET_NONE;
    return at;
}

static void add_touch(const cr_scene *s, const cr_touch *touch, cr_area_work *area, cr_stats *stats) {
    uint32_t z = find_zone(area, s->facets[touch->facet].patch, touch->area_m2, stats);
    if (z == CR_ZONES_MAX) {
        return;
    }
    cr_zone *zone = &area->zones[z];
    cr_zone_shape *shape = &area->shapes[z];
    if (touch->mixed || (shape->facet != CR_FACET_NONE && shape->facet != touch->facet)) {
        shape->curved = 1u;
    }
    shape->facet = touch->facet;
    zone->area_m2 += touch->area_m2;
    zone->normal_world = v3_add(zone->normal_world, touch->normal_sum_m2);
    zone->centre_world_m = v3_add(zone->centre_world_m, touch->point_sum_m3);
    shape->tool_sum_m2 = v3_add(shape->tool_sum_m2, touch->tool_sum_m2);
}

/* Sums to means. A zone on one facet has that facet's plane exactly. Returns 0 for a zone without direction. */
static int finish_zone(const cr_scene *s, cr_zone *zone, cr_zone_shape *shape) {
    const struct cr_img_facet *facet = &s->facets[shape->facet];
    float area = zone->area_m2;
    if (!(area > AREA_MIN_M2)) {
        return 0;
    }
    float length = v3_norm(zone->normal_world);
    if (!(length > 1e-3f * area)) {
        return 0;
    }
    zone->centre_world_m = v3_scale(zone->centre_world_m, 1.0f / area);
    if (shape->curved) {
        /* Mean resultant length R of the normals: their standard deviation is about sqrt(2 (1 - R)). */
        shape->spread_rad = sqrtf(max_f(0.0f, 2.0f * (1.0f - length / area)));
        zone->normal_world = v3_scale(zone->normal_world, 1.0f / length);
        zone->offset_m = v3_dot(zone->normal_world, zone->centre_world_m);
    } else {
        zone->normal_world = v3_from(facet->normal);
        zone->offset_m = facet->offset_m;
    }
    return 1;
}

static void finish_zones(const cr_scene *s, cr_area_work *area) {
    uint32_t kept = 0u;
    for (uint32_t z = 0; z < area->zone_count; z++) {
        if (finish_zone(s, &area->zones[z], &area->shapes[z])) {
            area->zones[kept] = area->zones[z];
            area->shapes[kept] = area->shapes[z];
            kept++;
        }
    }
    area->zone_count = kept;
}

/* Spheres that reach all that the zone touches [1]: mean surface points of the clusters, widened by the clusters' radii. */
static void widen_spheres(const cr_scene *s, const cr_contact_set *set, cr_area_set *areas) {
    for (uint32_t t = 0; t < set->touch_count; t++) {
        const cr_touch *touch = &set->touches[t];
        const cr_hit *hit = &set->hits[touch->hit];
        cr_area_work *area = &areas->areas[hit->area];
        uint32_t patch = s->facets[touch->facet].patch;
        for (uint32_t z = 0; z < area->zone_count && touch->area_m2 > AREA_MIN_M2; z++) {
            if (area->zones[z].patch == patch) {
                cr_vec3 mean = v3_scale(touch->point_sum_m3, 1.0f / touch->area_m2);
                float reach = v3_norm(v3_sub(mean, area->zones[z].centre_world_m)) + s->clusters[hit->cluster].radius_m;
                area->zones[z].radius_m = max_f(area->zones[z].radius_m, reach);
            }
        }
    }
}

void cr_zones(const cr_scene *scene, uint16_t *hit_of_cluster, cr_contact_set *set, cr_area_set *areas,
              cr_stats *stats) {
    connect_hits(scene, hit_of_cluster, set);
    label_areas(set, areas, stats);
    for (uint32_t t = 0; t < set->touch_count; t++) {
        const cr_touch *touch = &set->touches[t];
        add_touch(scene, touch, &areas->areas[set->hits[touch->hit].area], stats);
    }
    for (uint32_t a = 0; a < areas->count; a++) {
        finish_zones(scene, &areas->areas[a]);
    }
    widen_spheres(scene, set, areas);
}
