/* Proof    the list of a cluster's neighbours that is taken names clusters and lanes that are there, and is no longer than its bound
 * Entry    check_neighbours of cr_scene_open
 * Bounds   3 clusters, 6 neighbours in all; every content
 * Long     minutes on a busy machine
 * Unwind   8 */
#include "prove.h"

#include "contact/scene.c"

void cr_sum_cluster(const struct cr_img_cluster *c, const float share[CR_LANES], struct cr_img_sum *out) {
    (void)c, (void)share, (void)out;
}

#define CLUSTERS 3u
#define NEIGHBOURS 6u

int cr_in_range(float v, float low, float high) { return v >= low && v <= high; }

int main(void) {
    cr_scene s = {0};
    static struct cr_img_cluster clusters[CLUSTERS];
    uint32_t start[CLUSTERS + 1u]; /* not set: anything */
    struct cr_img_neighbour adj[NEIGHBOURS];
    for (uint32_t i = 0; i < CLUSTERS; i++) {
        clusters[i].count = nondet_u16();
        ASSUME(clusters[i].count >= 1u && clusters[i].count <= CR_LANES); /* cluster_is_sound */
    }
    s.clusters = clusters;
    s.cluster_count = CLUSTERS;
    s.adj_start = start;
    s.adj = adj;
    s.adj_count = NEIGHBOURS;
    for (uint32_t cluster = 0; cluster < CLUSTERS; cluster++) {
        if (check_neighbours(&s, cluster) == CR_OK) {
            PROVE(start[cluster] <= start[cluster + 1u] && start[cluster + 1u] <= NEIGHBOURS);
            for (uint32_t i = 0; i < NEIGHBOURS; i++) {
                const int listed = i >= start[cluster] && i < start[cluster + 1u];
                PROVE(!listed || (adj[i].cluster < CLUSTERS && adj[i].cluster != cluster && adj[i].mine != 0u));
            }
        }
    }
    return 0;
}
