/* What the core meets seldom: an image that changes under it, a tree that multiplies itself, planes that hardly differ, creases that
 * are labelled both ways. */
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define VOXEL_M 2e-3
#define HALF_M 8e-3

static void open_cube(crt_rig *rig, const crt_solid *solid) { crt_open_cube(rig, solid, HALF_M, 1e-3, VOXEL_M); }

/* ---- memory that fails ------------------------------------------------------------------------------------------- */

static void image_that_changes_after_it_was_opened_is_a_fault_and_no_force(void **state) {
    (void)state;
    const crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    const cr_pose pose = crt_pose(0.0, 0.0, HALF_M - 0.2e-3), free = crt_pose(0.0, 0.0, 0.1);
    cr_output out;
    crt_rig rig;
    open_cube(&rig, &block);
    cr_tick(rig.world, &pose, 1e-3f, &out);
    assert_true(out.force_world_N.z > 0.1f && out.faults == 0u);
    assert_int_equal(cr_world_contacts(rig.world)->hit_count, out.stats.clusters);
    struct cr_img_cluster *clusters = crt_section(rig.image, CR_SEC_CLUSTERS);
    for (uint32_t i = 0; i < rig.scene.cluster_count; i++) {
        clusters[i].area[3] = NAN; /* a place that is none is no sample's: the test below */
    }
    cr_tick(rig.world, &pose, 1e-3f, &out);
    assert_int_equal(out.faults, CR_FAULT_NUMBER);
    assert_true(v3_norm(out.force_world_N) == 0.0f && v3_norm(out.torque_world_Nm) == 0.0f && out.area_count == 0u);
    assert_memory_equal(&out.display_pose.pos_m, &pose.pos_m, sizeof pose.pos_m);
    cr_tick(rig.world, &free, 1e-3f, &out);
    assert_int_equal(out.faults, CR_FAULT_NUMBER); /* latched, as any fault */
    crt_close(&rig);
}

/* The same tick from rest, with `count` numbers `step_bytes` apart made none: a fault, or no harder push. A tenth is allowed: a plane
 * lies a little otherwise when samples are left out. */
static void spoil_and_tick(crt_rig *rig, const cr_pose *pose, float whole_N, void *at, uint32_t count,
                           size_t step_bytes) {
    uint8_t *first = at;
    float *kept = malloc(count * sizeof *kept);
    const float none = NAN;
    cr_output out;
    assert_non_null(kept);
    for (uint32_t i = 0; i < count; i++) {
        memcpy(&kept[i], first + i * step_bytes, sizeof none);
        memcpy(first + i * step_bytes, &none, sizeof none);
    }
    crt_restart(rig, NULL);
    cr_tick(rig->world, pose, 1e-3f, &out);
    for (uint32_t i = 0; i < count; i++) {
        memcpy(first + i * step_bytes, &kept[i], sizeof none);
    }
    free(kept);
    const float force_N = v3_norm(out.force_world_N);
    if (!(force_N <= (out.faults != 0u ? 0.0f : 1.1f * whole_N))) {
        fail_msg("%g N instead of %g N", (double)force_N, (double)whole_N);
    }
}

/* A spacing of the image that is none was once cut to the largest depth: 13.9 N instead of 0.5 N, and no fault. */
static void not_a_number_in_the_image_never_pushes_harder(void **state) {
    (void)state;
    const crt_solid block = crt_box(-20e-3, 20e-3, 20e-3, -20e-3, 0.0);
    cr_pose poses[] = {crt_pose(0.0, 0.0, 3.5e-3), crt_pose(20e-3, 0.0, 3e-3), crt_pose(19e-3, 19.5e-3, 2.5e-3)};
    poses[1].rot = crt_turn(0.0, 1.0, 0.0, 0.7);
    poses[2].rot = crt_turn(1.0, 2.0, 0.3, 0.5);
    crt_rig rig;
    crt_open_cube(&rig, &block, 4e-3, 1e-3, VOXEL_M);
    struct cr_img_meta *m = crt_section(rig.image, CR_SEC_META);
    struct cr_img_cluster *c = crt_section(rig.image, CR_SEC_CLUSTERS);
    struct cr_img_facet *f = crt_section(rig.image, CR_SEC_FACETS);
    float *const lengths[] = {m->origin_m,    &m->brick_m,       &m->voxel_m,       &m->band_m,      &m->crease_m,
                              &m->quantum_m,  &m->error_out_m,   &m->error_in_m,    &m->error_max_m, &m->spacing_m,
                              &m->ramp_max_m, &m->tool_radius_m, &m->root_radius_m, m->root_centre_m};
    for (size_t p = 0; p < sizeof poses / sizeof *poses; p++) {
        cr_output out;
        crt_restart(&rig, NULL);
        cr_tick(rig.world, &poses[p], 1e-3f, &out);
        const float whole_N = v3_norm(out.force_world_N);
        assert_true(whole_N > 0.1f && out.faults == 0u);
        for (size_t i = 0; i < sizeof lengths / sizeof *lengths; i++) {
            spoil_and_tick(&rig, &poses[p], whole_N, lengths[i], 1u, sizeof *m);
        }
        for (size_t k = 0; k < offsetof(struct cr_img_cluster, count); k += sizeof(float)) {
            spoil_and_tick(&rig, &poses[p], whole_N, (uint8_t *)c + k, rig.scene.cluster_count, sizeof *c);
        }
        for (size_t k = 0; k < 4u; k++) {
            spoil_and_tick(&rig, &poses[p], whole_N, (float *)f + k, rig.scene.facet_count, sizeof *f);
            spoil_and_tick(&rig, &poses[p], whole_N, f->low_m + k, rig.scene.facet_count, sizeof *f);
        }
    }
    crt_close(&rig);
}

static void limits_keep_what_is_no_number(void **state) {
    (void)state;
    const float none[] = {NAN, -NAN};
    for (size_t i = 0; i < 2; i++) {
        assert_false(is_finite_f(min_f(none[i], 1.0f)) || is_finite_f(min_f(1.0f, none[i])));
        assert_false(is_finite_f(max_f(none[i], 1.0f)) || is_finite_f(max_f(1.0f, none[i])));
        assert_false(is_finite_f(min_f(none[i], INFINITY)) || is_finite_f(max_f(-INFINITY, none[i])));
        assert_true(clamp_f(none[i], -1.0f, 2.0f) == -1.0f); /* an index stays one */
    }
    assert_true(min_f(1.0f, 2.0f) == 1.0f && min_f(2.0f, 1.0f) == 1.0f && min_f(-INFINITY, INFINITY) == -INFINITY);
    assert_true(max_f(1.0f, 2.0f) == 2.0f && max_f(2.0f, 1.0f) == 2.0f && max_f(-INFINITY, INFINITY) == INFINITY);
    assert_true(clamp_f(3.0f, -1.0f, 2.0f) == 2.0f && clamp_f(-3.0f, -1.0f, 2.0f) == -1.0f);
}

/* ---- work that is bounded ---------------------------------------------------------------------------------------- */

/* The image with its tree replaced: groups[levels], each the only child of the one before, sixteen times over. */
static uint8_t *with_multiplying_tree(const uint8_t *image, uint32_t bytes, uint32_t levels, uint32_t *size_bytes) {
    const uint32_t at = bytes, groups = levels * (uint32_t)sizeof(struct cr_img_group);
    uint8_t *out = aligned_alloc(CR_IMG_ALIGN, at + groups);
    assert_non_null(out);
    memcpy(out, image, bytes);
    struct cr_img_group *g = (struct cr_img_group *)(void *)(out + at);
    struct cr_img_meta *m = crt_section(out, CR_SEC_META);
    memset(g, 0, groups);
    for (uint32_t i = 0; i < levels; i++) {
        g[i].count = CR_LANES;
        g[i].level = i;
        g[i].leaf = i + 1u == levels;
        for (uint32_t k = 0; k < CR_LANES; k++) {
            g[i].x[k] = m->root_centre_m[0];
            g[i].y[k] = m->root_centre_m[1];
            g[i].z[k] = m->root_centre_m[2];
            g[i].radius[k] = m->root_radius_m;
            g[i].margin[k] = m->ramp_max_m;
            g[i].rho[k] = m->tool_radius_m;
            g[i].child[k] = g[i].leaf ? k % crt_row(out, CR_SEC_CLUSTERS)->count : i + 1u;
        }
    }
    m->levels = levels;
    crt_row(out, CR_SEC_GROUPS)->offset = at;
    crt_row(out, CR_SEC_GROUPS)->count = levels;
    ((struct cr_img_header *)(void *)out)->size_bytes = *size_bytes = at + groups;
    crt_seal(out);
    return out;
}

/* The image with one list of neighbours, of the first cluster, of `count` records. */
static uint8_t *with_long_list(const uint8_t *image, uint32_t bytes, uint32_t count, uint32_t *size_bytes) {
    const uint32_t more =
        (count * (uint32_t)sizeof(struct cr_img_neighbour) + CR_IMG_ALIGN - 1u) / CR_IMG_ALIGN * CR_IMG_ALIGN;
    uint8_t *out = aligned_alloc(CR_IMG_ALIGN, bytes + more);
    assert_non_null(out);
    memcpy(out, image, bytes);
    memset(out + bytes, 0, more);
    struct cr_img_neighbour *list = (struct cr_img_neighbour *)(void *)(out + bytes);
    uint32_t *start = crt_section(out, CR_SEC_ADJ_START);
    for (uint32_t i = 0; i < count; i++) {
        list[i] = (struct cr_img_neighbour){1u, (uint16_t)(i + 1u), 1u};
    }
    for (uint32_t i = 1; i < crt_row(out, CR_SEC_ADJ_START)->count; i++) {
        start[i] = count;
    }
    crt_row(out, CR_SEC_ADJ)->offset = bytes;
    crt_row(out, CR_SEC_ADJ)->count = count;
    ((struct cr_img_header *)(void *)out)->size_bytes = *size_bytes = bytes + more;
    crt_seal(out);
    return out;
}

static void image_that_multiplies_the_work_of_a_tick_is_refused(void **state) {
    (void)state;
    const crt_solid block = crt_box(-20e-3, 20e-3, 20e-3, -20e-3, 0.0);
    crt_tool plate = crt_plate();
    uint32_t bytes = 0u, size = 0u;
    uint8_t *image = crt_image(&block, &plate, VOXEL_M, &bytes);
    cr_scene scene;
    /* 16^5 leaves in 6 groups: each child is shared by all lanes of its parent. Together with a list of 200,000 records one tick
     * took 35 s when this was accepted. */
    uint8_t *hostile = with_multiplying_tree(image, bytes, CR_TREE_DEPTH_MAX, &size);
    assert_int_equal(cr_scene_open(&scene, hostile, size), CR_ERR_INDEX);
    free(hostile);
    const struct {
        uint32_t count;
        cr_err err;
    } lists[] = {{CR_IMG_BESIDE_MAX, CR_OK}, {CR_IMG_BESIDE_MAX + 1u, CR_ERR_INDEX}, {60000u, CR_ERR_INDEX}};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        hostile = with_long_list(image, bytes, lists[i].count, &size);
        assert_int_equal(cr_scene_open(&scene, hostile, size), lists[i].err);
        free(hostile);
    }
    free(image);
    crt_tool_free(&plate);
}

/* ---- planes ------------------------------------------------------------------------------------------------------ */

/* A box image in which every cell sees the first `count` facets as one convex crease, at no distance from the samples. */
static void open_planes(crt_rig *rig, const double plane[][4], uint32_t count) {
    const crt_solid block = crt_box(-20e-3, 20e-3, 20e-3, -20e-3, 0.0);
    open_cube(rig, &block);
    struct cr_img_brick *bricks = crt_section(rig->image, CR_SEC_BRICKS);
    struct cr_img_kind *kinds = crt_section(rig->image, CR_SEC_KINDS);
    struct cr_img_facet *facets = crt_section(rig->image, CR_SEC_FACETS);
    uint32_t *top = crt_section(rig->image, CR_SEC_TOP);
    memset(crt_section(rig->image, CR_SEC_SAMPLES), 0, rig->scene.sample_count * 2u);
    kinds[1].kind = CR_KIND_CONVEX;
    kinds[1].count = (uint16_t)count;
    for (uint32_t k = 0; k < count; k++) {
        kinds[1].facet[k] = k;
        facets[k].offset_m = (float)plane[k][3];
        for (int a = 0; a < 3; a++) {
            facets[k].normal[a] = (float)plane[k][a];
        }
    }
    for (uint32_t i = 0; i < rig->scene.brick_count; i++) {
        bricks[i].creased = 1u;
        bricks[i].cells = CR_CELLS_NONE;
        bricks[i].kind = 1u;
    }
    for (uint32_t i = 0; i < crt_row(rig->image, CR_SEC_TOP)->count; i++) {
        top[i] = 0u;
    }
}

static double phi_at(const crt_rig *rig, double x, double y, double z) {
    cr_lanes3 p;
    cr_lookup at;
    for (int i = 0; i < CR_LANES; i++) {
        p.x[i] = (float)x;
        p.y[i] = (float)y;
        p.z[i] = (float)z;
    }
    cr_field_look_up(&rig->field, &p, &at);
    assert_int_equal(at.from_facet, 0xffff);
    return (double)at.phi_m[0];
}

static void field_takes_planes_that_hardly_differ_as_one(void **state) {
    (void)state;
    const double turn = 5e-4; /* rad: the edge of the two is not a number worth dividing by */
    const double plane[2][4] = {{0.0, 0.0, 1.0, 0.0}, {sin(turn), 0.0, cos(turn), 0.0}};
    crt_rig rig;
    open_planes(&rig, plane, 2u);
    for (int i = -3; i <= 3; i++) {
        const double x = 1e-6 * i, z = 2e-3, exact = fmax(z, x * plane[1][0] + z * plane[1][2]);
        assert_true(fabs(phi_at(&rig, x, 0.0, z) - exact) < 1e-8);
    }
    crt_close(&rig);
}

static void field_of_one_plane_is_its_height(void **state) {
    (void)state;
    const double plane[1][4] = {{0.6, 0.0, 0.8, 1e-3}};
    crt_rig rig;
    open_planes(&rig, plane, 1u);
    assert_true(fabs(phi_at(&rig, 2e-3, 0.0, 3e-3) - (0.6 * 2e-3 + 0.8 * 3e-3 - 1e-3)) < 1e-8);
    assert_true(fabs(phi_at(&rig, -2e-3, 0.0, 1e-3) - (0.6 * -2e-3 + 0.8 * 1e-3 - 1e-3)) < 1e-8);
    crt_close(&rig);
}

/* Three planes with one direction in common have no vertex, the edge stays: SPEC.md "Distance at a point". Distance to the
 * edge of the first two, where they meet in the plane y = 0, by Cramer's rule. */
static void field_of_planes_without_a_vertex_stays_at_the_edge(void **state) {
    (void)state;
    const double angle[3] = {3.014119641543828, 0.374436162931669, 1.8870889886223299};
    const double offset[3] = {-3.67103609e-4, -1.52763988e-3, -8.18097941e-4}, x = -1.5107017e-3, z = 1.49746087e-3;
    double plane[3][4];
    crt_rig rig;
    for (int k = 0; k < 3; k++) {
        const double row[4] = {cos(angle[k]), 0.0, sin(angle[k]), offset[k]};
        memcpy(plane[k], row, sizeof row);
    }
    open_planes(&rig, (const double(*)[4])plane, 3u);
    const double *a = plane[2], *b = plane[0], det = a[0] * b[2] - a[2] * b[0];
    const double ex = (a[3] * b[2] - a[2] * b[3]) / det, ez = (a[0] * b[3] - a[3] * b[0]) / det;
    assert_true(plane[1][0] * ex + plane[1][2] * ez - offset[1] > 1e-3); /* the third cuts that edge off */
    assert_true(fabs(phi_at(&rig, x, 0.0, z) - hypot(x - ex, z - ez)) < 1e-7);
    crt_close(&rig);
}

/* ---- labels ------------------------------------------------------------------------------------------------------ */

static void same_with_other_labels(const crt_solid *solid, cr_pose pose, uint32_t label, uint32_t pairs) {
    cr_output known, other;
    crt_rig rig;
    open_cube(&rig, solid);
    cr_tick(rig.world, &pose, 1e-3f, &known);
    assert_true(known.zone_count == 2u && known.force_world_N.z != 0.0f);
    struct cr_img_pair *pair = crt_section(rig.image, CR_SEC_PAIRS);
    for (uint32_t i = 0; i < rig.scene.pair_count; i++) {
        pair[i].label = label;
    }
    crt_row(rig.image, CR_SEC_PAIRS)->count = pairs < rig.scene.pair_count ? pairs : rig.scene.pair_count;
    crt_seal(rig.image);
    assert_int_equal(cr_scene_open(&rig.scene, rig.image, rig.size_bytes), CR_OK);
    crt_restart(&rig, NULL);
    cr_tick(rig.world, &pose, 1e-3f, &other);
    assert_true(crt_same(&known, &other));
    crt_close(&rig);
}

/* An edge and a groove whose labels say nothing: how the zones lie to each other tells which is which. */
static void zones_with_ambiguous_creases_go_by_where_they_lie(void **state) {
    (void)state;
    const crt_solid edge = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0),
                    room = crt_room(-30e-3, 20e-3, 30e-3, -30e-3, 20e-3);
    const uint32_t both = CR_PAIR_CONVEX | CR_PAIR_CONCAVE, all = 0xffffffffu;
    cr_pose over = crt_pose(HALF_M - 2e-3, 0.0, HALF_M - 2e-3),
            in = crt_pose(20e-3 - HALF_M + 1e-3, 0.0, 20e-3 - HALF_M + 1e-3);
    same_with_other_labels(&edge, over, both, all);
    same_with_other_labels(&edge, over, both, 0u);
    same_with_other_labels(&room, in, both, all);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(image_that_changes_after_it_was_opened_is_a_fault_and_no_force),
        cmocka_unit_test(not_a_number_in_the_image_never_pushes_harder),
        cmocka_unit_test(limits_keep_what_is_no_number),
        cmocka_unit_test(image_that_multiplies_the_work_of_a_tick_is_refused),
        cmocka_unit_test(field_takes_planes_that_hardly_differ_as_one),
        cmocka_unit_test(field_of_one_plane_is_its_height),
        cmocka_unit_test(field_of_planes_without_a_vertex_stays_at_the_edge),
        cmocka_unit_test(zones_with_ambiguous_creases_go_by_where_they_lie),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
