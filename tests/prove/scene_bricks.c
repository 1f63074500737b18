/* Proof    a brick that is taken names samples, cells and kinds that are there
 * Entry    check_brick of cr_scene_open
 * Bounds   3 kinds, every count of samples and cells; every brick that is not fine, every content
 * Unwind   2 */
#include "prove.h"

#include "contact/scene.c"

void cr_sum_cluster(const struct cr_img_cluster *c, const float share[CR_LANES], struct cr_img_sum *out) {
    (void)c, (void)share, (void)out;
}

#define KINDS 3u

int cr_in_range(float v, float low, float high) { return v >= low && v <= high; }

int main(void) {
    cr_scene s = {0};
    struct cr_img_kind kinds[KINDS]; /* not set: anything */
    struct cr_img_brick b;
    uint32_t next = nondet_u32();
    s.kinds = kinds;
    s.kind_count = KINDS;
    s.sample_count = nondet_u32();
    s.cell_count = nondet_u32();
    ASSUME(b.fine == 0u); /* the others: scene_fine.c */
    if (check_brick(&s, &b, &next) == CR_OK) {
        const uint64_t side = (uint64_t)b.side + 1u;
        PROVE(b.side >= 1u && b.side <= CR_BRICK_SIDE_MAX);
        PROVE(b.samples + side * side * side <= s.sample_count);
        PROVE(b.kind < s.kind_count && b.planes < s.kind_count);
        PROVE(b.cells == CR_CELLS_NONE || (uint64_t)b.cells + 512u <= s.cell_count);
    }
    return 0;
}
