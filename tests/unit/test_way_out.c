/* The response way_out: what it pushes with leads out, and just out, at walls, edges and corners, for tools of any number of pieces. */
#include "contact/way_out.h"
#include "contact/world.h"
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define VOXEL_M 2e-3
#define HALF_M 8e-3
#define PERIOD_S 1e-3f
#define STIFFNESS_N_m 1000.0
#define MICRO_N 1e-6

static cr_config way_out(void) {
    cr_config c = cr_config_default();
    c.response = CR_RESPONSE_WAY_OUT;
    return c;
}

static void open_with(crt_rig *rig, const crt_solid *solid, const crt_tool *tool) {
    const cr_config config = way_out();
    crt_open(rig, solid, tool, VOXEL_M, &config);
}

static void open_cube(crt_rig *rig, const crt_solid *solid) {
    const double centre[3] = {0.0, 0.0, 0.0}, half[3] = {HALF_M, HALF_M, HALF_M};
    crt_tool tool = crt_tool_new(1e-3);
    crt_add_box(&tool, centre, half);
    open_with(rig, solid, &tool);
    crt_tool_free(&tool);
}

static cr_output tick(crt_rig *rig, const cr_pose *pose) {
    static cr_output out;
    const cr_config config = way_out();
    memset(&out, 0xa5, sizeof out);
    cr_tick(rig->world, pose, PERIOD_S, &out);
    assert_true(crt_is_sound(&out, &config));
    return out;
}

static void assert_force(const cr_output *out, double x, double y, double z, double room_N) {
    const cr_vec3 f = out->force_world_N;
    if (!(fabs((double)f.x - x) < room_N && fabs((double)f.y - y) < room_N && fabs((double)f.z - z) < room_N)) {
        fail_msg("(%g, %g, %g) N instead of (%g, %g, %g)", (double)f.x, (double)f.y, (double)f.z, x, y, z);
    }
}

/* Flat on a face: stiffness times depth, no torque about the middle, and the display pose just touches. */
static void wall_pushes_by_its_depth(void **state) {
    (void)state;
    const crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    open_cube(&rig, &block);
    for (int marked = 0; marked < 2; marked++) {
        for (double depth = 0.2e-3; depth < 6e-3; depth += 0.7e-3) {
            const cr_pose pose = crt_pose(1e-3, -2e-3, HALF_M - depth);
            const cr_output out = tick(&rig, &pose);
            assert_force(&out, 0.0, 0.0, STIFFNESS_N_m * depth, 2e-3);
            assert_int_equal(out.area_count, 1);
            assert_true(out.areas[0].zone_count >= 1u && out.areas[0].zones[0].normal_world.z > 0.999f);
            assert_true(v3_norm(out.torque_world_Nm) < 1e-5f);
            assert_true(fabsf(out.display_pose.pos_m.z - (float)HALF_M) < 5e-6f);
        }
        crt_mark_planes(&rig);
        assert_int_equal(cr_scene_open(&rig.scene, rig.image, rig.size_bytes), CR_OK);
        const cr_config config = way_out();
        crt_restart(&rig, &config);
    }
    crt_close(&rig);
}

/* Pushed over an edge: the force of the face, while over half of the block lies on it. The zones double it. */
static void face_pushes_the_same_while_an_edge_comes_under_it(void **state) {
    (void)state;
    const crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    open_cube(&rig, &block);
    for (double x = -20e-3; x < -1e-3; x += 0.37e-3) {
        const cr_pose pose = crt_pose(x, 0.0, HALF_M - 1e-3);
        const cr_output out = tick(&rig, &pose);
        assert_force(&out, 0.0, 0.0, 1.0, 0.1);
        assert_true(fabs((double)v3_norm(out.force_world_N) - 1.0) < 0.02);
    }
    crt_close(&rig);
}

/* Walls that meet concavely push each by its own depth. */
static void walls_of_a_corner_are_independent(void **state) {
    (void)state;
    const crt_solid room = crt_room(-30e-3, 20e-3, 30e-3, -30e-3, 20e-3);
    crt_rig rig;
    open_cube(&rig, &room);
    for (int i = 0; i < 8; i++) {
        const double a = 0.3e-3 + 0.2e-3 * i, b = 1.9e-3 - 0.2e-3 * i;
        const cr_pose pose = crt_pose(20e-3 - HALF_M + a, 0.0, 20e-3 - HALF_M + b);
        const cr_output out = tick(&rig, &pose);
        assert_force(&out, -STIFFNESS_N_m * a, 0.0, -STIFFNESS_N_m * b, 0.03);
    }
    crt_close(&rig);
}

/* Two jaws that clamp a block with unequal depths: the difference is felt. */
static void jaws_feel_the_difference(void **state) {
    (void)state;
    const crt_solid block = crt_box(-10e-3, 10e-3, 40e-3, -40e-3, 0.0);
    const double half[3] = {4e-3, 4e-3, 4e-3}, left[3] = {-13e-3, 0.0, 0.0}, right[3] = {12.9e-3, 0.0, 0.0};
    crt_tool jaws = crt_tool_new(1e-3);
    crt_rig rig;
    crt_add_box(&jaws, left, half);
    crt_add_box(&jaws, right, half);
    open_with(&rig, &block, &jaws);
    /* The image is by hand: its clusters up to the middle are of the left jaw. */
    struct cr_img_cluster *c = crt_section(rig.image, CR_SEC_CLUSTERS);
    ((struct cr_img_meta *)crt_section(rig.image, CR_SEC_META))->piece_count = 2u;
    for (uint32_t i = 0; i < rig.scene.cluster_count; i++) {
        c[i].piece[0] = (uint16_t)(c[i].x[0] >= 0.0f);
    }
    crt_seal(rig.image);
    assert_int_equal(cr_scene_open(&rig.scene, rig.image, rig.size_bytes), CR_OK);
    const cr_config config = way_out();
    crt_restart(&rig, &config);
    const cr_pose pose = crt_pose(0.0, 0.0, -20e-3);
    const cr_output out = tick(&rig, &pose);
    assert_force(&out, 0.1, 0.0, 0.0, 0.02); /* 1.0 and 1.1 mm */
    assert_int_equal(out.area_count, 2);
    crt_close(&rig);
    crt_tool_free(&jaws);
}

/* A corner that reaches into one piece of the tool: its normals tell the way, not which face the one sample is nearest to. */
static void corner_inside_of_one_sample_pushes_along_its_middle(void **state) {
    (void)state;
    const double ball_m = 15e-3, depth_m = 0.75e-3;
    const crt_solid block = crt_box(-40e-3, 0.0, 20e-3, -40e-3, 0.0);
    crt_tool tool = crt_tool_new(2e-3);
    crt_rig rig;
    crt_add_ball(&tool, ball_m);
    open_with(&rig, &block, &tool);
    uint64_t seed = 5u;
    for (int i = 0; i < 60; i++) {
        const double far = ball_m - depth_m, x = 1.0 + crt_uniform(&seed, -0.04, 0.04),
                     z = 1.0 + crt_uniform(&seed, -0.04, 0.04), length = sqrt(x * x + 1.0 + z * z);
        const cr_pose pose = crt_pose(far * x / length, 20e-3 + far / length, far * z / length);
        const cr_output out = tick(&rig, &pose);
        const cr_vec3 n = v3_unit(out.force_world_N, 0.0f);
        const double along = (x * (double)n.x + (double)n.y + z * (double)n.z) / length;
        if (!(along > 0.99)) {
            fail_msg("pose %d: the force is %g degrees off", i, acos(along) * 57.3);
        }
    }
    crt_close(&rig);
    crt_tool_free(&tool);
}

/* A ball on a ball: along their middles, as deep as they overlap, where they touch. */
static void balls_push_along_their_middles(void **state) {
    (void)state;
    const double ball_m = 12e-3, tool_m = 9e-3;
    const crt_solid ball = crt_ball(ball_m);
    crt_tool tool = crt_tool_new(1e-3);
    crt_rig rig;
    crt_add_ball(&tool, tool_m);
    open_with(&rig, &ball, &tool);
    uint64_t seed = 11u;
    for (int i = 0; i < 60; i++) {
        const double depth = crt_uniform(&seed, 0.3e-3, 2e-3), far = ball_m + tool_m - depth;
        double way[3], length = 0.0;
        for (int a = 0; a < 3; a++) {
            way[a] = crt_uniform(&seed, -1.0, 1.0);
            length += way[a] * way[a];
        }
        length = sqrt(length);
        const cr_pose pose = crt_pose(far * way[0] / length, far * way[1] / length, far * way[2] / length);
        const cr_output out = tick(&rig, &pose);
        const double force = STIFFNESS_N_m * depth / length;
        assert_force(&out, force * way[0], force * way[1], force * way[2], 0.15);
    }
    crt_close(&rig);
    crt_tool_free(&tool);
}

/* Change the image and open it again with other settings. */
static void reopen(crt_rig *rig, const cr_config *config) {
    crt_seal(rig->image);
    assert_int_equal(cr_scene_open(&rig->scene, rig->image, rig->size_bytes), CR_OK);
    crt_restart(rig, config);
}

/* No pose of any scene gives anything but a finite wrench that does not pull, and nothing without overlap. */
static void press_anyhow(crt_rig *rig, const crt_solid *solid, double reach_m, uint64_t seed) {
    for (int i = 0; i < 150; i++) {
        cr_pose pose = crt_pose(crt_uniform(&seed, -reach_m, reach_m), crt_uniform(&seed, -reach_m, reach_m),
                                crt_uniform(&seed, -reach_m, reach_m));
        if (i % 3 != 0) {
            pose.rot = crt_random_rotation(&seed);
        }
        const cr_output out = tick(rig, &pose);
        for (uint32_t a = 0; a < out.area_count; a++) {
            assert_true(out.areas[a].depth_m > 0.0f || out.stats.late_ticks > 0u);
            assert_true(v3_dot(out.areas[a].force_world_N, out.areas[a].normal_world) >= 0.0f);
        }
        const double p[3] = {(double)pose.pos_m.x, (double)pose.pos_m.y, (double)pose.pos_m.z};
        if (out.stats.late_ticks == 0u && crt_distance(solid, p) > sqrt(3.0) * HALF_M + 1e-3) {
            assert_true(v3_norm(out.force_world_N) == 0.0f);
        }
    }
}

static void any_pose_of_any_scene_is_answered(void **state) {
    (void)state;
    const crt_solid solids[] = {crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0),
                                crt_wedge(1.0, 40e-3, 30e-3),
                                crt_wedge(0.4, 40e-3, 6e-3),
                                crt_room(-24e-3, 20e-3, 24e-3, -24e-3, 20e-3),
                                crt_box(-3e-3, 3e-3, 40e-3, -40e-3, 0.0),
                                crt_ball(15e-3)};
    for (size_t s = 0; s < sizeof solids / sizeof *solids; s++) {
        crt_rig rig;
        cr_config config = way_out();
        open_cube(&rig, &solids[s]);
        press_anyhow(&rig, &solids[s], 24e-3, 3u + s);
        config.lookups_max = 40u;
        crt_restart(&rig, &config);
        press_anyhow(&rig, &solids[s], 24e-3, 13u + s);
        config = way_out();
        if (solids[s].ball_m <= 0.0) {
            crt_mark_planes(&rig);
            reopen(&rig, &config);
            press_anyhow(&rig, &solids[s], 24e-3, 33u + s);
        }
        crt_close(&rig);
    }
}

/* Creases whose labels say nothing, or both: how the surfaces lie to each other tells. */
static void surfaces_without_labels_go_by_where_they_lie(void **state) {
    (void)state;
    const crt_solid edge = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0),
                    room = crt_room(-30e-3, 20e-3, 30e-3, -30e-3, 20e-3);
    const cr_config config = way_out();
    const cr_pose over = crt_pose(-4e-3, 0.0, HALF_M - 1e-3),
                  in = crt_pose(20e-3 - HALF_M + 1e-3, 0.0, 20e-3 - HALF_M + 0.7e-3);
    for (int which = 0; which < 2; which++) {
        crt_rig rig;
        open_cube(&rig, which == 0 ? &edge : &room);
        struct cr_img_pair *pair = crt_section(rig.image, CR_SEC_PAIRS);
        for (uint32_t i = 0; i < rig.scene.pair_count; i++) {
            pair[i].label = CR_PAIR_CONVEX | CR_PAIR_CONCAVE;
        }
        reopen(&rig, &config);
        const cr_output out = tick(&rig, which == 0 ? &over : &in);
        if (which == 0) {
            assert_force(&out, 0.0, 0.0, 1.0, 0.1);
        } else {
            assert_force(&out, -1.0, 0.0, -0.7, 0.05);
        }
        crt_close(&rig);
    }
}

/* Cells of several facets whose planes do not give the distance: each sample counts for those that explain it. */
static void mixed_cells_answer_as_their_planes_do(void **state) {
    (void)state;
    const crt_solid solids[] = {crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0), crt_wedge(1.0, 40e-3, 30e-3)};
    for (size_t s = 0; s < 2u; s++) {
        const cr_config config = way_out();
        crt_rig planes, mixed;
        open_cube(&planes, &solids[s]);
        open_cube(&mixed, &solids[s]);
        crt_forget_planes(&mixed);
        reopen(&mixed, &config);
        press_anyhow(&mixed, &solids[s], 20e-3, 5u);
        const cr_pose over = crt_pose(-4e-3, 0.0, HALF_M - 1e-3);
        if (s == 0u) {
            const cr_output a = tick(&planes, &over), b = tick(&mixed, &over);
            assert_true(v3_norm(v3_sub(a.force_world_N, b.force_world_N)) < 0.1f);
        }
        crt_close(&planes);
        crt_close(&mixed);
    }
}

/* More pieces of the tool than there is room for zones: what has none is counted, the rest answers. */
static void zones_beyond_their_room_are_counted(void **state) {
    (void)state;
    const crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    const cr_config config = way_out();
    crt_rig rig;
    open_cube(&rig, &block);
    struct cr_img_cluster *c = crt_section(rig.image, CR_SEC_CLUSTERS);
    ((struct cr_img_meta *)crt_section(rig.image, CR_SEC_META))->piece_count = rig.scene.cluster_count;
    for (uint32_t i = 0; i < rig.scene.cluster_count; i++) {
        c[i].piece[0] = (uint16_t)i;
        c[i].piece[1] = i > 0u ? (uint16_t)(i - 1u) : CR_PIECE_NONE;
        c[i].piece_lanes[1] = i > 0u ? 1u : 0u;
    }
    reopen(&rig, &config);
    const cr_pose pose = crt_pose(-3e-3, 0.0, HALF_M - 1e-3);
    const cr_output out = tick(&rig, &pose);
    assert_true(out.stats.zones_dropped > 0u);
    assert_true(fabs((double)out.force_world_N.z - 1.0) < 0.1);
    press_anyhow(&rig, &block, 20e-3, 6u);
    crt_close(&rig);
}

/* Facets that stand for curved surfaces, in cells of several, and bricks that know no surface: by sides of the distance's direction. */
static void curved_and_unknown_surfaces_answer_by_sides(void **state) {
    (void)state;
    const crt_solid solids[] = {crt_box(-12e-3, 12e-3, 12e-3, -12e-3, 12e-3), crt_ball(18e-3)};
    for (size_t s = 0; s < 2u; s++) {
        const cr_config config = way_out();
        crt_rig rig;
        open_cube(&rig, &solids[s]);
        struct cr_img_brick *brick = crt_section(rig.image, CR_SEC_BRICKS);
        struct cr_img_facet *facet = crt_section(rig.image, CR_SEC_FACETS);
        crt_forget_planes(&rig);
        for (uint32_t i = 0; i < rig.scene.facet_count; i++) {
            facet[i].curved = 1u;
        }
        for (uint32_t i = 0; i < rig.scene.brick_count; i++) {
            brick[i].kind = i % 3u == 0u && brick[i].cells == CR_CELLS_NONE ? 0u : brick[i].kind;
        }
        reopen(&rig, &config);
        press_anyhow(&rig, &solids[s], 22e-3, 8u);
        const cr_pose flat = crt_pose(0.0, 0.0, 12e-3 + HALF_M - 1e-3);
        if (s == 0u) {
            assert_true(fabs((double)tick(&rig, &flat).force_world_N.z - 1.0) < 0.1);
        }
        crt_close(&rig);
    }
}

/* Planes of round surfaces have zones by sides, and push as the planes that they are. */
static void planes_of_round_surfaces_answer_by_sides(void **state) {
    (void)state;
    const crt_solid solids[] = {crt_box(-12e-3, 12e-3, 12e-3, -12e-3, 12e-3),
                                crt_room(-30e-3, 20e-3, 30e-3, -30e-3, 20e-3)};
    const cr_pose poses[] = {crt_pose(0.0, 0.0, 12e-3 + HALF_M - 1e-3), crt_pose(0.0, 0.0, 20e-3 - HALF_M + 1e-3)};
    for (size_t s = 0; s < 4u; s++) {
        const cr_config config = way_out();
        crt_rig rig;
        open_cube(&rig, &solids[s & 1u]);
        struct cr_img_facet *facet = crt_section(rig.image, CR_SEC_FACETS);
        if (s >= 2u) {
            crt_forget_planes(&rig);
        }
        const cr_output plane = tick(&rig, &poses[s & 1u]);
        for (uint32_t i = 0; i < rig.scene.facet_count; i++) {
            facet[i].curved = CR_FACET_OF_CURVED;
        }
        reopen(&rig, &config);
        const cr_output out = tick(&rig, &poses[s & 1u]);
        const cr_way_zones *zones = &rig.world->set.way;
        assert_true(zones->count > 0u);
        for (uint32_t z = 0; z < zones->count; z++) {
            assert_true((zones->zones[z].key.surface & CR_WAY_CURVED) != 0u && zones->zones[z].flat == 0u);
        }
        assert_true(fabs(fabs((double)out.force_world_N.z) - 1.0) < 0.1);
        assert_true(v3_norm(v3_sub(out.force_world_N, plane.force_world_N)) < 1e-3f);
        press_anyhow(&rig, &solids[s & 1u], 22e-3, 8u);
        crt_close(&rig);
    }
}

/* Two walls and room for one contact: the other is counted. */
static void contacts_beyond_their_room_are_counted(void **state) {
    (void)state;
    static cr_contact_set set;
    static cr_way_work work;
    static cr_area areas[2];
    const crt_solid room = crt_room(-30e-3, 20e-3, 30e-3, -30e-3, 20e-3);
    const cr_config config = way_out();
    const cr_pose pose = crt_pose(20e-3 - HALF_M + 1e-3, 0.0, 20e-3 - HALF_M + 0.7e-3);
    const xform at = cr_xform_from_pose(&pose);
    const cr_detect_options options = {
        .skip = CR_SKIP_ALL, .lookups_max = UINT32_MAX, .slices_max = CR_SEARCH_TICKS_MAX};
    cr_descent search = {0};
    cr_motion motion = {0};
    cr_stats stats = {0};
    crt_rig rig;
    open_cube(&rig, &room);
    motion.wake_count = rig.scene.group_count * CR_LANES;
    motion.wake_m = calloc(motion.wake_count, sizeof(float));
    cr_motion_advance(&motion, &pose);
    assert_int_equal(cr_detect(&rig.field, &at, &options, &motion, &search, &set, &stats), 1);
    const cr_respond_input in = {.field = &rig.field, .world_from_tool = &at, .set = &set, .config = &config};
    cr_way_begin(&in, &work);
    assert_int_equal(cr_way_measure(&in, &work, UINT32_MAX), 1);
    assert_int_equal(cr_way_push(&work, UINT32_MAX), 1);
    assert_int_equal(cr_way_answer(&in, &work, areas, 2u, &stats), 2);
    assert_int_equal(stats.areas_merged, 0);
    const float most_m = max_f(work.push_m[0], work.push_m[1]);
    assert_int_equal(cr_way_answer(&in, &work, areas, 1u, &stats), 1);
    assert_true(stats.areas_merged == 1u && areas[0].depth_m == most_m);
    free(motion.wake_m);
    crt_close(&rig);
}

/* Lanes of a cluster in two cells behind one wall: what the second cell says leaves what the first one said. */
static void lanes_of_two_cells_behind_one_wall_all_count(void **state) {
    (void)state;
    static cr_way_layers layers;
    const crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    cr_planes wall = {.kind = 1u, .count = 1u, .normal_tool = {{0.0f, 0.0f, 1.0f}}};
    cr_heights h;
    crt_rig rig;
    open_cube(&rig, &block);
    const struct cr_img_cluster *c = rig.scene.clusters;
    for (int way = 0; way < 2; way++) {
        wall.sign = way == 0 ? 1.0f : -1.0f;
        wall.offset_m[0] = way == 0 ? -0.1f : 0.1f; /* deep below the plane, or behind the wall */
        cr_planes_measure(&wall, c, &h);
        memset(&layers, 0, sizeof layers);
        layers.near = 0xffffu;
        cr_way_over_planes(&rig.scene, c, 0x00ffu, NULL, &wall, &h, &layers);
        cr_way_over_planes(&rig.scene, c, 0xff00u, NULL, &wall, &h, &layers);
        assert_int_equal(layers.count, 1);
        assert_int_equal(layers.layers[0].lanes, 0xffff);
        for (int i = 0; i < CR_LANES; i++) {
            assert_true(layers.layers[0].depth_m[i] > 0.05f && layers.layers[0].coverage[i] == 1.0f);
        }
    }
    crt_close(&rig);
}

/* Of planes that are the same twice, and of one alone, the way is that of one. */
static void exits_that_are_the_same_are_one(void **state) {
    (void)state;
    const crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    cr_way_exits e;
    uint32_t places;
    open_cube(&rig, &block);
    const struct cr_img_cluster *c = rig.scene.clusters;
    e.count = 3u;
    for (uint32_t k = 0; k < e.count; k++) {
        e.normal[k] = v3(0.0f, 0.0f, 1.0f);
        e.height_m[k] = -1e-3f;
        e.leaves[k] = 1.0f;
    }
    for (int i = 0; i < (int)c->count; i++) {
        const float three = cr_way_longest(c, i, &e, 0.0f, &places);
        e.count = 1u;
        assert_true(cr_way_longest(c, i, &e, 0.0f, &places) == three);
        e.count = 3u;
    }
    e.count = 0u;
    assert_true(cr_way_longest(c, 0, &e, 0.0f, &places) == 0.0f);
    crt_close(&rig);
}

static void resolve(const cr_vec3 *normal, const float *depth_m, uint32_t count, float *push_m) {
    static cr_way_along along;
    cr_way_resolve_begin(normal, depth_m, count, &along, push_m);
    while (!cr_way_resolve_sweep(depth_m, &along, push_m)) {
    }
}

/* Contacts that push one against another, or share a wall: no more than their own depth each. */
static void resolve_pushes_no_contact_beyond_its_depth(void **state) {
    (void)state;
    const float slope = sqrtf(0.5f);
    const cr_vec3 up = v3(0.0f, 0.0f, 1.0f), down = v3(0.0f, 0.0f, -1.0f), side = v3(1.0f, 0.0f, 0.0f),
                  between = v3(slope, 0.0f, slope);
    float push[3];
    resolve((cr_vec3[]){up, up}, (float[]){1e-3f, 1e-3f}, 2u, push); /* one wall in two: one push */
    assert_true(fabsf(push[0] + push[1] - 1e-3f) < (float)MICRO_N);
    resolve((cr_vec3[]){up, down}, (float[]){1.2e-3f, 1e-3f}, 2u, push);
    assert_true(push[0] == 1.2e-3f && push[1] == 1e-3f);
    resolve((cr_vec3[]){up, side, between}, (float[]){1e-3f, 2e-3f, 1e-3f}, 3u, push);
    assert_true(fabsf(push[0] - 1e-3f) < 1e-8f && fabsf(push[1] - 2e-3f) < 1e-8f &&
                push[2] == 0.0f); /* led out of by the two already */
}

/* However many half-spaces, it stops within a sweep of what it may do, and what it finds is the same to the bit. */
static void pushes_found_in_pieces_are_the_same_to_the_bit(void **state) {
    (void)state;
    static cr_way_work whole, pieces;
    const uint32_t count = CR_WAY_ZONES_MAX, sweep = count * count;
    whole.relations.half_count = count;
    for (uint32_t h = 0; h < count; h++) {
        const float turn = 0.7f * (float)h, rise = 0.2f + 0.03f * (float)h;
        const float flat = sqrtf(1.0f - rise * rise);
        whole.half[h].normal = v3(flat * cosf(turn), flat * sinf(turn), rise);
        whole.half[h].depth_m = 1e-3f + 1e-4f * (float)(h * h % 11u);
        whole.half[h].open = 1.0f;
    }
    pieces = whole;
    assert_int_equal(cr_way_push(&whole, UINT32_MAX), 1);
    assert_true(whole.along.sweeps > 5u && whole.along.count == count);
    uint32_t spent = 0u, calls = 0u;
    for (int done = 0; !done; calls++) {
        pieces.spent = 0u;
        done = cr_way_push(&pieces, 1u);
        assert_true(done ? pieces.spent == 0u
                         : pieces.spent > 0u && pieces.spent <= (calls == 0u ? 2u * (count + sweep) : sweep));
        spent += pieces.spent;
    }
    assert_true(calls == 2u + whole.along.sweeps && spent == whole.spent);
    assert_memory_equal(pieces.push_m, whole.push_m, sizeof whole.push_m);
}

/* Half-spaces of one direction share their moment; one that does not push, whose arm is a moment over next to no force, has no part in it. */
static void what_does_not_push_turns_nothing(void **state) {
    (void)state;
    static cr_way_half half[3];
    for (int h = 0; h < 3; h++) {
        half[h].normal = v3(0.0f, 0.0f, 1.0f);
        half[h].joined_m3 = 1e-9f;
        half[h].open = h < 2 ? 1.0f : 0.0f;
        half[h].own_m = v3(h < 2 ? (float)h : 1e6f, 0.0f, 0.0f);
    }
    for (uint32_t h = 0; h < 2u; h++) {
        cr_way_share_arm(3u, h, half);
        assert_true(fabsf(half[h].arm_m.x - 0.5f) < 1e-6f);
    }
}

/* -1 to 1. */
static float any(uint32_t *state) {
    *state = 1664525u * *state + 1013904223u;
    return (float)(*state >> 8) / 8388608.0f - 1.0f;
}

/* Planes that hardly differ meet anywhere, also far beside the piece: the way from a place on it is bounded by each plane. */
static void no_way_starts_beside_a_piece(crt_rig *rig) {
    const float flat = 0.505f,
                bent = 0.72f; /* of a piece's width to its border, of a bent one's to its corners; and rounding */
    cr_way_exits e = {.count = 4u};
    uint32_t seed = 1u;
    for (int n = 0; n < 200000; n++) {
        const struct cr_img_cluster *c = rig->scene.clusters + (uint32_t)n % rig->scene.cluster_count;
        const int i = (int)((uint32_t)n % c->count);
        const float apart = powf(10.0f, -3.5f + 3.5f * any(&seed));
        const cr_vec3 base = v3(any(&seed), any(&seed), any(&seed)), way = v3(any(&seed), any(&seed), any(&seed));
        float most = 1.0f;
        for (uint32_t k = 0; k < e.count; k++) {
            const cr_vec3 other = v3(any(&seed), any(&seed), any(&seed));
            e.normal[k] = v3_unit(v3_mad(base, other, k < 3u ? apart : 1.0f), 0.0f);
            e.leaves[k] = max_f(0.1f, v3_dot(e.normal[k], v3_unit(way, 0.0f)));
            e.height_m[k] = -1e-3f * (1.0f + (k < 3u ? apart : 1.0f) * any(&seed));
            const float wide_m = ((c->crease_mask >> i) & 1u) != 0u
                                     ? 1.001f * c->reach[i]
                                     : (c->bow[i] > 0.0f ? bent : flat) * piece_width(c, i, e.normal[k]);
            most = min_f(most, (wide_m - e.height_m[k]) / e.leaves[k]);
        }
        uint32_t places;
        assert_true(cr_way_longest(c, i, &e, 0.0f, &places) <= max_f(0.0f, most) + 1e-8f);
    }
}

/* Of a cube the spreads are along its axes; those of a ball are in all directions, and thin ones are no longer positive, but for rounding. */
static void no_way_starts_beside_the_piece(void **state) {
    (void)state;
    const crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    crt_tool ball = crt_tool_new(1e-3);
    crt_rig rig;
    open_cube(&rig, &block);
    no_way_starts_beside_a_piece(&rig);
    crt_close(&rig);
    crt_add_ball(&ball, HALF_M);
    open_with(&rig, &block, &ball);
    no_way_starts_beside_a_piece(&rig);
    crt_tool_free(&ball);
    crt_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(wall_pushes_by_its_depth),
        cmocka_unit_test(face_pushes_the_same_while_an_edge_comes_under_it),
        cmocka_unit_test(walls_of_a_corner_are_independent),
        cmocka_unit_test(jaws_feel_the_difference),
        cmocka_unit_test(corner_inside_of_one_sample_pushes_along_its_middle),
        cmocka_unit_test(balls_push_along_their_middles),
        cmocka_unit_test(any_pose_of_any_scene_is_answered),
        cmocka_unit_test(surfaces_without_labels_go_by_where_they_lie),
        cmocka_unit_test(mixed_cells_answer_as_their_planes_do),
        cmocka_unit_test(zones_beyond_their_room_are_counted),
        cmocka_unit_test(curved_and_unknown_surfaces_answer_by_sides),
        cmocka_unit_test(planes_of_round_surfaces_answer_by_sides),
        cmocka_unit_test(contacts_beyond_their_room_are_counted),
        cmocka_unit_test(lanes_of_two_cells_behind_one_wall_all_count),
        cmocka_unit_test(exits_that_are_the_same_are_one),
        cmocka_unit_test(no_way_starts_beside_the_piece),
        cmocka_unit_test(resolve_pushes_no_contact_beyond_its_depth),
        cmocka_unit_test(pushes_found_in_pieces_are_the_same_to_the_bit),
        cmocka_unit_test(what_does_not_push_turns_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
