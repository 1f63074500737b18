/* Normal, contact plane and depth of contact areas, against closed forms. */
#include "image_builder.h"
#include "rivals/extent.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define PI 3.14159265358979323846
#define VOXEL_M 2e-3
#define HALF_M 8e-3
#define SPACING_M 1e-3

static cr_contact_set set;
static cr_area_set area_set;
static cr_stats stats;
static cr_area areas[CR_AREAS_MAX];

static cr_config extent_config(void) {
    cr_config c = cr_config_default();
    c.response = CR_RESPONSE_EXTENT;
    return c;
}

static void open_cube(crt_rig *rig, const crt_solid *solid) { crt_open_cube(rig, solid, HALF_M, SPACING_M, VOXEL_M); }

static uint32_t respond(const crt_rig *rig, const cr_pose *pose, const cr_config *config, uint32_t room) {
    const xform now = cr_xform_from_pose(pose);
    cr_respond_input in = {.field = &rig->field, .world_from_tool = &now, .set = &set, .config = config};
    crt_find_areas(rig, pose, CR_SKIP_ALL, config->coverage, &set, &area_set, &stats);
    return cr_respond(&in, &area_set, areas, room, &stats);
}

/* Largest -n . v over the cube's vertices: how far the cube reaches below the plane through the origin. */
static double reach_below(const cr_pose *pose, double nx, double ny, double nz) {
    xform now = cr_xform_from_pose(pose);
    double deepest = -1.0;
    for (int k = 0; k < 8; k++) {
        cr_vec3 v = v3(k & 1 ? (float)HALF_M : -(float)HALF_M, k & 2 ? (float)HALF_M : -(float)HALF_M,
                       k & 4 ? (float)HALF_M : -(float)HALF_M);
        cr_vec3 p = cr_xform_point(&now, v);
        deepest = fmax(deepest, -(nx * (double)p.x + ny * (double)p.y + nz * (double)p.z));
    }
    return deepest;
}

static double angle_deg(cr_vec3 n, double x, double y, double z) {
    double length = sqrt(x * x + y * y + z * z);
    double cx = (double)n.y * z - (double)n.z * y, cy = (double)n.z * x - (double)n.x * z,
           cz = (double)n.x * y - (double)n.y * x;
    double dot = (double)n.x * x + (double)n.y * y + (double)n.z * z;
    return atan2(sqrt(cx * cx + cy * cy + cz * cz) / length, dot / length) * 180.0 / PI;
}

static void check_flat_wall(const cr_config *config) {
    crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    uint64_t seed = 3u;
    open_cube(&rig, &block);
    for (int n = 0; n < 400; n++) {
        cr_pose pose = crt_pose(crt_uniform(&seed, -8e-3, 8e-3), crt_uniform(&seed, -8e-3, 8e-3), 0.0);
        pose.rot = crt_random_rotation(&seed);
        double down = crt_uniform(&seed, 0.5e-3, 5e-3);
        pose.pos_m.z = (float)(reach_below(&pose, 0.0, 0.0, 1.0) - down);
        double depth = reach_below(&pose, 0.0, 0.0, 1.0);
        if (respond(&rig, &pose, config, CR_AREAS_MAX) == 0u && config->coverage == CR_COVERAGE_HARD) {
            continue; /* in-or-out counting may see nothing of a vertex */
        }
        assert_true(angle_deg(areas[0].normal_world, 0.0, 0.0, 1.0) < 1e-4 && fabsf(areas[0].offset_m) < 1e-6f);
        /* The published method takes its plane from sampled distances: one step of theirs more. */
        double step = config->coverage == CR_COVERAGE_HARD ? (double)rig.scene.meta->quantum_m : 0.0;
        if (!(fabs((double)areas[0].depth_m - depth) < 1e-4 * depth + step)) {
            fail_msg("pose %d: depth %.9g m, exact %.9g m", n, (double)areas[0].depth_m, depth);
        }
    }
    crt_close(&rig);
}

/* A corner of the static box, its diagonal upwards along d, comes into a flat face of the cube anywhere between its samples:
 * no force before it touches, no kick worth more than an eighth of a spacing on the way, and the exact depth once it is a spacing
 * deep. */
static void respond_feels_a_static_corner_between_the_samples_of_a_face(void **state) {
    (void)state;
    crt_solid box = crt_box(-30e-3, 0.0, 30e-3, -30e-3, 0.0);
    const cr_config config = extent_config();
    const double root = 1.0 / sqrt(3.0), step_m = 10e-6, corner[3] = {0.0, 30e-3, 0.0};
    crt_rig rig;
    uint64_t seed = 23u;
    open_cube(&rig, &box);
    for (int n = 0; n < 40; n++) {
        double u = crt_uniform(&seed, -4e-3, 4e-3), v = crt_uniform(&seed, -4e-3, 4e-3), before = 0.0;
        for (double down = -0.1e-3; down < 1.5e-3; down += step_m) {
            cr_pose pose = crt_pose(0.0, 0.0, 0.0);
            pose.rot = crt_turn(-1.0, 1.0, 0.0, acos(root)); /* takes z to the diagonal */
            xform turn = cr_xform_from_pose(&pose);
            cr_vec3 spot = xform_rotate(&turn, v3((float)u, (float)v, -(float)HALF_M));
            pose.pos_m =
                v3((float)(corner[0] - down * root - (double)spot.x), (float)(corner[1] - down * root - (double)spot.y),
                   (float)(corner[2] - down * root - (double)spot.z));
            double depth = respond(&rig, &pose, &config, CR_AREAS_MAX) > 0u ? (double)areas[0].depth_m : 0.0;
            assert_true(down > 0.0 || depth < 1e-6);
            if (!(fabs(depth - before) < 0.125 * SPACING_M)) {
                fail_msg("spot %d, %.3f mm deep: %.4f to %.4f mm", n, down * 1e3, before * 1e3, depth * 1e3);
            }
            if (down > SPACING_M && !(fabs(depth - down) < 0.03 * down)) {
                fail_msg("spot %d: depth %.4f mm, exact %.4f mm", n, depth * 1e3, down * 1e3);
            }
            before = depth;
        }
    }
    crt_close(&rig);
}

static void respond_depth_on_a_flat_wall_is_exact(void **state) {
    (void)state;
    cr_config config = extent_config();
    check_flat_wall(&config);
    config.vertices_only = 1u;
    check_flat_wall(&config);
}

static void respond_depth_on_a_flat_wall_is_exact_with_hard_coverage(void **state) {
    (void)state;
    cr_config config = extent_config();
    config.coverage = CR_COVERAGE_HARD;
    check_flat_wall(&config);
}

/* A cube over the edge of a block, sides parallel: overlap a along x and b along z. The tool's normal sum is (b, a). */
static void place_over_edge(cr_pose *pose, double a, double b) { *pose = crt_pose(HALF_M - a, 1.3e-3, HALF_M - b); }

static const double overlaps_m[][2] = {{3e-3, 3e-3}, {2e-3, 4e-3}, {5e-3, 2.5e-3}, {1.7e-3, 5.2e-3}, {3.3e-3, 6.1e-3}};

static void respond_at_an_edge_follows_the_overlap_volume(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    cr_config config = extent_config();
    crt_rig rig;
    open_cube(&rig, &block);
    for (size_t i = 0; i < sizeof overlaps_m / sizeof *overlaps_m; i++) {
        double a = overlaps_m[i][0], b = overlaps_m[i][1], depth = 2.0 * a * b / hypot(a, b);
        cr_pose pose;
        place_over_edge(&pose, a, b);
        assert_int_equal(respond(&rig, &pose, &config, CR_AREAS_MAX), 1);
        assert_int_equal(areas[0].zone_count, 2);
        double turn = angle_deg(areas[0].normal_world, b, 0.0, a);
        if (!(turn < 0.5)) {
            fail_msg("overlap %g x %g m: %g degrees off", a, b, turn);
        }
        assert_true(fabs((double)areas[0].depth_m - depth) < 0.01 * depth);
    }
    crt_close(&rig);
}

static void respond_weights_of_zones_are_areas_inside_the_tool(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    cr_config config = extent_config();
    crt_rig rig;
    cr_pose pose;
    open_cube(&rig, &block);
    place_over_edge(&pose, 3e-3, 5e-3);
    assert_int_equal(respond(&rig, &pose, &config, CR_AREAS_MAX), 1);
    for (int z = 0; z < 2; z++) {
        double wide = areas[0].zones[z].patch == 2u ? 3e-3 : 5e-3, area = 2.0 * HALF_M * wide;
        assert_true(fabs((double)areas[0].zones[z].weight_m2 - area) < 0.02 * area);
    }
    crt_close(&rig);
}

/* Random attitudes over an edge through the origin: the contact plane passes through it and supports the block. */
static void check_plane_through_edge(const crt_solid *solid, const cr_config *config, double tolerance_m) {
    crt_rig rig;
    uint64_t seed = 19u;
    uint32_t seen = 0u;
    double left[4], right[4];
    crt_plane(solid, 1, right);
    crt_plane(solid, 2, left);
    open_cube(&rig, solid);
    for (int n = 0; n < 400; n++) {
        cr_pose pose =
            crt_pose(crt_uniform(&seed, -5e-3, 5e-3), crt_uniform(&seed, -5e-3, 5e-3), crt_uniform(&seed, 4e-3, 9e-3));
        pose.rot = crt_random_rotation(&seed);
        if (respond(&rig, &pose, config, CR_AREAS_MAX) != 1u || areas[0].zone_count != 2u) {
            continue;
        }
        cr_vec3 v = areas[0].normal_world;
        /* n = alpha right + beta left with both >= 0: inside the cone of the zone normals. */
        double det = right[0] * left[2] - right[2] * left[0];
        double alpha = ((double)v.x * left[2] - (double)v.z * left[0]) / det;
        double beta = (right[0] * (double)v.z - right[2] * (double)v.x) / det;
        assert_true(alpha > -1e-5 && beta > -1e-5 && fabsf(v.y) < 1e-5f);
        if (alpha > 1e-6 && beta > 1e-6) {
            assert_true(fabs((double)areas[0].offset_m) < tolerance_m);
            double depth = reach_below(&pose, (double)v.x, (double)v.y, (double)v.z);
            assert_true((double)areas[0].depth_m <= depth + 1e-6);
            seen++;
        }
    }
    assert_true(seen > 50u);
    crt_close(&rig);
}

static void respond_plane_of_two_zones_passes_through_their_edge(void **state) {
    (void)state;
    crt_solid solids[] = {crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0), crt_wedge(60.0 * PI / 180.0, 40e-3, 30e-3),
                          crt_wedge(120.0 * PI / 180.0, 40e-3, 30e-3)};
    cr_config config = extent_config();
    for (size_t i = 0; i < sizeof solids / sizeof *solids; i++) {
        check_plane_through_edge(&solids[i], &config, 2e-6);
    }
}

static cr_plane plane_at(float x, float y, float z, float offset_m) {
    cr_plane p = {v3(x, y, z), offset_m};
    return p;
}

/* Planes of a box: the top along n is the sum of |n_i| half_i; with faces left out, where it is still bounded, the same. */
static void top_behind_planes_is_that_of_the_box_they_bound(void **state) {
    (void)state;
    const cr_plane box[6] = {plane_at(1.0f, 0.0f, 0.0f, 1e-3f), plane_at(-1.0f, 0.0f, 0.0f, 1e-3f),
                             plane_at(0.0f, 1.0f, 0.0f, 2e-3f), plane_at(0.0f, -1.0f, 0.0f, 2e-3f),
                             plane_at(0.0f, 0.0f, 1.0f, 3e-3f), plane_at(0.0f, 0.0f, -1.0f, 3e-3f)};
    uint64_t seed = 5u;
    for (int k = 0; k < 200; k++) {
        double x = crt_uniform(&seed, -1.0, 1.0), y = crt_uniform(&seed, -1.0, 1.0), z = crt_uniform(&seed, -1.0, 1.0);
        double length = sqrt(x * x + y * y + z * z);
        cr_vec3 n = v3((float)(x / length), (float)(y / length), (float)(z / length));
        double top = (1e-3 * fabs(x) + 2e-3 * fabs(y) + 3e-3 * fabs(z)) / length;
        /* Weights down to -1e-4 pass for zero: that is worth twice the farthest plane's offset. */
        assert_float_equal(cr_top_behind(box, 6u, n, 1.0f), top, 6e-7);
        /* A lower plane stays as it is. */
        assert_float_equal(cr_top_behind(box, 6u, n, 1e-4f), 1e-4, 0.0);
    }
    cr_vec3 up = v3(0.0f, 0.0f, 1.0f), aslant = v3(0.0f, 0.6f, 0.8f);
    /* Two faces of a plate; two of an edge; one that n turns away from bounds nothing. */
    assert_float_equal(cr_top_behind(&box[4], 2u, up, 1.0f), 3e-3, 1e-9);
    assert_float_equal(cr_top_behind(&box[2], 3u, aslant, 1.0f), 3.6e-3f, 1e-8f);
    assert_float_equal(cr_top_behind(&box[5], 1u, up, 1.0f), 1.0, 0.0);
    assert_float_equal(cr_top_behind(&box[0], 4u, aslant, 1.0f), 1.0, 0.0);
}

static void respond_hard_plane_of_two_zones_passes_through_their_edge(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    cr_config config = extent_config();
    config.coverage = CR_COVERAGE_HARD;
    check_plane_through_edge(&block, &config, 2e-6);
}

static void respond_plane_of_three_zones_passes_through_their_vertex(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 20e-3, -40e-3, 0.0);
    cr_config config = extent_config();
    crt_rig rig;
    uint64_t seed = 23u;
    uint32_t seen = 0u;
    open_cube(&rig, &block);
    for (int n = 0; n < 300; n++) {
        cr_pose pose =
            crt_pose(crt_uniform(&seed, 0.0, 7e-3), crt_uniform(&seed, 20e-3, 27e-3), crt_uniform(&seed, 0.0, 7e-3));
        pose.rot = crt_random_rotation(&seed);
        if (respond(&rig, &pose, &config, CR_AREAS_MAX) == 1u && areas[0].zone_count == 3u) {
            const cr_area *a = &areas[0];
            if (a->zones[0].weight_m2 > 0.0f && a->zones[1].weight_m2 > 0.0f && a->zones[2].weight_m2 > 0.0f) {
                assert_true(fabsf(a->offset_m - a->normal_world.y * 20e-3f) < 2e-6f);
                seen++;
            }
        }
    }
    assert_true(seen > 50u);
    crt_close(&rig);
}

static void respond_direction_is_hard_within_what_counting_gives(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    cr_config config = extent_config();
    crt_rig rig;
    config.coverage = CR_COVERAGE_HARD;
    open_cube(&rig, &block);
    for (size_t i = 0; i < sizeof overlaps_m / sizeof *overlaps_m; i++) {
        double a = overlaps_m[i][0], b = overlaps_m[i][1];
        cr_pose pose;
        place_over_edge(&pose, a, b);
        assert_int_equal(respond(&rig, &pose, &config, CR_AREAS_MAX), 1);
        /* Each side counts whole rows of samples: off by half a spacing at most. */
        double most = atan2(0.5 * SPACING_M, hypot(a, b)) * 180.0 / PI * 1.5;
        assert_true(angle_deg(areas[0].normal_world, b, 0.0, a) < most);
        assert_true(areas[0].depth_m > 0.0f);
    }
    crt_close(&rig);
}

static void respond_fixed45_gives_45_degrees_at_a_right_edge(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    cr_config config = extent_config();
    crt_rig rig;
    config.response = CR_RESPONSE_FIXED45;
    open_cube(&rig, &block);
    for (uint32_t hard = 0; hard < 2u; hard++) {
        config.coverage = hard ? CR_COVERAGE_HARD : CR_COVERAGE_SOFT;
        for (size_t i = 0; i < sizeof overlaps_m / sizeof *overlaps_m; i++) {
            cr_pose pose;
            place_over_edge(&pose, overlaps_m[i][0], overlaps_m[i][1]);
            assert_int_equal(respond(&rig, &pose, &config, CR_AREAS_MAX), 1);
            assert_true(angle_deg(areas[0].normal_world, 1.0, 0.0, 1.0) < 1e-3);
            assert_true(areas[0].depth_m > 0.0f);
        }
    }
    crt_close(&rig);
}

static void respond_fixed45_is_the_zone_method_on_one_zone(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    cr_config config = extent_config();
    crt_rig rig;
    cr_pose pose = crt_pose(1e-3, 2e-3, 6e-3);
    open_cube(&rig, &block);
    pose.rot = crt_turn(1.0, 0.4, 0.3, 0.2);
    respond(&rig, &pose, &config, CR_AREAS_MAX);
    cr_area zones = areas[0];
    config.response = CR_RESPONSE_FIXED45;
    respond(&rig, &pose, &config, CR_AREAS_MAX);
    assert_true(angle_deg(areas[0].normal_world, 0.0, 0.0, 1.0) < 1e-3);
    assert_true(fabsf(areas[0].depth_m - zones.depth_m) < 1e-6f);
    crt_close(&rig);
}

/* In the corner of a room: floor z = -14, wall x = -14, and the wall y = -14 mm. */
static void respond_concave_creases_give_one_area_per_face(void **state) {
    (void)state;
    crt_solid room = crt_room(-14e-3, 20e-3, 14e-3, -14e-3, 20e-3);
    crt_rig rig;
    open_cube(&rig, &room);
    const double push[][3] = {{2e-3, 0.0, 1e-3}, {0.5e-3, 0.0, 3e-3}, {2e-3, 1.5e-3, 1e-3}};
    cr_config config = extent_config();
    for (size_t i = 0; i < sizeof push / sizeof *push; i++) {
        double y = push[i][1] > 0.0 ? -6e-3 - push[i][1] : 0.0;
        cr_pose pose = crt_pose(-6e-3 - push[i][0], y, -6e-3 - push[i][2]);
        uint32_t expected = push[i][1] > 0.0 ? 3u : 2u;
        assert_int_equal(respond(&rig, &pose, &config, CR_AREAS_MAX), expected);
        for (uint32_t a = 0; a < expected; a++) {
            cr_vec3 n = areas[a].normal_world;
            double depth = (double)n.x * push[i][0] + (double)n.y * push[i][1] + (double)n.z * push[i][2];
            assert_int_equal(areas[a].zone_count, 1);
            assert_true(fabsf(max_f(max_f(n.x, n.y), n.z) - 1.0f) < 1e-6f);
            assert_true(fabs((double)areas[a].depth_m - depth) < 1e-3 * depth);
        }
    }
    crt_close(&rig);
}

static void respond_ball_on_ball_pushes_along_the_line_of_centres(void **state) {
    (void)state;
    crt_solid ball = crt_ball(20e-3);
    crt_tool tool = crt_tool_new(1e-3);
    crt_rig rig;
    cr_config config = extent_config();
    uint64_t seed = 41u;
    crt_add_ball(&tool, 10e-3);
    crt_open(&rig, &ball, &tool, 1e-3, NULL);
    crt_tool_free(&tool);
    for (int n = 0; n < 100; n++) {
        double depth = crt_uniform(&seed, 1e-3, 4e-3), u[3], length = 0.0;
        for (int a = 0; a < 3; a++) {
            u[a] = crt_uniform(&seed, -1.0, 1.0);
            length += u[a] * u[a];
        }
        double far = (30e-3 - depth) / sqrt(length);
        cr_pose pose = crt_pose(far * u[0], far * u[1], far * u[2]);
        pose.rot = crt_random_rotation(&seed);
        assert_int_equal(respond(&rig, &pose, &config, CR_AREAS_MAX), 1);
        double turn = angle_deg(areas[0].normal_world, u[0], u[1], u[2]);
        if (!(turn < 0.5) || !(fabs((double)areas[0].depth_m - depth) < 0.1e-3)) {
            fail_msg("depth %g m: %g degrees, depth off by %g m", depth, turn, (double)areas[0].depth_m - depth);
        }
    }
    crt_close(&rig);
}

static void respond_force_acts_within_the_contact(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    cr_config config = extent_config();
    crt_rig rig;
    cr_pose pose = crt_pose(3e-3, -2e-3, 6e-3);
    open_cube(&rig, &block);
    assert_int_equal(respond(&rig, &pose, &config, CR_AREAS_MAX), 1);
    /* Face-on: in the middle. */
    assert_true(fabsf(areas[0].point_world_m.x - 3e-3f) < 2e-5f && fabsf(areas[0].point_world_m.y + 2e-3f) < 2e-5f);
    assert_true(areas[0].point_world_m.z < 0.0f && areas[0].point_world_m.z > -2e-3f);
    crt_close(&rig);
}

static void respond_writes_no_more_areas_than_there_is_room_for(void **state) {
    (void)state;
    crt_solid room = crt_room(-14e-3, 20e-3, 14e-3, -14e-3, 20e-3);
    cr_config config = extent_config();
    crt_rig rig;
    cr_pose pose = crt_pose(-8e-3, -8e-3, -8e-3);
    open_cube(&rig, &room);
    for (uint32_t limit = 0u; limit <= 3u; limit++) {
        memset(areas, 0x5a, sizeof areas);
        assert_int_equal(respond(&rig, &pose, &config, limit), limit);
        const uint8_t *beyond = (const uint8_t *)&areas[limit];
        for (size_t i = 0; i < sizeof areas[0]; i++) {
            assert_int_equal(beyond[i], 0x5a);
        }
    }
    crt_close(&rig);
}

static void respond_depth_is_never_negative_and_the_normal_is_unit(void **state) {
    (void)state;
    crt_solid solids[] = {crt_box(-12e-3, 0.0, 9e-3, -12e-3, 0.0), crt_room(-12e-3, 9e-3, 11e-3, -10e-3, 12e-3),
                          crt_wedge(0.6, 20e-3, 9e-3), crt_ball(9e-3)};
    uint64_t seed = 55u;
    for (size_t k = 0; k < sizeof solids / sizeof *solids; k++) {
        crt_rig rig;
        open_cube(&rig, &solids[k]);
        for (int n = 0; n < 600; n++) {
            cr_config config = extent_config();
            config.coverage = (uint32_t)n % 2u;
            config.response = (uint32_t)n / 2u % 2u;
            config.vertices_only = (uint32_t)n / 4u % 2u;
            cr_pose pose = crt_pose(crt_uniform(&seed, -16e-3, 16e-3), crt_uniform(&seed, -16e-3, 16e-3),
                                    crt_uniform(&seed, -20e-3, 16e-3));
            pose.rot = crt_random_rotation(&seed);
            uint32_t count = respond(&rig, &pose, &config, CR_AREAS_MAX);
            assert_true(count <= CR_AREAS_MAX);
            for (uint32_t a = 0; a < count; a++) {
                assert_true(areas[a].depth_m > 0.0f && is_finite_f(areas[a].depth_m));
                assert_true(fabsf(v3_norm(areas[a].normal_world) - 1.0f) < 1e-5f);
                assert_true(v3_is_finite(areas[a].point_world_m));
                /* Not deeper than the tool is long. */
                assert_true(areas[a].depth_m < 2.0f * (float)HALF_M * 1.74f + 25e-3f);
            }
        }
        crt_close(&rig);
    }
}

static void extent_gives_no_force_in_free_space(void **state) {
    (void)state;
    const crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    crt_open_cube(&rig, &block, HALF_M, 1e-3, VOXEL_M);
    cr_config config = extent_config();
    crt_check_free(&rig, HALF_M, &config);
    config.response = CR_RESPONSE_FIXED45;
    crt_check_free(&rig, HALF_M, &config);
    config = extent_config();
    config.coverage = CR_COVERAGE_HARD;
    crt_check_free(&rig, HALF_M, &config);
    crt_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(extent_gives_no_force_in_free_space),
        cmocka_unit_test(respond_depth_on_a_flat_wall_is_exact),
        cmocka_unit_test(respond_depth_on_a_flat_wall_is_exact_with_hard_coverage),
        cmocka_unit_test(respond_at_an_edge_follows_the_overlap_volume),
        cmocka_unit_test(respond_weights_of_zones_are_areas_inside_the_tool),
        cmocka_unit_test(respond_plane_of_two_zones_passes_through_their_edge),
        cmocka_unit_test(top_behind_planes_is_that_of_the_box_they_bound),
        cmocka_unit_test(respond_hard_plane_of_two_zones_passes_through_their_edge),
        cmocka_unit_test(respond_plane_of_three_zones_passes_through_their_vertex),
        cmocka_unit_test(respond_direction_is_hard_within_what_counting_gives),
        cmocka_unit_test(respond_fixed45_gives_45_degrees_at_a_right_edge),
        cmocka_unit_test(respond_fixed45_is_the_zone_method_on_one_zone),
        cmocka_unit_test(respond_concave_creases_give_one_area_per_face),
        cmocka_unit_test(respond_ball_on_ball_pushes_along_the_line_of_centres),
        cmocka_unit_test(respond_force_acts_within_the_contact),
        cmocka_unit_test(respond_feels_a_static_corner_between_the_samples_of_a_face),
        cmocka_unit_test(respond_writes_no_more_areas_than_there_is_room_for),
        cmocka_unit_test(respond_depth_is_never_negative_and_the_normal_is_unit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
