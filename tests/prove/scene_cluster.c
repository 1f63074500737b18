/* Proof    a cluster that is taken has lanes that are there, in one piece at least each, and pieces that are there; a lane stands beside others of
 *          its cluster only
 * Entry    cluster_is_sound of cr_scene_open
 * Bounds   none: every cluster of every content, against every settings; a number may be in its range or not, a root any number, whatever they are
 * Floats   their overflow is not asked for: all integers here are unsigned
 * Unwind   97 */
#include "prove.h"

#include <math.h>

/* Numbers decide nothing that is proved here: whatever is said of them, the integers hold. cr_in_range has no body, so that it says anything. */
static inline float any_root(float value) { return (void)value, nondet_float(); }
#define sqrtf any_root

#include "contact/scene.c"

void cr_sum_cluster(const struct cr_img_cluster *c, const float share[CR_LANES], struct cr_img_sum *out) {
    (void)c, (void)share, (void)out;
}

int main(void) {
    cr_scene s = {0};
    struct cr_img_meta meta; /* not set: anything */
    struct cr_img_cluster cluster, *c = &cluster;
    s.meta = &meta;
    s.clusters = c;
    s.cluster_count = 1u;
    const uint32_t lane = nondet_u32(), piece = nondet_u32();
    ASSUME(lane < CR_LANES && piece < CR_PIECES);
    if (cluster_is_sound(&s, 0u) != 0) {
        const uint32_t lanes = c->count < CR_LANES ? (1u << c->count) - 1u : 0xffffu;
        PROVE(c->count >= 1u && c->count <= CR_LANES);
        PROVE(((c->vertex_mask | c->crease_mask) & ~lanes) == 0u && (c->vertex_mask & c->crease_mask) == 0u);
        PROVE((c->beside[lane] & ~lanes) == 0u && (c->beside[lane] >> lane & 1u) == 0u);
        PROVE(c->piece[piece] == CR_PIECE_NONE || c->piece[piece] < meta.piece_count);
        PROVE((c->piece_lanes[piece] & ~lanes) == 0u && c->piece[0] != CR_PIECE_NONE);
    }
    return 0;
}
