/* resolve: all half-spaces at once. WAY_OUT.md "All contacts at once". */
#include "contact/way_out.h"

/* Most sweeps over the half-spaces: it ends when none moves by 1e-6 of the deepest. Those that hardly differ are not told apart in full by then: solved in full, a
 * ball on a torus (make bench-curved) amplifies 1.4 to 1.7; with 64 sweeps 0.9, with 32 0.7. The sum is 0.6 % short at most. */
#define SWEEPS 32u
/* What a half-space pushes less than this share of the deepest fades, so that what hardly pushes is no contact. */
#define HARDLY 1e-3f

/* A push of less is none, m: a denormal number takes an x86 processor some 150 cycles. */
#define NOTHING_M 1e-20f

/* Each half-space is led out of by what it pushes itself and by what those on its side push along its normal. Those against it do not count: no contact
 * pushes more than its own depth, whatever pushes against it, and however often the surface is cut.
 *
 * All change at once, by the ratio of its depth to what leads out of it (Sha, Lin, Saul, Lee 2007; to the power of 1.5 it takes half the sweeps). So their
 * order, which turns at once, does not matter, also where it has not converged: two whose normals have the cosine 0.997, as deep, moved one after the other,
 * were off by 2.6 % of their depth, towards the first. */
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
    along->deepest_m = deepest;
    for (uint32_t j = 0; j < along->count; j++) {
        float row = 0.0f;
        for (uint32_t i = 0; i < along->count; i++) {
            const float part = i == j ? 1.0f : max_f(0.0f, v3_dot(normal[along->felt[i]], normal[along->felt[j]]));
            along->part[j][i] = part;
            row += part;
        }
        along->push_m[0][j] = depth_m[along->felt[j]] / row;
    }
}

/* What each pushes in the end. */
static void tell_pushes(const cr_way_along *along, const float *found_m, float *lambda_m) {
    const float hardly_m = HARDLY * along->deepest_m;
    for (uint32_t j = 0; j < along->count; j++) {
        const float push_m = found_m[j];
        lambda_m[along->felt[j]] = push_m < 2.0f * hardly_m ? max_f(0.0f, 2.0f * (push_m - hardly_m)) : push_m;
    }
}

int cr_way_resolve_sweep(const float *depth_m, cr_way_along *along, float *lambda_m) {
    float moved = 0.0f;
    const float *from_m = along->push_m[along->sweeps & 1u];
    float *to_m = along->push_m[~along->sweeps & 1u];
    along->sweeps++;
    for (uint32_t j = 0; j < along->count; j++) {
        float led = 0.0f;
        for (uint32_t i = 0; i < along->count; i++) {
            led += from_m[i] * along->part[j][i];
        }
        const float depth = depth_m[along->felt[j]], ratio = depth / max_f(led, 1e-30f);
        to_m[j] = max_f(0.0f, min_f(depth, from_m[j] * ratio * sqrtf(ratio)) - NOTHING_M);
        CR_ASSERT(!(to_m[j] > depth)); /* no more than its own depth */
        moved = max_f(moved, abs_f(to_m[j] - from_m[j]));
    }
    if (moved > 1e-6f * along->deepest_m && along->sweeps < SWEEPS) {
        return 0;
    }
    tell_pushes(along, to_m, lambda_m);
    return 1;
}
