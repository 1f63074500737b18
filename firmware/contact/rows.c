/* rows: which planes bound the way of the lanes of a surface out of a half-space, and how far they are trusted. WAY_OUT.md "Depth". */
#include "contact/way_out.h"

/* Share of a half-space's weight from which on a plane bounds it in full. */
#define SEEN 0.02f
/* Cosine of normal and plane from which on the exit through the plane is trusted; up to CR_WAY_STEEP_MIN it is looked for along the normal. Where planes are
 * all there is they are trusted longer than beside a curved surface, whose exit no plane tells. */
#define STEEP 0.5f
#define STEEP_CURVED 0.95f
#define STEEP_MIN_CURVED 0.7f
/* Share of curved zones in a half-space from which on they count in full. By their share alone (1): 279 mm of jumps instead of 264 on 459 random slow paths;
 * at once (0): 149 instead of 154 of 175 random poses deep inside are cleared. */
#define CURVED 0.25f

/* Is a plane among those that are known at some lanes? */
static int is_known(const cr_way_spots *at, uint32_t facet) {
    uint32_t k = 0u;
    while (k < at->count && at->planes[k].facet != facet) {
        k++;
    }
    return k < at->count;
}

/* How much of a half-space's weight is at a plane: from 1 on it bounds in full. One that is hardly touched yet is hardly left through: it comes from afar, and where
 * no other is steep a march tells the way until it is there. */
static float seen_of(const cr_way_half *half, const cr_way_bound *q) { return q->weight_m3 / (SEEN * half->weight_m3); }

float cr_way_leaves(const cr_way_half *half, const cr_way_bound *q) {
    return v3_dot(q->normal, half->normal) * q->part * lower_f(1.0f, seen_of(half, q));
}

/* The planes that bound a half-space, but for those that are known. One that a lane is above does not bound it, unless the static object surely
 * ends there. */
static void add_bounds(const cr_way_half *half, const cr_way_spots *at, uint32_t lanes, cr_way_rows *e) {
    for (uint32_t b = 0; b < half->bound_count; b++) {
        const cr_way_bound *q = &half->bounds[b];
        const float leaves = cr_way_leaves(half, q);
        if (is_known(at, q->facet) || !(leaves > CR_WAY_LEAVES_MIN)) {
            continue;
        }
        const struct cr_img_cluster *c = at->c;
        float *height = e->height_m[e->count], *steep = e->leaves[e->count];
        CR_ASSERT(e->count < CR_WAY_EXITS_MAX);
        for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
            const float h = height_above(c, i, q->normal, q->offset_m);
            height[i] = h;
            steep[i] = h < 0.0f || q->sure != 0u ? leaves : CR_WAY_NO_PLANE;
        }
        e->facet[e->count] = q->facet;
        e->curved[e->count] = 0;
        e->seen[e->count] = clamp_f(seen_of(half, q) - 1.0f, 0.0f, 1.0f);
        e->normal[e->count++] = q->normal;
    }
}

static void find_own(const cr_way_half *half, const cr_way_spots *at, uint32_t lanes, cr_way_rows *e) {
    e->count = e->own = at->count;
    for (uint32_t k = 0; k < at->count; k++) {
        const cr_way_known *p = &at->planes[k];
        const float leaves = p->curved ? 0.0f : v3_dot(p->normal, half->normal);
        e->normal[k] = p->normal;
        e->curved[k] = p->curved;
        for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
            e->height_m[k][i] = p->height_m[i];
            e->leaves[k][i] = p->curved ? v3_dot(lane_of(at->normal, i), half->normal) : leaves;
        }
    }
}

int cr_way_find_exits(const cr_way_half *half, const cr_way_spots *at, cr_way_rest *r) {
    cr_way_exits *out = &r->exits;
    float steep = 0.0f;
    out->count = 0u;
    for (uint32_t b = 0; b < half->bound_count; b++) {
        if (!is_known(at, half->bounds[b].facet)) {
            return 0;
        }
    }
    for (uint32_t k = 0; k < at->count; k++) {
        r->height_m[k] = at->planes[k].height_m;
        out->normal[k] = at->planes[k].normal;
        out->leaves[k] = v3_dot(at->planes[k].normal, half->normal);
        steep = higher_f(steep, out->leaves[k]);
    }
    out->count = at->count > 1u && half->curved_m3 <= 0.0f && steep >= STEEP ? at->count : 0u;
    return out->count > 0u;
}

void cr_way_find_rows(const cr_way_half *half, const cr_way_spots *at, uint32_t lanes, cr_way_rows *e) {
    find_own(half, at, lanes, e);
    add_bounds(half, at, lanes, e);
}

/* How far the piece of a sample reaches. */
static inline float piece_reach(const struct cr_img_cluster *c, int i) {
    return CR_WAY_REACH * c->ramp[i] + c->reach[i];
}

/* How far beside the rectangle of a row's facet a sample is after a way along the half-space's normal. */
CR_OUT_OF_LINE float beside(const cr_respond_input *in, const cr_way_scratch *scratch, uint32_t row, int i,
                            float way_m) {
    const cr_way_rest *r = &scratch->rest;
    const struct cr_img_cluster *c = r->c;
    const cr_vec3 gone = v3_mad(v3(c->x[i], c->y[i], c->z[i]), r->half->normal, way_m);
    const uint32_t facet = scratch->rows.facet[row];
    CR_ASSERT(facet < in->field->scene->facet_count);
    return cr_way_beside(&in->field->scene->facets[facet], cr_xform_point(in->world_from_tool, gone));
}

uint32_t cr_way_find_ends(const cr_respond_input *in, uint32_t lanes, uint32_t row, cr_way_scratch *scratch) {
    cr_way_rows *e = &scratch->rows;
    uint32_t asked = 0u;
    CR_ASSERT(!(row < e->own));
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        float *height_m = &e->height_m[row][i];
        if (!(*height_m < 0.0f) && e->leaves[row][i] > CR_WAY_NO_PLANE) {
            *height_m -= higher_f(0.0f, beside(in, scratch, row, i, 0.0f) - piece_reach(scratch->rest.c, i));
            asked++;
        }
    }
    return asked;
}

void cr_way_trust(const cr_respond_input *in, uint32_t lanes, uint32_t row, cr_way_scratch *scratch) {
    const cr_way_rest *r = &scratch->rest;
    const cr_way_rows *e = &scratch->rows;
    float *steep = scratch->ways.steep;
    CR_ASSERT(!(row < e->own));
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        const float leaves = e->leaves[row][i];
        if (e->seen[row] * leaves > steep[i]) {
            const float way_m = higher_f(0.0f, -e->height_m[row][i]) / leaves;
            const float past = beside(in, scratch, row, i, way_m) / piece_reach(r->c, i);
            const float trust = e->seen[row] * clamp_f(2.0f - past, 0.0f, 1.0f);
            steep[i] = higher_f(steep[i], trust * leaves);
        }
    }
}

float cr_way_trusted(const cr_way_half *half) { return half->curved_m3 > 0.0f ? STEEP_CURVED : STEEP; }

float cr_way_sure(const cr_way_half *half, float steep) {
    const float curved = lower_f(1.0f, half->curved_m3 / (CURVED * half->weight_m3));
    const float flat = clamp_f((steep - CR_WAY_STEEP_MIN) / (STEEP - CR_WAY_STEEP_MIN), 0.0f, 1.0f);
    const float beside = clamp_f((steep - STEEP_MIN_CURVED) / (STEEP_CURVED - STEEP_MIN_CURVED), 0.0f, 1.0f);
    return flat + curved * (beside - flat);
}
