#include "contacts.h"

#include "contact/way_out.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
    uint32_t area, patch;
} state;

struct crv_watch {
    cr_world *world;
    const cr_scene *scene;
    cr_field field;
    state *states;    /* [cluster_count * CR_LANES] */
    uint32_t *active; /* clusters with a sample in contact in the last tick */
    uint32_t *seen;   /* [cluster_count] tick in which the cluster was last a hit */
    uint32_t active_count, tick;
};

crv_watch *crv_watch_new(cr_world *world, const cr_scene *scene) {
    crv_watch *watch = calloc(1, sizeof *watch);
    if (watch == NULL) {
        return NULL;
    }
    watch->world = world;
    watch->scene = scene;
    watch->states = malloc((size_t)scene->cluster_count * CR_LANES * sizeof *watch->states);
    watch->active = malloc(CR_CLUSTERS_MAX * sizeof *watch->active);
    watch->seen = calloc(scene->cluster_count, sizeof *watch->seen);
    if (watch->states == NULL || watch->active == NULL || watch->seen == NULL) {
        crv_watch_free(watch);
        return NULL;
    }
    for (size_t i = 0; i < (size_t)scene->cluster_count * CR_LANES; i++) {
        watch->states[i].area = 0u;
        watch->states[i].patch = CRV_PATCH_NONE;
    }
    cr_field_init(&watch->field, scene);
    return watch;
}

void crv_watch_free(crv_watch *watch) {
    if (watch != NULL) {
        free(watch->states);
        free(watch->active);
        free(watch->seen);
        free(watch);
    }
}

/* Heaviest zone of a hit, or CR_WAY_NONE: responses of rivals/ know none. */
static uint32_t zone_of(const cr_contact_set *set, uint32_t hit) {
    uint32_t best = CR_WAY_NONE;
    for (uint32_t z = 0; z < set->way.count; z++) {
        const int its = (int)(set->way.reach[hit].zones >> z & 1u);
        if (its && (best == CR_WAY_NONE || set->way.zones[z].weight_m3 > set->way.zones[best].weight_m3)) {
            best = z;
        }
    }
    return best;
}

/* Area of a hit, CR_AREAS_MAX for none. */
static uint32_t area_of(const cr_contact_set *set, uint32_t hit) {
    const uint32_t zone = zone_of(set, hit);
    uint32_t area = zone == CR_WAY_NONE ? CR_AREAS_MAX : set->way.area_of[zone];
#ifdef CR_RIVALS
    area = zone == CR_WAY_NONE ? set->hits[hit].area : area;
#endif
    return area < CR_AREAS_MAX ? area : CR_AREAS_MAX;
}

/* Labels of this tick's areas: that of most of an area's samples in the last tick, a free one for a new area. */
static void label_areas(const crv_watch *watch, const cr_contact_set *set, uint32_t *label) {
    uint32_t votes[CR_AREAS_MAX + 1][CR_AREAS_MAX] = {{0u}};
    uint64_t taken = 0u, done = 0u; /* CR_AREAS_MAX is 64 at most */
    for (uint32_t h = 0; h < set->hit_count; h++) {
        const cr_hit *hit = &set->hits[h];
        const uint32_t area = area_of(set, h);
        for (uint32_t i = 0; i < watch->scene->clusters[hit->cluster].count; i++) {
            uint32_t before = watch->states[(size_t)hit->cluster * CR_LANES + i].area;
            votes[area][before == 0u ? 0u : before - 1u] += before != 0u && (hit->covered >> i & 1u);
        }
    }
    for (;;) { /* the pair of most votes first; each pass gives one label away */
        uint32_t best = 0u, area = 0u, to = 0u;
        for (uint32_t a = 0; a < CR_AREAS_MAX; a++) {
            for (uint32_t l = 0; l < CR_AREAS_MAX; l++) {
                if (votes[a][l] > best && !(done >> a & 1u) && !(taken >> l & 1u)) {
                    best = votes[a][l];
                    area = a;
                    to = l;
                }
            }
        }
        if (best == 0u) {
            break;
        }
        label[area] = to;
        done |= (uint64_t)1u << area;
        taken |= (uint64_t)1u << to;
    }
    for (uint32_t a = 0, l = 0; a < CR_AREAS_MAX; a++) {
        if (!(done >> a & 1u)) {
            while (taken >> l & 1u) {
                l++;
            }
            label[a] = l++;
        }
    }
}

/* Patch that a lane is nearest to: by the facets of its cell. */
static uint32_t patch_of_lane(const crv_watch *watch, const cr_lookup *at, uint32_t i, cr_vec3 p, uint32_t otherwise) {
    const struct cr_img_facet *facets = watch->scene->facets;
    cr_way_facets on;
    if ((at->from_facet >> i & 1u) != 0u) {
        return facets[at->facet[i]].patch;
    }
    cr_way_facets_of(&watch->field, at, (int)i, p, &on);
    uint32_t best = 0u;
    for (uint32_t k = 1; k < on.count; k++) {
        best = on.share[k] > on.share[best] ? k : best;
    }
    return on.count > 0u ? facets[on.facet[best]].patch : otherwise;
}

static void find_patches(const crv_watch *watch, const xform *pose, const cr_contact_set *set, uint32_t hit,
                         uint32_t *patch) {
    const struct cr_img_cluster *c = &watch->scene->clusters[set->hits[hit].cluster];
    const uint32_t zone = zone_of(set, hit),
                   otherwise = zone == CR_WAY_NONE ? CRV_PATCH_NONE : set->way.zones[zone].patch;
    cr_lanes3 world;
    cr_lookup at;
    cr_lanes_to_world(pose, c->x, c->y, c->z, &world);
    cr_field_look_up(&watch->field, &world, &at);
    for (uint32_t i = 0; i < CR_LANES; i++) {
        patch[i] = patch_of_lane(watch, &at, i, lane_of(&world, (int)i), otherwise);
    }
}

static const state no_contact = {0u, CRV_PATCH_NONE};

/* Notes where the samples of a cluster have another state than before. */
static size_t change_cluster(crv_watch *watch, uint32_t cluster, const state *next, crv_change *changes) {
    size_t count = 0;
    for (uint32_t i = 0; i < watch->scene->clusters[cluster].count; i++) {
        state *now = &watch->states[(size_t)cluster * CR_LANES + i];
        if (next[i].area != now->area || next[i].patch != now->patch) {
            crv_change *change = &changes[count++];
            change->sample = cluster * CR_LANES + i;
            change->area = next[i].area;
            change->patch = next[i].patch;
            *now = next[i];
        }
    }
    return count;
}

/* Samples of the cluster of hit h, over all hits that it has: they follow each other. Returns the next cluster's hit. */
static uint32_t find_states(const crv_watch *watch, const xform *pose, const cr_contact_set *set, const uint32_t *label,
                            uint32_t h, state *next) {
    const uint32_t cluster = set->hits[h].cluster;
    uint32_t patch[CR_LANES];
    for (; h < set->hit_count && set->hits[h].cluster == cluster; h++) {
        const cr_hit *hit = &set->hits[h];
        const uint32_t area = area_of(set, h);
        find_patches(watch, pose, set, h, patch);
        for (uint32_t i = 0; i < CR_LANES; i++) {
            if (area < CR_AREAS_MAX && (hit->covered >> i & 1u)) {
                next[i].area = 1u + label[area];
                next[i].patch = patch[i];
            }
        }
    }
    return h;
}

static size_t find_changes(crv_watch *watch, const cr_pose *shown, const cr_contact_set *set, crv_change *changes) {
    const xform pose = cr_xform_from_pose(shown);
    uint32_t label[CR_AREAS_MAX];
    state next[CR_LANES];
    size_t count = 0;
    watch->tick++;
    label_areas(watch, set, label);
    for (uint32_t h = 0; h < set->hit_count;) {
        const uint32_t cluster = set->hits[h].cluster;
        for (uint32_t i = 0; i < CR_LANES; i++) {
            next[i] = no_contact;
        }
        h = find_states(watch, &pose, set, label, h, next);
        count += change_cluster(watch, cluster, next, changes + count);
        watch->seen[cluster] = watch->tick;
    }
    for (uint32_t i = 0; i < CR_LANES; i++) {
        next[i] = no_contact;
    }
    for (uint32_t k = 0; k < watch->active_count; k++) {
        if (watch->seen[watch->active[k]] != watch->tick) {
            count += change_cluster(watch, watch->active[k], next, changes + count);
        }
    }
    watch->active_count = set->hit_count;
    for (uint32_t h = 0; h < set->hit_count; h++) {
        watch->active[h] = set->hits[h].cluster;
    }
    return count;
}

static void store_vec3(float to[3], cr_vec3 from) {
    to[0] = from.x;
    to[1] = from.y;
    to[2] = from.z;
}

static uint32_t store_zones(const cr_output *out, crv_zone *zones) {
    uint32_t count = 0u;
    for (uint32_t a = 0; a < out->area_count; a++) {
        const cr_area *area = &out->areas[a];
        float sum = 0.0f;
        for (uint32_t z = 0; z < area->zone_count; z++) {
            sum += area->zones[z].weight_m2;
        }
        for (uint32_t z = 0; z < area->zone_count; z++) {
            crv_zone *zone = &zones[count++];
            zone->patch = area->zones[z].patch;
            zone->area = a;
            store_vec3(zone->centre_m, area->zones[z].centre_world_m);
            store_vec3(zone->normal, area->zones[z].normal_world);
            zone->area_m2 = area->zones[z].area_m2;
            zone->share = sum > 0.0f ? area->zones[z].weight_m2 / sum : 0.0f;
        }
    }
    return count;
}

static cr_vec3 acting_point(const cr_output *out) {
    cr_vec3 sum = v3(0.0f, 0.0f, 0.0f);
    float depth = 0.0f;
    for (uint32_t a = 0; a < out->area_count; a++) {
        sum = v3_mad(sum, out->areas[a].point_world_m, out->areas[a].depth_m);
        depth += out->areas[a].depth_m;
    }
    return depth > 0.0f ? v3_scale(sum, 1.0f / depth) : v3(0.0f, 0.0f, 0.0f);
}

/* The tick of a row of the path; returns its pose. */
static cr_pose tick_row(cr_world *world, const cr_path_row *path, size_t i, double period_first_s, cr_output *out) {
    const double *p = path[i].pos_m, *q = path[i].rot;
    const cr_pose pose = {{(float)p[0], (float)p[1], (float)p[2]},
                          {(float)q[0], (float)q[1], (float)q[2], (float)q[3]}};
    const double period_s = i == 0 ? period_first_s : path[i].t_s - path[i - 1].t_s;
    cr_tick(world, &pose, (float)period_s, out);
    return pose;
}

size_t crv_watch_run(crv_watch *watch, const cr_path_row *path, size_t count, double period_first_s, crv_tick *ticks,
                     crv_change *changes, size_t changes_room, crv_zone *zones, size_t zones_room) {
    static const cr_contact_set nothing;
    const size_t most = (size_t)2u * CR_LANES * (size_t)watch->scene->cluster_count;
    size_t changed = 0, stored = 0, i = 0;
    cr_output out;
    memset(&out, 0, sizeof out);
    for (; i < count && changes_room - changed >= most && zones_room - stored >= (size_t)CR_AREAS_MAX * CR_ZONES_MAX;
         i++) {
        const cr_pose pose = tick_row(watch->world, path, i, period_first_s, &out);
        const cr_contact_set *set = out.area_count > 0u ? cr_world_contacts(watch->world) : &nothing;
        crv_tick *tick = &ticks[i];
        tick->changes = (uint32_t)find_changes(watch, &pose, set, changes + changed);
        tick->zones_stored = store_zones(&out, zones + stored);
        tick->areas = out.area_count;
        tick->zones = out.zone_count;
        tick->contacts = out.stats.contacts;
        store_vec3(tick->point_m, acting_point(&out));
        changed += tick->changes;
        stored += tick->zones_stored;
    }
    return i;
}

size_t crv_areas_run(cr_world *world, const cr_path_row *path, size_t count, double period_first_s, uint32_t *counts,
                     crv_area *areas, size_t room) {
    size_t stored = 0, i = 0;
    cr_output out;
    memset(&out, 0, sizeof out);
    for (; i < count && room - stored >= (size_t)CR_AREAS_MAX; i++) {
        (void)tick_row(world, path, i, period_first_s, &out);
        counts[i] = out.area_count;
        for (uint32_t a = 0; a < out.area_count; a++) {
            crv_area *area = &areas[stored++];
            store_vec3(area->point_m, out.areas[a].point_world_m);
            store_vec3(area->force_N, out.areas[a].force_world_N);
            store_vec3(area->normal, out.areas[a].normal_world);
            area->depth_m = out.areas[a].depth_m;
        }
    }
    return i;
}
