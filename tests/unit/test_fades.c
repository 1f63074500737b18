/* What switches on or off between two places does so over a width that is chosen, neither at once nor from afar: pieces at a plane and beside an edge, sides of
 * a curved surface, surfaces that an image has no samples of any more; and which normals are one. */
#include "contact/way_out.h"
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define HALF_M 8e-3
#define RAMP_M 0.5e-3f
#define FLOOR 2u

static void assert_near(double is, double ought, double room) {
    if (!(fabs(is - ought) <= room)) {
        fail_msg("%g instead of %g", is, ought);
    }
}

/* A sample whose piece is level: no height varies across it. */
static struct cr_img_cluster level_piece(void) {
    struct cr_img_cluster c;
    memset(&c, 0, sizeof c);
    c.count = 1u;
    c.ramp[0] = RAMP_M;
    return c;
}

static double cover_level_piece(float height_m) {
    const struct cr_img_cluster c = level_piece();
    const cr_planes p = {.count = 1u, .sign = 1.0f, .normal_tool = {{0.0f, 0.0f, 1.0f}}};
    return (double)cr_cover_by_planes(&p, &c, 0, &height_m, height_m, height_m);
}

/* A level piece of 1 mm is pressed in over a tenth of a millimetre, which a hand at 0.1 m/s takes a tick for: part of it counts 0.025 mm above and below the
 * plane, and none of it 0.075 above. */
static void level_piece_fades_in_over_a_tenth_of_its_width(void **state) {
    (void)state;
    assert_near(cover_level_piece(0.0f), 0.5, 1e-6);
    assert_near(cover_level_piece(0.05f * RAMP_M), 0.25, 0.1);
    assert_near(cover_level_piece(-0.05f * RAMP_M), 0.75, 0.1);
    assert_near(cover_level_piece(0.15f * RAMP_M), 0.0, 1e-6);
}

/* Beside an edge the distance is longer than the height above either plane: what counts of a piece is less only on the last quarter of the way to the ramp. */
static void piece_beside_an_edge_fades_late(void **state) {
    (void)state;
    struct cr_img_cluster c = level_piece();
    const cr_planes p = {.count = 2u, .sign = 1.0f, .normal_tool = {{0.0f, 0.0f, 1.0f}, {1.0f, 0.0f, 0.0f}}};
    const float top_m = 0.2f * RAMP_M, height_m[2] = {top_m, top_m}, rest_m = RAMP_M - top_m;
    c.wxx[0] = c.wzz[0] = 4.0f * RAMP_M * RAMP_M; /* as wide as it gets, so that both planes cut it */
    const double full = (double)cr_cover_by_planes(&p, &c, 0, height_m, top_m, top_m);
    assert_true(full > 0.05);
    assert_near((double)cr_cover_by_planes(&p, &c, 0, height_m, top_m, top_m + 0.70f * rest_m) / full, 1.0, 1e-3);
    assert_near((double)cr_cover_by_planes(&p, &c, 0, height_m, top_m, top_m + 0.875f * rest_m) / full, 0.5, 0.15);
    assert_near((double)cr_cover_by_planes(&p, &c, 0, height_m, top_m, RAMP_M) / full, 0.0, 1e-6);
}

static float share_of_square(float height) { return cr_square_below(height, cr_rest_of_square(height)); }

/* A piece of width 1 at a static corner: a square that is seen along its diagonal. Its share goes on to 0.707 from its middle, where a strip's ends at 0.5, and is the
 * slope of its mean depth; both have the same second moment, so far below and above they are as deep. */
static void piece_at_a_corner_reaches_to_its_corners(void **state) {
    (void)state;
    const float step = 1e-3f;
    double summed = 0.0, moment = 0.0; /* from above all of it on, down; of the density, what the share changes by */
    assert_near((double)share_of_square(0.0f), 0.5, 1e-6);
    assert_true(share_of_square(0.69f) > 1e-4f);
    assert_near((double)share_of_square(0.71f), 0.0, 1e-9);
    assert_near((double)share_of_square(-0.71f), 1.0, 1e-6);
    for (int i = 800; i > -800; i--) {
        const float h = (float)i * step;
        const double more = (double)(share_of_square(h - step) - share_of_square(h));
        assert_true(more >= -1e-6);
        assert_near((double)cr_square_depth(h, cr_rest_of_square(h)), summed, 2e-5);
        summed += (double)share_of_square(h - 0.5f * step) * (double)step;
        moment += more * (double)h * (double)h;
    }
    assert_near(moment, 1.0 / 12.0, 1e-3);
}

/* Three planes are a corner to a piece that all three of them may cut, and two never are. */
static void corner_is_where_three_planes_cut(void **state) {
    (void)state;
    const float at[3] = {0.2f * RAMP_M, -0.1f * RAMP_M, -1.4f * RAMP_M};
    assert_near((double)cr_corner_part(at, 2u, RAMP_M), 0.0, 1e-9);
    assert_near((double)cr_corner_part(at, 3u, RAMP_M), 1.0, 1e-6);
    const float beside[4] = {-2.12f * RAMP_M, 0.2f * RAMP_M, -3.0f * RAMP_M, 0.1f * RAMP_M};
    assert_near((double)cr_corner_part(beside, 4u, RAMP_M), 0.0, 0.01);
    const float between[3] = {0.2f * RAMP_M, -1.77f * RAMP_M, 0.1f * RAMP_M};
    assert_near((double)cr_corner_part(between, 3u, RAMP_M), 0.5, 0.01);
    assert_near((double)cr_corner_reach(0.0f), 1.0, 1e-6);
    assert_near((double)cr_corner_reach(1.0f), sqrt(2.0), 1e-6);
}

/* A piece that is hardly a corner's ends at its own reach, over a face as beside an edge, and nothing of it changes at once. */
static void what_is_hardly_a_corner_ends_before_the_square(void **state) {
    (void)state;
    struct cr_img_cluster c;
    cr_planes p;
    memset(&c, 0, sizeof c);
    memset(&p, 0, sizeof p);
    c.count = 1u;
    c.ramp[0] = RAMP_M;
    c.wxx[0] = c.wyy[0] = c.wzz[0] = 2.0f * RAMP_M * RAMP_M;
    p.count = 3u;
    p.sign = 1.0f;
    p.reach = CR_CORNER_REACH;
    p.normal_tool[0] = v3(1.0f, 0.0f, 0.0f);
    p.normal_tool[1] = v3(0.0f, 1.0f, 0.0f);
    p.normal_tool[2] = v3(0.0f, 0.0f, 1.0f);
    for (float third = -2.2f; third < -1.3f; third += 0.05f) {
        float height_m[3] = {0.0f, 0.5f * RAMP_M, third * RAMP_M}, last[2] = {-1.0f, -1.0f};
        const float reach_m = cr_corner_reach(cr_corner_part(height_m, 3u, RAMP_M)) * RAMP_M;
        for (float top_m = 0.6f * RAMP_M; top_m < 1.5f * RAMP_M; top_m += 1e-3f * RAMP_M) {
            height_m[0] = top_m;
            const float away_m[2] = {top_m, 1.0001f * top_m};
            for (int beside = 0; beside < 2; beside++) {
                const float share = cr_cover_by_planes(&p, &c, 0, height_m, top_m, away_m[beside]);
                assert_true(last[beside] < 0.0f || fabsf(share - last[beside]) < 3e-3f);
                assert_true(share == 0.0f || away_m[beside] < reach_m);
                last[beside] = share;
            }
            assert_near((double)last[1], (double)last[0], 3e-3);
        }
    }
    const float both[3] = {1.3f * RAMP_M, 1.3f * RAMP_M, -1.77f * RAMP_M};
    assert_true(cr_cover_by_planes(&p, &c, 0, both, both[0], 1.84f * RAMP_M) == 0.0f);
}

/* One lane, as deep as this inside of a facet: the share of it that still counts for that. Bricks and reach as host/crease/bake/voxmap.py lays them out:
 * distances end at the diagonal of a brick and 1.1 times the reach. */
static double share_that_stays(double depth_m, double reach_m, double voxel_m) {
    static cr_way_layers layers;
    struct cr_img_meta meta;
    const cr_scene scene = {.meta = &meta};
    memset(&meta, 0, sizeof meta);
    memset(&layers, 0, sizeof layers);
    meta.voxel_m = (float)voxel_m;
    meta.brick_m = (float)(8.0 * voxel_m);
    meta.band_m = (float)(8.0 * sqrt(3.0) * voxel_m + 1.1 * reach_m);
    layers.count = 1u;
    layers.deep_m = (float)depth_m;
    layers.layers[0].lanes = 1u;
    layers.layers[0].depth_m[0] = (float)depth_m;
    layers.layers[0].coverage[0] = 1.0f;
    assert_true(cr_way_fade(&scene, 1u, &layers) != 0 || depth_m < reach_m - voxel_m);
    return (double)layers.layers[0].coverage[0];
}

/* Beyond that reach bricks have no samples: a sample passes from its surfaces to none in the last voxel before. */
static void surfaces_fade_where_the_bricks_end(void **state) {
    (void)state;
    assert_near(share_that_stays(18.5e-3, 20e-3, 1e-3), 1.0, 1e-6);
    assert_near(share_that_stays(19.5e-3, 20e-3, 1e-3), 0.5, 0.25);
    assert_near(share_that_stays(20.5e-3, 20e-3, 1e-3), 0.0, 1e-6);
}

/* Two balls that touch where the normal is this: how deep they are for the side upwards, as a share of how deep they are. Every hit counts for that side alone,
 * along the normal. */
static double share_for_the_side_upwards(cr_vec3 n) {
    static cr_contact_set set;
    static cr_way_work work;
    const double ball_m = 12e-3, tool_m = 9e-3, deep_m = 0.3e-3, far_m = ball_m + tool_m - deep_m;
    const crt_solid ball = crt_ball(ball_m);
    const cr_config config = cr_config_default();
    const cr_detect_options options = {.skip = CR_SKIP_ALL, .lookups_max = UINT32_MAX, .slices_max = 1u};
    crt_tool tool = crt_tool_new(0.7e-3);
    crt_rig rig;
    crt_add_ball(&tool, tool_m);
    crt_open(&rig, &ball, &tool, 0.5e-3, &config);
    const cr_pose pose = crt_pose(far_m * (double)n.x, far_m * (double)n.y, far_m * (double)n.z);
    const xform at = cr_xform_from_pose(&pose);
    cr_descent search = {0};
    cr_stats stats = {0};
    cr_motion motion = {.wake_count = rig.scene.group_count * CR_LANES};
    motion.wake_m = calloc(motion.wake_count, sizeof(float));
    cr_motion_advance(&motion, &pose);
    assert_int_equal(cr_detect(&rig.field, &at, &options, &motion, &search, &set, &stats), 1);
    const cr_respond_input in = {.field = &rig.field, .world_from_tool = &at, .set = &set, .config = &config};
    memset(&work, 0, sizeof work);
    set.way.count = 1u;
    set.way.zones[0].key = (cr_way_key){CR_WAY_CURVED, 4u, 0u};
    set.way.zones[0].deep_hit = 0u;
    for (uint32_t h = 0; h < set.hit_count; h++) {
        set.way.reach[h].zones = 1u;
    }
    work.next = 5u; /* its passes are done */
    work.relations.part[0][0] = work.relations.lead[0] = 1.0f;
    work.relations.half_count = 1u;
    work.half[0].normal = n;
    work.half[0].weight_m3 = work.half[0].curved_m3 = 1e-9f;
    work.half[0].deep_m = (float)deep_m;
    assert_int_equal(cr_way_measure(&in, &work, UINT32_MAX), 1);
    free(motion.wake_m);
    crt_close(&rig);
    crt_tool_free(&tool);
    return (double)work.half[0].depth_m / deep_m;
}

/* The squares of a normal's parts are its shares of the sides. One of them is a third at least: that is in full, so that the deepest sample is as deep for its
 * side as it is. An eighth counts half. */
static void a_quarter_of_a_side_counts_in_full(void **state) {
    (void)state;
    assert_near(share_for_the_side_upwards(v3_unit(v3(1.0f, 1.0f, 1.0f), 0.0f)), 1.0, 0.08);
    assert_near(share_for_the_side_upwards(v3(sqrtf(0.875f), 0.0f, sqrtf(0.125f))), 0.5, 0.13);
}

/* The normal that is reported of a half-space over the floor alone, which leans so much from it. */
static cr_vec3 reported(const crt_rig *rig, const cr_pose *pose, float leans) {
    static cr_contact_set set;
    static cr_way_work work;
    static cr_area area;
    const xform at = cr_xform_from_pose(pose);
    const cr_config config = cr_config_default();
    const cr_respond_input in = {.field = &rig->field, .world_from_tool = &at, .set = &set, .config = &config};
    cr_stats stats = {0};
    memset(&set, 0, sizeof set);
    memset(&work, 0, sizeof work);
    cr_way_zone *z = &set.way.zones[0];
    set.way.count = work.relations.half_count = 1u;
    z->key.surface = FLOOR;
    z->flat = 1u;
    z->plane_offset_m = cr_way_plane(&rig->scene, &at, FLOOR, &z->plane_normal);
    z->weight_m3 = z->deep_m = 1e-9f;
    work.half[0].zones = 1u;
    work.half[0].normal =
        v3_unit(v3_add(z->plane_normal, v3_scale(xform_unrotate(&at, v3(1.0f, 0.0f, 0.0f)), leans)), 0.0f);
    work.half[0].depth_m = 1e-3f;
    work.half[0].open = 1.0f;
    assert_int_equal(cr_way_push(&work, UINT32_MAX), 1);
    assert_int_equal(cr_way_answer(&in, &work, &area, 1u, &stats), 1);
    return area.normal_world;
}

/* Turned to the tool and back a normal comes out beside itself by up to six roundings of 6e-8 in each of its parts: that is the facet's. One that leans by three
 * times as much, of a force of 10 N 0.02 mN, is its own. */
static void normals_are_one_but_for_rounding(void **state) {
    (void)state;
    const crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    uint64_t seed = 7u;
    crt_open_cube(&rig, &block, HALF_M, 1e-3, 2e-3);
    for (int i = 0; i < 300; i++) {
        cr_pose pose = crt_pose(0.0, 0.0, HALF_M);
        pose.rot = crt_random_rotation(&seed);
        const cr_vec3 same = reported(&rig, &pose, 6e-7f), other = reported(&rig, &pose, 1.9e-6f);
        assert_true(same.x == 0.0f && same.y == 0.0f && same.z == 1.0f);
        assert_true(other.x > 1e-6f);
    }
    crt_close(&rig);
}

/* Where there is no room the lightest zone gives way, but not to one that is lighter still. */
static void the_lightest_zone_gives_way(void **state) {
    (void)state;
    static cr_contact_set set;
    const crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    cr_planes wall = {.kind = 1u, .count = 1u, .sign = 1.0f, .normal_tool = {{0.0f, 0.0f, 1.0f}}};
    const float coverage[CR_LANES] = {1.0f}, weights_m3[] = {1.0f, 1e-30f};
    const uint32_t lightest = 7u;
    const xform at = cr_xform_from_pose(&(cr_pose){{0.0f, 0.0f, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}});
    const double centre[3] = {0.0, 0.0, 0.0}, half[3] = {10e-3, 10e-3, 10e-3};
    const cr_config config = cr_config_default();
    crt_tool tool = crt_tool_new(1e-3);
    crt_rig rig;
    cr_heights h;
    crt_add_box(&tool, centre, half);
    crt_open(&rig, &block, &tool, 2e-3, &config);
    crt_tool_free(&tool);
    const struct cr_img_cluster *c = rig.scene.clusters;
    wall.offset_m[0] = -1e-3f - c->z[0]; /* the first sample is 1 mm deep */
    cr_planes_measure(&wall, c, &h);
    for (int kept = 0; kept < 2; kept++) {
        cr_looked looked = {.c = c, .planes = &wall, .heights = &h, .coverage = coverage, .covered = 1u};
        memset(&set, 0, sizeof set);
        set.hit_count = 1u;
        set.hits[0].covered = 1u;
        set.way.count = CR_WAY_ZONES_MAX;
        for (uint32_t z = 0; z < CR_WAY_ZONES_MAX; z++) {
            set.way.zones[z].key = (cr_way_key){CR_WAY_CURVED | z, 0u, 0u};
            set.way.zones[z].weight_m3 = z == lightest && kept == 0 ? weights_m3[1] : weights_m3[0];
        }
        cr_way_add(&set, 0u, &looked);
        while (!cr_way_add_more(&rig.field, &at, &set, 0u, &looked)) {
        }
        assert_int_equal(set.way.dropped, 1);
        assert_int_equal(set.way.count, CR_WAY_ZONES_MAX);
        for (uint32_t z = 0; z < CR_WAY_ZONES_MAX; z++) {
            const int gone = z == lightest && kept == 0;
            assert_int_equal(set.way.zones[z].key.surface, gone ? wall.facet[0] : CR_WAY_CURVED | z);
            assert_true(gone ? set.way.zones[z].weight_m3 > 1e-12f : set.way.zones[z].weight_m3 == 1.0f);
        }
        assert_int_equal(set.way.reach[0].zones, kept == 0 ? 1u << lightest : 0u);
    }
    /* What was left out weighed 1e-3 of a sample: zones of twice that are halved, heavier ones hardly less, and none goes below a quarter. */
    const float left_m3 = set.way.dropped_m3, weigh_m3[] = {left_m3, 2.0f * left_m3, 1e3f * left_m3};
    const double keep[] = {0.25, 0.5, 0.999};
    assert_true(left_m3 > 0.0f && left_m3 < 1e-6f);
    set.way.count = 3u;
    for (uint32_t z = 0; z < 3u; z++) {
        set.way.zones[z].weight_m3 = weigh_m3[z];
        set.way.zones[z].push_m3 = v3(0.0f, 0.0f, weigh_m3[z]);
    }
    cr_way_lighten(&set.way);
    for (uint32_t z = 0; z < 3u; z++) {
        assert_float_equal(set.way.zones[z].weight_m3 / weigh_m3[z], keep[z], z == 0u ? 0.1f : 1e-3f);
        assert_true(set.way.zones[z].push_m3.z == set.way.zones[z].weight_m3);
    }
    set.way.layers.count = CR_WAY_LAYERS_MAX; /* and a layer that there is no room for is counted */
    for (uint32_t k = 0; k < CR_WAY_LAYERS_MAX; k++) {
        set.way.layers.layers[k].surface = CR_WAY_CURVED | k;
    }
    cr_way_over_planes(&rig.scene, c, 1u, coverage, &wall, &h, &set.way.layers);
    assert_int_equal(set.way.layers.dropped, 1);
    crt_close(&rig);
}

/* A half-space whose zone weighs less than what had no room fades, unless all zones are as light: which of them stay turns at once. */
static void what_weighs_less_than_what_had_no_room_fades(void **state) {
    (void)state;
    static cr_way_relations relations;
    static cr_way_zones zones;
    static cr_way_half half;
    const float weight[] = {0.01f, 0.01f, 0.01f, 1.0f / (float)CR_WAY_ZONES_MAX};
    const float dropped[] = {0.0f, 0.01f, 0.5f, 1.0f / (float)CR_WAY_ZONES_MAX};
    const float open[] = {1.0f, 1.0f, 0.5f, 1.0f};
    relations.half_count = 1u;
    relations.all_m3 = 1.0f;
    for (int i = 0; i < 4; i++) {
        zones.dropped_m3 = dropped[i];
        half.weight_m3 = half.led_m3 = weight[i];
        half.open = 1.0f;
        (void)cr_way_agree(&zones, &relations, 0u, &half);
        assert_float_equal(half.open, open[i], 0.15f);
    }
}

#define SIDE_M 2e-3

/* A square piece over two planes, 400 by 400 in double precision: its mean depth below both. */
static double slow_depth(double n[2][3], const double *height_m) {
    double depth_m = 0.0;
    for (int i = 0; i < 160000; i++) {
        const double x = ((i % 400 + 0.5) / 400.0 - 0.5) * SIDE_M, y = ((i / 400 + 0.5) / 400.0 - 0.5) * SIDE_M;
        const double first = height_m[0] + n[0][0] * x + n[0][1] * y, second = height_m[1] + n[1][0] * x + n[1][1] * y;
        depth_m -= fmin(0.0, fmax(first, second)) / 160000.0;
    }
    return depth_m;
}

/* Over the edge of a solid a piece is as deep as it is below both planes, however it is turned and however deep. */
static void piece_that_two_planes_cut_is_as_deep_as_below_both(void **state) {
    (void)state;
    static struct cr_img_cluster c;
    static cr_way_layers layers;
    const crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    const float coverage[CR_LANES] = {1.0f};
    cr_planes edge = {.kind = 1u, .count = 2u, .facet = {0u, 1u}, .sign = 1.0f, .reach = 1.0f};
    crt_rig rig;
    cr_heights h;
    double worst_m = 0.0;
    const double centre[3] = {0.0, 0.0, 0.0}, half[3] = {10e-3, 10e-3, 10e-3};
    const cr_config config = cr_config_default();
    crt_tool tool = crt_tool_new(1e-3);
    crt_add_box(&tool, centre, half);
    crt_open(&rig, &block, &tool, 2e-3, &config);
    crt_tool_free(&tool);
    c.count = 1u;
    c.wxx[0] = c.wyy[0] = (float)(SIDE_M * SIDE_M);
    c.ramp[0] = (float)(0.5 * SIDE_M);
    for (int turn = 0; turn < 120; turn++) {
        const double about = 0.37 * turn, tilt = 0.05 * (turn % 31),
                     height_m[2] = {-4e-4 - 2e-5 * turn, -5e-4 - 1e-5 * turn};
        double n[2][3] = {{sin(tilt) * cos(about), sin(tilt) * sin(about), cos(tilt)},
                          {-cos(tilt) * cos(about), -cos(tilt) * sin(about), sin(tilt)}};
        for (int k = 0; k < 2; k++) {
            edge.normal_tool[k] = v3((float)n[k][0], (float)n[k][1], (float)n[k][2]);
            edge.offset_m[k] = (float)height_m[k];
        }
        double off_m = slow_depth(n, height_m);
        cr_planes_measure(&edge, &c, &h);
        memset(&layers, 0, sizeof layers);
        layers.near = 1u;
        cr_way_over_planes(&rig.scene, &c, 1u, coverage, &edge, &h, &layers);
        for (uint32_t l = 0; l < layers.count; l++) {
            off_m -= (double)layers.layers[l].depth_m[0];
        }
        worst_m = fmax(worst_m, fabs(off_m));
    }
    assert_near(worst_m, 0.0, SIDE_M / 48.0); /* where the planes meet amid a part: a 90th */
    /* Where its coverage says that hardly any of it is inside its parts are believed up to four times as much. */
    const float hardly[CR_LANES] = {0.01f};
    edge.normal_tool[0] = v3(1.0f, 0.0f, 0.0f);
    edge.normal_tool[1] = v3(0.0f, 0.0f, 1.0f);
    edge.offset_m[0] = (float)(-0.1 * SIDE_M);
    edge.offset_m[1] = (float)(-0.15 * SIDE_M);
    cr_planes_measure(&edge, &c, &h);
    memset(&layers, 0, sizeof layers);
    layers.near = 1u;
    cr_way_over_planes(&rig.scene, &c, 1u, hardly, &edge, &h, &layers);
    double deep_m = 0.0;
    for (uint32_t l = 0; l < layers.count; l++) {
        deep_m += (double)layers.layers[l].depth_m[0];
    }
    const double below = 0.6, told_m = 0.5 * SIDE_M * below * below * (0.01 / below);
    assert_near(deep_m / told_m, 4.0, 1.0);
    crt_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_lightest_zone_gives_way),
        cmocka_unit_test(what_weighs_less_than_what_had_no_room_fades),
        cmocka_unit_test(piece_that_two_planes_cut_is_as_deep_as_below_both),
        cmocka_unit_test(level_piece_fades_in_over_a_tenth_of_its_width),
        cmocka_unit_test(piece_beside_an_edge_fades_late),
        cmocka_unit_test(piece_at_a_corner_reaches_to_its_corners),
        cmocka_unit_test(corner_is_where_three_planes_cut),
        cmocka_unit_test(what_is_hardly_a_corner_ends_before_the_square),
        cmocka_unit_test(surfaces_fade_where_the_bricks_end),
        cmocka_unit_test(a_quarter_of_a_side_counts_in_full),
        cmocka_unit_test(normals_are_one_but_for_rounding),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
