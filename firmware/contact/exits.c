/* exits: the longest way to the first exit from anywhere on a piece of tool surface. WAY_OUT.md "Depth".
 *
 * Over planes the way to the first exit is the least of those through each of them: the least of some linear functions. Its greatest value on
 * a piece is at the middle, at the ends of a crease, or where two or three are as long: where a static edge or corner reaches into the piece. */
#include "contact/way_out.h"

/* A crease ends here, in half-widths, but for rounding. */
#define CREASE_END 1.001f
/* Exits that are compared on a piece: the shortest ones. */
#define RIVALS_MAX 4u

/* How long the way is to the first exit from a place u beside the middle of the piece; planes that it does not leave through only bound the inside. Without
 * end where none leads out. */
static float first_exit(const cr_way_exits *e, cr_vec3 u) {
    float least = 3.0e38f;
    for (uint32_t k = 0; k < e->count; k++) {
        const float height = e->height_m[k] + v3_dot(e->normal[k], u);
        if (e->leaves[k] > CR_WAY_LEAVES_MIN || height > 0.0f) {
            least = min_f(least, -height / max_f(e->leaves[k], CR_WAY_LEAVES_MIN));
        }
    }
    return least;
}

/* An exit that may be the first somewhere on the piece: how long at the middle, its gradient, and W times that. */
typedef struct {
    float way_m;
    cr_vec3 gradient, spread;
} rival;

/* The exits that may be first somewhere within reach half-widths of the middle, the shortest ones. None where no way from there is longer than what is known. */
static uint32_t find_rivals(const struct cr_img_cluster *c, int i, const cr_way_exits *e, float reach, float known_m,
                            rival *out) {
    uint32_t count = 0u;
    float most = 3.0e38f;
    for (uint32_t k = 0; k < e->count; k++) {
        /* One that is not left through ends the inside where the piece reaches across it. */
        const float inverse = -1.0f / max_f(e->leaves[k], CR_WAY_LEAVES_MIN);
        rival r = {e->height_m[k] * inverse, v3_scale(e->normal[k], inverse), {0.0f, 0.0f, 0.0f}};
        r.spread = spread_times(c, i, r.gradient);
        const float most_m = r.way_m + 0.5f * reach * sqrtf(max_f(0.0f, v3_dot(r.gradient, r.spread)));
        most = e->leaves[k] > CR_WAY_LEAVES_MIN ? min_f(most, most_m) : most;
        uint32_t at = count < RIVALS_MAX ? count++ : RIVALS_MAX;
        for (; at > 0u && out[at - 1u].way_m > r.way_m; at--) {
            if (at < RIVALS_MAX) {
                out[at] = out[at - 1u];
            }
        }
        if (at < RIVALS_MAX) {
            out[at] = r;
        }
    }
    count = most <= known_m ? 0u : count;
    while (count > 1u &&
           out[count - 1u].way_m -
                   0.5f * reach * sqrtf(max_f(0.0f, v3_dot(out[count - 1u].gradient, out[count - 1u].spread))) >
               most) {
        count--;
    }
    return count;
}

/* Exit at the place u = W y of a piece, 2 sqrt(y W y) is 1 at its border; or, when that lies beyond it, where the way to it crosses the border: it fades
 * out from there on. A bent piece lies behind its plane. Where exits are nearly one their tie may be anywhere, y so long that y W y is rounding: u is
 * no nearer the middle than in half-widths of the widest. */
static float exit_at(const struct cr_img_cluster *c, int i, const cr_way_exits *e, cr_vec3 y, float base_m) {
    const cr_vec3 u = spread_times(c, i, y);
    const float out = sqrtf(higher_f(4.0f * v3_dot(u, y), v3_dot(u, u) / (c->ramp[i] * c->ramp[i])));
    if ((c->crease_mask >> i) & 1u) {
        return out <= CREASE_END ? first_exit(e, u) : base_m;
    }
    if (!(out < CR_WAY_REACH)) { /* nor where it is not a number */
        return base_m;
    }
    const int wide = cr_way_is_wide(c, i);
    const float full = wide ? CR_WAY_END : 1.0f, ends = wide ? CR_WAY_END : CR_WAY_FLAT_END, at = min_f(out, full);
    const float part = clamp_f((CR_WAY_REACH - out) / (CR_WAY_REACH - ends), 0.0f, 1.0f);
    const float way_m = first_exit(e, v3_scale(u, out > full ? full / out : 1.0f)) - c->bow[i] * at * at;
    return base_m + part * (way_m - base_m);
}

/* Nearest place where two exits are as long as each other: its y. */
static int tie_of_two(const rival *a, const rival *b, cr_vec3 *at) {
    const cr_vec3 y = v3_sub(a->gradient, b->gradient), u = v3_sub(a->spread, b->spread);
    const float size = v3_dot(y, u);
    if (!(size > 0.0f)) {
        return 0;
    }
    *at = v3_scale(y, (b->way_m - a->way_m) / size);
    return 1;
}

/* Where three are: the tip of a static corner. */
static int tie_of_three(const rival *a, const rival *b, const rival *c, cr_vec3 *at) {
    const cr_vec3 y = v3_sub(a->gradient, b->gradient), z = v3_sub(a->gradient, c->gradient);
    const cr_vec3 u = v3_sub(a->spread, b->spread), v = v3_sub(a->spread, c->spread);
    const float yu = v3_dot(y, u), yv = v3_dot(y, v), zv = v3_dot(z, v), det = yu * zv - yv * yv;
    if (!(det > 1e-4f * yu * zv)) {
        return 0;
    }
    const float f = b->way_m - a->way_m, g = c->way_m - a->way_m;
    const float s = (f * zv - g * yv) / det, t = (g * yu - f * yv) / det;
    *at = v3_mad(v3_scale(y, s), z, t);
    return 1;
}

/* From the middle of a crease to its end, along the longest column of its W. W times a gradient across it is rounding, and would point anywhere. */
static cr_vec3 end_of_crease(const struct cr_img_cluster *c, int i) {
    const float x = c->wxx[i], y = c->wyy[i], z = c->wzz[i];
    const cr_vec3 column = x >= max_f(y, z) ? v3(x, c->wxy[i], c->wzx[i])
                           : y >= z         ? v3(c->wxy[i], y, c->wyz[i])
                                            : v3(c->wzx[i], c->wyz[i], z);
    return v3_scale(column, c->reach[i] / sqrtf(v3_dot(column, column) + 1e-37f));
}

/* Longest first exit over a piece: at its middle, at the ends of a crease, and where two or three exits are as long. */
float cr_way_longest(const struct cr_img_cluster *c, int i, const cr_way_exits *e, float known_m, uint32_t *places) {
    const int is_crease = (int)((c->crease_mask >> i) & 1u);
    CR_ASSERT(e->count <= CR_WAY_EXITS_MAX);
    rival r[RIVALS_MAX];
    cr_vec3 y = {0.0f, 0.0f, 0.0f};
    const uint32_t count = find_rivals(c, i, e, is_crease ? CREASE_END : CR_WAY_REACH, known_m, r);
    *places = 1u;
    if (count == 0u) {
        return 0.0f;
    }
    const float base = max_f(0.0f, first_exit(e, y));
    float best = base;
    uint32_t looked_at = is_crease ? 3u : 1u;
    if (is_crease) {
        const cr_vec3 end = end_of_crease(c, i);
        best = max_f(best, max_f(first_exit(e, end), first_exit(e, v3_scale(end, -1.0f))));
    }
    for (uint32_t a = 0; a < count; a++) {
        for (uint32_t b = 0; b < a; b++) {
            looked_at += is_crease ? 1u : 1u + b;
            best = tie_of_two(&r[a], &r[b], &y) ? max_f(best, exit_at(c, i, e, y, base)) : best;
            for (uint32_t d = 0; d < b && !is_crease; d++) {
                best = tie_of_three(&r[a], &r[b], &r[d], &y) ? max_f(best, exit_at(c, i, e, y, base)) : best;
            }
        }
    }
    *places = looked_at;
    return best;
}

float cr_way_of_lane(const cr_way_scratch *scratch, int i, float most_m, float known_m, uint32_t *places) {
    const cr_way_rest *r = &scratch->rest;
    const cr_way_rows *e = &scratch->rows;
    cr_way_exits exits;
    exits.count = 0u;
    for (uint32_t k = 0; k < e->count; k++) {
        if (e->leaves[k][i] > CR_WAY_NO_PLANE) {
            exits.normal[exits.count] = e->curved[k] ? lane_of(r->normal, i) : e->normal[k];
            exits.height_m[exits.count] = e->height_m[k][i];
            exits.leaves[exits.count++] = e->leaves[k][i];
        }
    }
    const float way_m = exits.count > 0u ? min_f(most_m, cr_way_longest(r->c, i, &exits, known_m, places)) : most_m;
    const float sure = cr_way_sure(r->half, scratch->ways.steep[i]);
    return sure < 1.0f ? sure * way_m + (1.0f - sure) * min_f(r->gone_m[i], way_m) : way_m;
}
