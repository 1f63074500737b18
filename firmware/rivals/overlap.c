/* overlap: a bed of springs over the contact section, integrated. Hasegawa, Sato 2004.
 *
 * The section is the overlap seen along the contact normal: by the divergence theorem its area is the length of the area-vector
 * sum of the tool surface inside. Springs of stiffness / area stand on it, as long as the overlap is deep: the force is
 * stiffness times volume / section area, and acts at the centre of the volume's columns. */
#include "rivals/rivals.h"

/* Share of closed surface below which the overlap has no section: the tool is wholly inside. */
#define OPEN_MIN 0.01f

static uint32_t answer(const cr_respond_input *in, uint32_t index, const struct cr_img_sum *sum, cr_area *out) {
    cr_vec3 s = xform_rotate(in->world_from_tool, v3(-sum->ax, -sum->ay, -sum->az)), moment = v3(0.0f, 0.0f, 0.0f);
    float section = v3_norm(s), volume = 0.0f, weight = 0.0f, deepest = 0.0f;
    if (!(section > OPEN_MIN * sum->area)) {
        return 0u;
    }
    cr_vec3 n = v3_scale(s, 1.0f / section);
    for (uint32_t h = 0; h < in->set->hit_count; h++) {
        const cr_hit *hit = &in->set->hits[h];
        cr_rival_samples at;
        if (hit->area != index) {
            continue;
        }
        cr_rival_look(in, hit, &at);
        while (at.inside != 0u) {
            int i = take_lane(&at.inside);
            float depth = -at.at.phi_m[i];
            /* Columns under faces turned to the obstacle, less those above faces turned away. */
            float column = at.cluster->area[i] * v3_dot(cr_rival_inward(in, &at, i), n) * depth;
            volume += column;
            weight += max_f(0.0f, column);
            moment = v3_mad(moment, cr_rival_place(&at, i), max_f(0.0f, column));
            deepest = max_f(deepest, depth);
        }
    }
    if (!(volume > 0.0f) || !(weight > 0.0f)) {
        return 0u;
    }
    cr_rival_sum push = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f};
    cr_rival_add(&push, v3_scale(n, min_f(volume / section, deepest)), v3_scale(moment, 1.0f / weight));
    return cr_rival_finish(&push, sum->area, out);
}

uint32_t cr_rival_overlap(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room) {
    uint32_t made = 0u;
    for (uint32_t a = 0; a < areas->count && made < room; a++) {
        made += answer(in, a, &areas->areas[a].sum, &out[made]);
    }
    return made;
}
