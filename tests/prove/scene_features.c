/* Proof    kinds, facets, pairs and edges that are taken name facets and patches that are there
 * Entry    check_kind, check_facet, check_pair, check_edge of cr_scene_open
 * Bounds   none: every element of tables of every size, every content
 * Floats   their overflow is not asked for: all integers here are unsigned
 * Long     minutes on a busy machine
 * Unwind   8 */
#include "prove.h"

#include "contact/math3.h"

/* Lengths decide whether a facet is taken, not what it names: any number stands for them. */
#define v3_dot(a, b) nondet_float()

#include "contact/scene.c"

void cr_sum_cluster(const struct cr_img_cluster *c, const float share[CR_LANES], struct cr_img_sum *out) {
    (void)c, (void)share, (void)out;
}

int cr_in_range(float v, float low, float high) { return v >= low && v <= high; }

int main(void) {
    cr_scene s = {0};
    struct cr_img_meta meta; /* not set: anything */
    s.meta = &meta;
    s.kind_count = nondet_u32();
    s.facet_count = nondet_u32();
    s.pair_count = nondet_u32();
    s.edge_count = nondet_u32();
    ASSUME(s.kind_count <= 0xffu && s.facet_count <= 0xffu && s.pair_count <= 0xffu &&
           s.edge_count <= 0xffu); /* 4 GiB of each */
    s.kinds = ANY_ARRAY(struct cr_img_kind, s.kind_count);
    s.facets = ANY_ARRAY(struct cr_img_facet, s.facet_count);
    s.pairs = ANY_ARRAY(struct cr_img_pair, s.pair_count);
    s.edges = ANY_ARRAY(struct cr_img_edge, s.edge_count);
    const uint32_t i = nondet_u32(), j = nondet_u32();
    if (i < s.kind_count && check_kind(&s, i) == CR_OK) {
        PROVE(s.kinds[i].kind <= CR_KIND_MIXED && s.kinds[i].count <= CR_KIND_FACETS_MAX);
        PROVE(j >= s.kinds[i].count || s.kinds[i].facet[j] < s.facet_count);
    }
    if (i < s.facet_count && check_facet(&s, i) == CR_OK) {
        PROVE(s.facets[i].patch < s.meta->patch_count);
    }
    if (i < s.pair_count && check_pair(&s, i) == CR_OK) {
        PROVE(s.pairs[i].first < s.pairs[i].second && s.pairs[i].second < s.meta->patch_count);
    }
    if (i < s.edge_count && check_edge(&s, i) == CR_OK) {
        PROVE(s.edges[i].patch[0] < s.meta->patch_count && s.edges[i].patch[1] < s.meta->patch_count);
    }
    return 0;
}
