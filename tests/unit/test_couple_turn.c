/* Rotation vectors of the coupling against the same in double with libm. */
#include "couple/couple_parts.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

static void assert_near(float a, double b, double within) {
    if (!(fabs((double)a - b) <= within)) {
        fail_msg("%.9g is not %.9g within %.3g", (double)a, b, within);
    }
}

static void turns_are_exact_for_every_angle(void **state) {
    (void)state;
    for (int i = 0; i <= 314; i++) {
        const double angle = 0.01 * i, axis[3] = {0.36, -0.48, 0.8};
        const cr_quat from = {0.5f, 0.5f, -0.5f, 0.5f};
        const cr_vec3 turn = v3((float)(angle * axis[0]), (float)(angle * axis[1]), (float)(angle * axis[2]));
        const cr_quat to = cr_couple_turned(from, turn);
        const double c = cos(angle / 2), s = sin(angle / 2), x = s * axis[0], y = s * axis[1], z = s * axis[2];
        assert_near(to.w, 0.5 * (c - x + y - z), 3e-7);
        assert_near(to.x, 0.5 * (c + x + y + z), 3e-7);
        assert_near(to.y, 0.5 * (-c - x + y + z), 3e-7);
        assert_near(to.z, 0.5 * (c - x - y + z), 3e-7);
        const cr_quat same = {-to.w, -to.x, -to.y, -to.z};
        const cr_vec3 back = v3_sub(cr_couple_turn_between(from, i % 2 == 0 ? to : same), turn);
        assert_true(v3_norm(back) <= 2e-6f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(turns_are_exact_for_every_angle),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
