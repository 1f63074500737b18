/* resolve: all half-spaces at once. WAY_OUT.md "All contacts at once". */
#include "contact/way_out.h"

/* Most sweeps over the half-spaces: it ends when none moves by 1e-6 of the deepest. */
#define SWEEPS 64u

/* Each half-space is led out of by what it pushes itself and by what those on its side push along its normal. Those against it do not count: no contact
 * pushes more than its own depth, whatever pushes against it, and however often the surface is cut. */
uint32_t cr_way_resolve(const cr_vec3 *normal, const float *depth_m, uint32_t count, cr_way_along *along,
                        float *lambda_m) {
    uint32_t felt[CR_WAY_ZONES_MAX], felt_count = 0u;
    float deepest = 0.0f;
    for (uint32_t j = 0; j < count; j++) {
        lambda_m[j] = 0.0f;
        deepest = max_f(deepest, depth_m[j]);
        if (!(depth_m[j] <= 0.0f)) { /* not a number is felt: a fault */
            CR_ASSERT(v3_is_unit(normal[j]));
            felt[felt_count++] = j;
        }
    }
    for (uint32_t j = 0; j < felt_count; j++) {
        for (uint32_t i = 0; i < felt_count; i++) {
            along->part[j][i] = i == j ? 0.0f : max_f(0.0f, v3_dot(normal[felt[i]], normal[felt[j]]));
        }
    }
    uint32_t sweep = 0u;
    while (sweep < SWEEPS) {
        float moved = 0.0f;
        sweep++;
        for (uint32_t j = 0; j < felt_count; j++) {
            float led = 0.0f, *own = &lambda_m[felt[j]];
            for (uint32_t i = 0; i < felt_count; i++) {
                led += lambda_m[felt[i]] * along->part[j][i];
            }
            const float next = max_f(0.0f, depth_m[felt[j]] - led);
            CR_ASSERT(!(next > depth_m[felt[j]])); /* no more than its own depth */
            moved = max_f(moved, abs_f(next - *own));
            *own = next;
        }
        if (moved <= 1e-6f * deepest) {
            break;
        }
    }
    return (sweep + 2u) * felt_count * felt_count;
}
