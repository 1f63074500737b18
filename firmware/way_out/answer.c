/* answer: the stages in their order, and the contacts they make. */
#include "way_out/way_out.h"

/* A point on which a force along the normal has this moment about the tool origin, nearest to the middle of what is inside. */
static cr_vec3 acting_point(const cr_way_half *half, cr_vec3 middle) {
    return v3_mad(v3_cross(half->normal, half->arm_m), half->normal, v3_dot(half->normal, middle));
}

/* Area, and the middle, of the zones of a half-space. */
static float sum_zones(const cr_way_zones *zones, uint32_t bits, cr_vec3 *middle) {
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

static void report(const cr_respond_input *in, const cr_way_zones *zones, const cr_way_half *half, float push_m,
                   cr_area *out) {
    static const cr_area none = {0};
    cr_vec3 middle;
    *out = none;
    out->area_m2 = sum_zones(zones, half->zones, &middle);
    out->normal_world = xform_rotate(in->world_from_tool, half->normal);
    out->point_world_m = xform_point(in->world_from_tool, acting_point(half, middle));
    out->depth_m = push_m;
    out->offset_m = v3_dot(out->normal_world, out->point_world_m) + push_m;
}

uint32_t cr_way_answer(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room) {
    cr_way_zones zones;
    cr_way_relations relations;
    cr_way_half half[CR_WAY_ZONES_MAX];
    cr_vec3 normal[CR_WAY_ZONES_MAX];
    float depth[CR_WAY_ZONES_MAX], push[CR_WAY_ZONES_MAX];
    uint32_t made = 0u;
    (void)areas;
    cr_way_gather(in, &zones);
    const uint32_t count = cr_way_relate(in->field->scene, &zones, &relations, half);
    cr_way_measure(in, &zones, &relations, half);
    for (uint32_t h = 0; h < count; h++) {
        normal[h] = half[h].normal;
        depth[h] = v3_dot(normal[h], normal[h]) > 0.5f ? half[h].depth_m * half[h].open : 0.0f;
    }
    cr_way_resolve(normal, depth, count, push);
    for (uint32_t h = 0; h < count && made < room; h++) {
        if (push[h] > 0.0f) {
            report(in, &zones, &half[h], push[h], &out[made++]);
        }
    }
    return made;
}
