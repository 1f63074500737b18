/* planes: where the static object is a few planes that meet convexly or concavely, its distances come from them alone: no samples,
 * no lookups, and the planes are turned into the tool frame once for many samples. DESIGN.md "Planes instead of lookups". */
#include "contact/stages.h"

/* Planes with an angle of more than 90 degrees between their normals. Less than this beyond it changes a distance by 1e-8 of it. */
#define SHARP_MIN 1e-4f
/* Bricks an axis that are asked for common planes: 27 cost less than 16 lookups. */
#define BOX_MAX 3

/* Plane of the given ones whose height is largest; planes in `taken` (bits) are left out. */
static uint32_t highest(const float *height, uint32_t count, uint32_t taken) {
    uint32_t best = CR_KIND_FACETS_MAX;
    for (uint32_t k = 0; k < count; k++) {
        if (!((taken >> k) & 1u) && (best == CR_KIND_FACETS_MAX || height[k] > height[best])) {
            best = k;
        }
    }
    return best;
}

/* Vector from the vertex of three planes to a point at heights a, b, c above them: it has just these components. */
static int from_vertex(cr_vec3 n0, cr_vec3 n1, cr_vec3 n2, float a, float b, float c, cr_vec3 *offset) {
    cr_vec3 u = v3_cross(n1, n2), v = v3_cross(n2, n0), w = v3_cross(n0, n1);
    float volume = v3_dot(n0, u);
    if (abs_f(volume) < 1e-3f) {
        return 0;
    }
    *offset = v3_scale(v3_mad(v3_mad(v3_scale(u, a), v, b), w, c), 1.0f / volume);
    return 1;
}

float cr_convex_distance(const cr_vec3 *normal, const float *height, uint32_t count, uint32_t *nearest, cr_vec3 *grad) {
    uint32_t first = highest(height, count, 0u);
    CR_ASSERT(first < count && count <= CR_KIND_FACETS_MAX);
    float a = height[first], foot[CR_KIND_FACETS_MAX];
    *nearest = first;
    *grad = normal[first];
    if (a <= 0.0f) {
        return a;
    }
    for (uint32_t k = 0; k < count; k++) {
        foot[k] = height[k] - a * v3_dot(normal[first], normal[k]);
    }
    uint32_t second = highest(foot, count, 1u << first);
    if (second == CR_KIND_FACETS_MAX || foot[second] <= 0.0f) {
        return a;
    }
    float c = v3_dot(normal[first], normal[second]);
    float sine2 = 1.0f - c * c;
    if (sine2 < 1e-6f) {
        return a;
    }
    cr_vec3 offset =
        v3_mad(v3_scale(normal[first], a), v3_mad(normal[second], normal[first], -c), foot[second] / sine2);
    for (uint32_t k = 0; k < count; k++) {
        foot[k] = height[k] - v3_dot(normal[k], offset);
    }
    uint32_t third = highest(foot, count, (1u << first) | (1u << second));
    if (third != CR_KIND_FACETS_MAX && foot[third] > 0.0f) {
        cr_vec3 corner;
        if (from_vertex(normal[first], normal[second], normal[third], a, height[second], height[third], &corner)) {
            offset = corner;
        }
    }
    float d = v3_norm(offset);
    *grad = d > 0.0f ? v3_scale(offset, 1.0f / d) : normal[first];
    return d;
}

/* Bricks from low to high, on each axis. */
typedef struct {
    int32_t low[3], high[3];
} box;

/* Kind whose planes hold in all bricks of a box: the planes of `first`, one of them, or else its kind. reach: of all that any of them knows. */
static uint32_t planes_of_box(const cr_field *f, const struct cr_img_brick *first, const box *b, float *reach) {
    const cr_scene *s = f->scene;
    uint32_t most = first->planes, least = first->kind;
    uint32_t corner = cr_is_corner(&s->kinds[most]);
    for (int32_t z = b->low[2]; z <= b->high[2]; z++) {
        for (int32_t y = b->low[1]; y <= b->high[1]; y++) {
            const int32_t start = (z * f->dims[1] + y) * f->dims[0];
            const uint32_t *row = &s->top[start];
            for (int32_t x = b->low[0]; x <= b->high[0]; x++) {
                const uint32_t entry = row[x];
                if ((entry & CR_TOP_FAR) != 0u || s->bricks[entry].planes == 0u) {
                    return 0u;
                }
                const uint32_t planes = s->bricks[entry].planes, kind = s->bricks[entry].kind;
                if (planes != most) {
                    most = kind == most ? most : 0u;
                    corner |= cr_is_corner(&s->kinds[planes]);
                }
                least = planes == least || kind == least ? least : 0u;
            }
        }
    }
    *reach = corner != 0u ? CR_CORNER_REACH : 1.0f;
    return most != 0u ? most : least;
}

uint32_t cr_planes_around(const cr_field *f, cr_vec3 p_world, float radius_m, float *reach) {
    const struct cr_img_meta *m = f->scene->meta;
    const float p[3] = {p_world.x, p_world.y, p_world.z}, radius = radius_m * f->inv_brick;
    int32_t middle[3];
    box b;
    for (int a = 0; a < 3; a++) {
        const float at = (p[a] - m->origin_m[a]) * f->inv_brick;
        middle[a] = (int32_t)clamp_f(at, 0.0f, f->grid_max[a]);
        b.low[a] = (int32_t)clamp_f(at - radius, 0.0f, f->grid_max[a]);
        b.high[a] = (int32_t)clamp_f(at + radius, 0.0f, f->grid_max[a]);
        if (b.high[a] - b.low[a] >= BOX_MAX) {
            return 0u;
        }
    }
    const uint32_t entry = f->scene->top[(middle[2] * f->dims[1] + middle[1]) * f->dims[0] + middle[0]];
    return (entry & CR_TOP_FAR) != 0u || f->scene->bricks[entry].planes == 0u
               ? 0u
               : planes_of_box(f, &f->scene->bricks[entry], &b, reach);
}

void cr_planes_turn(const cr_scene *s, const xform *pose, uint32_t kind, cr_planes *out) {
    const struct cr_img_kind *k = &s->kinds[kind];
    /* Of other kinds the planes are not those of one solid. */
    CR_ASSERT(kind < s->kind_count && k->count > 0u && k->kind != CR_KIND_CURVED && k->kind != CR_KIND_MIXED);
    out->kind = kind;
    out->count = k->count;
    out->sign = k->kind == CR_KIND_CONCAVE ? -1.0f : 1.0f;
    out->reach = cr_reach_of_kind(k);
    out->spread = 0.0f;
    out->sharp = 0u;
    for (uint32_t i = 0; i < k->count; i++) {
        const struct cr_img_facet *facet = &s->facets[k->facet[i]];
        const cr_vec3 normal = v3_scale(v3_from(facet->normal), out->sign);
        out->normal_tool[i] = xform_unrotate(pose, normal);
        CR_ASSERT(v3_is_unit(out->normal_tool[i]));
        out->offset_m[i] = v3_dot(normal, pose->t) - facet->offset_m * out->sign;
        out->facet[i] = k->facet[i];
        for (uint32_t j = 0; j < i; j++) {
            out->spread = max_f(out->spread, v3_norm(v3_sub(out->normal_tool[i], out->normal_tool[j])));
            out->sharp |= (uint32_t)(v3_dot(out->normal_tool[i], out->normal_tool[j]) < -SHARP_MIN);
        }
    }
}

const cr_planes *cr_planes_alone(const cr_planes *p, cr_vec3 p_tool, float radius_m, float apart_m, cr_planes *one) {
    float first = -3.4e38f, second = first;
    uint32_t best = 0u;
    if (p->count == 1u) {
        return p;
    }
    for (uint32_t k = 0; k < p->count; k++) {
        const float height = v3_dot(p->normal_tool[k], p_tool) + p->offset_m[k];
        second = higher_f(second, lower_f(height, first));
        best = height > first ? k : best;
        first = higher_f(height, first);
    }
    if (!(first - second > p->spread * radius_m + p->reach * p->reach * apart_m)) {
        return p;
    }
    one->kind = p->kind;
    one->count = 1u;
    one->sign = p->sign;
    one->reach = 1.0f;
    one->normal_tool[0] = p->normal_tool[best];
    one->offset_m[0] = p->offset_m[best];
    one->facet[0] = p->facet[best];
    return one;
}

/* Heights above plane k. Lanes that are higher above it than above those before are its own. */
static void measure_plane(const cr_planes *p, const struct cr_img_cluster *c, uint32_t k, cr_heights *out) {
    const cr_vec3 n = p->normal_tool[k];
    const float offset = p->offset_m[k];
    uint32_t higher = 0u;
    for (int i = 0; i < CR_LANES; i++) {
        const float height = height_above(c, i, n, offset), top = out->top_m[i];
        out->height_m[k][i] = height;
        higher |= sign_bit_f(top - height) << i;
        out->top_m[i] = higher_f(height, top);
    }
    for (uint32_t before = 0; before < k; before++) {
        out->highest[before] &= ~higher;
    }
    out->highest[k] = higher;
}

void cr_planes_measure(const cr_planes *p, const struct cr_img_cluster *c, cr_heights *out) {
    const cr_vec3 n = p->normal_tool[0];
    const float offset = p->offset_m[0];
    CR_ASSERT(p->count > 0u && p->count <= CR_KIND_FACETS_MAX);
    for (int i = 0; i < CR_LANES; i++) {
        out->height_m[0][i] = out->top_m[i] = height_above(c, i, n, offset);
    }
    out->highest[0] = 0xffffu;
    for (uint32_t k = 1; k < p->count; k++) {
        measure_plane(p, c, k, out);
    }
    uint32_t under = 0u, below = 0u;
    for (int i = 0; i < CR_LANES; i++) {
        const float top = out->top_m[i], ramp = p->reach * c->ramp[i];
        under |= sign_bit_f(top - ramp) << i;
        below |= sign_bit_f(top + ramp) << i;
    }
    out->below = below;
    out->cut = under & ~below;
}

float cr_planes_distance(const cr_planes *p, const float *height, float top) {
    uint32_t nearest, above = p->sharp;
    cr_vec3 gradient;
    if (top <= 0.0f) {
        return top;
    }
    for (uint32_t k = 0; k < p->count; k++) {
        above += (uint32_t)(height[k] > 0.0f);
    }
    /* The foot on the highest plane lies below all others, unless one is above 0 or leans over it. */
    return above > 1u ? cr_convex_distance(p->normal_tool, height, p->count, &nearest, &gradient) : top;
}
