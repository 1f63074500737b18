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

/* The eight samples round each lane, and where it lies between them. */
typedef struct {
    float c000[CR_LANES], c100[CR_LANES], c010[CR_LANES], c110[CR_LANES];
    float c001[CR_LANES], c101[CR_LANES], c011[CR_LANES], c111[CR_LANES];
    float fx[CR_LANES], fy[CR_LANES], fz[CR_LANES];
    float cells[CR_LANES]; /* cells along a side of the brick */
} corners;

static inline void load_pair(const int16_t *at, float *low, float *high) {
    int16_t pair[2];
    memcpy(pair, at, sizeof pair); /* one 32-bit load where the target allows it */
    *low = (float)pair[0];
    *high = (float)pair[1];
}

static void load_corners(const cr_field *f, const places *at, uint32_t *brick_of, corners *c) {
    const cr_scene *s = f->scene;
    int32_t base[CR_LANES], side[CR_LANES], index[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        /* A far lane reads the first samples of the image and is overwritten below. */
        uint32_t entry = s->top[at->top[i]];
        uint32_t far = entry & CR_TOP_FAR;
        const struct cr_img_brick *b = &s->bricks[far ? 0u : entry];
        brick_of[i] = entry;
        base[i] = far ? 0 : (int32_t)b->samples;
        side[i] = far ? 1 : (int32_t)(1u << b->level);
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
        load_pair(q, &c->c000[i], &c->c100[i]);
        load_pair(q + row, &c->c010[i], &c->c110[i]);
        load_pair(q + row * row, &c->c001[i], &c->c101[i]);
        load_pair(q + row * row + row, &c->c011[i], &c->c111[i]);
    }
}

/* Trilinear value and gradient. A cell is flat where its samples are, so planes come out exact. */
static void interpolate(const cr_field *f, const corners *c, cr_lookup *out) {
    const float quantum = f->scene->meta->quantum_m;
    const float slope = quantum * f->inv_brick;
    for (int i = 0; i < CR_LANES; i++) {
        float x = c->fx[i], y = c->fy[i], z = c->fz[i];
        float d00 = c->c100[i] - c->c000[i], d10 = c->c110[i] - c->c010[i];
        float d01 = c->c101[i] - c->c001[i], d11 = c->c111[i] - c->c011[i];
        float a00 = c->c000[i] + d00 * x, a10 = c->c010[i] + d10 * x;
        float a01 = c->c001[i] + d01 * x, a11 = c->c011[i] + d11 * x;
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

/* Signed distance to a convex solid bounded by planes: distance[k] above plane k, negative inside all. Exact inside, on faces
 * and at the edge of the two nearest planes; at a vertex it is the distance to the nearest of its edges' lines. */
static float convex_distance(const cr_vec3 *normal, const float *distance, uint32_t count, uint32_t *nearest,
                             cr_vec3 *grad) {
    uint32_t first = 0u, second = 0u;
    for (uint32_t k = 1; k < count; k++) {
        first = distance[k] > distance[first] ? k : first;
    }
    second = first == 0u ? 1u : 0u;
    for (uint32_t k = 0; k < count; k++) {
        second = k != first && distance[k] > distance[second] ? k : second;
    }
    *nearest = first;
    *grad = normal[first];
    float a = distance[first];
    if (count < 2u || a <= 0.0f) {
        return a;
    }
    /* Outside: the nearest point lies on the edge when the foot on the first plane is above the second. */
    float b = distance[second], c = v3_dot(normal[first], normal[second]);
    float rise = b - c * a, sine2 = 1.0f - c * c;
    if (rise <= 0.0f || sine2 < 1e-6f) {
        return a;
    }
    float d = sqrtf(a * a + rise * rise / sine2);
    /* Gradient: along the foot point, a combination of both normals. */
    cr_vec3 lift = v3_scale(v3_mad(normal[second], normal[first], -c), rise / sine2);
    *grad = v3_unit(v3_mad(lift, normal[first], a), 1e-12f);
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
    float distance[CR_KIND_FACETS_MAX] = {0.0f};
    float sign = kind->kind == CR_KIND_CONCAVE ? -1.0f : 1.0f;
    for (uint32_t k = 0; k < kind->count; k++) {
        const struct cr_img_facet *facet = &f->scene->facets[kind->facet[k]];
        normal[k] = v3_scale(v3_from(facet->normal), sign);
        distance[k] = v3_dot(v3_from(facet->normal), p) * sign - facet->offset_m * sign;
    }
    uint32_t nearest = 0u;
    cr_vec3 grad;
    out->phi_m[lane] = sign * convex_distance(normal, distance, kind->count, &nearest, &grad);
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
