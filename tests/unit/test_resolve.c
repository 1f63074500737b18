/* What resolve makes of half-spaces whose depths are given: each number that decides there, by what it stands for. Firmware's comments have the reasons. */
#include "contact/way_out.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <cmocka.h>

static void assert_near(double is, double ought, double room) {
    if (!(fabs(is - ought) <= room)) {
        fail_msg("%g instead of %g", is, ought);
    }
}

/* How many sweeps it takes. */
static uint32_t resolve(const cr_vec3 *normal, const float *depth_m, uint32_t count, float *push_m) {
    static cr_way_along along;
    cr_way_resolve_begin(normal, depth_m, count, &along, push_m);
    while (!cr_way_resolve_sweep(depth_m, &along, push_m)) {
    }
    return along.sweeps;
}

/* Two contacts whose normals have the cosine c push (d - c e) / (1 - c^2) each, d its own depth and e the other's. */
static void resolve_ends_near_its_fixed_point(void **state) {
    (void)state;
    const float c = 0.8f, depth_m[2] = {1e-3f, 0.9e-3f};
    const cr_vec3 normal[2] = {v3(0.0f, 0.0f, 1.0f), v3(sqrtf(1.0f - c * c), 0.0f, c)};
    float push_m[2];
    (void)resolve(normal, depth_m, 2u, push_m);
    for (int i = 0; i < 2; i++) {
        assert_near((double)push_m[i], (double)(depth_m[i] - c * depth_m[1 - i]) / (1.0 - (double)(c * c)), 8e-6);
    }
}

/* Of two that are 8 degrees apart and as deep but for half a hundredth one pushes half more than the other in the end. Sides of a round surface differ by that
 * from one tick to the next: they are not told apart in full. */
static void contacts_that_hardly_differ_push_alike(void **state) {
    (void)state;
    const float c = 0.99f, depth_m[2] = {1e-3f, 0.995e-3f};
    const cr_vec3 normal[2] = {v3(0.0f, 0.0f, 1.0f), v3(sqrtf(1.0f - c * c), 0.0f, c)};
    float push_m[2];
    (void)resolve(normal, depth_m, 2u, push_m);
    assert_true(push_m[0] > push_m[1] && push_m[0] - push_m[1] < 0.14e-3f);
    assert_near((double)(push_m[0] + push_m[1]), 1e-3, 0.01e-3); /* both are led out of all the same */
}

/* What pushes a thousandth of the deepest and less is no contact; what pushes more than twice that does so in full, and in between it is continuous. */
static void what_hardly_pushes_fades(void **state) {
    (void)state;
    const cr_vec3 normal[2] = {v3(0.0f, 0.0f, 1.0f), v3(1.0f, 0.0f, 0.0f)};
    const float share[3] = {0.9e-3f, 1.5e-3f, 2.1e-3f};
    float felt[3];
    for (int i = 0; i < 3; i++) {
        const float depth_m[2] = {1e-2f, share[i] * 1e-2f};
        float push_m[2];
        (void)resolve(normal, depth_m, 2u, push_m);
        felt[i] = push_m[1] / depth_m[1];
    }
    assert_true(felt[0] == 0.0f && felt[1] > 0.1f && felt[1] < 0.9f);
    assert_near((double)felt[2], 1.0, 1e-6);
}

/* The order of the half-spaces is that in which hits are found, and turns at once: it may not matter, also where the sweeps end before they have converged. */
static void order_of_half_spaces_does_not_matter(void **state) {
    (void)state;
    for (float c = 0.6f; c < 0.99995f; c += 0.25f * (1.0f - c)) {
        const float depth_m[2] = {1e-3f, 0.999e-3f}, turned_m[2] = {0.999e-3f, 1e-3f};
        const cr_vec3 normal[2] = {v3(0.0f, 0.0f, 1.0f), v3(sqrtf(1.0f - c * c), 0.0f, c)};
        const cr_vec3 turned[2] = {normal[1], normal[0]};
        float push_m[2], other_m[2];
        (void)resolve(normal, depth_m, 2u, push_m);
        (void)resolve(turned, turned_m, 2u, other_m);
        assert_near((double)push_m[0], (double)other_m[1], 1e-8);
        assert_near((double)push_m[1], (double)other_m[0], 1e-8);
    }
}

/* And where it hardly converges it ends all the same. */
static void resolve_ends(void **state) {
    (void)state;
    const float c = 0.9999f, depth_m[2] = {1e-3f, 1e-3f};
    const cr_vec3 normal[2] = {v3(0.0f, 0.0f, 1.0f), v3(sqrtf(1.0f - c * c), 0.0f, c)};
    float push_m[2];
    assert_true(resolve(normal, depth_m, 2u, push_m) <= 40u);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(resolve_ends_near_its_fixed_point),
        cmocka_unit_test(contacts_that_hardly_differ_push_alike),
        cmocka_unit_test(what_hardly_pushes_fades),
        cmocka_unit_test(order_of_half_spaces_does_not_matter),
        cmocka_unit_test(resolve_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
