/* resolve: all half-spaces at once. WAY_OUT.md "All contacts at once". */
#include "contact/way_out.h"

/* Most sweeps over the half-spaces: it ends when none moves by 1e-6 of the deepest. */
#define SWEEPS 64

/* Each half-space is led out of by what it pushes itself and by what those on its side push along its normal. Those against it do not count: no contact
 * pushes more than its own depth, whatever pushes against it, and however often the surface is cut. */
void cr_way_resolve(const cr_vec3 *normal, const float *depth_m, uint32_t count, float *lambda_m) {
    float deepest = 0.0f;
    for (uint32_t j = 0; j < count; j++) {
        lambda_m[j] = 0.0f;
        deepest = max_f(deepest, depth_m[j]);
    }
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        float moved = 0.0f;
        for (uint32_t j = 0; j < count; j++) {
            float led = 0.0f;
            for (uint32_t i = 0; i < count; i++) {
                led += i == j ? 0.0f : lambda_m[i] * max_f(0.0f, v3_dot(normal[i], normal[j]));
            }
            const float next = max_f(0.0f, depth_m[j] - led);
            moved = max_f(moved, abs_f(next - lambda_m[j]));
            lambda_m[j] = next;
        }
        if (moved <= 1e-6f * deepest) {
            break;
        }
    }
}
