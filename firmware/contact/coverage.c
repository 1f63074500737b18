/* coverage: which part of each sample's piece of tool surface is inside the static object, and sums over a cluster.
 * DESIGN.md "Point shell and coverage". */
#include "contact/lanes.h"
#include "contact/stages.h"

/* Least share of the full width over which a sample fades in: a face that comes down flat would otherwise switch on at once. With 0.25 the block in
 * the groove was 0.48 mm off as a wall let go, with 0.1 it is 0.004. */
#define WIDTH_MIN 0.1f
/* How steeply a piece beside an edge fades as its distance nears the ramp: with 1 instead of 4 the block in the groove is 0.40 deg
 * off (p99) instead of 0.23. Cut off at the ramp instead, a cube that comes down on an edge of 25 degrees is pushed 0.17 mm farther within a micrometre
 * instead of 0.015: tests/property/test_force_of_way_out.py. */
#define FADE 4.0f

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

float cr_corner_part(const float *height_m, uint32_t count, float ramp_m) {
    float first = -3.4e38f, second = -3.4e38f, third = -3.4e38f;
    for (uint32_t k = 0; k < count; k++) {
        const float h = height_m[k];
        third = higher_f(third, lower_f(second, h));
        second = higher_f(second, lower_f(first, h));
        first = higher_f(first, h);
    }
    return clamp_f(3.0f + CR_CORNER_REACH * third / ramp_m, 0.0f, 1.0f);
}

/* A piece over a crease is cut by several planes at once. Where they meet convexly it is inside as far as it is below all of
 * them, taken as independent; where they meet concavely, as far as it is not in the space round them. */
float cr_cover_by_planes(const cr_planes *p, const struct cr_img_cluster *c, int i, const float *height, float top,
                         float distance) {
    float share = 1.0f;
    const float ramp = c->ramp[i], most = 2.0f * ramp;
    const float corner = p->reach > 1.0f ? cr_corner_part(height, p->count, ramp) : 0.0f;
    const float whole_m = (corner > 0.0f ? CR_CORNER_REACH : 1.0f) * ramp, reach_m = cr_corner_reach(corner) * ramp;
    for (uint32_t k = 0; k < p->count; k++) {
        if (height[k] <= -whole_m) {
            continue; /* all of it is below: the width is at most two ramps */
        }
        const cr_vec3 n = p->normal_tool[k];
        /* piece_width in place: called, it took 2,100 instructions more in wall_cube's worst tick on an M7 */
        float cross = c->wxy[i] * n.x * n.y + c->wyz[i] * n.y * n.z + c->wzx[i] * n.z * n.x;
        float width2 = c->wxx[i] * n.x * n.x + c->wyy[i] * n.y * n.y + c->wzz[i] * n.z * n.z + 2.0f * cross;
        const float at = height[k] / clamp_f(sqrtf(higher_f(width2, 0.0f)), WIDTH_MIN * most, most);
        float its = clamp_f(0.5f - at, 0.0f, 1.0f);
        if (corner > 0.0f) {
            its += corner * (cr_square_below(at, cr_rest_of_square(at)) - its);
        }
        share *= its;
    }
    /* What is hardly a corner ends before the square does; and beside an edge the distance is longer than the heights: fade out late, where it comes near the end. */
    if (corner > 0.0f) {
        if (!(distance < reach_m)) {
            return 0.0f;
        }
        share *= clamp_f(FADE * (reach_m - top) / (reach_m - ramp), 0.0f, 1.0f);
    }
    if (distance > top) {
        share *= clamp_f(FADE * (reach_m - distance) / (reach_m - top), 0.0f, 1.0f);
    }
    return share;
}

/* The same for a lane whose distance was looked up. */
static float cover_looked_up(const cr_planes *p, const struct cr_img_cluster *c, const cr_lookup *at, int i) {
    float height[CR_KIND_FACETS_MAX], top = -3.4e38f;
    for (uint32_t k = 0; k < p->count; k++) {
        height[k] = v3_dot(p->normal_tool[k], v3(c->x[i], c->y[i], c->z[i])) + p->offset_m[k];
        top = higher_f(top, height[k]);
    }
    float share = cr_cover_by_planes(p, c, i, height, top, max_f(top, at->phi_m[i] * p->sign));
    return p->sign < 0.0f ? 1.0f - share : share;
}

uint32_t cr_cover(const cr_scene *s, const xform *pose, uint32_t mode, const struct cr_img_cluster *c,
                  const cr_lookup *at, float *coverage) {
    if (mode == CR_COVERAGE_HARD) {
        for (int i = 0; i < CR_LANES; i++) {
            coverage[i] = at->phi_m[i] <= 0.0f ? 1.0f : 0.0f;
        }
        return 0u;
    }
    cover_by_slope(pose, c, at, coverage);
    cr_planes planes;
    uint32_t count = 0u;
    planes.kind = planes.count = 0u;
    planes.sign = planes.reach = 1.0f;
    for (uint32_t over = at->from_facet & first_lanes(c->count); over != 0u;) {
        int i = take_lane(&over);
        const float away = abs_f(at->phi_m[i]), ramp = c->ramp[i];
        if (!(away < CR_CORNER_REACH * ramp)) {
            continue;
        }
        const float found = cr_reach_of_kind(&s->kinds[at->kind[i]]), reach = mode == CR_COVERAGE_STRIPS ? 1.0f : found;
        count++;
        if (!(away < reach * ramp)) {
            continue;
        }
        if (at->kind[i] != planes.kind) {
            cr_planes_turn(s, pose, at->kind[i], &planes);
            planes.reach = reach;
            count += planes.count;
        }
        count += (reach > 1.0f ? 2u : 1u) * planes.count;
        coverage[i] = cover_looked_up(&planes, c, at, i);
    }
    return count;
}

void cr_sum_cluster(const struct cr_img_cluster *c, const float *w, struct cr_img_sum *sum) {
    float area[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        area[i] = w[i] * c->area[i];
    }
    const float *const by[] = {w, w, w, area, area, area, w}, *const of[] = {c->ax, c->ay, c->az,  c->x,
                                                                             c->y,  c->z,  c->area};
    float *const to[] = {&sum->ax, &sum->ay, &sum->az, &sum->px, &sum->py, &sum->pz, &sum->area};
    for (size_t k = 0; k < sizeof to / sizeof *to; k++) {
        *to[k] = cr_sum_products(by[k], of[k]);
    }
    sum->peak = w[0];
    for (int i = 1; i < CR_LANES; i++) {
        sum->peak = higher_f(sum->peak, w[i]);
    }
}
