/* published: the contact plane to the letter of [1], for comparison. DESIGN.md "The method as published". */
#include "rivals/extent.h"

/* Sweeps over the zones' planes to find their common point; two planes at 30 degrees converge by 0.75 a sweep. */
#define COMMON_POINT_SWEEPS 24

/* Normal of an area: its zone's; with two zones the reversed tool normals in the plane of the zone normals; with more, as is. */
static cr_vec3 published_normal(const cr_area_work *a, cr_vec3 s) {
    if (a->zone_count == 1u) {
        return a->zones[0].normal_world;
    }
    if (a->zone_count == 2u) {
        cr_vec3 across = v3_unit(v3_cross(a->zones[0].normal_world, a->zones[1].normal_world), 1e-6f);
        s = v3_mad(s, across, -v3_dot(s, across));
    }
    return v3_unit(s, 1e-6f * a->sum.area);
}

/* Point of the contact plane: the sphere's centre, or where the planes of several zones meet (their common vertex or a point of
 * their common edge), by projecting onto one after the other. */
static cr_vec3 published_point(const cr_area_work *a) {
    cr_vec3 p = v3(0.0f, 0.0f, 0.0f);
    for (uint32_t i = 0; i < a->zone_count; i++) {
        p = v3_mad(p, a->zones[i].centre_world_m, 1.0f / (float)a->zone_count);
    }
    for (int sweep = 0; sweep < COMMON_POINT_SWEEPS && a->zone_count > 1u; sweep++) {
        for (uint32_t i = 0; i < a->zone_count; i++) {
            const cr_zone *zone = &a->zones[i];
            p = v3_mad(p, zone->normal_world, zone->offset_m - v3_dot(zone->normal_world, p));
        }
    }
    return p;
}

/* In the inner half of some zone's sphere. */
static int is_internal(const cr_area_work *a, cr_vec3 p) {
    for (uint32_t i = 0; i < a->zone_count; i++) {
        cr_vec3 d = v3_sub(p, a->zones[i].centre_world_m);
        float r = a->zones[i].radius_m;
        if (v3_dot(d, d) <= r * r && v3_dot(d, a->zones[i].normal_world) < 0.0f) {
            return 1;
        }
    }
    return 0;
}

/* Lowest n . p of the internal vertices, the contact plane at least. */
static float published_lowest(const cr_respond_input *in, uint32_t area, const cr_area_work *a, cr_vec3 n,
                              float start) {
    float best = start;
    for (uint32_t h = 0; h < in->set->hit_count; h++) {
        const cr_hit *hit = &in->set->hits[h];
        if (hit->area != area) {
            continue;
        }
        const struct cr_img_cluster *c = &in->field->scene->clusters[hit->cluster];
        cr_lanes3 world;
        cr_lanes_to_world(in->world_from_tool, c->x, c->y, c->z, &world);
        uint32_t lanes = first_lanes(c->count) & (in->config->vertices_only ? c->vertex_mask : 0xffffu);
        while (lanes != 0u) {
            cr_vec3 p = lane_of(&world, take_lane(&lanes));
            float height = v3_dot(n, p);
            best = height < best && is_internal(a, p) ? height : best;
        }
    }
    return best;
}

uint32_t cr_answer_as_published(const cr_respond_input *in, uint32_t index, const cr_area_work *a, cr_vec3 s,
                                cr_area *out) {
    float whole[CR_ZONES_MAX], weight[CR_ZONES_MAX];
    for (uint32_t i = 0; i < a->zone_count; i++) {
        whole[i] = 1.0f;
        weight[i] = a->zones[i].area_m2;
    }
    cr_vec3 n = published_normal(a, s);
    out->normal_world = n;
    out->offset_m = v3_dot(n, published_point(a));
    out->depth_m = out->offset_m - published_lowest(in, index, a, n, out->offset_m);
    if (!(out->depth_m > 0.0f) || !(v3_dot(n, n) > 0.5f)) {
        return 0u;
    }
    out->point_world_m =
        cr_xform_point(in->world_from_tool, v3_scale(v3(a->sum.px, a->sum.py, a->sum.pz), 1.0f / a->sum.area));
    cr_report_area(a, weight, whole, out);
    return 1u;
}
