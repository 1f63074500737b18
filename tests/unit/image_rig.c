/* Opened images with a world, random poses, and what every output must satisfy: see image_builder.h. */
#include "image_builder.h"
#ifdef CR_RIVALS
#include "rivals/extent.h"
#endif

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

void crt_forget_planes(crt_rig *rig) {
    struct cr_img_kind *kind = crt_section(rig->image, CR_SEC_KINDS);
    struct cr_img_brick *brick = crt_section(rig->image, CR_SEC_BRICKS);
    for (uint32_t i = 0; i < rig->scene.kind_count; i++) {
        kind[i].kind = kind[i].count > 1u ? (uint32_t)CR_KIND_MIXED : kind[i].kind;
    }
    for (uint32_t i = 0; i < rig->scene.brick_count; i++) {
        brick[i].creased = 0u;
        brick[i].planes = 0u;
    }
}

void crt_restart(crt_rig *rig, const cr_config *config) {
    cr_config defaults = cr_config_default();
    const cr_config *c = config != NULL ? config : &defaults;
    assert_int_equal(cr_world_init(&rig->world, rig->memory, rig->memory_bytes, &rig->scene, c), CR_OK);
}

void crt_open(crt_rig *rig, const crt_solid *solid, const crt_tool *tool, double voxel_m, const cr_config *config) {
    cr_config defaults = cr_config_default();
    memset(rig, 0, sizeof *rig);
    rig->image = crt_image(solid, tool, voxel_m, &rig->size_bytes);
    assert_int_equal(cr_scene_open(&rig->scene, rig->image, rig->size_bytes), CR_OK);
    cr_field_init(&rig->field, &rig->scene);
    rig->memory_bytes = cr_world_size(&rig->scene, &defaults);
    assert_true(rig->memory_bytes > 0u);
    rig->memory = aligned_alloc(CR_IMG_ALIGN, rig->memory_bytes);
    assert_non_null(rig->memory);
    crt_restart(rig, config);
}

void crt_open_cube(crt_rig *rig, const crt_solid *solid, double half_m, double spacing_m, double voxel_m) {
    const double centre[3] = {0.0, 0.0, 0.0}, half[3] = {half_m, half_m, half_m};
    crt_tool tool = crt_tool_new(spacing_m);
    crt_add_box(&tool, centre, half);
    crt_open(rig, solid, &tool, voxel_m, NULL);
    crt_tool_free(&tool);
}

void crt_mark_planes(crt_rig *rig) {
    struct cr_img_brick *bricks = crt_section(rig->image, CR_SEC_BRICKS);
    const uint32_t all = rig->scene.kind_count - 1u; /* kinds are numbered by the set of their facets */
    for (uint32_t i = 0; i < rig->scene.brick_count; i++) {
        bricks[i].planes = (uint16_t)all;
        bricks[i].kind = (uint16_t)(bricks[i].cells == CR_CELLS_NONE ? bricks[i].kind : all);
    }
    crt_seal(rig->image);
}

void crt_close(crt_rig *rig) {
    free(rig->memory);
    free(rig->image);
    memset(rig, 0, sizeof *rig);
}

#ifdef CR_RIVALS
void crt_find_areas(const crt_rig *rig, const cr_pose *pose, uint32_t skip, uint32_t coverage, cr_contact_set *set,
                    cr_area_set *areas, cr_stats *stats) {
    const cr_detect_options options = {.skip = skip,
                                       .coverage = coverage,
                                       .lookups_max = UINT32_MAX,
                                       .slices_max = CR_SEARCH_TICKS_MAX,
                                       .touches = 1u};
    const xform at = cr_xform_from_pose(pose);
    const uint32_t clusters = rig->scene.cluster_count;
    uint16_t *hit_of_cluster = malloc(clusters * sizeof *hit_of_cluster);
    cr_descent search;
    cr_motion motion;
    memset(&search, 0, sizeof search);
    memset(&motion, 0, sizeof motion);
    memset(stats, 0, sizeof *stats);
    motion.wake_count = rig->scene.group_count * CR_LANES;
    motion.wake_m = calloc(motion.wake_count, sizeof(float));
    memset(hit_of_cluster, 0xff, clusters * sizeof *hit_of_cluster); /* CR_HIT_NONE in every byte */
    cr_motion_advance(&motion, pose);
    assert_true(cr_detect(&rig->field, &at, &options, &motion, &search, set, stats));
    cr_zones(&rig->scene, hit_of_cluster, set, areas, stats);
    for (uint32_t i = 0; i < clusters; i++) {
        assert_int_equal(hit_of_cluster[i], CR_HIT_NONE);
    }
    free(hit_of_cluster);
    free(motion.wake_m);
}
#endif

double crt_uniform(uint64_t *seed, double low, double high) {
    *seed ^= *seed << 13;
    *seed ^= *seed >> 7;
    *seed ^= *seed << 17;
    return low + (high - low) * (double)(*seed >> 11) * 0x1p-53;
}

cr_quat crt_random_rotation(uint64_t *seed) {
    double q[4], n = 0.0;
    do {
        n = 0.0;
        for (int i = 0; i < 4; i++) {
            q[i] = crt_uniform(seed, -1.0, 1.0);
            n += q[i] * q[i];
        }
    } while (n > 1.0 || n < 0.01);
    n = sqrt(n);
    cr_quat r = {(float)(q[0] / n), (float)(q[1] / n), (float)(q[2] / n), (float)(q[3] / n)};
    return r;
}

cr_quat crt_turn(double x, double y, double z, double angle_rad) {
    double s = sin(0.5 * angle_rad) / sqrt(x * x + y * y + z * z);
    cr_quat r = {(float)cos(0.5 * angle_rad), (float)(x * s), (float)(y * s), (float)(z * s)};
    return r;
}

cr_pose crt_pose(double x, double y, double z) {
    cr_pose p = {{(float)x, (float)y, (float)z}, {1.0f, 0.0f, 0.0f, 0.0f}};
    return p;
}

static int areas_are_sound(const cr_output *out) {
    int good = 1;
    for (uint32_t i = 0; i < out->area_count; i++) {
        const cr_area *a = &out->areas[i];
        good &= v3_is_finite(a->normal_world) && v3_is_finite(a->point_world_m) && v3_is_finite(a->force_world_N);
        good &= is_finite_f(a->depth_m) && a->depth_m >= 0.0f && is_finite_f(a->offset_m) && is_finite_f(a->area_m2);
        good &= a->zone_count <= CR_ZONES_MAX && fabsf(v3_norm(a->normal_world) - 1.0f) < 1e-4f;
        for (uint32_t z = 0; good && z < a->zone_count; z++) {
            const cr_zone *zone = &a->zones[z];
            good &= v3_is_finite(zone->normal_world) && v3_is_finite(zone->centre_world_m);
            good &= is_finite_f(zone->radius_m) && is_finite_f(zone->weight_m2) && is_finite_f(zone->offset_m);
        }
    }
    return good;
}

int crt_is_sound(const cr_output *out, const cr_config *config) {
    cr_quat q = out->display_pose.rot;
    int good =
        v3_is_finite(out->force_world_N) && v3_is_finite(out->torque_world_Nm) && v3_is_finite(out->normal_world);
    good &= v3_is_finite(out->display_pose.pos_m) && is_finite_f(q.w + q.x + q.y + q.z);
    good &= is_finite_f(out->depth_m) && out->depth_m >= 0.0f && out->area_count <= CR_AREAS_MAX;
    good &= v3_norm(out->force_world_N) <= config->force_max_N * 1.00001f;
    return good && areas_are_sound(out);
}

int crt_same(const cr_output *a, const cr_output *b) {
    const cr_stats *s = &a->stats, *t = &b->stats;
    /* What comes before the statistics: no padding in it. */
    if (memcmp(a, b, offsetof(cr_output, stats)) != 0 || s->contacts != t->contacts || s->clusters != t->clusters ||
        s->force_limited != t->force_limited || s->zones_dropped != t->zones_dropped ||
        s->areas_merged != t->areas_merged) {
        return 0;
    }
    for (uint32_t i = 0; i < a->area_count; i++) {
        const cr_area *p = &a->areas[i], *q = &b->areas[i];
        if (memcmp(p, q, offsetof(cr_area, zones)) != 0 ||
            memcmp(p->zones, q->zones, p->zone_count * sizeof *p->zones) != 0) {
            return 0;
        }
    }
    return 1;
}

#define QUARTER 1.57079632679489661923

void crt_check_free(const crt_rig *rig, double half_m, const cr_config *config) {
    uint64_t seed = 83u;
    int pushed = 0;
    double most = 0.0;
    crt_restart((crt_rig *)rig, config);
    for (int i = 0; i < 4000; i++) {
        double turn = crt_uniform(&seed, 0.0, QUARTER), gap = crt_uniform(&seed, 2e-6, 0.4e-3);
        cr_vec3 n = v3((float)cos(turn), 0.0f, (float)sin(turn));
        cr_pose pose = crt_pose(0.0, crt_uniform(&seed, -20e-3, 20e-3), 0.0);
        pose.rot = i % 3 ? crt_random_rotation(&seed) : crt_turn(0.0, 1.0, 0.0, QUARTER - turn);
        xform now = cr_xform_from_pose(&pose);
        float lowest = 1.0f;
        for (int k = 0; k < 8; k++) {
            float h = (float)half_m;
            cr_vec3 v = v3(k & 1 ? h : -h, k & 2 ? h : -h, k & 4 ? h : -h);
            lowest = min_f(lowest, v3_dot(n, xform_rotate(&now, v)));
        }
        double along = crt_uniform(&seed, -8e-3, 8e-3), up = gap - (double)lowest;
        pose.pos_m.x = (float)(up * (double)n.x - along * (double)n.z);
        pose.pos_m.z = (float)(up * (double)n.z + along * (double)n.x);
        cr_output out;
        cr_tick(rig->world, &pose, 1e-3f, &out);
        const float *f = &out.force_world_N.x;
        if (f[0] != 0.0f || f[1] != 0.0f || f[2] != 0.0f || out.depth_m != 0.0f) {
            pushed++;
            most = fmax(most, (double)out.depth_m);
        }
    }
    if (pushed > 0) {
        fail_msg("coverage %u, response %u: a force at %d of 4000 free poses, largest depth %g m", config->coverage,
                 config->response, pushed, most);
    }
}
