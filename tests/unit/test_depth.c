/* How far a sample has to go: through its planes where they are trusted, else by a march along the normal; and each number that decides, by what it stands for.
 * The planes that the count is told of lie twice as far out as the image's, so that the depth shows which of the two was gone by. */
#include "contact/way_out.h"
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define VOXEL_M 2e-3
#define HALF_M 8e-3
#define FIELD_M 1e-3
#define PLANE_M 2e-3
#define FLOOR 2u /* the upper facet of the block */
#define WALL 1u  /* and that beside it, which all of the block is seen through */
#define WEIGHT_M3 1e-9f

static crt_rig rig;
static cr_contact_set set;
static cr_way_work work;
static cr_way_relations relations;
static cr_way_half half;
static uint32_t floor_cluster; /* of the lower side of the tool, in its middle */

static int open_block(void **state) {
    (void)state;
    const crt_solid block = crt_box(-60e-3, 60e-3, 60e-3, -60e-3, 0.0);
    crt_open_cube(&rig, &block, HALF_M, 1e-3, VOXEL_M);
    for (uint32_t i = 0; i < rig.scene.cluster_count; i++) {
        const struct cr_img_cluster *c = &rig.scene.clusters[i];
        const int below = c->normal[2] < -0.9f && c->crease_mask == 0u && c->vertex_mask == 0u;
        floor_cluster = below && fabsf(c->x[0]) < 2e-3f && fabsf(c->y[0]) < 2e-3f ? i : floor_cluster;
    }
    assert_true(rig.scene.clusters[floor_cluster].normal[2] < -0.9f);
    return 0;
}

static int close_block(void **state) {
    (void)state;
    crt_close(&rig);
    return 0;
}

/* One zone of the floor and its half-space: as deep as its deepest sample, along a normal that leans so that its cosine with the floor's is this. */
static int set_up(void **state) {
    (void)state;
    memset(&set, 0, sizeof set);
    memset(&work, 0, sizeof work);
    memset(&relations, 0, sizeof relations);
    memset(&half, 0, sizeof half);
    set.way.count = 1u;
    set.way.zones[0].key = (cr_way_key){FLOOR, 0u, 0u};
    relations.part[0][0] = relations.lead[0] = 1.0f;
    relations.counts_for[0] = 1u;
    half.weight_m3 = WEIGHT_M3;
    half.deep_m = 10e-3f;
    return 0;
}

static void assert_near(double is, double ought, double room) {
    if (!(fabs(is - ought) <= room)) {
        fail_msg("%g instead of %g", is, ought);
    }
}

static cr_vec3 leaning(double cosine) { return v3((float)sqrt(1.0 - cosine * cosine), 0.0f, (float)cosine); }

/* Depth of the half-space by lanes of that cluster, m: this far inside by the image, and by the plane that is told. */
static double depth_of(double cosine, uint32_t lanes, double field_m, double plane_m) {
    static const float whole[CR_LANES] = {1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f,
                                          1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f};
    static cr_way_spots at;
    const cr_pose pose = crt_pose(0.0, 0.0, HALF_M - field_m);
    const xform from_tool = cr_xform_from_pose(&pose);
    const cr_config config = cr_config_default();
    const cr_respond_input in = {.field = &rig.field, .world_from_tool = &from_tool, .set = &set, .config = &config};
    const cr_way_survey survey = {&in, &set.way, &relations, &half, &work.scratch, &work, UINT32_MAX};
    float height_m[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        height_m[i] = -(float)plane_m;
    }
    memset(&at, 0, sizeof at);
    at.c = &rig.scene.clusters[floor_cluster];
    at.lanes = lanes;
    at.count = 1u;
    at.planes[0] = (cr_way_known){FLOOR, 0, v3(0.0f, 0.0f, 1.0f), height_m};
    half.normal = leaning(cosine);
    half.depth_m = 0.0f;
    work.spent = work.done = work.seen = work.moved = 0u;
    cr_way_count(&survey, &at, FLOOR, 0u, whole);
    return (double)half.depth_m;
}

/* How far the exit through the plane is trusted at a cosine: 1 the plane, 0 the march. */
static double trust_at(double cosine) {
    return depth_of(cosine, 1u, FIELD_M, PLANE_M) * cosine / (PLANE_M - FIELD_M) - FIELD_M / (PLANE_M - FIELD_M);
}

/* From 60 degrees between normal and plane on the exit is looked for along the normal, from 72.5 on by that alone. */
static void planes_are_trusted_up_to_60_degrees(void **state) {
    (void)state;
    assert_near(trust_at(0.29), 0.0, 0.05);
    assert_near(trust_at(0.4), 0.5, 0.15);
    assert_near(trust_at(0.51), 1.0, 1e-3);
}

/* Beside a curved surface, which no plane tells: from 18 degrees, and 45. */
static void planes_beside_curves_are_trusted_up_to_18_degrees(void **state) {
    (void)state;
    half.curved_m3 = half.weight_m3;
    assert_near(trust_at(0.69), 0.0, 0.05);
    assert_near(trust_at(0.825), 0.5, 0.15);
    assert_near(trust_at(0.96), 1.0, 1e-3);
}

/* A half-space is beside a curved surface when a quarter of it is; by an eighth half. */
static void a_quarter_of_curves_counts_in_full(void **state) {
    (void)state;
    half.curved_m3 = 0.0f;
    assert_near(trust_at(0.65), 1.0, 1e-3);
    half.curved_m3 = 0.125f * half.weight_m3;
    assert_near(trust_at(0.65), 0.5, 0.15);
    half.curved_m3 = 0.26f * half.weight_m3;
    assert_near(trust_at(0.65), 0.0, 0.05);
}

/* Each step is as long as the distance and leaves 1 - c of it: ten lead within 3 % of the way where the cosine is 0.3, the steepest that is marched alone. */
static void a_march_comes_near_the_way(void **state) {
    (void)state;
    const double cosine = 0.299;
    assert_near(depth_of(cosine, 1u, FIELD_M, PLANE_M), FIELD_M / cosine, 0.03 * FIELD_M / cosine);
}

/* Along a wall no step comes nearer: after as many lookups as a cluster has samples at most it is given up. */
static void a_march_along_a_wall_is_given_up(void **state) {
    (void)state;
    (void)depth_of(0.0, 1u, FIELD_M, PLANE_M);
    assert_in_range(work.scratch.rest.steps, 8u, CR_LANES);
}

/* From as deep as its piece reaches, at 60 degrees, where each step leaves half: seven lookups lead to within a 40th of the piece. */
static void a_march_ends_near_the_surface(void **state) {
    (void)state;
    const double reach_m = (double)rig.scene.clusters[floor_cluster].ramp[0], cosine = 0.5;
    half.curved_m3 = half.weight_m3;
    const double gone_m = depth_of(cosine, 1u, reach_m, PLANE_M);
    assert_true(reach_m - cosine * gone_m <= reach_m / 40.0);
    assert_in_range(work.scratch.rest.steps, 6u, 7u);
}

/* From the edge of a wedge of 30 degrees the way along its middle is 1 / sin 15 = 3.86 times as long as the deepest sample is deep; nothing that is felt is
 * longer than from one of 23 degrees, and half a sample. */
static void no_way_is_much_longer_than_the_deepest_sample_is_deep(void **state) {
    (void)state;
    const double deep_m = 1e-3, reach_m = (double)rig.scene.clusters[floor_cluster].ramp[0];
    half.deep_m = (float)deep_m;
    const double depth_m = depth_of(0.6, 1u, FIELD_M, 20e-3);
    assert_true(depth_m >= 3.86 * deep_m && depth_m <= 5.0 * deep_m + reach_m);
}

/* A wall that is 1 mm away, where the floor is 10: from a 50th of the weight on it is the exit; with a 100th it seems twice as far. */
static void a_plane_that_is_hardly_touched_comes_from_afar(void **state) {
    (void)state;
    const double cosine = 0.6, sine = 0.8, away_m = 1e-3;
    const float share[2] = {0.021f, 0.01f};
    const struct cr_img_cluster *c = &rig.scene.clusters[floor_cluster];
    half.bound_count = 1u;
    half.bounds[0] = (cr_way_bound){.facet = WALL, .normal = {1.0f, 0.0f, 0.0f}, .part = 1.0f, .sure = 1u};
    half.bounds[0].offset_m = -c->x[0] - (float)away_m;
    for (int i = 0; i < 2; i++) {
        half.bounds[0].weight_m3 = share[i] * half.weight_m3;
        /* The piece reaches on towards the wall: its middle and its end, which half a sample lies between. */
        const double depth_m = depth_of(cosine, 1u, FIELD_M, 10e-3);
        const double least_m = (i == 0 ? 1.0 : 2.0) * away_m / sine;
        assert_near(depth_m, least_m, 0.25 * least_m);
    }
}

/* A wall that is 8 mm away, and a floor that the way hardly leaves; the march, which sees the floor alone, says half of that. Up to a 50th of the weight the march is all that counts;
 * from a 33rd on the wall is. */
static void a_plane_is_not_trusted_before_it_is_there(void **state) {
    (void)state;
    const double cosine = 0.25, sine = sqrt(1.0 - cosine * cosine), away_m = 8e-3;
    const float share[4] = {0.01f, 0.0199f, 0.0283f, 0.041f};
    const double trust[4] = {0.0, 0.0, 0.5, 1.0};
    const struct cr_img_cluster *c = &rig.scene.clusters[floor_cluster];
    half.bound_count = 1u;
    half.bounds[0] = (cr_way_bound){.facet = WALL, .normal = {1.0f, 0.0f, 0.0f}, .part = 1.0f, .sure = 1u};
    half.bounds[0].offset_m = -c->x[0] - (float)away_m;
    for (int i = 0; i < 4; i++) {
        half.bounds[0].weight_m3 = share[i] * half.weight_m3;
        const double march_m = FIELD_M / cosine, wall_m = away_m / sine;
        assert_near(depth_of(cosine, 1u, FIELD_M, 10e-3), march_m + trust[i] * (wall_m - march_m), 0.05 * wall_m);
    }
}

/* The same wall, its facet so far beside where the way meets its plane. As far as the piece reaches it is met; from twice as far on the march is all that
 * counts, and what is hardly left through then decides nothing. */
static void a_plane_is_not_trusted_beside_its_facet(void **state) {
    (void)state;
    const double cosine = 0.25, sine = sqrt(1.0 - cosine * cosine), away_m = 8e-3;
    const double beside[4] = {0.0, 1.0, 2.0 - 0.4 / sine, 2.1}, trust[4] = {1.0, 1.0, 0.5, 0.0};
    const struct cr_img_cluster *c = &rig.scene.clusters[floor_cluster];
    struct cr_img_facet *wall = (struct cr_img_facet *)crt_section(rig.image, CR_SEC_FACETS) + WALL;
    const struct cr_img_facet whole = *wall;
    const double reach_m = (double)(CR_WAY_REACH * c->ramp[0]);
    half.bound_count = 1u;
    half.bounds[0] = (cr_way_bound){.facet = WALL, .normal = {1.0f, 0.0f, 0.0f}, .part = 1.0f, .sure = 1u};
    half.bounds[0].offset_m = -c->x[0] - (float)away_m;
    half.bounds[0].weight_m3 = half.weight_m3;
    for (int axis = 0; axis < 2; axis++) {
        for (int i = 0; i < 4; i++) {
            const float there_m = axis == 0 ? c->y[0] : (float)(-FIELD_M + away_m * cosine / sine);
            wall->along[0] = wall->along[2] = 0;
            wall->along[1] = 32767;
            wall->low_m[axis] = axis == 0 ? there_m + (float)(beside[i] * reach_m) : -1.0f;
            wall->high_m[axis] = axis == 0 ? 1.0f : there_m - (float)(beside[i] * reach_m);
            const double march_m = FIELD_M / cosine, wall_m = away_m / sine;
            const double depth_m = depth_of(cosine, 1u, FIELD_M, 10e-3);
            *wall = whole;
            assert_near(depth_m, march_m + trust[i] * (wall_m - march_m), 0.05 * wall_m);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(planes_are_trusted_up_to_60_degrees, set_up),
        cmocka_unit_test_setup(planes_beside_curves_are_trusted_up_to_18_degrees, set_up),
        cmocka_unit_test_setup(a_quarter_of_curves_counts_in_full, set_up),
        cmocka_unit_test_setup(a_march_comes_near_the_way, set_up),
        cmocka_unit_test_setup(a_march_along_a_wall_is_given_up, set_up),
        cmocka_unit_test_setup(a_march_ends_near_the_surface, set_up),
        cmocka_unit_test_setup(no_way_is_much_longer_than_the_deepest_sample_is_deep, set_up),
        cmocka_unit_test_setup(a_plane_that_is_hardly_touched_comes_from_afar, set_up),
        cmocka_unit_test_setup(a_plane_is_not_trusted_before_it_is_there, set_up),
        cmocka_unit_test_setup(a_plane_is_not_trusted_beside_its_facet, set_up),
    };
    return cmocka_run_group_tests(tests, open_block, close_block);
}
