/* top: highest point behind several planes, where the overlap of convex solids ends. EXTENT.md "Contact plane and depth". */
#include "rivals/extent.h"

/* Normals that agree to this in every part are one direction; a weight this little below zero is rounding. */
#define SAME_DIRECTION 1e-4f
/* Sine of the angle between two normals, and of the third to their plane, from which on a point common to them is well defined. */
#define APART 2e-3f

static float top_of_three(const cr_plane *a, const cr_plane *b, const cr_plane *c, cr_vec3 n, float best) {
    cr_vec3 bc = v3_cross(b->normal, c->normal), ca = v3_cross(c->normal, a->normal),
            ab = v3_cross(a->normal, b->normal);
    float det = v3_dot(a->normal, bc);
    if (!(abs_f(det) > APART)) {
        return best;
    }
    float x = v3_dot(n, bc) / det, y = v3_dot(n, ca) / det, z = v3_dot(n, ab) / det;
    if (min_f(x, min_f(y, z)) < -SAME_DIRECTION) {
        return best;
    }
    return min_f(best, x * a->offset_m + y * b->offset_m + z * c->offset_m);
}

static float top_of_two(const cr_plane *a, const cr_plane *b, cr_vec3 n, float best) {
    cr_vec3 across = v3_cross(a->normal, b->normal);
    float sine2 = v3_dot(across, across), out = v3_dot(n, across);
    if (!(sine2 > APART * APART) || out * out > SAME_DIRECTION * SAME_DIRECTION * sine2) {
        return best;
    }
    float x = v3_dot(v3_cross(n, b->normal), across) / sine2, y = v3_dot(v3_cross(a->normal, n), across) / sine2;
    return min_f(x, y) < -SAME_DIRECTION ? best : min_f(best, x * a->offset_m + y * b->offset_m);
}

static float top_of_one(const cr_plane *a, cr_vec3 n, float best) {
    cr_vec3 off = v3_sub(n, a->normal);
    return v3_dot(off, off) > SAME_DIRECTION * SAME_DIRECTION ? best : min_f(best, a->offset_m);
}

/* The greatest n . x of points behind all planes is the least offset of the combinations, none negative, of up to three normals that
 * make n (duality of linear programs). */
float cr_top_behind(const cr_plane *planes, uint32_t count, cr_vec3 n, float best) {
    for (uint32_t i = 0; i < count; i++) {
        best = top_of_one(&planes[i], n, best);
        for (uint32_t j = i + 1u; j < count; j++) {
            best = top_of_two(&planes[i], &planes[j], n, best);
            for (uint32_t k = j + 1u; k < count; k++) {
                best = top_of_three(&planes[i], &planes[j], &planes[k], n, best);
            }
        }
    }
    return best;
}
