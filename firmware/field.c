/* field: signed distance of 16 points at a time from the two-level voxmap.
 *
 * Every loop below runs over lanes and holds no branch, so that compilers turn it into vector code; the loads in between are
 * the only scalar part: one top entry, one brick record and four pairs of samples for each lane. */
#include "stages.h"

#include <string.h>

void cr_field_init(cr_field *field, const cr_scene *scene) {
    const struct cr_img_meta *m = scene->meta;
    field->scene = scene;
    field->inv_brick = 1.0f / m->brick_m;
    for (int a = 0; a < 3; a++) {
        field->dims[a] = (int32_t)m->dims[a];
        /* 1 - 2^-22 below the count: truncation gives at most dims - 1 for any dims up to 65536. */
        field->grid_max[a] = (float)m->dims[a] * (1.0f - 1.0f / 4194304.0f);
    }
}

void cr_lanes_to_world(const xform *m, const float *x, const float *y, const float *z, cr_lanes3 *world_m) {
    for (int i = 0; i < CR_LANES; i++) {
        world_m->x[i] = m->r0.x * x[i] + m->r0.y * y[i] + m->r0.z * z[i] + m->t.x;
        world_m->y[i] = m->r1.x * x[i] + m->r1.y * y[i] + m->r1.z * z[i] + m->t.y;
        world_m->z[i] = m->r2.x * x[i] + m->r2.y * y[i] + m->r2.z * z[i] + m->t.z;
    }
}

/* Where the lanes lie in the grid. */
typedef struct {
    float ux[CR_LANES], uy[CR_LANES], uz[CR_LANES]; /* position in its brick, 0..1 */
    float beyond_m[CR_LANES];                       /* distance outside the grid, 0 inside */
    int32_t top[CR_LANES];
} places;

static void find_places(const cr_field *f, const cr_lanes3 *p, places *at) {
    const struct cr_img_meta *m = f->scene->meta;
    const float ox = m->origin_m[0], oy = m->origin_m[1], oz = m->origin_m[2];
    const float inv = f->inv_brick, brick = m->brick_m;
    const float hx = f->grid_max[0], hy = f->grid_max[1], hz = f->grid_max[2];
    const int32_t nx = f->dims[0], ny = f->dims[1];
    for (int i = 0; i < CR_LANES; i++) {
        float gx = (p->x[i] - ox) * inv, gy = (p->y[i] - oy) * inv, gz = (p->z[i] - oz) * inv;
        float cx = clamp_f(gx, 0.0f, hx), cy = clamp_f(gy, 0.0f, hy), cz = clamp_f(gz, 0.0f, hz);
        float ex = gx - cx, ey = gy - cy, ez = gz - cz;
        int32_t ix = (int32_t)cx, iy = (int32_t)cy, iz = (int32_t)cz;
        at->beyond_m[i] = sqrtf(ex * ex + ey * ey + ez * ez) * brick;
        at->ux[i] = cx - (float)ix;
        at->uy[i] = cy - (float)iy;
        at->uz[i] = cz - (float)iz;
        at->top[i] = (iz * ny + iy) * nx + ix;
    }
}

/* The eight samples round each lane, two neighbours along x in one word, and where the lane lies between them. */
typedef struct {
    uint32_t pair00[CR_LANES], pair10[CR_LANES], pair01[CR_LANES], pair11[CR_LANES];
    float fx[CR_LANES], fy[CR_LANES], fz[CR_LANES];
    float cells[CR_LANES]; /* cells along a side of the brick */
} corners;

static inline uint32_t load_pair(const int16_t *at) {
    uint32_t pair;
    memcpy(&pair, at, sizeof pair); /* one load where the target allows it; the low half is the first sample */
    return pair;
}

static inline float first_of(uint32_t pair) { return (float)(int16_t)(uint16_t)(pair & 0xffffu); }
static inline float second_of(uint32_t pair) { return (float)(int16_t)(uint16_t)(pair >> 16); }

static void load_corners(const cr_field *f, const places *at, uint32_t *entry, corners *c) {
    const cr_scene *s = f->scene;
    int32_t base[CR_LANES], side[CR_LANES], index[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        /* A far lane reads the first samples of the image and is overwritten later. */
        entry[i] = s->top[at->top[i]];
        int near = (entry[i] & CR_TOP_FAR) == 0u;
        base[i] = near ? (int32_t)s->bricks[entry[i]].samples : 0;
        side[i] = near ? (int32_t)(1u << s->bricks[entry[i]].level) : 1;
    }
    for (int i = 0; i < CR_LANES; i++) {
        float n = (float)side[i];
        float vx = at->ux[i] * n, vy = at->uy[i] * n, vz = at->uz[i] * n;
        float last = n - 1.0f;
        int32_t kx = (int32_t)min_f(vx, last), ky = (int32_t)min_f(vy, last), kz = (int32_t)min_f(vz, last);
        c->fx[i] = vx - (float)kx;
        c->fy[i] = vy - (float)ky;
        c->fz[i] = vz - (float)kz;
        c->cells[i] = n;
        index[i] = base[i] + (kz * (side[i] + 1) + ky) * (side[i] + 1) + kx;
    }
    for (int i = 0; i < CR_LANES; i++) {
        int32_t row = side[i] + 1;
        const int16_t *q = s->samples + index[i];
        c->pair00[i] = load_pair(q);
        c->pair10[i] = load_pair(q + row);
        c->pair01[i] = load_pair(q + row * row);
        c->pair11[i] = load_pair(q + row * row + row);
    }
}

/* Trilinear value and gradient. A cell is flat where its samples are, so planes come out exact. */
static void interpolate(const cr_field *f, const corners *c, cr_lookup *out) {
    const float quantum = f->scene->meta->quantum_m;
    const float slope = quantum * f->inv_brick;
    for (int i = 0; i < CR_LANES; i++) {
        float x = c->fx[i], y = c->fy[i], z = c->fz[i];
        float c00 = first_of(c->pair00[i]), c10 = first_of(c->pair10[i]);
        float c01 = first_of(c->pair01[i]), c11 = first_of(c->pair11[i]);
        float d00 = second_of(c->pair00[i]) - c00, d10 = second_of(c->pair10[i]) - c10;
        float d01 = second_of(c->pair01[i]) - c01, d11 = second_of(c->pair11[i]) - c11;
        float a00 = c00 + d00 * x, a10 = c10 + d10 * x;
        float a01 = c01 + d01 * x, a11 = c11 + d11 * x;
        float b0 = a00 + (a10 - a00) * y, b1 = a01 + (a11 - a01) * y;
        float s = slope * c->cells[i];
        out->phi_m[i] = (b0 + (b1 - b0) * z) * quantum;
        float dx0 = d00 + (d10 - d00) * y, dx1 = d01 + (d11 - d01) * y;
        float dy0 = a10 - a00, dy1 = a11 - a01;
        out->gx[i] = (dx0 + (dx1 - dx0) * z) * s;
        out->gy[i] = (dy0 + (dy1 - dy0) * z) * s;
        out->gz[i] = (b1 - b0) * s;
    }
}

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

/* Signed distance to a convex solid bounded by planes, height[k] above plane k, negative inside all. Outside, the nearest point
 * lies on the highest plane, or, when that foot is above a second plane, on their edge, or above a third, at their vertex. */
static float convex_distance(const cr_vec3 *normal, const float *height, uint32_t count, uint32_t *nearest,
                             cr_vec3 *grad) {
    uint32_t first = highest(height, count, 0u);
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

static uint32_t kind_of_lane(const cr_scene *s, const struct cr_img_brick *b, float ux, float uy, float uz) {
    if (b->cells == CR_CELLS_NONE) {
        return b->kind;
    }
    const float side = (float)CR_CELLS_SIDE;
    const float last = side - 1.0f;
    uint32_t kx = (uint32_t)min_f(ux * side, last), ky = (uint32_t)min_f(uy * side, last);
    uint32_t kz = (uint32_t)min_f(uz * side, last);
    return s->cells[b->cells + (kz * CR_CELLS_SIDE + ky) * CR_CELLS_SIDE + kx];
}

/* Distances of lanes in crease cells, from the planes that meet there. */
static void use_planes(const cr_field *f, const struct cr_img_kind *kind, cr_vec3 p, int lane, cr_lookup *out) {
    cr_vec3 normal[CR_KIND_FACETS_MAX] = {{0.0f, 0.0f, 0.0f}};
    float height[CR_KIND_FACETS_MAX] = {0.0f};
    float sign = kind->kind == CR_KIND_CONCAVE ? -1.0f : 1.0f;
    for (uint32_t k = 0; k < kind->count; k++) {
        const struct cr_img_facet *facet = &f->scene->facets[kind->facet[k]];
        normal[k] = v3_scale(v3_from(facet->normal), sign);
        height[k] = v3_dot(v3_from(facet->normal), p) * sign - facet->offset_m * sign;
    }
    uint32_t nearest = 0u;
    cr_vec3 grad;
    out->phi_m[lane] = sign * convex_distance(normal, height, kind->count, &nearest, &grad);
    out->facet[lane] = kind->facet[nearest];
    out->gx[lane] = sign * grad.x;
    out->gy[lane] = sign * grad.y;
    out->gz[lane] = sign * grad.z;
}

static void far_lane(const cr_field *f, uint32_t entry, float beyond_m, int lane, cr_lookup *out) {
    float bound = (float)(entry & CR_TOP_BOUND) * f->scene->meta->quantum_m + beyond_m;
    out->phi_m[lane] = (entry & CR_TOP_INSIDE) ? -bound : bound;
    out->gx[lane] = out->gy[lane] = out->gz[lane] = 0.0f;
    out->kind[lane] = 0u;
}

void cr_field_look_up(const cr_field *f, const cr_lanes3 *p, cr_lookup *out) {
    const cr_scene *s = f->scene;
    places at;
    corners c;
    uint32_t entry[CR_LANES];
    find_places(f, p, &at);
    load_corners(f, &at, entry, &c);
    interpolate(f, &c, out);
    for (int i = 0; i < CR_LANES; i++) {
        out->facet[i] = CR_FACET_NONE;
        if (entry[i] & CR_TOP_FAR) {
            far_lane(f, entry[i], at.beyond_m[i], i, out);
            continue;
        }
        uint32_t k = kind_of_lane(s, &s->bricks[entry[i]], at.ux[i], at.uy[i], at.uz[i]);
        out->kind[i] = k;
        if (s->kinds[k].kind == CR_KIND_CONVEX || s->kinds[k].kind == CR_KIND_CONCAVE) {
            use_planes(f, &s->kinds[k], v3(p->x[i], p->y[i], p->z[i]), i, out);
        }
    }
}
