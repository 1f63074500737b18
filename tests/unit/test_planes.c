/* Planes instead of lookups: the distances of a solid, where they hold, and contact as lookups find it. */
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define VOXEL_M 2e-3
#define DEEP_M 6e-3f
#define POSES 400

static const double CENTRE[3] = {2e-3, 0.0, 1e-3}, HALF[3] = {12e-3, 9e-3, 7e-3};

static crt_solid solid_of(int which) {
    return which == 0   ? crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0)
           : which == 1 ? crt_room(-15e-3, 15e-3, 20e-3, -20e-3, 20e-3)
                        : crt_wedge(1.0, 30e-3, 20e-3);
}

static void open_cube_on(crt_rig *rig, const crt_solid *solid) {
    crt_tool tool = crt_tool_new(1.5e-3);
    crt_add_box(&tool, CENTRE, HALF);
    crt_open(rig, solid, &tool, VOXEL_M, NULL);
    crt_tool_free(&tool);
}

static cr_pose random_pose(uint64_t *seed, double reach) {
    cr_pose p =
        crt_pose(crt_uniform(seed, -reach, reach), crt_uniform(seed, -reach, reach), crt_uniform(seed, -reach, reach));
    p.rot = crt_random_rotation(seed);
    return p;
}

static void planes_give_the_distance_of_a_solid_from_both_sides(void **state) {
    (void)state;
    for (int which = 0; which < 3; which++) {
        crt_rig rig;
        crt_solid solid = solid_of(which);
        open_cube_on(&rig, &solid);
        uint64_t seed = 5u;
        int near = 0;
        for (int i = 0; i < POSES; i++) {
            const cr_pose pose = random_pose(&seed, 25e-3);
            const xform now = cr_xform_from_pose(&pose);
            const struct cr_img_cluster *c = &rig.scene.clusters[(uint32_t)i % rig.scene.cluster_count];
            cr_planes planes;
            cr_heights h;
            cr_planes_turn(&rig.scene, &now, rig.scene.kind_count - 1u, &planes);
            cr_planes_measure(&planes, c, &h);
            for (int lane = 0; lane < CR_LANES; lane++) {
                const cr_vec3 q = cr_xform_point(&now, v3(c->x[lane], c->y[lane], c->z[lane]));
                const double p[3] = {(double)q.x, (double)q.y, (double)q.z}, exact = crt_distance(&solid, p);
                float height[CR_KIND_FACETS_MAX];
                for (uint32_t k = 0; k < planes.count; k++) {
                    height[k] = h.height_m[k][lane];
                }
                float found = planes.sign * cr_planes_distance(&planes, height, h.top_m[lane]);
                if (fabs(exact) < 4e-3) {
                    assert_float_equal((double)found, exact, 2e-7);
                    near++;
                }
            }
        }
        assert_true(near > 500);
        crt_close(&rig);
    }
}

/* Kind that is found round a point. */
static uint32_t around(const crt_rig *rig, double x, double y, double z, float reach_m) {
    float found;
    return cr_planes_around(&rig->field, v3((float)x, (float)y, (float)z), reach_m, &found);
}

/* The near brick of a point, to be changed. */
static struct cr_img_brick *brick_at(const crt_rig *rig, double x, double y, double z) {
    const struct cr_img_meta *m = rig->scene.meta;
    const double p[3] = {x, y, z};
    uint32_t at[3];
    for (int a = 0; a < 3; a++) {
        at[a] = (uint32_t)((p[a] - (double)m->origin_m[a]) / (double)m->brick_m);
    }
    const uint32_t entry = rig->scene.top[(at[2] * m->dims[1] + at[1]) * m->dims[0] + at[0]];
    assert_int_equal(entry & CR_TOP_FAR, 0);
    return (struct cr_img_brick *)crt_section(rig->image, CR_SEC_BRICKS) + entry;
}

static void planes_hold_only_where_all_bricks_of_the_box_have_them(void **state) {
    (void)state;
    crt_rig rig;
    crt_solid box = crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0);
    open_cube_on(&rig, &box);
    const struct cr_img_meta *m = rig.scene.meta;
    const uint32_t all = rig.scene.kind_count - 1u;
    /* The corner of four bricks nearest to the edge, and a place a millimetre from it in each. */
    double corner[3];
    for (int a = 0; a < 3; a++) {
        corner[a] = (double)m->origin_m[a] + round(-(double)m->origin_m[a] / (double)m->brick_m) * (double)m->brick_m;
    }
    const double x = corner[0] - 1e-3, y = corner[1] + 8e-3, z = corner[2] - 1e-3;
    assert_int_equal(around(&rig, x, y, z, 0.5e-3f), 0);
    crt_mark_planes(&rig);
    assert_int_equal(around(&rig, x, y, z, 0.5e-3f), all);
    assert_int_equal(around(&rig, x, y, z, 2e-3f), all);
    assert_int_equal(around(&rig, x, y, z, 30e-3f), 0); /* too many bricks */
    assert_int_equal(around(&rig, 1.0, 1.0, 1.0, 2e-3f), 0);
    struct cr_img_brick *here = brick_at(&rig, x, y, z), *there = brick_at(&rig, x + 2e-3, y, z);
    there->planes = 0u;
    assert_int_equal(around(&rig, x, y, z, 2e-3f), 0);
    assert_int_equal(around(&rig, x + 2e-3, y, z, 0.5e-3f), 0);
    /* Another kind there: what the bricks have in common counts, be it the planes of one or the kind of the other. */
    there->planes = 4u;
    there->kind = 4u;
    here->kind = 2u;
    assert_int_equal(around(&rig, x, y, z, 2e-3f), 0);
    here->kind = 4u;
    assert_int_equal(around(&rig, x, y, z, 2e-3f), 0); /* the other two have neither */
    brick_at(&rig, x, y, z + 2e-3)->kind = 4u;
    brick_at(&rig, x + 2e-3, y, z + 2e-3)->kind = 4u;
    assert_int_equal(around(&rig, x, y, z, 2e-3f), 4);
    there->kind = (uint16_t)all;
    assert_int_equal(around(&rig, x, y, z, 2e-3f), all);
    crt_close(&rig);
}

/* Planes of a floor that hold all round, while a brick beside knows a corner: pieces may be cut as far as there. */
static void a_corner_beside_is_reckoned_with(void **state) {
    (void)state;
    crt_rig rig;
    crt_solid box = crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0);
    open_cube_on(&rig, &box);
    crt_mark_planes(&rig);
    const uint32_t all = rig.scene.kind_count - 1u, floor = 1u; /* kinds are numbered by the set of their facets */
    struct cr_img_brick *bricks = crt_section(rig.image, CR_SEC_BRICKS);
    const cr_vec3 at = v3(-5e-3f, 5e-3f, 0.0f);
    float reach = 0.0f;
    assert_true(cr_is_corner(&rig.scene.kinds[all]) && !cr_is_corner(&rig.scene.kinds[floor]));
    assert_int_equal(cr_planes_around(&rig.field, at, 3e-3f, &reach), all);
    assert_true(reach > 1.4f);
    for (uint32_t i = 0; i < rig.scene.brick_count; i++) {
        bricks[i].planes = bricks[i].kind = (uint16_t)floor;
    }
    assert_int_equal(cr_planes_around(&rig.field, at, 3e-3f, &reach), floor);
    assert_true(reach == 1.0f);
    uint32_t beside = 0u; /* one brick after the other knows the corner: where it is one of those that are asked */
    for (uint32_t i = 0; i < rig.scene.brick_count; i++) {
        bricks[i].planes = (uint16_t)all;
        const uint32_t kind = cr_planes_around(&rig.field, at, 3e-3f, &reach);
        assert_int_equal(kind, floor);
        beside += reach > 1.4f;
        bricks[i].planes = (uint16_t)floor;
    }
    assert_in_range(beside, 1u, 8u);
    crt_close(&rig);
}

static void planes_that_do_not_matter_are_left_out(void **state) {
    (void)state;
    crt_rig rig;
    crt_solid box = crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0);
    open_cube_on(&rig, &box);
    const cr_pose pose = crt_pose(0.0, 0.0, 0.0);
    const xform now = cr_xform_from_pose(&pose);
    cr_planes all, one;
    cr_planes_turn(&rig.scene, &now, rig.scene.kind_count - 1u, &all);
    assert_ptr_equal(cr_planes_alone(&all, v3(-2e-3f, 0.0f, 0.0f), 3e-3f, 1e-3f, &one), &all);
    assert_ptr_equal(cr_planes_alone(&all, v3(-12e-3f, 0.0f, 0.0f), 3e-3f, 1e-3f, &one), &one);
    assert_int_equal(one.count, 1);
    assert_true(one.normal_tool[0].z > 0.99f);
    assert_ptr_equal(cr_planes_alone(&one, v3(0.0f, 0.0f, 0.0f), 1.0f, 1.0f, &all), &one);
    crt_close(&rig);
}

static void tick_over_planes_feels_what_lookups_feel(void **state) {
    (void)state;
    for (int which = 0; which < 3; which++) {
        crt_rig looked, planes;
        crt_solid solid = solid_of(which);
        open_cube_on(&looked, &solid);
        open_cube_on(&planes, &solid);
        crt_mark_planes(&planes);
        uint64_t seed = 9u;
        int touching = 0, shallow = 0;
        for (int i = 0; i < POSES; i++) {
            cr_pose pose = random_pose(&seed, 22e-3);
            if (i % 4 == 0) {
                pose.rot = crt_turn(0.0, 0.0, 1.0, 0.0); /* creases of the tool along those of the solid */
            }
            static cr_output a, b;
            cr_tick(looked.world, &pose, 1e-3f, &a);
            cr_tick(planes.world, &pose, 1e-3f, &b);
            touching += a.depth_m > 0.0f;
            /* 0.05 mm at 1000 N/m. Deeper, lookups know less than planes: beyond the band no distance, and no way out longer than a
             * few times the depth of the deepest sample. */
            const float most = max_f(v3_norm(a.force_world_N), v3_norm(b.force_world_N));
            const float bound = a.depth_m < DEEP_M ? 0.05f : 0.6f * most;
            shallow += a.depth_m > 0.0f && a.depth_m < DEEP_M;
            assert_true(v3_norm(v3_sub(a.force_world_N, b.force_world_N)) < bound);
        }
        assert_true(touching > 200 && shallow > 40);
        crt_close(&looked);
        crt_close(&planes);
    }
}

/* A cube that hovers closer than its creases fade in over: they run along the face, above it from end to end, and give no depth. */
static void crease_along_a_face_is_outside_as_a_whole(void **state) {
    (void)state;
    crt_rig rig;
    const crt_solid box = crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0);
    open_cube_on(&rig, &box);
    crt_mark_planes(&rig);
    for (double gap = 2e-6; gap < 60e-6; gap += 3e-6) {
        static cr_output out;
        cr_pose pose = crt_pose(-CENTRE[0] - HALF[0] + 4e-3, 0.0, HALF[2] - CENTRE[2] + gap);
        cr_tick(rig.world, &pose, 1e-3f, &out);
        assert_true(v3_norm(out.force_world_N) == 0.0f);
    }
    /* Turned about the edge: creases of the tool run along that of the box, beside it and into it. */
    uint64_t seed = 5u;
    for (int i = 0; i < 3000; i++) {
        static cr_output out;
        const cr_config config = cr_config_default();
        cr_pose pose = crt_pose(crt_uniform(&seed, -14e-3, 14e-3), 0.0, crt_uniform(&seed, -10e-3, 10e-3));
        pose.rot = crt_turn(0.0, 1.0, 0.0, crt_uniform(&seed, -3.0, 3.0));
        cr_tick(rig.world, &pose, 1e-3f, &out);
        assert_true(crt_is_sound(&out, &config));
        assert_true(fabsf(out.force_world_N.y) < 0.02f * v3_norm(out.force_world_N) + 1e-3f);
    }
    crt_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(planes_give_the_distance_of_a_solid_from_both_sides),
        cmocka_unit_test(planes_hold_only_where_all_bricks_of_the_box_have_them),
        cmocka_unit_test(a_corner_beside_is_reckoned_with),
        cmocka_unit_test(planes_that_do_not_matter_are_left_out),
        cmocka_unit_test(crease_along_a_face_is_outside_as_a_whole),
        cmocka_unit_test(tick_over_planes_feels_what_lookups_feel),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
