/* Proof    a group whose children are taken names groups and clusters that are there, groups only after itself: the traversal ends
 * Entry    check_children of cr_scene_open
 * Bounds   trees of 3 groups with up to 4 children each, into every count of clusters; every content
 * Long     minutes on a busy machine
 * Unwind   6 */
#include "prove.h"

#include "contact/scene.c"

void cr_sum_cluster(const struct cr_img_cluster *c, const float share[CR_LANES], struct cr_img_sum *out) {
    (void)c, (void)share, (void)out;
}

#define GROUPS 3u

/* One group after the other: the solver need not guess which it is. */
static void prove_children(uint32_t index) {
    cr_scene s = {0};
    struct cr_img_group groups[GROUPS]; /* not set: anything */
    s.groups = groups;
    s.group_count = GROUPS;
    s.cluster_count = nondet_u32();
    reached next = {nondet_u32(), nondet_u32()};
    ASSUME(next.group <= s.group_count && next.cluster <= s.cluster_count); /* as the groups before left it */
    const struct cr_img_group *g = &groups[index];
    ASSUME(g->count >= 1u && g->count <= 4u); /* check_group lets up to 16 through */
    if (check_children(&s, index, &next) == CR_OK) {
        PROVE(next.group <= s.group_count && next.cluster <= s.cluster_count);
        for (uint32_t i = 0; i < 4u; i++) {
            PROVE(i >= g->count ||
                  (g->leaf != 0u ? g->child[i] < s.cluster_count : g->child[i] < s.group_count && g->child[i] > index));
        }
    }
}

int cr_in_range(float v, float low, float high) { return v >= low && v <= high; }

int main(void) {
    for (uint32_t index = 0; index < GROUPS; index++) {
        prove_children(index);
    }
    return 0;
}
