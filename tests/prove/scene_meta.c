/* Proof    settings of an image that are taken are numbers within their ranges, and the grid of bricks is no larger than its table
 * Entry    check_meta, check_top of cr_scene_open
 * Bounds   every content of the settings; grids of up to 4 bricks, of any shape, into any count of bricks
 * Floats   their overflow is not asked for: all integers here are unsigned
 * Long     minutes on a busy machine
 * Unwind   16 */
#include "prove.h"

#include "contact/scene.c"

void cr_sum_cluster(const struct cr_img_cluster *c, const float share[CR_LANES], struct cr_img_sum *out) {
    (void)c, (void)share, (void)out;
}

int cr_in_range(float v, float low, float high) { return v >= low && v <= high; }

int main(void) {
    cr_scene s = {0};
    struct cr_img_meta meta, *m = &meta; /* not set: anything */
    s.meta = m;
    s.brick_count = nondet_u32();
    const uint32_t tops = nondet_u32();
    ASSUME(tops >= 1u && tops <= 4u);
    s.top = ANY_ARRAY(uint32_t, tops);
    ASSUME(m->dims[0] <= 65536u && m->dims[1] <= 65536u && m->dims[2] <= 65536u);
    ASSUME((uint64_t)m->dims[0] * m->dims[1] * m->dims[2] == tops);
    if (check_meta(m) == CR_OK) {
        PROVE(m->voxel_m >= LENGTH_MIN && m->brick_m > 0.0f && m->quantum_m > 0.0f && m->spacing_m > 0.0f);
        PROVE(m->levels >= 1u && m->levels <= CR_TREE_DEPTH_MAX && m->piece_count <= CR_PIECE_NONE);
        if (check_top(&s) == CR_OK) {
            const uint32_t i = nondet_u32();
            PROVE(i >= tops || (s.top[i] & CR_TOP_FAR) != 0u || s.top[i] < s.brick_count);
        }
    }
    return 0;
}
