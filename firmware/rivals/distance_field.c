/* distance_field: penalty of points against a signed distance field, summed. Barbic, James 2008. */
#include "rivals/rivals.h"

/* Each point has this part of the stiffness, so that ten of them feel the whole: the paper tunes it to the device. */
#define POINT_SHARE 0.1f

static void add_hit(const cr_respond_input *in, const cr_hit *hit, cr_rival_sum *sum) {
    cr_rival_samples s;
    cr_rival_look(in, hit, &s);
    while (s.inside != 0u) {
        int i = take_lane(&s.inside);
        float push = -s.at.phi_m[i] * POINT_SHARE * cr_rival_count(in, &s, i);
        cr_rival_add(sum, v3_scale(cr_rival_inward(in, &s, i), push), cr_rival_place(&s, i));
    }
}

uint32_t cr_rival_distance_field(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room) {
    cr_rival_sum sums[CR_AREAS_MAX];
    cr_rival_clear(sums, areas->count);
    for (uint32_t h = 0; h < in->set->hit_count; h++) {
        add_hit(in, &in->set->hits[h], &sums[in->set->hits[h].area]);
    }
    return cr_rival_answers(sums, areas, out, room);
}
