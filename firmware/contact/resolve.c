/* resolve: all half-spaces at once. WAY_OUT.md "All contacts at once". */
#include "contact/way_out.h"

/* Most sweeps over the half-spaces: it ends when none moves by 1e-6 of the deepest. */
#define SWEEPS 64u

/* Each half-space is led out of by what it pushes itself and by what those on its side push along its normal. Those against it do not count: no contact
 * pushes more than its own depth, whatever pushes against it, and however often the surface is cut. */
void cr_way_resolve_begin(const cr_vec3 *normal, const float *depth_m, uint32_t count, cr_way_along *along,
                          float *lambda_m) {
    float deepest = 0.0f;
    along->count = along->sweeps = 0u;
    for (uint32_t j = 0; j < count; j++) {
        lambda_m[j] = 0.0f;
        deepest = max_f(deepest, depth_m[j]);
        if (!(depth_m[j] <= 0.0f)) { /* not a number is felt: a fault */
            CR_ASSERT(v3_is_unit(normal[j]));
            along->felt[along->count++] = j;
        }
    }
    along->still_m = 1e-6f * deepest;
    for (uint32_t j = 0; j < along->count; j++) {
        for (uint32_t i = 0; i < along->count; i++) {
            along->part[j][i] = i == j ? 0.0f : max_f(0.0f, v3_dot(normal[along->felt[i]], normal[along->felt[j]]));
        }
    }
}

int cr_way_resolve_sweep(const float *depth_m, cr_way_along *along, float *lambda_m) {
    float moved = 0.0f;
    along->sweeps++;
    for (uint32_t j = 0; j < along->count; j++) {
        const uint32_t mine = along->felt[j];
        float led = 0.0f;
        for (uint32_t i = 0; i < along->count; i++) {
            led += lambda_m[along->felt[i]] * along->part[j][i];
        }
        const float next = max_f(0.0f, depth_m[mine] - led);
        CR_ASSERT(!(next > depth_m[mine])); /* no more than its own depth */
        moved = max_f(moved, abs_f(next - lambda_m[mine]));
        lambda_m[mine] = next;
    }
    return moved <= along->still_m || along->sweeps == SWEEPS;
}
