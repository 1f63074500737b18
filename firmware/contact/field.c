/* field: signed distance of 16 points at a time from the two-level voxmap.
 *
 * With vectors (CR_SCALAR 0) every loop over lanes holds no branch, so that compilers turn it into vector code; the loads in between are
 * the only scalar part: one top entry, one brick record and four pairs of samples for each lane. */
#include "contact/stages.h"

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
        const float px = x[i], py = y[i], pz = z[i]; /* read before the writes below, which may lie anywhere */
        world_m->x[i] = m->r0.x * px + m->r0.y * py + m->r0.z * pz + m->t.x;
        world_m->y[i] = m->r1.x * px + m->r1.y * py + m->r1.z * pz + m->t.y;
        world_m->z[i] = m->r2.x * px + m->r2.y * py + m->r2.z * pz + m->t.z;
    }
}

static inline uint32_t load_pair(const int16_t *at) {
    uint32_t pair;
    memcpy(&pair, at, sizeof pair); /* one load where the target allows it; the low half is the first sample */
    return pair;
}

static inline float first_of(uint32_t pair) { return (float)(int16_t)(uint16_t)(pair & 0xffffu); }
static inline float second_of(uint32_t pair) { return (float)(int16_t)(uint16_t)(pair >> 16); }

/* Trilinear value and gradient in a cell, in its own units. A cell is flat where its samples are, so planes come out exact. */
typedef struct {
    float value, x, y, z;
} sloped;

static inline sloped trilinear(uint32_t pair00, uint32_t pair10, uint32_t pair01, uint32_t pair11, float x, float y,
                               float z) {
    float c00 = first_of(pair00), c10 = first_of(pair10);
    float c01 = first_of(pair01), c11 = first_of(pair11);
    float d00 = second_of(pair00) - c00, d10 = second_of(pair10) - c10;
    float d01 = second_of(pair01) - c01, d11 = second_of(pair11) - c11;
    float a00 = c00 + d00 * x, a10 = c10 + d10 * x;
    float a01 = c01 + d01 * x, a11 = c11 + d11 * x;
    float b0 = a00 + (a10 - a00) * y, b1 = a01 + (a11 - a01) * y;
    float dx0 = d00 + (d10 - d00) * y, dx1 = d01 + (d11 - d01) * y;
    float dy0 = a10 - a00, dy1 = a11 - a01;
    sloped r = {b0 + (b1 - b0) * z, dx0 + (dx1 - dx0) * z, dy0 + (dy1 - dy0) * z, b1 - b0};
    return r;
}

/* Where a lane lies among samples: those at its cell's low corner, samples of a row, intervals along the brick; how far it is
 * into the cell. */
typedef struct {
    const int16_t *low;
    int32_t row;
    float cells, x, y, z;
} sample_place;

/* Voxel x, y, z of a fine brick may have samples of its own: then the place is among those. */
static inline void find_fine(const int16_t *brick, int32_t x, int32_t y, int32_t z, sample_place *at) {
    const int32_t entry =
        brick[CR_FINE_TABLE + (uint32_t)((z * (int32_t)CR_CELLS_SIDE + y) * (int32_t)CR_CELLS_SIDE + x)];
    if (entry == 0) {
        return;
    }
    const int32_t side = (entry & (int32_t)CR_FINE_QUARTERS) != 0 ? 4 : 2, row = side + 1;
    const float n = (float)side, last = n - 1.0f;
    const float vx = at->x * n, vy = at->y * n, vz = at->z * n;
    const int32_t kx = (int32_t)lower_f(vx, last), ky = (int32_t)lower_f(vy, last), kz = (int32_t)lower_f(vz, last);
    const int32_t place = (entry & (int32_t)CR_FINE_AT) * (int32_t)CR_FINE_UNIT + (kz * row + ky) * row + kx;
    at->low = brick + place;
    at->row = row;
    at->cells *= n;
    at->x = vx - (float)kx;
    at->y = vy - (float)ky;
    at->z = vz - (float)kz;
}

uint32_t cr_field_kind(const cr_field *f, const cr_lookup *at, int lane) {
    if (at->entry[lane] & CR_TOP_FAR) {
        return 0u;
    }
    const struct cr_img_brick *b = &f->scene->bricks[at->entry[lane]];
    if (b->cells == CR_CELLS_NONE) {
        return b->kind;
    }
    const float side = (float)CR_CELLS_SIDE;
    const float last = side - 1.0f;
    uint32_t kx = (uint32_t)lower_f(at->ux[lane] * side, last), ky = (uint32_t)lower_f(at->uy[lane] * side, last);
    uint32_t kz = (uint32_t)lower_f(at->uz[lane] * side, last);
    return f->scene->cells[b->cells + (kz * CR_CELLS_SIDE + ky) * CR_CELLS_SIDE + kx];
}

/* Distances of lanes in crease cells, from the planes that meet there. */
static void use_planes(const cr_field *f, uint32_t index, cr_vec3 p, int lane, cr_lookup *out) {
    const struct cr_img_kind *kind = &f->scene->kinds[index];
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
    out->parts += CR_PARTS_OF_MEETING * (2u + kind->count);
    out->phi_m[lane] = sign * cr_convex_distance(normal, height, kind->count, &nearest, &grad);
    out->facet[lane] = kind->facet[nearest];
    out->from_facet |= 1u << lane;
    out->bent |= (uint32_t)(v3_dot(grad, normal[nearest]) < 0.99999f) << lane;
    out->gx[lane] = sign * grad.x;
    out->gy[lane] = sign * grad.y;
    out->gz[lane] = sign * grad.z;
}

/* A lane in a brick with crease cells: its distance comes from planes when its cell has them and the surface is near. */
static inline void use_crease(const cr_field *f, const cr_lanes3 *p, int i, cr_lookup *out) {
    const float crease_m = f->scene->meta->crease_m, phi = out->phi_m[i];
    if (phi >= crease_m) {
        return;
    }
    out->parts += CR_PARTS_OF_CELL;
    const uint32_t kind = cr_field_kind(f, out, i), what = f->scene->kinds[kind].kind;
    if (what != CR_KIND_CONVEX && what != CR_KIND_CONCAVE) {
        return;
    }
    out->kind[i] = kind;
    out->on_planes |= 1u << i;
    if (phi > -crease_m) {
        use_planes(f, kind, v3(p->x[i], p->y[i], p->z[i]), i, out);
    }
}

#if CR_SCALAR

/* Far lane: the lower bound of its brick, and how far it lies outside the grid. */
static void use_bound(const cr_field *f, cr_vec3 beyond, uint32_t entry, int i, cr_lookup *out) {
    float beyond_m = v3_norm(beyond) * f->scene->meta->brick_m;
    float bound = (float)(int32_t)(entry & CR_TOP_BOUND) * f->scene->meta->quantum_m + beyond_m;
    out->phi_m[i] = (entry & CR_TOP_INSIDE) ? -bound : bound;
    out->gx[i] = out->gy[i] = out->gz[i] = 0.0f;
}

/* The same arithmetic as below, one lane from end to end, so that it stays in registers and far lanes read no samples. */
void cr_field_look_up_lanes(const cr_field *f, const cr_lanes3 *p, uint32_t lanes, cr_lookup *out) {
    const cr_scene *s = f->scene;
    const struct cr_img_meta *m = s->meta;
    const float inv = f->inv_brick, quantum = m->quantum_m, slope = quantum * inv;
    const float ox = m->origin_m[0], oy = m->origin_m[1], oz = m->origin_m[2];
    const float hx = f->grid_max[0], hy = f->grid_max[1], hz = f->grid_max[2];
    const int32_t nx = f->dims[0], ny = f->dims[1];
    uint32_t parts = 0u;
    out->from_facet = out->on_planes = out->parts = 0u;
    out->bent = 0u;
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        parts += CR_PARTS_OF_POINT;
        float gx = (p->x[i] - ox) * inv, gy = (p->y[i] - oy) * inv, gz = (p->z[i] - oz) * inv;
        float cx = clamp_f(gx, 0.0f, hx), cy = clamp_f(gy, 0.0f, hy), cz = clamp_f(gz, 0.0f, hz);
        int32_t ix = (int32_t)cx, iy = (int32_t)cy, iz = (int32_t)cz;
        const uint32_t entry = s->top[(iz * ny + iy) * nx + ix];
        const float ux = cx - (float)ix, uy = cy - (float)iy, uz = cz - (float)iz;
        out->entry[i] = entry;
        out->ux[i] = ux;
        out->uy[i] = uy;
        out->uz[i] = uz;
        if (entry & CR_TOP_FAR) {
            use_bound(f, v3(gx - cx, gy - cy, gz - cz), entry, i, out);
            continue;
        }
        parts += CR_PARTS_OF_SAMPLES;
        const struct cr_img_brick *b = &s->bricks[entry];
        const int32_t side = (int32_t)b->side, row = side + 1;
        const float n = (float)side, last = n - 1.0f;
        const float vx = ux * n, vy = uy * n, vz = uz * n;
        const int32_t kx = (int32_t)lower_f(vx, last), ky = (int32_t)lower_f(vy, last), kz = (int32_t)lower_f(vz, last);
        const int16_t *first = s->samples + (int32_t)b->samples;
        const int32_t corner = (kz * row + ky) * row + kx;
        sample_place at = {first + corner, row, n, vx - (float)kx, vy - (float)ky, vz - (float)kz};
        if (b->fine) {
            find_fine(first, kx, ky, kz, &at);
        }
        const int32_t layer = at.row * at.row;
        const int16_t *low = at.low, *high = low + layer;
        sloped r = trilinear(load_pair(low), load_pair(low + at.row), load_pair(high), load_pair(high + at.row), at.x,
                             at.y, at.z);
        const float scale = slope * at.cells;
        out->phi_m[i] = r.value * quantum;
        out->gx[i] = r.x * scale;
        out->gy[i] = r.y * scale;
        out->gz[i] = r.z * scale;
        if (b->creased) {
            use_crease(f, p, i, out);
        }
    }
    out->parts += parts;
}

#else

/* Brick of each lane and the lane's place in it; how far it lies outside the grid. */
static void find_places(const cr_field *f, const cr_lanes3 *p, cr_lookup *at, int32_t *top, float *beyond_m) {
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
        beyond_m[i] = sqrtf(ex * ex + ey * ey + ez * ez) * brick;
        at->ux[i] = cx - (float)ix;
        at->uy[i] = cy - (float)iy;
        at->uz[i] = cz - (float)iz;
        top[i] = (iz * ny + iy) * nx + ix;
    }
}

/* The eight samples round each lane, two neighbours along x in one word, and where the lane lies between them. */
typedef struct {
    uint32_t pair00[CR_LANES], pair10[CR_LANES], pair01[CR_LANES], pair11[CR_LANES];
    float fx[CR_LANES], fy[CR_LANES], fz[CR_LANES];
    float cells[CR_LANES]; /* cells along a side of the brick */
} corners;

/* What the loads reveal: lanes that are far, in bricks with crease cells, and in fine bricks. */
typedef struct {
    uint32_t far, creased, fine;
} lane_sets;

/* The cell of each lane in its brick: the sample at its low corner, and samples of a row. */
typedef struct {
    int32_t base[CR_LANES], side[CR_LANES], index[CR_LANES], rows[CR_LANES];
} places;

/* Lanes of fine bricks whose voxel has samples of its own. */
static void find_fine_lanes(const int16_t *samples, const cr_lookup *at, uint32_t lanes, places *p, corners *c) {
    const float side = (float)CR_CELLS_SIDE, last = side - 1.0f;
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        const int16_t *brick = samples + p->base[i];
        sample_place place = {samples + p->index[i], p->rows[i], c->cells[i], c->fx[i], c->fy[i], c->fz[i]};
        find_fine(brick, (int32_t)lower_f(at->ux[i] * side, last), (int32_t)lower_f(at->uy[i] * side, last),
                  (int32_t)lower_f(at->uz[i] * side, last), &place);
        p->index[i] = (int32_t)(place.low - samples);
        p->rows[i] = place.row;
        c->cells[i] = place.cells;
        c->fx[i] = place.x;
        c->fy[i] = place.y;
        c->fz[i] = place.z;
    }
}

static lane_sets load_corners(const cr_field *f, const int32_t *top, uint32_t lanes, cr_lookup *at, corners *c) {
    const cr_scene *s = f->scene;
    places p;
    lane_sets sets = {0u, 0u, 0u};
    for (int i = 0; i < CR_LANES; i++) {
        /* A far lane reads the first brick and is overwritten later: no branch, since far and near lanes mix at random. */
        uint32_t entry = s->top[top[i]], far = entry >> 31;
        const struct cr_img_brick *b = &s->bricks[far ? 0u : entry];
        at->entry[i] = entry;
        p.base[i] = (int32_t)b->samples;
        p.side[i] = (int32_t)b->side;
        sets.far |= far << i;
        sets.creased |= ((uint32_t)b->creased & ~far) << i;
        sets.fine |= ((uint32_t)b->fine & ~far) << i;
    }
    for (int i = 0; i < CR_LANES; i++) {
        float n = (float)p.side[i];
        float vx = at->ux[i] * n, vy = at->uy[i] * n, vz = at->uz[i] * n;
        float last = n - 1.0f;
        int32_t kx = (int32_t)lower_f(vx, last), ky = (int32_t)lower_f(vy, last), kz = (int32_t)lower_f(vz, last);
        c->fx[i] = vx - (float)kx;
        c->fy[i] = vy - (float)ky;
        c->fz[i] = vz - (float)kz;
        c->cells[i] = n;
        int32_t row = p.side[i] + 1;
        p.rows[i] = row;
        p.index[i] = p.base[i] + (kz * row + ky) * row + kx;
    }
    if ((sets.fine & lanes) != 0u) {
        find_fine_lanes(s->samples, at, sets.fine & lanes, &p, c);
    }
    for (int i = 0; i < CR_LANES; i++) {
        const int32_t layer = p.rows[i] * p.rows[i];
        const int16_t *low = s->samples + p.index[i], *high = low + layer;
        c->pair00[i] = load_pair(low);
        c->pair10[i] = load_pair(low + p.rows[i]);
        c->pair01[i] = load_pair(high);
        c->pair11[i] = load_pair(high + p.rows[i]);
    }
    return sets;
}

static void interpolate(const cr_field *f, const corners *c, cr_lookup *out) {
    const float quantum = f->scene->meta->quantum_m;
    const float slope = quantum * f->inv_brick;
    for (int i = 0; i < CR_LANES; i++) {
        sloped r = trilinear(c->pair00[i], c->pair10[i], c->pair01[i], c->pair11[i], c->fx[i], c->fy[i], c->fz[i]);
        float s = slope * c->cells[i];
        out->phi_m[i] = r.value * quantum;
        out->gx[i] = r.x * s;
        out->gy[i] = r.y * s;
        out->gz[i] = r.z * s;
    }
}

/* Far lanes: the lower bound of their brick, and how far they lie outside the grid. */
static void use_bounds(const cr_field *f, const float *beyond_m, cr_lookup *out) {
    const float quantum = f->scene->meta->quantum_m;
    for (int i = 0; i < CR_LANES; i++) {
        uint32_t entry = out->entry[i];
        int far = (entry & CR_TOP_FAR) != 0u;
        float bound = (float)(int32_t)(entry & CR_TOP_BOUND) * quantum + beyond_m[i];
        float value = (entry & CR_TOP_INSIDE) ? -bound : bound;
        out->phi_m[i] = far ? value : out->phi_m[i];
        out->gx[i] = far ? 0.0f : out->gx[i];
        out->gy[i] = far ? 0.0f : out->gy[i];
        out->gz[i] = far ? 0.0f : out->gz[i];
    }
}

void cr_field_look_up_lanes(const cr_field *f, const cr_lanes3 *p, uint32_t lanes, cr_lookup *out) {
    int32_t top[CR_LANES];
    float beyond_m[CR_LANES];
    corners c;
    find_places(f, p, out, top, beyond_m);
    lane_sets sets = load_corners(f, top, lanes, out, &c);
    interpolate(f, &c, out);
    out->from_facet = out->on_planes = out->bent = 0u;
    out->parts = CR_PARTS_OF_POINT * cr_count_lanes(lanes) + CR_PARTS_OF_SAMPLES * cr_count_lanes(lanes & ~sets.far);
    if (sets.far != 0u) {
        use_bounds(f, beyond_m, out);
    }
    sets.creased &= lanes;
    while (sets.creased != 0u) {
        use_crease(f, p, take_lane(&sets.creased), out);
    }
}

#endif

void cr_field_look_up(const cr_field *f, const cr_lanes3 *p, cr_lookup *out) {
    cr_field_look_up_lanes(f, p, 0xffffu, out);
}

uint32_t cr_pair_label(const cr_scene *s, uint32_t a, uint32_t b) {
    CR_ASSERT(a != b);
    const uint32_t first = a < b ? a : b, second = a < b ? b : a;
    uint32_t low = 0u, high = s->pair_count;
    while (low < high) {
        const uint32_t mid = low + (high - low) / 2u;
        const struct cr_img_pair *p = &s->pairs[mid];
        if (p->first < first || (p->first == first && p->second < second)) {
            low = mid + 1u;
        } else {
            high = mid;
        }
    }
    return low < s->pair_count && s->pairs[low].first == first && s->pairs[low].second == second ? s->pairs[low].label
                                                                                                 : 0u;
}
