/* answer: the stages in their order, and the contacts they make. */
#include "contact/way_out.h"

/* Work, in parts of a unit: a half-space in a sweep, beside pairs of them, so many a part; a pair before the first. */
#define PARTS_OF_HALF 3u
#define PAIRS_OF_PART 2u
#define PARTS_OF_PAIR 2u
/* Normals that differ by less are one, m/m: a few times the rounding of a turn. Without it a flat wall pushes sideways, by 1.2e-6 N at up to 3 mm:
 * tests/property/test_invariants.py. */
#define SAME_NORMAL 1e-6f

/* A point on which a force along the normal has this moment about the tool origin, nearest to the middle of what is inside. */
static cr_vec3 point_of_force(const cr_way_half *half, cr_vec3 middle) {
    return v3_mad(v3_cross(half->normal, half->arm_m), half->normal, v3_dot(half->normal, middle));
}

/* Area, and the middle, of the zones of a half-space. */
static float sum_zones(const cr_way_zones *zones, uint32_t bits, cr_vec3 *middle) {
    CR_ASSERT(bits != 0u && (bits >> zones->count) == 0u);
    cr_vec3 centre = v3(0.0f, 0.0f, 0.0f);
    float area = 0.0f, weight = 0.0f;
    while (bits != 0u) {
        const cr_way_zone *z = &zones->zones[take_lane(&bits)];
        area += z->area_m2;
        weight += z->weight_m3;
        centre = v3_add(centre, z->centre_m4);
    }
    *middle = v3_scale(centre, 1.0f / weight);
    return area;
}

static cr_vec3 world_normal(const xform *pose, const cr_way_zone *z) {
    return xform_rotate(pose, z->flat ? z->plane_normal : v3_unit(z->normal_m3, 0.0f));
}

/* A zone for the report: of curved surfaces the sides are zones of their own. */
static void report_zone(const cr_respond_input *in, const cr_way_relations *r, uint32_t index, cr_area *out) {
    const cr_way_zone *z = &in->set->way.zones[index];
    if (out->zone_count == CR_ZONES_MAX || z->patch == CR_FACET_NONE) {
        return;
    }
    cr_zone *zone = &out->zones[out->zone_count++];
    zone->patch = z->patch;
    zone->normal_world = world_normal(in->world_from_tool, z);
    zone->centre_world_m = cr_xform_point(in->world_from_tool, r->touched[index]);
    zone->area_m2 = z->area_m2;
    zone->radius_m = sqrtf(z->area_m2);
    zone->weight_m2 = z->deep_m > 0.0f ? z->weight_m3 / z->deep_m : 0.0f;
    zone->offset_m = v3_dot(zone->normal_world, zone->centre_world_m);
}

/* Normal of a half-space. That of a facet, but for rounding, is the facet's: turned to the tool and back it would push a little aside. */
static cr_vec3 push_normal(const cr_respond_input *in, const cr_way_half *half) {
    for (uint32_t left = half->zones; left != 0u;) {
        const cr_way_zone *z = &in->set->way.zones[take_lane(&left)];
        if (z->flat && v3_norm(v3_sub(z->plane_normal, half->normal)) < SAME_NORMAL) {
            return v3_from(in->field->scene->facets[z->key.surface].normal);
        }
    }
    return xform_rotate(in->world_from_tool, half->normal);
}

static void report(const cr_respond_input *in, const cr_way_relations *r, const cr_way_half *half, float push_m,
                   cr_area *out) {
    cr_vec3 middle;
    out->area_m2 = sum_zones(&in->set->way, half->zones, &middle);
    out->force_world_N = v3(0.0f, 0.0f, 0.0f);
    out->normal_world = push_normal(in, half);
    CR_ASSERT(v3_is_unit(out->normal_world));
    out->point_world_m = cr_xform_point(in->world_from_tool, point_of_force(half, middle));
    out->depth_m = push_m;
    out->offset_m = v3_dot(out->normal_world, out->point_world_m) + push_m;
    out->zone_count = 0u;
    for (uint32_t left = half->zones; left != 0u;) {
        report_zone(in, r, (uint32_t)take_lane(&left), out);
    }
}

/* Contact of each zone: that of its half-space, or where that does not push, of the one that pushes most along it. */
static void label_zones(cr_way_zones *zones, const cr_way_relations *r, const cr_way_half *half, const uint32_t *area,
                        uint32_t count) {
    for (uint32_t z = 0; z < zones->count; z++) {
        const uint32_t mine = r->half_of[z];
        float most = -3.0f;
        zones->area_of[z] = area[mine];
        for (uint32_t h = 0; h < count && area[mine] == CR_HIT_NONE; h++) {
            const float along = v3_dot(half[mine].normal, half[h].normal);
            if (area[h] != CR_HIT_NONE && along > most) {
                most = along;
                zones->area_of[z] = area[h];
            }
        }
        CR_ASSERT(zones->area_of[z] < CR_AREAS_MAX || zones->area_of[z] == CR_HIT_NONE);
    }
}

/* How far it is resolved which half-spaces push. */
enum { CR_WAY_MEASURING, CR_WAY_SWEEPING, CR_WAY_RESOLVED };

static void begin_push(cr_way_work *work) {
    const cr_way_half *half = work->half;
    const uint32_t count = work->relations.half_count;
    for (uint32_t h = 0; h < count; h++) {
        const cr_vec3 n = half[h].normal;
        work->normal[h] = n;
        work->depth_m[h] = v3_dot(n, n) <= 0.5f ? 0.0f : half[h].depth_m * half[h].open;
    }
    cr_way_resolve_begin(work->normal, work->depth_m, count, &work->along, work->push_m);
    work->resolving = CR_WAY_SWEEPING;
    work->spent += PARTS_OF_PAIR * (count + work->along.count * work->along.count);
}

static void sweep_pushes(cr_way_work *work) {
    if (cr_way_resolve_sweep(work->depth_m, &work->along, work->push_m)) {
        work->resolving = CR_WAY_RESOLVED;
    }
    work->spent += work->along.count * (PARTS_OF_HALF + work->along.count / PAIRS_OF_PART) + 1u;
}

int cr_way_push(cr_way_work *work, uint32_t lookups_max) {
    int is_whole = 0;
    while (!is_whole && work->spent / CR_WORK_PARTS < lookups_max) {
        if (work->resolving == CR_WAY_MEASURING) {
            begin_push(work);
        } else if (work->resolving == CR_WAY_SWEEPING) {
            sweep_pushes(work);
        } else {
            is_whole = 1;
        }
    }
    return is_whole;
}

/* Of the half-spaces the one that pushes least is no contact of its own: what it pushes goes to the one that pushes most along it. Left out as they come, half a
 * millimetre was lost at once where a ring of sixteen pieces lies on a boss. */
static void merge_least(cr_way_work *work, uint32_t count) {
    float *push_m = work->push_m, along = 0.0f;
    uint32_t least = count, to = count;
    for (uint32_t h = 0; h < count; h++) {
        const int less = least == count || push_m[h] < push_m[least];
        least = push_m[h] <= 0.0f || !less ? least : h;
    }
    CR_ASSERT(least < count);
    for (uint32_t h = 0; h < count; h++) {
        const float its = v3_dot(work->half[least].normal, work->half[h].normal);
        if (h != least && its > along && push_m[h] > 0.0f) {
            along = its;
            to = h;
        }
    }
    if (to < count) {
        push_m[to] += along * push_m[least];
    }
    push_m[least] = 0.0f;
}

uint32_t cr_way_answer(const cr_respond_input *in, cr_way_work *work, cr_area *out, uint32_t room, cr_stats *stats) {
    cr_way_zones *zones = &in->set->way;
    const cr_way_half *half = work->half;
    const uint32_t count = work->relations.half_count;
    uint32_t made = 0u, push = 0u;
    CR_ASSERT(count <= zones->count && room <= CR_AREAS_MAX);
    for (uint32_t h = 0; h < count; h++) {
        push += (uint32_t) !(work->push_m[h] <= 0.0f);
    }
    for (; push > room; push--) {
        merge_least(work, count);
        stats->areas_merged++;
    }
    for (uint32_t h = 0; h < count; h++) {
        const float push_m = work->push_m[h];
        work->area[h] = CR_HIT_NONE;
        if (!(push_m <= 0.0f)) {
            work->area[h] = made;
            report(in, &work->relations, &half[h], push_m, &out[made++]);
        }
    }
    label_zones(zones, &work->relations, half, work->area, count);
    stats->zones_dropped += zones->dropped + zones->layers.dropped;
    return made;
}
