/* facets: which facets of a cell a sample is over, and how far. WAY_OUT.md "Zones". */
#include "contact/way_out.h"

/* In a cell of many facets a sample counts for those whose planes explain its distance nearly as well as the best does: to its own depth, and no
 * more than this share of a voxel, or what the image's distances are off. */
#define EXPLAINS 0.45f

/* How far it is to the end of what has none, m: beyond all that a scene may be. */
#define ENDLESS_M 1e9f

/* How far a number lies outside of a range. */
static float outside(float v, float low, float high) { return higher_f(0.0f, higher_f(low - v, v - high)); }

/* Where the foot of a point lies in the plane of a facet, along the sides of its rectangle. */
CR_OUT_OF_LINE void place_on(const struct cr_img_facet *f, cr_vec3 p, float at[2]) {
    const cr_vec3 along = v3_from_16(f->along), across = v3_cross(v3_from(f->normal), along);
    at[0] = v3_dot(along, p);
    at[1] = v3_dot(across, p);
}

float cr_way_beside(const struct cr_img_facet *f, cr_vec3 p) {
    float at[2];
    place_on(f, p, at);
    const float x = outside(at[0], f->low_m[0], f->high_m[0]);
    const float y = outside(at[1], f->low_m[1], f->high_m[1]);
    return sqrtf(x * x + y * y);
}

/* Each counts by how much worse than the best it explains the distance.   Input  share: by how much it does not, m. */
static void share_by(float most_m, cr_way_facets *out) {
    float best = 3.4e38f, total = 0.0f;
    for (uint32_t k = 0; k < out->count; k++) {
        best = lower_f(best, out->share[k]);
    }
    for (uint32_t k = 0; k < out->count; k++) {
        out->share[k] = higher_f(0.0f, 1.0f - (out->share[k] - best) / most_m);
        total += out->share[k];
    }
    CR_ASSERT(!(total < 1.0f)); /* the best one counts in full */
    for (uint32_t k = 0; k < out->count; k++) {
        out->share[k] /= total;
    }
}

/* In a cell of many facets: those whose plane lies as deep as the distance says, and that are there. Where a foot lies beside its facet, the surface is farther off
 * the plane the more it is turned from what is nearest: by the mean normal of those that explain the distance even so. Which way the distance grows
 * does not matter: that turns at once in the middle of a thin wall, and from sample to sample of the image beside it. */
static void weigh_facets(const cr_scene *s, float phi_m, cr_vec3 p, cr_way_facets *out) {
    const float least_m = higher_f(s->meta->error_in_m, 1e-9f); /* a divisor */
    const float most_m = clamp_f(abs_f(phi_m), least_m, higher_f(least_m, EXPLAINS * s->meta->voxel_m));
    float off_m[CR_KIND_FACETS_MAX], beside_m[CR_KIND_FACETS_MAX];
    cr_vec3 mean = {0.0f, 0.0f, 0.0f};
    for (uint32_t k = 0; k < out->count; k++) {
        const struct cr_img_facet *facet = &s->facets[out->facet[k]];
        out->normal[k] = v3_from(facet->normal);
        off_m[k] = abs_f(v3_dot(out->normal[k], p) - facet->offset_m - phi_m);
        beside_m[k] = cr_way_beside(facet, p);
        out->share[k] = higher_f(off_m[k], beside_m[k]);
    }
    share_by(most_m, out);
    for (uint32_t k = 0; k < out->count; k++) {
        mean = v3_mad(mean, out->normal[k], out->share[k]);
    }
    for (uint32_t k = 0; k < out->count; k++) {
        const float turned = lower_f(1.0f, v3_norm(v3_sub(mean, out->normal[k])));
        out->share[k] = higher_f(off_m[k], beside_m[k] * turned);
    }
    share_by(most_m, out);
}

float cr_way_margin(const struct cr_img_facet *f, cr_vec3 p) {
    const uint32_t ends = f->ends;
    float at[2], margin_m = ENDLESS_M;
    if (ends == 0u) {
        return margin_m;
    }
    place_on(f, p, at);
    margin_m = (ends & 1u) != 0u ? lower_f(margin_m, at[0] - f->low_m[0]) : margin_m;
    margin_m = (ends & 2u) != 0u ? lower_f(margin_m, f->high_m[0] - at[0]) : margin_m;
    margin_m = (ends & 4u) != 0u ? lower_f(margin_m, at[1] - f->low_m[1]) : margin_m;
    margin_m = (ends & 8u) != 0u ? lower_f(margin_m, f->high_m[1] - at[1]) : margin_m;
    return margin_m;
}

void cr_way_facets_of(const cr_field *f, const cr_lookup *at, int lane, cr_vec3 p, cr_way_facets *out) {
    const cr_scene *s = f->scene;
    out->count = 0u;
    if ((at->entry[lane] & CR_TOP_FAR) != 0u) {
        return;
    }
    const struct cr_img_kind *kind = &s->kinds[cr_field_kind(f, at, lane)];
    for (; out->count < kind->count; out->count++) {
        out->facet[out->count] = kind->facet[out->count];
    }
    if (kind->count > 1u) {
        weigh_facets(s, at->phi_m[lane], p, out);
        return;
    }
    out->normal[0] = v3_unit(v3(at->gx[lane], at->gy[lane], at->gz[lane]), 1e-3f);
    out->share[0] = 1.0f;
}
