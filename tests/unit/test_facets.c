/* Facets of a cell: how far a point lies beside one, and how far a sample counts for each. Scenes of two planes written by hand. */
#include "contact/way_out.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

enum { FLOOR, WALL };

static struct cr_img_meta meta;
static struct cr_img_brick brick;
static struct cr_img_kind kinds[2];
static struct cr_img_facet facets[2];
static cr_scene scene;
static cr_field field;
static cr_lookup at;

/* A floor z = 0 that goes on everywhere, and a wall x = 0 from z = 0 to 10 mm, y = -20 to 20 mm, in one cell; voxels of 1 mm. */
static int set_up(void **state) {
    (void)state;
    meta = (struct cr_img_meta){.voxel_m = 1e-3f, .error_in_m = 1e-6f};
    brick = (struct cr_img_brick){.cells = CR_CELLS_NONE, .kind = 1u};
    kinds[1] = (struct cr_img_kind){CR_KIND_MIXED, 2u, {FLOOR, WALL}};
    facets[FLOOR] = (struct cr_img_facet){.normal = {0.0f, 0.0f, 1.0f}, .along = {32767, 0, 0}};
    facets[FLOOR].low_m[0] = facets[FLOOR].low_m[1] = -1.0f;
    facets[FLOOR].high_m[0] = facets[FLOOR].high_m[1] = 1.0f;
    facets[WALL] = (struct cr_img_facet){.normal = {1.0f, 0.0f, 0.0f}, .along = {0, 32767, 0}};
    facets[WALL].low_m[0] = -20e-3f;
    facets[WALL].high_m[0] = 20e-3f;
    facets[WALL].high_m[1] = 10e-3f;
    scene = (cr_scene){.meta = &meta, .bricks = &brick, .kinds = kinds, .facets = facets, .facet_count = 2u};
    field = (cr_field){.scene = &scene};
    return 0;
}

static void near(double value, double wanted) {
    if (!(fabs(value - wanted) <= 1e-6)) {
        fail_msg("%.9g instead of %.9g", value, wanted);
    }
}

/* What a sample counts for the wall, at x, z mm where the image says that it is phi mm deep. The rest is the floor's. */
static double wall_share(double x_mm, double z_mm, double phi_mm) {
    cr_way_facets out;
    at.phi_m[3] = (float)(1e-3 * phi_mm);
    cr_way_facets_of(&field, &at, 3, v3((float)(1e-3 * x_mm), 0.0f, (float)(1e-3 * z_mm)), &out);
    assert_int_equal(out.count, 2u);
    near((double)out.share[0] + (double)out.share[1], 1.0);
    return (double)out.share[WALL];
}

static void beside_is_the_way_to_the_rectangle_in_its_plane(void **state) {
    (void)state;
    struct cr_img_facet f = {.normal = {0.0f, 0.0f, 1.0f}, .along = {32767, 0, 0}};
    f.low_m[0] = -1.0f;
    f.low_m[1] = 2.0f;
    f.high_m[0] = 3.0f;
    f.high_m[1] = 5.0f;
    near((double)cr_way_beside(&f, v3(0.0f, 3.0f, 0.0f)), 0.0);
    near((double)cr_way_beside(&f, v3(3.0f, 5.0f, 7.0f)), 0.0); /* above its corner */
    near((double)cr_way_beside(&f, v3(-1.5f, 3.0f, -2.0f)), 0.5);
    near((double)cr_way_beside(&f, v3(3.25f, 2.0f, 0.0f)), 0.25);
    near((double)cr_way_beside(&f, v3(1.0f, 1.0f, 0.0f)), 1.0);
    near((double)cr_way_beside(&f, v3(6.0f, 9.0f, 0.0f)), 5.0); /* 3 and 4 */
    f.along[0] = f.along[1] = 23170; /* turned by 45 degrees: (3, 3) is 3 sqrt 2 along, 0 across */
    assert_true(fabs((double)cr_way_beside(&f, v3(3.0f, 3.0f, 0.0f)) - hypot(3.0 * sqrt(2.0) - 3.0, 2.0)) < 1e-4);
}

static void planes_that_explain_a_distance_alike_share_a_sample(void **state) {
    (void)state;
    near(wall_share(-0.2, 5.0, -0.2), 1.0); /* far above the floor */
    facets[WALL].low_m[1] = -1.0f;          /* goes on below the floor, as planes do */
    near(wall_share(-0.2, -0.2, -0.2), 0.5);
    near(wall_share(-5.0, -0.2, -0.2), 0.0);
}

/* Below the floor the wall does not go on, where its plane does: a sample there is the floor's. */
static void a_facet_does_not_count_where_it_is_not(void **state) {
    (void)state;
    near(wall_share(-0.2, 0.0, -0.2), 1.0); /* at the foot: the floor is 0.2 mm off what the image says */
    near(wall_share(-0.2, -0.2, -0.2), 0.0);
    facets[WALL].low_m[1] = 5e-3f; /* nor where it begins far above */
    near(wall_share(-0.2, -0.2, -0.2), 0.0);
}

/* What is off by less than the sample is deep counts in part, and by no more than 0.45 of a voxel. */
static void as_well_as_the_best_is_within_the_depth(void **state) {
    (void)state;
    facets[WALL].low_m[1] = -1.0f;
    /* Of the floor, 0.05 mm off at a depth of 0.1: half of what the wall counts. */
    near(wall_share(-0.1, -0.05, -0.1), 1.0 / 1.5);
    near(wall_share(-2.0, -1.95, -2.0), 1.0 / (2.0 - 0.05 / 0.45));
    near(wall_share(-2.0, -1.5, -2.0), 1.0);
    /* An image that is sure of its distances to no more than that. */
    meta.error_in_m = 0.2e-3f;
    near(wall_share(-0.1, -0.05, -0.1), 1.0 / 1.75);
}

static void an_image_without_error_divides_by_no_zero(void **state) {
    (void)state;
    meta.error_in_m = 0.0f;
    facets[WALL].low_m[1] = -1.0f;
    near(wall_share(0.0, 0.0, 0.0), 0.5);
    near(wall_share(-1.0, 0.0, 0.0), 0.0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(beside_is_the_way_to_the_rectangle_in_its_plane, set_up),
        cmocka_unit_test_setup(planes_that_explain_a_distance_alike_share_a_sample, set_up),
        cmocka_unit_test_setup(a_facet_does_not_count_where_it_is_not, set_up),
        cmocka_unit_test_setup(as_well_as_the_best_is_within_the_depth, set_up),
        cmocka_unit_test_setup(an_image_without_error_divides_by_no_zero, set_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
