/* The tick as a whole: faults, limits, damping, display pose, settings, memory. */
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define PI 3.14159265358979323846
#define VOXEL_M 2e-3
#define HALF_M 8e-3
#define PERIOD_S 1e-3f

static crt_rig wall, edge, room;

static void open_cube(crt_rig *rig, const crt_solid *solid) { crt_open_cube(rig, solid, HALF_M, 1e-3, VOXEL_M); }

static int open_rigs(void **state) {
    (void)state;
    crt_solid w = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0), e = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0),
              r = crt_room(-14e-3, 20e-3, 14e-3, -14e-3, 20e-3);
    open_cube(&wall, &w);
    open_cube(&edge, &e);
    open_cube(&room, &r);
    return 0;
}

static int close_rigs(void **state) {
    (void)state;
    crt_close(&wall);
    crt_close(&edge);
    crt_close(&room);
    return 0;
}

static cr_output tick(const crt_rig *rig, const cr_pose *pose) {
    cr_output out;
    memset(&out, 0xa5, sizeof out);
    cr_tick(rig->world, pose, PERIOD_S, &out);
    return out;
}

static int is_zero(cr_vec3 v) { return v.x == 0.0f && v.y == 0.0f && v.z == 0.0f; }

static cr_pose pressed(double depth) { return crt_pose(0.0, 0.0, HALF_M - depth); }

static void tick_pushes_back_along_the_wall_normal(void **state) {
    (void)state;
    cr_pose pose = pressed(2e-3);
    crt_restart(&wall, NULL);
    cr_output out = tick(&wall, &pose);
    assert_int_equal(out.faults, 0);
    assert_int_equal(out.area_count, 1);
    assert_int_equal(out.zone_count, 1);
    assert_true(fabsf(out.force_world_N.z - 2.0f) < 2e-4f);
    assert_true(fabsf(out.force_world_N.x) < 1e-4f && fabsf(out.force_world_N.y) < 1e-4f);
    assert_true(fabsf(out.depth_m - 2e-3f) < 2e-7f && fabsf(out.normal_world.z - 1.0f) < 1e-6f);
    assert_true(out.stats.contacts > 0u && out.stats.points > 0u);
}

static void tick_torque_is_about_the_tool_origin(void **state) {
    (void)state;
    uint64_t seed = 5u;
    crt_restart(&edge, NULL);
    for (int i = 0; i < 200; i++) {
        cr_pose pose =
            crt_pose(crt_uniform(&seed, -6e-3, 6e-3), crt_uniform(&seed, -6e-3, 6e-3), crt_uniform(&seed, 2e-3, 8e-3));
        pose.rot = crt_random_rotation(&seed);
        cr_output out = tick(&edge, &pose);
        cr_vec3 torque = v3(0.0f, 0.0f, 0.0f), force = torque;
        for (uint32_t a = 0; a < out.area_count; a++) {
            cr_vec3 arm = v3_sub(out.areas[a].point_world_m, pose.pos_m);
            torque = v3_add(torque, v3_cross(arm, out.areas[a].force_world_N));
            force = v3_add(force, out.areas[a].force_world_N);
        }
        assert_true(v3_norm(v3_sub(torque, out.torque_world_Nm)) < 1e-6f + 1e-4f * v3_norm(torque));
        assert_true(v3_norm(v3_sub(force, out.force_world_N)) < 1e-5f + 1e-4f * v3_norm(force));
    }
}

static void check_fault(cr_pose bad, float period_s, uint32_t fault) {
    cr_output out;
    cr_pose good = pressed(2e-3);
    crt_restart(&wall, NULL);
    assert_true(tick(&wall, &good).force_world_N.z > 1.0f);
    memset(&out, 0xa5, sizeof out);
    cr_tick(wall.world, &bad, period_s, &out);
    assert_int_equal(out.faults, fault);
    assert_true(is_zero(out.force_world_N) && is_zero(out.torque_world_Nm) && out.depth_m == 0.0f);
    assert_int_equal(out.area_count, 0);
    assert_memory_equal(&out.display_pose, &good, sizeof good);
    for (int i = 0; i < 3; i++) {
        out = tick(&wall, &good);
        assert_int_equal(out.faults, fault);
        assert_true(is_zero(out.force_world_N) && is_zero(out.torque_world_Nm));
    }
    cr_world_clear_fault(wall.world);
    out = tick(&wall, &good);
    assert_int_equal(out.faults, 0);
    assert_true(fabsf(out.force_world_N.z - 2.0f) < 2e-4f);
}

static void tick_bad_poses_fault_latch_zero_and_clear(void **state) {
    (void)state;
    const float bad[] = {NAN, INFINITY, -INFINITY, 1.01e4f, -3e38f};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        for (int a = 0; a < 3; a++) {
            cr_pose pose = pressed(2e-3);
            *(&pose.pos_m.x + a) = bad[i];
            check_fault(pose, PERIOD_S, CR_FAULT_POSE);
        }
    }
    const float scale[] = {0.0f, 0.98f, 1.02f, -2.0f, NAN, INFINITY, 1e30f};
    for (size_t i = 0; i < sizeof scale / sizeof *scale; i++) {
        cr_pose pose = pressed(2e-3);
        pose.rot.w *= scale[i];
        check_fault(pose, PERIOD_S, CR_FAULT_POSE);
        pose = pressed(2e-3);
        pose.rot.y = isfinite(scale[i]) && scale[i] < 1e3f ? 0.5f : scale[i];
        check_fault(pose, PERIOD_S, CR_FAULT_POSE);
    }
}

static void tick_bad_periods_fault_latch_zero_and_clear(void **state) {
    (void)state;
    const float bad[] = {0.0f, -1e-3f, 1.0001f, NAN, INFINITY, -INFINITY};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        check_fault(pressed(2e-3), bad[i], CR_FAULT_PERIOD);
    }
}

static void tick_faults_add_up(void **state) {
    (void)state;
    cr_pose pose = pressed(2e-3);
    cr_output out;
    crt_restart(&wall, NULL);
    cr_tick(wall.world, &pose, 0.0f, &out);
    pose.rot.w = NAN;
    cr_tick(wall.world, &pose, PERIOD_S, &out);
    assert_int_equal(out.faults, CR_FAULT_POSE | CR_FAULT_PERIOD);
    assert_true(crt_is_sound(&out, &(cr_config){.force_max_N = 1.0f}));
}

static void tick_takes_a_quaternion_within_one_percent_and_normalises_it(void **state) {
    (void)state;
    cr_pose pose = pressed(2e-3);
    crt_restart(&wall, NULL);
    pose.rot.w = 1.004f;
    cr_output out = tick(&wall, &pose);
    assert_int_equal(out.faults, 0);
    assert_true(fabsf(out.force_world_N.z - 2.0f) < 2e-4f);
    assert_true(fabsf(out.display_pose.rot.w - 1.0f) < 1e-6f);
}

static void tick_takes_the_whole_range_of_periods(void **state) {
    (void)state;
    const float periods[] = {1.0f, 1e-6f, 1e-30f, 1e-40f};
    cr_config config = cr_config_default();
    config.damping_Ns_m = 1e4f;
    for (size_t i = 0; i < sizeof periods / sizeof *periods; i++) {
        cr_output out;
        cr_pose high = pressed(1e-3), low = pressed(2e-3);
        crt_restart(&wall, &config);
        cr_tick(wall.world, &high, periods[i], &out);
        cr_tick(wall.world, &low, periods[i], &out);
        assert_true(crt_is_sound(&out, &config));
        cr_tick(wall.world, &high, periods[i], &out);
        assert_true(crt_is_sound(&out, &config));
    }
}

static void tick_limits_the_force_and_scales_the_torque_along(void **state) {
    (void)state;
    cr_config config = cr_config_default();
    cr_pose pose = crt_pose(3e-3, 1e-3, 6e-3);
    pose.rot = crt_turn(1.0, 0.5, 0.0, 0.4);
    crt_restart(&edge, &config);
    cr_output free_out = tick(&edge, &pose);
    float force = v3_norm(free_out.force_world_N);
    assert_int_equal(free_out.stats.force_limited, 0);
    config.force_max_N = 0.25f * force;
    assert_int_equal(cr_world_configure(edge.world, &config), CR_OK);
    cr_output out = tick(&edge, &pose);
    assert_int_equal(out.stats.force_limited, 1);
    assert_true(fabsf(v3_norm(out.force_world_N) - config.force_max_N) < 1e-5f * force);
    cr_vec3 torque = v3_scale(free_out.torque_world_Nm, 0.25f);
    assert_true(v3_norm(v3_sub(out.torque_world_Nm, torque)) < 1e-5f * v3_norm(torque) + 1e-9f);
    assert_true(out.depth_m == free_out.depth_m);
}

static void tick_stays_finite_at_the_largest_settings(void **state) {
    (void)state;
    cr_config config = cr_config_default();
    config.stiffness_N_m = 1e6f;
    config.damping_Ns_m = 1e4f;
    config.force_max_N = 1e6f;
    uint64_t seed = 71u;
    crt_restart(&edge, &config);
    for (int i = 0; i < 300; i++) {
        cr_pose pose = crt_pose(crt_uniform(&seed, -20e-3, 10e-3), 0.0, crt_uniform(&seed, -20e-3, 10e-3));
        pose.rot = crt_random_rotation(&seed);
        cr_output out;
        cr_tick(edge.world, &pose, 1e-9f, &out);
        assert_true(crt_is_sound(&out, &config));
    }
}

static void tick_damping_adds_on_the_way_in_and_takes_away_on_the_way_out(void **state) {
    (void)state;
    cr_config config = cr_config_default();
    config.damping_Ns_m = 20.0f;
    cr_pose poses[] = {pressed(2.0e-3), pressed(2.01e-3), pressed(2.01e-3), pressed(2.0e-3)};
    const float speed[] = {0.0f, 0.01f, 0.0f, -0.01f};
    crt_restart(&wall, &config);
    for (int i = 0; i < 4; i++) {
        cr_output out = tick(&wall, &poses[i]);
        float expected = 1000.0f * out.depth_m + 20.0f * speed[i];
        assert_true(fabsf(out.force_world_N.z - expected) < 2e-4f * expected);
    }
}

static void tick_damping_sees_the_motion_of_the_contact_when_the_tool_turns(void **state) {
    (void)state;
    cr_config config = cr_config_default();
    crt_restart(&wall, &config);
    /* One corner down; turning about y by a milliradian a tick moves the contact, 8 mm beside the origin, by 8 um. */
    cr_pose before = pressed(2e-3), after = before;
    before.rot = crt_turn(0.0, 1.0, 0.0, 0.10);
    after.rot = crt_turn(0.0, 1.0, 0.0, 0.101);
    tick(&wall, &before);
    cr_output still = tick(&wall, &after);
    config.damping_Ns_m = 10.0f;
    crt_restart(&wall, &config);
    tick(&wall, &before);
    cr_output out = tick(&wall, &after);
    float arm = out.areas[0].point_world_m.x - after.pos_m.x;
    float expected = still.force_world_N.z + 10.0f * 1.0f * arm;
    assert_true(fabsf(out.force_world_N.z - expected) < 0.02f * fabsf(10.0f * arm) + 1e-3f);
}

static void tick_never_pulls_on_exit(void **state) {
    (void)state;
    const crt_rig *rigs[] = {&wall, &edge, &room};
    cr_config config = cr_config_default();
    uint64_t seed = 61u;
    config.damping_Ns_m = 500.0f;
    for (int r = 0; r < 3; r++) {
        int touching = 0;
        crt_restart((crt_rig *)rigs[r], &config);
        for (int i = 0; i < 1500; i++) {
            cr_pose pose = crt_pose(crt_uniform(&seed, -9e-3, 9e-3), crt_uniform(&seed, -9e-3, 9e-3),
                                    crt_uniform(&seed, -9e-3, 9e-3));
            pose.rot = crt_turn(1.0, 0.3, 0.2, crt_uniform(&seed, -0.5, 0.5));
            cr_output out = tick(rigs[r], &pose);
            for (uint32_t a = 0; a < out.area_count; a++) {
                touching++;
                assert_true(v3_dot(out.areas[a].force_world_N, out.areas[a].normal_world) >= 0.0f);
                cr_vec3 across = v3_cross(out.areas[a].force_world_N, out.areas[a].normal_world);
                assert_true(v3_norm(across) <= 1e-5f * v3_norm(out.areas[a].force_world_N));
            }
        }
        assert_true(touching > 500);
    }
}

static void tick_first_tick_has_no_velocity(void **state) {
    (void)state;
    cr_config config = cr_config_default();
    config.damping_Ns_m = 1000.0f;
    cr_pose pose = pressed(2e-3), away = pressed(1.5e-3);
    crt_restart(&wall, &config);
    assert_true(fabsf(tick(&wall, &pose).force_world_N.z - 2.0f) < 2e-4f);
    tick(&wall, &away);
    cr_world_clear_fault(wall.world);
    assert_true(fabsf(tick(&wall, &pose).force_world_N.z - 2.0f) < 2e-4f);
}

/* A tick at the display pose: what is left of the contact, as a share of the depth before. */
static float share_left(const crt_rig *rig, const cr_pose *pose, float *depth) {
    cr_output out = tick(rig, pose);
    *depth = out.depth_m;
    cr_output shown = tick(rig, &out.display_pose);
    assert_true(fabsf(out.display_pose.rot.w - pose->rot.w) < 1e-6f);
    return out.depth_m > 0.0f ? shown.depth_m / out.depth_m : 0.0f;
}

/* How deep a cube of half side HALF_M reaches into the quadrant x < 0, z < 0, by geometry alone: the smaller of the two heights is
 * largest on an edge of the cube. */
static float reach_into_quadrant(const cr_pose *pose) {
    xform now = cr_xform_from_pose(pose);
    float most = -1.0f;
    for (int axis = 0; axis < 3; axis++) {
        for (int corner = 0; corner < 4; corner++) {
            for (int step = 0; step <= 400; step++) {
                float along = (float)HALF_M * ((float)step / 200.0f - 1.0f);
                float one = (float)HALF_M * (corner & 1 ? 1.0f : -1.0f),
                      two = (float)HALF_M * (corner & 2 ? 1.0f : -1.0f);
                cr_vec3 v = axis == 0 ? v3(along, one, two) : axis == 1 ? v3(one, along, two) : v3(one, two, along);
                cr_vec3 p = cr_xform_point(&now, v);
                most = max_f(most, min_f(-p.x, -p.z));
            }
        }
    }
    return most;
}

static void check_display(const crt_rig *rig, double low, double high, uint64_t seed) {
    int touching = 0;
    crt_restart((crt_rig *)rig, NULL);
    for (int i = 0; i < 400; i++) {
        cr_pose pose =
            crt_pose(crt_uniform(&seed, low, high), crt_uniform(&seed, -1e-3, 1e-3), crt_uniform(&seed, low, high));
        float depth = 0.0f;
        pose.rot = crt_turn(crt_uniform(&seed, -1, 1), crt_uniform(&seed, -1, 1), 0.3, crt_uniform(&seed, -0.4, 0.4));
        float left = share_left(rig, &pose, &depth);
        if (depth > 0.5e-3f) {
            touching++;
            if (!(left < 0.02f)) {
                fail_msg("pose %d: %g of %g m left", i, (double)left, (double)depth);
            }
        }
    }
    assert_true(touching > 100);
}

static void tick_display_pose_leaves_a_wall(void **state) {
    (void)state;
    check_display(&wall, 5e-3, 9e-3, 1u);
}

static void tick_display_pose_leaves_an_edge(void **state) {
    (void)state;
    uint64_t seed = 2u;
    int touching = 0;
    crt_restart(&edge, NULL);
    for (int i = 0; i < 400; i++) {
        cr_pose pose =
            crt_pose(crt_uniform(&seed, 4e-3, 8e-3), crt_uniform(&seed, -1e-3, 1e-3), crt_uniform(&seed, 4e-3, 8e-3));
        pose.rot = crt_turn(crt_uniform(&seed, -1, 1), crt_uniform(&seed, -1, 1), 0.3, crt_uniform(&seed, -0.4, 0.4));
        float before = reach_into_quadrant(&pose);
        cr_output out = tick(&edge, &pose);
        float after = reach_into_quadrant(&out.display_pose);
        if (before > 0.5e-3f) {
            touching++;
            if (!(after < 0.02f * before)) {
                fail_msg("pose %d: %g of %g m left", i, (double)after, (double)before);
            }
        }
    }
    assert_true(touching > 100);
}

static void tick_display_pose_leaves_a_concave_corner(void **state) {
    (void)state;
    check_display(&room, -8e-3, -4e-3, 3u);
}

static void tick_display_pose_is_the_pose_in_free_space(void **state) {
    (void)state;
    cr_pose pose = crt_pose(1e-3, 2e-3, 40e-3);
    crt_restart(&wall, NULL);
    cr_output out = tick(&wall, &pose);
    assert_memory_equal(&out.display_pose, &pose, sizeof pose);
}

static void tick_gives_no_force_in_free_space(void **state) {
    (void)state;
    cr_config config = cr_config_default();
    crt_check_free(&edge, HALF_M, &config);
}

static void tick_is_a_pure_function_of_its_history(void **state) {
    (void)state;
    static cr_output first[200];
    for (int round = 0; round < 2; round++) {
        uint64_t seed = 91u;
        crt_restart(&edge, NULL);
        for (int i = 0; i < 200; i++) {
            cr_pose pose = crt_pose(crt_uniform(&seed, -8e-3, 8e-3), 0.0, crt_uniform(&seed, -8e-3, 8e-3));
            pose.rot = crt_random_rotation(&seed);
            cr_output out = tick(&edge, &pose);
            if (round == 0) {
                first[i] = out;
            } else {
                assert_true(crt_same(&out, &first[i]));
                assert_memory_equal(&out.stats, &first[i].stats, sizeof out.stats);
            }
        }
    }
}

static void tick_skips_change_no_bit_of_the_output(void **state) {
    (void)state;
    static cr_output first[300];
    for (uint32_t skip = 0; skip <= CR_SKIP_ALL; skip++) {
        cr_config config = cr_config_default();
        uint64_t seed = 17u;
        config.skip = skip;
        config.damping_Ns_m = 3.0f;
        crt_restart(&room, &config);
        for (int i = 0; i < 300; i++) {
            cr_pose pose = crt_pose(crt_uniform(&seed, -8e-3, 12e-3), crt_uniform(&seed, -8e-3, 8e-3),
                                    crt_uniform(&seed, -8e-3, 12e-3));
            pose.rot = crt_random_rotation(&seed);
            cr_output out = tick(&room, &pose);
            if (skip == 0u) {
                first[i] = out;
            } else {
                assert_true(crt_same(&out, &first[i]));
            }
        }
    }
}

static void check_config(cr_config config, cr_err expected) {
    cr_config good = cr_config_default();
    crt_restart(&wall, &good);
    assert_int_equal(cr_world_size(&wall.scene, &config) > 0u, expected == CR_OK);
    assert_int_equal(cr_world_configure(wall.world, &config), expected);
    if (expected != CR_OK) {
        cr_pose pose = pressed(2e-3);
        cr_world *untouched = NULL;
        /* Nothing changed, and no world comes of it. */
        assert_true(fabsf(tick(&wall, &pose).force_world_N.z - 2.0f) < 2e-4f);
        assert_int_equal(cr_world_init(&untouched, wall.memory, wall.memory_bytes, &wall.scene, &config),
                         CR_ERR_CONFIG);
        assert_null(untouched);
    }
}

static void tick_settings_out_of_range_are_refused(void **state) {
    (void)state;
    const struct {
        size_t at;
        float low, high;
    } numbers[] = {{offsetof(cr_config, stiffness_N_m), 0.0f, 1e6f},
                   {offsetof(cr_config, damping_Ns_m), 0.0f, 1e4f},
                   {offsetof(cr_config, force_max_N), 1e-3f, 1e6f}};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        const float bad[] = {-1.0f, NAN, INFINITY, -INFINITY, numbers[i].high * 1.001f};
        for (size_t k = 0; k < 5; k++) {
            cr_config config = cr_config_default();
            memcpy((uint8_t *)&config + numbers[i].at, &bad[k], sizeof(float));
            check_config(config, CR_ERR_CONFIG);
        }
        const float fine[] = {numbers[i].low, numbers[i].high};
        for (size_t k = 0; k < 2; k++) {
            cr_config config = cr_config_default();
            memcpy((uint8_t *)&config + numbers[i].at, &fine[k], sizeof(float));
            check_config(config, CR_OK);
        }
    }
    cr_config config = cr_config_default();
    config.force_max_N = 0.0f;
    check_config(config, CR_ERR_CONFIG);
    assert_string_equal(cr_config_error(NULL), cr_err_text(CR_ERR_NULL));
    const size_t words[] = {offsetof(cr_config, response), offsetof(cr_config, coverage), offsetof(cr_config, skip),
                            offsetof(cr_config, vertices_only)};
    const uint32_t first_bad[] = {CR_RESPONSE_COUNT, CR_COVERAGE_HARD, CR_SKIP_ALL + 1u, 1u};
    for (size_t i = 0; i < 4; i++) {
        const uint32_t bad[] = {first_bad[i], 0xffffffffu};
        for (size_t k = 0; k < 2; k++) {
            config = cr_config_default();
            memcpy((uint8_t *)&config + words[i], &bad[k], sizeof(uint32_t));
            check_config(config, CR_ERR_CONFIG);
        }
    }
}

static void tick_defaults_are_those_of_the_header(void **state) {
    (void)state;
    cr_config c = cr_config_default();
    assert_true(c.stiffness_N_m == 1000.0f && c.damping_Ns_m == 0.0f && c.force_max_N == 100.0f);
    assert_int_equal(c.response, CR_RESPONSE_WAY_OUT);
    assert_int_equal(c.coverage, CR_COVERAGE_SOFT);
    assert_int_equal(c.skip, CR_SKIP_ALL);
    assert_int_equal(c.vertices_only, 0);
}

static void tick_world_refuses_bad_memory(void **state) {
    (void)state;
    cr_config config = cr_config_default();
    cr_world *world = NULL;
    size_t need = cr_world_size(&wall.scene, &config);
    uint8_t *memory = aligned_alloc(CR_IMG_ALIGN, need + 128u);
    memset(memory, 0x5a, need + 128u);
    assert_int_equal(cr_world_init(NULL, memory, need, &wall.scene, &config), CR_ERR_NULL);
    assert_int_equal(cr_world_init(&world, NULL, need, &wall.scene, &config), CR_ERR_NULL);
    assert_int_equal(cr_world_init(&world, memory, need, NULL, &config), CR_ERR_NULL);
    assert_int_equal(cr_world_init(&world, memory, need, &wall.scene, NULL), CR_ERR_NULL);
    for (size_t shift = 1u; shift < CR_IMG_ALIGN; shift *= 2u) {
        assert_int_equal(cr_world_init(&world, memory + shift, need, &wall.scene, &config), CR_ERR_ALIGN);
    }
    assert_int_equal(cr_world_init(&world, memory, need - 1u, &wall.scene, &config), CR_ERR_SIZE);
    assert_int_equal(cr_world_init(&world, memory, 0u, &wall.scene, &config), CR_ERR_SIZE);
    assert_null(world);
    for (size_t i = 0; i < need + 128u; i++) {
        assert_int_equal(memory[i], 0x5a);
    }
    assert_int_equal(cr_world_size(NULL, &config), 0);
    assert_int_equal(cr_world_size(&wall.scene, NULL), 0);
    assert_int_equal(cr_world_configure(NULL, &config), CR_ERR_NULL);
    assert_int_equal(cr_world_init(&world, memory, need, &wall.scene, &config), CR_OK);
    assert_int_equal(cr_world_configure(world, NULL), CR_ERR_NULL);
    free(memory);
}

static void tick_writes_only_its_memory_and_its_output(void **state) {
    (void)state;
    cr_config config = cr_config_default();
    cr_world *world = NULL;
    size_t need = cr_world_size(&edge.scene, &config);
    uint8_t *memory = aligned_alloc(CR_IMG_ALIGN, need + 64u), *image = malloc(edge.size_bytes);
    struct {
        uint8_t before[64];
        cr_output out;
        uint8_t after[64];
    } guarded;
    memset(memory + need, 0x5a, 64);
    memset(&guarded, 0x5a, sizeof guarded);
    memcpy(image, edge.image, edge.size_bytes);
    cr_scene scene = edge.scene;
    assert_int_equal(cr_world_init(&world, memory, need, &scene, &config), CR_OK);
    memset(&scene, 0, sizeof scene); /* the world has its own copy */
    for (int i = 0; i < 100; i++) {
        cr_pose pose = crt_pose(1e-4 * i, 0.0, 8e-3 - 1e-4 * i);
        cr_tick(world, &pose, PERIOD_S, &guarded.out);
    }
    for (int i = 0; i < 64; i++) {
        assert_true(memory[need + (size_t)i] == 0x5a && guarded.before[i] == 0x5a && guarded.after[i] == 0x5a);
    }
    assert_memory_equal(image, edge.image, edge.size_bytes);
    free(memory);
    free(image);
}

static void tick_state_fits_its_budget(void **state) {
    (void)state;
    cr_config config = cr_config_default();
    /* Budget of the issue: 64 KiB of state with a shell of some two thousand samples. */
    assert_true(cr_world_size(&wall.scene, &config) <= 65536u);
}

static void tick_stays_finite_anywhere(void **state) {
    (void)state;
    const crt_rig *rigs[] = {&wall, &edge, &room};
    uint64_t seed = 29u;
    for (int i = 0; i < 6000; i++) {
        const crt_rig *rig = rigs[i % 3];
        cr_config config = cr_config_default();
        double reach = pow(10.0, crt_uniform(&seed, -3.0, 4.0)), r = fmin(reach, 9.99e3);
        config.damping_Ns_m = i % 5 ? 0.0f : 50.0f;
        if (i % 100 < 3) {
            crt_restart((crt_rig *)rig, &config);
        } else {
            assert_int_equal(cr_world_configure(rig->world, &config), CR_OK);
        }
        cr_pose pose = crt_pose(crt_uniform(&seed, -r, r), crt_uniform(&seed, -r, r), crt_uniform(&seed, -r, r));
        pose.rot = crt_random_rotation(&seed);
        cr_output out = tick(rig, &pose);
        assert_int_equal(out.faults, 0);
        assert_true(crt_is_sound(&out, &config));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tick_pushes_back_along_the_wall_normal),
        cmocka_unit_test(tick_torque_is_about_the_tool_origin),
        cmocka_unit_test(tick_bad_poses_fault_latch_zero_and_clear),
        cmocka_unit_test(tick_bad_periods_fault_latch_zero_and_clear),
        cmocka_unit_test(tick_faults_add_up),
        cmocka_unit_test(tick_takes_a_quaternion_within_one_percent_and_normalises_it),
        cmocka_unit_test(tick_takes_the_whole_range_of_periods),
        cmocka_unit_test(tick_limits_the_force_and_scales_the_torque_along),
        cmocka_unit_test(tick_stays_finite_at_the_largest_settings),
        cmocka_unit_test(tick_damping_adds_on_the_way_in_and_takes_away_on_the_way_out),
        cmocka_unit_test(tick_damping_sees_the_motion_of_the_contact_when_the_tool_turns),
        cmocka_unit_test(tick_never_pulls_on_exit),
        cmocka_unit_test(tick_first_tick_has_no_velocity),
        cmocka_unit_test(tick_display_pose_leaves_a_wall),
        cmocka_unit_test(tick_display_pose_leaves_an_edge),
        cmocka_unit_test(tick_display_pose_leaves_a_concave_corner),
        cmocka_unit_test(tick_display_pose_is_the_pose_in_free_space),
        cmocka_unit_test(tick_gives_no_force_in_free_space),
        cmocka_unit_test(tick_is_a_pure_function_of_its_history),
        cmocka_unit_test(tick_skips_change_no_bit_of_the_output),
        cmocka_unit_test(tick_settings_out_of_range_are_refused),
        cmocka_unit_test(tick_defaults_are_those_of_the_header),
        cmocka_unit_test(tick_world_refuses_bad_memory),
        cmocka_unit_test(tick_writes_only_its_memory_and_its_output),
        cmocka_unit_test(tick_state_fits_its_budget),
        cmocka_unit_test(tick_stays_finite_anywhere),
    };
    return cmocka_run_group_tests(tests, open_rigs, close_rigs);
}
