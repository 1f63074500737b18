/* The rival responses against what their papers say in closed form: flat wall, edge, corner, plate, ball. */
#include "image_builder.h"
#include "rivals/rivals.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define HALF_M 8e-3
#define SPACING_M 1e-3
#define VOXEL_M 2e-3
#define BALL_M 8e-3
#define STIFFNESS 1000.0

enum { FIRST_RIVAL = CR_RESPONSE_FIXED45 + 1 };

static cr_output out;

static void open_with(crt_rig *rig, const crt_solid *solid, crt_tool *tool, uint32_t response) {
    cr_config config = cr_config_default();
    config.response = response;
    config.force_max_N = 1e5f;
    crt_open(rig, solid, tool, VOXEL_M, &config);
    crt_tool_free(tool);
}

static void open_cube(crt_rig *rig, const crt_solid *solid, uint32_t response) {
    const double centre[3] = {0.0, 0.0, 0.0}, half[3] = {HALF_M, HALF_M, HALF_M};
    crt_tool tool = crt_tool_new(SPACING_M);
    crt_add_box(&tool, centre, half);
    open_with(rig, solid, &tool, response);
}

static void open_ball(crt_rig *rig, const crt_solid *solid, uint32_t response) {
    crt_tool tool = crt_tool_new(0.5e-3);
    crt_add_ball(&tool, BALL_M);
    open_with(rig, solid, &tool, response);
}

static crt_solid wall(void) { return crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0); }

/* Force over stiffness at a place, in mm. */
static cr_vec3 force_mm(crt_rig *rig, double x_mm, double y_mm, double z_mm) {
    cr_pose pose = crt_pose(x_mm * 1e-3, y_mm * 1e-3, z_mm * 1e-3);
    cr_tick(rig->world, &pose, 1e-3f, &out);
    assert_int_equal(out.faults, 0);
    return v3_scale(out.force_world_N, (float)(1e3 / STIFFNESS));
}

/* The tool drawn straight from one place to another, 0.1 mm a tick. */
static cr_vec3 drag_mm(crt_rig *rig, const double from_mm[3], const double to_mm[3]) {
    double d[3] = {to_mm[0] - from_mm[0], to_mm[1] - from_mm[1], to_mm[2] - from_mm[2]};
    int ticks = 1 + (int)(sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / 0.1);
    cr_vec3 f = v3(0.0f, 0.0f, 0.0f);
    for (int i = 0; i <= ticks; i++) {
        double s = (double)i / ticks;
        f = force_mm(rig, from_mm[0] + s * d[0], from_mm[1] + s * d[1], from_mm[2] + s * d[2]);
    }
    return f;
}

static void assert_near(cr_vec3 f, double x, double y, double z, double tolerance) {
    if (!(fabs((double)f.x - x) <= tolerance && fabs((double)f.y - y) <= tolerance &&
          fabs((double)f.z - z) <= tolerance)) {
        fail_msg("force / stiffness (%g, %g, %g) mm, expected (%g, %g, %g) within %g", (double)f.x, (double)f.y,
                 (double)f.z, x, y, z, tolerance);
    }
}

static void rivals_are_silent_in_free_space(void **state) {
    (void)state;
    crt_solid wedge = crt_wedge(1.2, 40e-3, 40e-3);
    for (uint32_t response = FIRST_RIVAL; response < CR_RESPONSE_COUNT; response++) {
        crt_rig rig;
        uint64_t seed = 5u;
        open_ball(&rig, &wedge, response);
        for (int n = 0; n < 500; n++) {
            double a = crt_uniform(&seed, -0.95, 0.95), far = BALL_M * 1e3 + crt_uniform(&seed, 0.02, 1.0);
            assert_near(force_mm(&rig, far * sin(a), 0.0, far * cos(a)), 0.0, 0.0, 0.0, 0.0);
        }
        crt_close(&rig);
    }
}

/* The cube's face flat on the wall: no other face holds a sample that is inside. */
static void rivals_push_straight_out_of_a_flat_wall(void **state) {
    (void)state;
    crt_solid block = wall();
    for (uint32_t response = FIRST_RIVAL; response < CR_RESPONSE_COUNT; response++) {
        crt_rig rig;
        open_ball(&rig, &block, response);
        /* The god-object is a point: its point has to be inside. */
        double z = response == CR_RESPONSE_GOD_OBJECT ? -1.0 : BALL_M * 1e3 - 1.0;
        const double from[3] = {0.3, 0.2, z + 2.0}, to[3] = {0.3, 0.2, z};
        cr_vec3 f = drag_mm(&rig, from, to);
        /* Voxels are coarse: the tangent planes of a ball's points do not cancel sideways. */
        float sideways = response == CR_RESPONSE_VOXMAP ? 0.15f : 0.02f;
        assert_true(f.z > 0.1f);
        assert_true(hypotf(f.x, f.y) < sideways * f.z);
        crt_close(&rig);
    }
}

static void voxmap_measures_from_the_middle_of_the_voxel(void **state) {
    (void)state;
    crt_solid block = wall();
    crt_rig rig;
    open_cube(&rig, &block, CR_RESPONSE_VOXMAP);
    double origin = (double)rig.scene.meta->origin_m[2] * 1e3, voxel = VOXEL_M * 1e3;
    for (int i = 1; i < 40; i++) {
        double depth = 0.01 * i; /* less than half a spacing: only the face is inside */
        double middle = origin + (floor((-depth - origin) / voxel) + 0.5) * voxel;
        assert_near(force_mm(&rig, 0.0, 0.0, HALF_M * 1e3 - depth), 0.0, 0.0, fmax(0.0, middle + depth), 2e-3);
    }
    crt_close(&rig);
}

static double voxel_middle_mm(double x_mm, double origin_mm) {
    const double voxel = VOXEL_M * 1e3;
    return origin_mm + (floor((x_mm - origin_mm) / voxel) + 0.5) * voxel;
}

/* The cube's face leaning about y, its depth from 0.05 to 0.45 mm across it, so that some columns of points lie before the plane of
 * their voxel: the force is the mean over all of them, each as deep as it lies below its plane. */
static void voxmap_means_over_points_before_their_plane_too(void **state) {
    (void)state;
    /* The grid starts at the block's low end: this puts the middles of voxels 0.2 mm below the face. */
    crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40.8e-3, 0.0);
    crt_rig rig;
    open_cube(&rig, &block, CR_RESPONSE_VOXMAP);
    const double half = HALF_M * 1e3, lean = asin(0.4 / (2.0 * half)), height = half * cos(lean) - 0.25;
    cr_pose pose = crt_pose(0.0, 0.0, height * 1e-3);
    pose.rot.w = (float)cos(0.5 * lean);
    pose.rot.y = (float)sin(0.5 * lean);
    cr_tick(rig.world, &pose, 1e-3f, &out);
    const double x0 = (double)rig.scene.meta->origin_m[0] * 1e3, z0 = (double)rig.scene.meta->origin_m[2] * 1e3;
    double mean = 0.0;
    int before = 0;
    for (int i = 0; i < 16; i++) {
        const double along = -half + 0.5 + i, x = along * cos(lean) - half * sin(lean),
                     z = height - along * sin(lean) - half * cos(lean);
        const double below = (voxel_middle_mm(x, x0) - x) * sin(lean) + (voxel_middle_mm(z, z0) - z) * cos(lean);
        before += below < 0.0;
        mean += fmax(0.0, below) / 16.0;
    }
    assert_in_range(before, 4, 12);
    assert_near(v3_scale(out.force_world_N, (float)(1e3 / STIFFNESS)), mean * sin(lean), 0.0, mean * cos(lean), 1e-3);
    crt_close(&rig);
}

/* Deeper than the surface voxels: at most a voxel's half diagonal off the true depth. */
static void voxmap_goes_on_below_the_surface_voxels(void **state) {
    (void)state;
    crt_solid block = wall();
    crt_rig rig;
    open_ball(&rig, &block, CR_RESPONSE_VOXMAP);
    float shallow = force_mm(&rig, 0.0, 0.0, BALL_M * 1e3 - 2.0).z,
          deep = force_mm(&rig, 0.0, 0.0, BALL_M * 1e3 - 5.0).z;
    assert_true(deep > shallow && shallow > 0.0f);
    crt_close(&rig);
}

static void distance_field_stiffness_grows_with_the_face_in_contact(void **state) {
    (void)state;
    crt_solid block = wall();
    crt_rig rig;
    open_cube(&rig, &block, CR_RESPONSE_DISTANCE_FIELD);
    double points = pow(2.0 * HALF_M / SPACING_M, 2.0), depth = 0.3;
    assert_near(force_mm(&rig, 0.0, 0.0, HALF_M * 1e3 - depth), 0.0, 0.0, 0.1 * points * depth,
                0.02 * points * depth * 0.1);
    /* Half of the face over the rim. */
    assert_near(force_mm(&rig, 40.0, 0.0, HALF_M * 1e3 - depth), 0.0, 0.0, 0.05 * points * depth,
                0.05 * points * depth * 0.1);
    crt_close(&rig);
}

static void normal_groups_feel_the_set_stiffness_whatever_the_face(void **state) {
    (void)state;
    crt_solid block = wall();
    crt_rig rig;
    open_cube(&rig, &block, CR_RESPONSE_NORMAL_GROUPS);
    for (int i = 0; i < 8; i++) {
        double depth = 0.05 * (i + 1);
        assert_near(force_mm(&rig, 0.0, 0.0, HALF_M * 1e3 - depth), 0.0, 0.0, depth, 0.01 * depth);
        assert_near(force_mm(&rig, 40.0 - i, 0.0, HALF_M * 1e3 - depth), 0.0, 0.0, depth, 0.01 * depth);
    }
    crt_close(&rig);
}

static void normal_groups_feel_each_wall_of_a_corner(void **state) {
    (void)state;
    crt_solid room = crt_room(-14e-3, 20e-3, 40e-3, -14e-3, 20e-3);
    crt_rig rig;
    open_cube(&rig, &room, CR_RESPONSE_NORMAL_GROUPS);
    assert_near(force_mm(&rig, -6.3, 0.0, -6.2), 0.3, 0.0, 0.2, 0.01);
    crt_close(&rig);
}

static void deepest_group_is_as_deep_as_its_deepest_point(void **state) {
    (void)state;
    crt_solid block = wall();
    crt_rig rig;
    uint64_t seed = 9u;
    open_cube(&rig, &block, CR_RESPONSE_DEEPEST_GROUP);
    for (int n = 0; n < 300; n++) {
        cr_pose pose = crt_pose(crt_uniform(&seed, -8e-3, 8e-3), crt_uniform(&seed, -8e-3, 8e-3), 0.0);
        pose.rot = crt_random_rotation(&seed);
        xform now = cr_xform_from_pose(&pose);
        double low = 0.0, depth = crt_uniform(&seed, 0.5e-3, 3e-3);
        for (int k = 0; k < 8; k++) {
            cr_vec3 v = v3(k & 1 ? (float)HALF_M : -(float)HALF_M, k & 2 ? (float)HALF_M : -(float)HALF_M,
                           k & 4 ? (float)HALF_M : -(float)HALF_M);
            low = fmin(low, (double)xform_rotate(&now, v).z);
        }
        pose.pos_m.z = (float)(-low - depth);
        cr_tick(rig.world, &pose, 1e-3f, &out);
        assert_true(fabs((double)out.force_world_N.z / STIFFNESS - depth) < 2e-3 * depth + 1e-6);
        assert_true(hypotf(out.force_world_N.x, out.force_world_N.y) < 1e-3f * out.force_world_N.z);
    }
    crt_close(&rig);
}

/* At an edge each sample's nearest face decides. Over the bisector that is 45 degrees, but for the samples on the bisector itself,
 * 9 of 170 by weight, which all fall to one face. */
static void deepest_group_turns_to_the_middle_over_an_edge(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    open_cube(&rig, &block, CR_RESPONSE_DEEPEST_GROUP);
    cr_vec3 f = force_mm(&rig, 5.0, 0.0, 5.0);
    assert_near(v3_scale(f, 1.0f / v3_norm(f)), sqrt(0.5), 0.0, sqrt(0.5), 0.05);
    assert_true(fabsf(v3_norm(f) - 3.0f) < 0.05f);
    crt_close(&rig);
}

static void overlap_is_volume_over_section(void **state) {
    (void)state;
    crt_solid block = wall();
    crt_rig rig;
    open_cube(&rig, &block, CR_RESPONSE_OVERLAP);
    for (int i = 1; i < 8; i++) {
        assert_near(force_mm(&rig, 0.0, 0.0, HALF_M * 1e3 - 0.5 * i), 0.0, 0.0, 0.5 * i, 0.02 * i);
    }
    crt_close(&rig);
    open_ball(&rig, &block, CR_RESPONSE_OVERLAP);
    for (int i = 2; i < 8; i++) {
        double d = 0.5 * i, r = BALL_M * 1e3, mean = d * (3.0 * r - d) / (3.0 * (2.0 * r - d));
        assert_near(force_mm(&rig, 0.0, 0.0, r - d), 0.0, 0.0, mean, 0.04 * mean);
    }
    crt_close(&rig);
}

static void god_object_rests_on_the_wall_and_in_the_corner(void **state) {
    (void)state;
    crt_solid room = crt_room(-14e-3, 20e-3, 40e-3, -14e-3, 20e-3);
    crt_rig rig;
    open_cube(&rig, &room, CR_RESPONSE_GOD_OBJECT);
    const double above[3] = {0.0, 0.0, -13.0}, below[3] = {0.0, 0.0, -16.0}, corner[3] = {-15.0, 0.0, -16.0};
    assert_near(drag_mm(&rig, above, below), 0.0, 0.0, 2.0, 1e-3);
    assert_near(drag_mm(&rig, below, corner), 1.0, 0.0, 2.0, 1e-3);
    crt_close(&rig);
}

/* Inside a block the force stays that of the face it went in by, up to the edge, and is gone outside. */
static void god_object_keeps_its_face_and_lets_go_past_the_edge(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    open_cube(&rig, &block, CR_RESPONSE_GOD_OBJECT);
    const double above[3] = {-5.0, 0.0, 1.0}, inside[3] = {-5.0, 0.0, -2.0}, near[3] = {-0.2, 0.0, -2.0};
    const double past[3] = {0.3, 0.0, -2.0};
    assert_near(drag_mm(&rig, above, inside), 0.0, 0.0, 2.0, 1e-3);
    assert_near(drag_mm(&rig, inside, near), 0.0, 0.0, 2.0, 1e-3);
    assert_near(drag_mm(&rig, near, past), 0.0, 0.0, 0.0, 1e-3);
    crt_close(&rig);
}

static void god_object_does_not_fall_through_a_plate(void **state) {
    (void)state;
    crt_solid plate = crt_box(-40e-3, 40e-3, 40e-3, -2e-3, 0.0);
    crt_rig rig;
    open_cube(&rig, &plate, CR_RESPONSE_GOD_OBJECT);
    const double above[3] = {0.0, 0.0, 1.0}, below[3] = {0.0, 0.0, -5.0};
    assert_near(drag_mm(&rig, above, below), 0.0, 0.0, 5.0, 1e-3);
    crt_close(&rig);
}

static void sphere_proxy_rests_on_the_wall_and_in_the_corner(void **state) {
    (void)state;
    crt_solid room = crt_room(-14e-3, 20e-3, 40e-3, -14e-3, 20e-3);
    crt_rig rig;
    open_ball(&rig, &room, CR_RESPONSE_SPHERE_PROXY);
    const double above[3] = {3.0, 0.0, -5.0}, below[3] = {3.0, 0.0, -8.0}, corner[3] = {-7.0, 0.0, -8.0};
    assert_near(drag_mm(&rig, above, below), 0.0, 0.0, 2.0, 0.01);
    assert_near(drag_mm(&rig, below, corner), 1.0, 0.0, 2.0, 0.01);
    crt_close(&rig);
}

/* The centre's free space is bounded by a round edge of the ball's radius: the force points from the edge to the centre. */
static void sphere_proxy_turns_round_an_edge(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    open_ball(&rig, &block, CR_RESPONSE_SPHERE_PROXY);
    const double deep = 1.5, r = BALL_M * 1e3 - deep, above[3] = {-4.0, 0.0, 9.0}, on[3] = {-4.0, 0.0, r};
    const double start[3] = {0.0, 0.0, r};
    drag_mm(&rig, above, on);
    assert_near(drag_mm(&rig, on, start), 0.0, 0.0, deep, 0.02);
    cr_vec3 before = v3(0.0f, 0.0f, (float)deep);
    for (int i = 0; i <= 100; i++) {
        double a = 0.5 * 3.14159265358979 * i / 100.0;
        cr_vec3 f = force_mm(&rig, r * sin(a), 0.0, r * cos(a));
        assert_near(f, deep * sin(a), 0.0, deep * cos(a), 0.04);
        assert_true(v3_norm(v3_sub(f, before)) < 0.1f);
        before = f;
    }
    crt_close(&rig);
}

static void proxies_start_again_after_free_space(void **state) {
    (void)state;
    crt_solid block = wall();
    for (uint32_t response = CR_RESPONSE_GOD_OBJECT; response <= CR_RESPONSE_SPHERE_PROXY; response++) {
        crt_rig rig;
        open_ball(&rig, &block, response);
        double z = response == CR_RESPONSE_GOD_OBJECT ? 0.0 : BALL_M * 1e3;
        const double above[3] = {-10.0, 0.0, z + 1.0}, in[3] = {-10.0, 0.0, z - 1.0};
        assert_near(drag_mm(&rig, above, in), 0.0, 0.0, 1.0, 0.01);
        assert_near(force_mm(&rig, -10.0, 0.0, 30.0), 0.0, 0.0, 0.0, 0.0);
        force_mm(&rig, 10.0, 0.0, z + 0.5);
        assert_near(force_mm(&rig, 10.0, 0.0, z - 0.4), 0.0, 0.0, 0.4, 0.01);
        crt_close(&rig);
    }
}

/* A proxy that the device left far behind, or that has nowhere to come from, is pushed out of where it is. */
static void proxies_that_start_inside_are_finite(void **state) {
    (void)state;
    crt_solid block = wall();
    for (uint32_t response = CR_RESPONSE_GOD_OBJECT; response <= CR_RESPONSE_SPHERE_PROXY; response++) {
        crt_rig rig;
        cr_config config = cr_config_default();
        config.response = response;
        open_ball(&rig, &block, response);
        assert_near(force_mm(&rig, 0.0, 0.0, -1.0), 0.0, 0.0,
                    response == CR_RESPONSE_GOD_OBJECT ? 1.0 : BALL_M * 1e3 + 1.0, 0.05);
        force_mm(&rig, 1e6, 0.0, 0.0);
        force_mm(&rig, 0.0, 0.0, -20.0);
        assert_true(crt_is_sound(&out, &config));
        crt_close(&rig);
    }
}

static void rivals_are_finite_and_repeat_to_the_bit(void **state) {
    (void)state;
    crt_solid solids[] = {crt_box(-12e-3, 0.0, 9e-3, -12e-3, 0.0), crt_room(-12e-3, 9e-3, 11e-3, -10e-3, 12e-3),
                          crt_wedge(0.6, 20e-3, 9e-3), crt_ball(9e-3)};
    for (size_t k = 0; k < sizeof solids / sizeof *solids; k++) {
        for (uint32_t response = FIRST_RIVAL; response < CR_RESPONSE_COUNT; response++) {
            crt_rig rig[2];
            cr_output first;
            uint64_t seed = 55u;
            cr_config config = cr_config_default();
            config.response = response;
            config.damping_Ns_m = 3.0f;
            open_cube(&rig[0], &solids[k], response);
            open_cube(&rig[1], &solids[k], response);
            for (int n = 0; n < 150; n++) {
                config.coverage = (uint32_t)n / 3u % 2u;
                config.skip = n % 2 ? CR_SKIP_ALL : 0u;
                cr_pose pose = crt_pose(crt_uniform(&seed, -16e-3, 16e-3), crt_uniform(&seed, -16e-3, 16e-3),
                                        crt_uniform(&seed, -20e-3, 16e-3));
                pose.rot = crt_random_rotation(&seed);
                assert_int_equal(cr_world_configure(rig[0].world, &config), CR_OK);
                config.skip = CR_SKIP_ALL;
                assert_int_equal(cr_world_configure(rig[1].world, &config), CR_OK);
                cr_tick(rig[0].world, &pose, 1e-3f, &first);
                cr_tick(rig[1].world, &pose, 1e-3f, &out);
                assert_true(crt_is_sound(&out, &config));
                assert_true(crt_same(&first, &out));
            }
            crt_close(&rig[0]);
            crt_close(&rig[1]);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rivals_are_silent_in_free_space),
        cmocka_unit_test(rivals_push_straight_out_of_a_flat_wall),
        cmocka_unit_test(voxmap_measures_from_the_middle_of_the_voxel),
        cmocka_unit_test(voxmap_means_over_points_before_their_plane_too),
        cmocka_unit_test(voxmap_goes_on_below_the_surface_voxels),
        cmocka_unit_test(distance_field_stiffness_grows_with_the_face_in_contact),
        cmocka_unit_test(normal_groups_feel_the_set_stiffness_whatever_the_face),
        cmocka_unit_test(normal_groups_feel_each_wall_of_a_corner),
        cmocka_unit_test(deepest_group_is_as_deep_as_its_deepest_point),
        cmocka_unit_test(deepest_group_turns_to_the_middle_over_an_edge),
        cmocka_unit_test(overlap_is_volume_over_section),
        cmocka_unit_test(god_object_rests_on_the_wall_and_in_the_corner),
        cmocka_unit_test(god_object_keeps_its_face_and_lets_go_past_the_edge),
        cmocka_unit_test(god_object_does_not_fall_through_a_plate),
        cmocka_unit_test(sphere_proxy_rests_on_the_wall_and_in_the_corner),
        cmocka_unit_test(sphere_proxy_turns_round_an_edge),
        cmocka_unit_test(proxies_start_again_after_free_space),
        cmocka_unit_test(proxies_that_start_inside_are_finite),
        cmocka_unit_test(rivals_are_finite_and_repeat_to_the_bit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
