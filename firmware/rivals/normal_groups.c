/* normal_groups: distance-field penalty whose stiffness is shared among the points that push the same way. Xu, Barbic 2017.
 *
 * The sphere of directions (the Gauss map of the contact) is covered by 26 overlapping caps about the directions of a cube's faces, edges
 * and corners. A point belongs to the caps that its normal lies in, the more the nearer their middle. How many points share its
 * direction is the mean of the caps' counts, weighed by how much it belongs to them. */
#include "rivals/rivals.h"

#define CAPS 26
/* Cosine of a cap's half angle, 55 degrees: every direction is in several caps, and opposite walls share none. */
#define CAP_COS 0.5736f

/* Middle of a cap: components -1, 0, 1, not all 0. */
static cr_vec3 cap_middle(int cap) {
    int code = cap < CAPS / 2 ? cap : cap + 1;
    int x = code % 3 - 1, y = code / 3 % 3 - 1, z = code / 9 - 1;
    return v3_unit(v3((float)x, (float)y, (float)z), 0.0f);
}

static float belonging(const cr_vec3 *middle, cr_vec3 n) {
    float over = max_f(0.0f, v3_dot(*middle, n) - CAP_COS) * (1.0f / (1.0f - CAP_COS));
    return over * over;
}

static void count_hit(const cr_respond_input *in, const cr_hit *hit, const cr_vec3 *middle, float *points) {
    cr_rival_samples s;
    cr_rival_look(in, hit, &s);
    while (s.inside != 0u) {
        int i = take_lane(&s.inside);
        cr_vec3 n = cr_rival_inward(in, &s, i);
        float count = cr_rival_count(in, &s, i), part[CAPS], total = 0.0f;
        for (int cap = 0; cap < CAPS; cap++) {
            part[cap] = belonging(&middle[cap], n);
            total += part[cap];
        }
        for (int cap = 0; cap < CAPS && total > 0.0f; cap++) {
            points[cap] += count * part[cap] / total;
        }
    }
}

/* How many points push the way n does: the caps' counts, scaled so that points of one direction count themselves once. */
static float sharers(const cr_vec3 *middle, const float *points, cr_vec3 n) {
    float mine = 0.0f, total = 0.0f, squares = 0.0f;
    for (int cap = 0; cap < CAPS; cap++) {
        float part = belonging(&middle[cap], n);
        mine += part * points[cap];
        total += part;
        squares += part * part;
    }
    return squares > 0.0f ? mine * total / squares : 0.0f;
}

static void add_hit(const cr_respond_input *in, const cr_hit *hit, const cr_vec3 *middle, const float *points,
                    cr_rival_sum *sum) {
    cr_rival_samples s;
    cr_rival_look(in, hit, &s);
    while (s.inside != 0u) {
        int i = take_lane(&s.inside);
        cr_vec3 n = cr_rival_inward(in, &s, i);
        float count = cr_rival_count(in, &s, i), share = count / max_f(sharers(middle, points, n), 1e-9f);
        cr_rival_add(sum, v3_scale(n, -s.at.phi_m[i] * min_f(1.0f, share)), cr_rival_place(&s, i));
    }
}

uint32_t cr_rival_normal_groups(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room) {
    cr_rival_sum sums[CR_AREAS_MAX];
    cr_vec3 middle[CAPS];
    float points[CAPS] = {0.0f};
    for (int cap = 0; cap < CAPS; cap++) {
        middle[cap] = cap_middle(cap);
    }
    cr_rival_clear(sums, areas->count);
    for (uint32_t h = 0; h < in->set->hit_count; h++) {
        count_hit(in, &in->set->hits[h], middle, points);
    }
    for (uint32_t h = 0; h < in->set->hit_count; h++) {
        add_hit(in, &in->set->hits[h], middle, points, &sums[in->set->hits[h].area]);
    }
    return cr_rival_answers(sums, areas, out, room);
}
