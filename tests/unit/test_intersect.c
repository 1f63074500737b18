/* A surface through itself: passages count once, touching does not count. */
#include "intersect.h"

#include <setjmp.h>
#include <stdarg.h>

#include <cmocka.h>

#define TOLERANCE_M 1e-9

/* A unit triangle in the plane z = 0, and a second one given by its corners. */
static int64_t with_second(double ax, double ay, double az, double bx, double by, double bz, double cx, double cy,
                           double cz) {
    const double vertices[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, ax, ay, az, bx, by, bz, cx, cy, cz};
    const int32_t triangles[] = {0, 1, 2, 3, 4, 5};
    int32_t first[2] = {-1, -1};
    const int64_t count = cr_mesh_self_intersections(vertices, triangles, 2, TOLERANCE_M, first, 1);
    assert_int_equal(first[0] >= 0, count > 0);
    return count;
}

static void intersect_sees_a_passage(void **state) {
    (void)state;
    assert_int_equal(with_second(0.2, 0.2, -1, 0.3, 0.2, 1, 0.2, 0.3, 1), 1);
    assert_int_equal(with_second(0.3, 0.2, 1, 0.2, 0.2, -1, 0.2, 0.3, 1), 1);
}

static void intersect_sees_a_passage_of_the_other_triangles_edge(void **state) {
    (void)state;
    assert_int_equal(with_second(0.5, -1, -1, 0.5, 3, -1, 0.5, 0.2, 3), 1);
}

static void intersect_sees_edge_exactly_through_edge(void **state) {
    (void)state;
    assert_int_equal(with_second(0.5, 0, -1, 0.5, 0, 1, 0.5, -1, 0), 1);
}

static void intersect_leaves_touching_and_apart_alone(void **state) {
    (void)state;
    assert_int_equal(with_second(0.2, 0.2, 0, 0.3, 0.2, 1, 0.2, 0.3, 1), 0);
    assert_int_equal(with_second(0.2, 0.2, 1, 0.3, 0.2, 2, 0.2, 0.3, 2), 0);
    assert_int_equal(with_second(2, 2, -1, 2, 2, 1, 3, 2, 1), 0);
}

static void intersect_leaves_neighbours_alone(void **state) {
    (void)state;
    const double vertices[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    const int32_t tetrahedron[] = {0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3};
    int32_t first[2] = {-1, -1};
    assert_int_equal(cr_mesh_self_intersections(vertices, tetrahedron, 4, TOLERANCE_M, first, 1), 0);
}

static void intersect_sees_triangles_that_share_a_corner(void **state) {
    (void)state;
    const double vertices[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0.6, 0.2, 0.5, 0.2, 0.6, -0.5};
    const int32_t triangles[] = {0, 1, 2, 0, 3, 4};
    int32_t first[2] = {-1, -1};
    assert_int_equal(cr_mesh_self_intersections(vertices, triangles, 2, TOLERANCE_M, first, 1), 1);
}

static void intersect_counts_every_pair_of_many(void **state) {
    (void)state;
    enum { COUNT = 100 };
    double vertices[COUNT * 18];
    int32_t triangles[COUNT * 6];
    for (int i = 0; i < COUNT; i++) {
        const double pair[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0.2, 0.2, -1, 0.3, 0.2, 1, 0.2, 0.3, 1};
        for (int k = 0; k < 18; k++) {
            vertices[18 * i + k] = pair[k] + (k % 3 == 0 ? 3.0 * i : 0.0);
        }
        for (int k = 0; k < 6; k++) {
            triangles[6 * i + k] = 6 * i + k;
        }
    }
    int32_t first[2] = {-1, -1};
    assert_int_equal(cr_mesh_self_intersections(vertices, triangles, 2 * (size_t)COUNT, TOLERANCE_M, first, 1), COUNT);
}

static void intersect_takes_an_empty_mesh(void **state) {
    (void)state;
    const double vertex[] = {0, 0, 0};
    const int32_t none[] = {0};
    int32_t first[2] = {-1, -1};
    assert_int_equal(cr_mesh_self_intersections(vertex, none, 0, TOLERANCE_M, first, 1), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(intersect_sees_a_passage),
        cmocka_unit_test(intersect_sees_a_passage_of_the_other_triangles_edge),
        cmocka_unit_test(intersect_sees_edge_exactly_through_edge),
        cmocka_unit_test(intersect_leaves_touching_and_apart_alone),
        cmocka_unit_test(intersect_leaves_neighbours_alone),
        cmocka_unit_test(intersect_sees_triangles_that_share_a_corner),
        cmocka_unit_test(intersect_counts_every_pair_of_many),
        cmocka_unit_test(intersect_takes_an_empty_mesh),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
