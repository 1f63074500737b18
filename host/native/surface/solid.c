/* Distances from the planes of a convex solid: face, edge or vertex, as the tick has them (firmware/SPEC.md, "Distance at a point"). */
#include "mesh.h"

#define SINE2_MIN 1e-6  /* two planes nearly in one have no edge */
#define VOLUME_MIN 1e-3 /* nor three nearly across one line a vertex */

static vec normal_of(const crb_planes *s, int32_t k) {
    const double *p = s->plane + 4 * (int64_t)k;
    return mul((vec){p[0], p[1], p[2]}, s->sign);
}

/* Which plane is highest, but for two of them: the first of equals; -1 when there is none. */
static int32_t highest(const double *height, int32_t count, int32_t but, int32_t but_too) {
    int32_t best = -1;
    for (int32_t k = 0; k < count; k++) {
        if (k != but && k != but_too && (best < 0 || height[k] > height[best])) {
            best = k;
        }
    }
    return best;
}

/* From an edge on: the way to the vertex where a third plane lies below the point still, or the way to the edge. */
static vec to_vertex(const crb_planes *s, const double *height, int32_t first, int32_t second, vec offset) {
    double foot[CRB_PLANES_MAX];
    for (int32_t k = 0; k < s->count; k++) {
        foot[k] = height[k] - dot(offset, normal_of(s, k));
    }
    const int32_t third = highest(foot, s->count, first, second);
    if (third < 0 || foot[third] <= 0.0) {
        return offset;
    }
    const vec a = normal_of(s, first), b = normal_of(s, second), c = normal_of(s, third);
    const vec bc = cross(b, c), ca = cross(c, a), ab = cross(a, b);
    const double volume = dot(a, bc);
    if (fabs(volume) < VOLUME_MIN) {
        return offset;
    }
    return mul(add(add(mul(bc, height[first]), mul(ca, height[second])), mul(ab, height[third])), 1.0 / volume);
}

static double distance_to(const crb_planes *s, vec p) {
    double height[CRB_PLANES_MAX], foot[CRB_PLANES_MAX];
    for (int32_t k = 0; k < s->count; k++) {
        height[k] = dot(normal_of(s, k), p) - s->sign * s->plane[4 * (int64_t)k + 3];
    }
    const int32_t first = highest(height, s->count, -1, -1);
    if (first < 0) {
        return HUGE_VAL; /* of no plane */
    }
    const double a = height[first];
    if (a <= 0.0 || s->count < 2) {
        return s->sign * a;
    }
    const vec n = normal_of(s, first);
    for (int32_t k = 0; k < s->count; k++) {
        foot[k] = height[k] - a * dot(n, normal_of(s, k));
    }
    const int32_t second = highest(foot, s->count, first, -1);
    const double cosine = dot(n, normal_of(s, second)), sine2 = 1.0 - cosine * cosine;
    if (foot[second] <= 0.0 || sine2 < SINE2_MIN) {
        return s->sign * a;
    }
    const vec along = sub(normal_of(s, second), mul(n, cosine));
    const vec offset = add(mul(n, a), mul(along, foot[second] / sine2));
    return s->sign * norm(to_vertex(s, height, first, second, offset));
}

void crb_distance_from_planes(const crb_planes *planes, const double *points_m, int64_t n, double *phi_m) {
    for (int64_t i = 0; i < n; i++) {
        phi_m[i] = distance_to(planes, (vec){points_m[3 * i], points_m[3 * i + 1], points_m[3 * i + 2]});
    }
}

void crb_planes_agree(const crb_planes *planes, const crb_probes *probes, const int64_t *rows, int64_t n,
                      uint8_t *agrees) {
    for (int64_t r = 0; r < n; r++) {
        const double *p = probes->points_m + 3 * rows[r] * probes->width,
                     *phi_m = probes->phi_m + rows[r] * probes->width;
        agrees[r] = 1u;
        for (int64_t i = 0; i < probes->width && agrees[r]; i++) {
            const double off_m = fabs(distance_to(planes, (vec){p[3 * i], p[3 * i + 1], p[3 * i + 2]}) - phi_m[i]);
            agrees[r] = off_m <= (fabs(phi_m[i]) < probes->near_m ? probes->off_near_m : probes->off_far_m);
        }
    }
}
