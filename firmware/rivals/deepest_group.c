/* deepest_group: neighbouring contacts answer together, as deep as the deepest. Kim, Otaduy, Lin, Manocha 2003.
 *
 * A group is a contact area: samples inside that are next to each other on the tool. */
#include "rivals/rivals.h"

typedef struct {
    cr_vec3 normal_sum_m; /* depth times surface normal */
    cr_vec3 deepest_m;
    float depth_m;
} group;

static void add_hit(const cr_respond_input *in, const cr_hit *hit, group *g) {
    cr_rival_samples s;
    cr_rival_look(in, hit, &s);
    while (s.inside != 0u) {
        int i = take_lane(&s.inside);
        float depth = -s.at.phi_m[i];
        cr_vec3 gradient = v3(s.at.gx[i], s.at.gy[i], s.at.gz[i]);
        g->normal_sum_m = v3_mad(g->normal_sum_m, gradient, depth * cr_rival_count(in, &s, i));
        if (depth > g->depth_m) {
            g->depth_m = depth;
            g->deepest_m = cr_rival_place(&s, i);
        }
    }
}

uint32_t cr_rival_deepest_group(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room) {
    static const group empty = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f};
    group groups[CR_AREAS_MAX];
    uint32_t made = 0u;
    for (uint32_t a = 0; a < areas->count; a++) {
        groups[a] = empty;
    }
    for (uint32_t h = 0; h < in->set->hit_count; h++) {
        add_hit(in, &in->set->hits[h], &groups[in->set->hits[h].area]);
    }
    for (uint32_t a = 0; a < areas->count && made < room; a++) {
        cr_rival_sum sum = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f};
        cr_rival_add(&sum, v3_scale(v3_unit(groups[a].normal_sum_m, 1e-12f), groups[a].depth_m), groups[a].deepest_m);
        made += cr_rival_finish(&sum, areas->areas[a].sum.area, &out[made]);
    }
    return made;
}
