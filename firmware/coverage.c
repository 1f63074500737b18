/* coverage: which part of each sample's piece of tool surface is inside the static object, and sums over a cluster.
 * DESIGN.md "Point shell and coverage". */
#include "stages.h"

#if CR_SCALAR
/* Sum of w v in the same order of addition as with vectors, in one expression, so that all of it stays in registers. */
static inline float sum_products(const float *w, const float *v) {
    float a = (w[0] * v[0] + w[8] * v[8]) + (w[4] * v[4] + w[12] * v[12]);
    float b = (w[2] * v[2] + w[10] * v[10]) + (w[6] * v[6] + w[14] * v[14]);
    float c = (w[1] * v[1] + w[9] * v[9]) + (w[5] * v[5] + w[13] * v[13]);
    float d = (w[3] * v[3] + w[11] * v[11]) + (w[7] * v[7] + w[15] * v[15]);
    return (a + b) + (c + d);
}
#else
/* Fixed order of addition: lane i with lane i + 8, then 4, 2, 1. */
static inline float sum_products(const float *w, const float *v) {
    float t[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        t[i] = w[i] * v[i];
    }
    for (int width = CR_LANES / 2; width > 0; width /= 2) {
        for (int i = 0; i < width; i++) {
            t[i] += t[i + width];
        }
    }
    return t[0];
}
#endif

/* Least share of the full width over which a sample fades in: a face that comes down flat would otherwise switch on at once. */
#define WIDTH_MIN 0.25f

/* The part of each sample's own piece of surface that the plane of the static surface cuts off. Across the piece the distance varies by a width b = sqrt(g^T W g), W twelve times the second
 * moment of the piece; it is inside to the share 1/2 - phi / b. */
static void cover_by_slope(const xform *pose, const struct cr_img_cluster *c, const cr_lookup *at, float *coverage) {
    const xform m = *pose;
    for (int i = 0; i < CR_LANES; i++) {
        if (CR_SCALAR && !(abs_f(at->phi_m[i]) < c->ramp[i])) {
            coverage[i] = at->phi_m[i] > 0.0f ? 0.0f : 1.0f; /* as the formula has it: the width is at most two ramps */
            continue;
        }
        float gx = m.r0.x * at->gx[i] + m.r1.x * at->gy[i] + m.r2.x * at->gz[i];
        float gy = m.r0.y * at->gx[i] + m.r1.y * at->gy[i] + m.r2.y * at->gz[i];
        float gz = m.r0.z * at->gx[i] + m.r1.z * at->gy[i] + m.r2.z * at->gz[i];
        float cross = c->wxy[i] * gx * gy + c->wyz[i] * gy * gz + c->wzx[i] * gz * gx;
        float width2 = c->wxx[i] * gx * gx + c->wyy[i] * gy * gy + c->wzz[i] * gz * gz + 2.0f * cross;
        float most = 2.0f * c->ramp[i], least = WIDTH_MIN * most;
        float width = sqrtf(clamp_f(width2, least * least, most * most));
        coverage[i] = clamp_f(0.5f - at->phi_m[i] / width, 0.0f, 1.0f);
    }
}

/* Share of a piece of width b that lies below a plane at height h. */
static float share_below(float h, float width, float most) {
    float least = WIDTH_MIN * most;
    return clamp_f(0.5f - h / clamp_f(width, least, most), 0.0f, 1.0f);
}

/* A piece over a crease is cut by several planes at once. Where they meet convexly it is inside as far as it is below all of
 * them, taken as independent; where they meet concavely, as far as it is not above all. */
static float cover_by_planes(const cr_scene *s, const xform *pose, const struct cr_img_cluster *c, const cr_lookup *at,
                             int i, cr_vec3 p_world) {
    const struct cr_img_kind *kind = &s->kinds[at->kind[i]];
    int concave = kind->kind == CR_KIND_CONCAVE;
    float share = 1.0f;
    for (uint32_t k = 0; k < kind->count; k++) {
        const struct cr_img_facet *facet = &s->facets[kind->facet[k]];
        cr_vec3 n = xform_unrotate(pose, v3_from(facet->normal));
        float cross = c->wxy[i] * n.x * n.y + c->wyz[i] * n.y * n.z + c->wzx[i] * n.z * n.x;
        float width2 = c->wxx[i] * n.x * n.x + c->wyy[i] * n.y * n.y + c->wzz[i] * n.z * n.z + 2.0f * cross;
        float h = v3_dot(v3_from(facet->normal), p_world) - facet->offset_m;
        float below = share_below(h, sqrtf(max_f(0.0f, width2)), 2.0f * c->ramp[i]);
        share *= concave ? 1.0f - below : below;
    }
    /* Beside an edge the distance is longer than the heights: fade out where it reaches the ramp. */
    float fade = clamp_f(4.0f * (1.0f - at->phi_m[i] / c->ramp[i]), 0.0f, 1.0f);
    return (concave ? 1.0f - share : share) * fade;
}

void cr_cover(const cr_scene *s, const xform *pose, uint32_t mode, const struct cr_img_cluster *c,
              const cr_lanes3 *world_m, const cr_lookup *at, float *coverage) {
    if (mode == CR_COVERAGE_HARD) {
        for (int i = 0; i < CR_LANES; i++) {
            coverage[i] = at->phi_m[i] <= 0.0f ? 1.0f : 0.0f;
        }
        return;
    }
    cover_by_slope(pose, c, at, coverage);
    for (uint32_t over = at->from_facet & ((1u << c->count) - 1u); over != 0u;) {
        int i = take_lane(&over);
        if (abs_f(at->phi_m[i]) < c->ramp[i]) {
            cr_vec3 p_world = v3(world_m->x[i], world_m->y[i], world_m->z[i]);
            coverage[i] = cover_by_planes(s, pose, c, at, i, p_world);
        }
    }
}

void cr_sum_cluster(const struct cr_img_cluster *c, const float *w, struct cr_img_sum *sum) {
    float area[CR_LANES], one[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        area[i] = w[i] * c->area[i];
        one[i] = 1.0f;
    }
    sum->ax = sum_products(w, c->ax);
    sum->ay = sum_products(w, c->ay);
    sum->az = sum_products(w, c->az);
    sum->px = sum_products(area, c->x);
    sum->py = sum_products(area, c->y);
    sum->pz = sum_products(area, c->z);
    sum->area = sum_products(area, one);
    sum->peak = w[0];
    for (int i = 1; i < CR_LANES; i++) {
        sum->peak = max_f(sum->peak, w[i]);
    }
}
