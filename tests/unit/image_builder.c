/* Scene images by hand: see the header. */
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define REACH_M 4e-3
#define PROBES 3
#define PROBE_MARGIN 0.4
#define FEATURE_AREA 1e-3
#define FACETS_MAX (CRT_SIDES_MAX + 2)
#define PI 3.14159265358979323846

/* ---- tools -------------------------------------------------------------------------------------------------------- */

crt_tool crt_tool_new(double spacing_m) {
    crt_tool t = {NULL, calloc(1, sizeof(uint32_t)), 0, 0, spacing_m};
    return t;
}

void crt_tool_free(crt_tool *t) {
    free(t->samples);
    free(t->start);
    memset(t, 0, sizeof *t);
}

static void add_sample(crt_tool *t, const crt_sample *sample) {
    if (t->sample_count % 256u == 0u) {
        t->samples = realloc(t->samples, (t->sample_count + 256u) * sizeof *t->samples);
    }
    t->samples[t->sample_count++] = *sample;
}

static void end_cluster(crt_tool *t) {
    t->cluster_count++;
    t->start = realloc(t->start, (t->cluster_count + 1u) * sizeof *t->start);
    t->start[t->cluster_count] = t->sample_count;
}

static void add_tile(crt_tool *t, const double centre[3], const double half[3], int axis, int side, const int count[2],
                     int i, int j) {
    int ua = (axis + 1) % 3, va = (axis + 2) % 3;
    crt_sample s;
    memset(&s, 0, sizeof s);
    s.u[ua] = s.v[va] = 1.0;
    s.normal[axis] = side;
    s.width_m[0] = 2.0 * half[ua] / count[0];
    s.width_m[1] = 2.0 * half[va] / count[1];
    s.pos_m[axis] = centre[axis] + side * half[axis];
    s.pos_m[ua] = centre[ua] - half[ua] + (i + 0.5) * s.width_m[0];
    s.pos_m[va] = centre[va] - half[va] + (j + 0.5) * s.width_m[1];
    s.area_m2 = s.width_m[0] * s.width_m[1];
    add_sample(t, &s);
}

static int tiles(double length, double spacing) { return 4 * (int)fmax(1.0, round(length / (4.0 * spacing))); }

static void add_face(crt_tool *t, const double centre[3], const double half[3], int axis, int side) {
    int count[2] = {tiles(2.0 * half[(axis + 1) % 3], t->spacing_m), tiles(2.0 * half[(axis + 2) % 3], t->spacing_m)};
    for (int i = 0; i < count[0]; i += 4) {
        for (int j = 0; j < count[1]; j += 4) {
            for (int k = 0; k < CR_LANES; k++) {
                add_tile(t, centre, half, axis, side, count, i + k / 4, j + k % 4);
            }
            end_cluster(t);
        }
    }
}

/* A vertex (half_length 0) or a straight piece of crease along an axis; side: which way its normal points. */
static void add_feature(crt_tool *t, const double pos[3], const double side[3], int axis, double half_length) {
    crt_sample s;
    memset(&s, 0, sizeof s);
    double length = sqrt(side[0] * side[0] + side[1] * side[1] + side[2] * side[2]);
    for (int a = 0; a < 3; a++) {
        s.pos_m[a] = pos[a];
        s.normal[a] = side[a] / length;
    }
    s.u[axis] = 1.0;
    s.width_m[0] = 2.0 * half_length;
    s.area_m2 = FEATURE_AREA * t->spacing_m * t->spacing_m;
    s.reach_m = half_length;
    s.vertex = half_length <= 0.0;
    s.crease = !s.vertex;
    add_sample(t, &s);
}

/* The four edges along an axis, cut into pieces, in clusters of their own. */
static void add_edges(crt_tool *t, const double centre[3], const double half[3], int axis) {
    int pieces = (int)fmax(1.0, ceil(2.0 * half[axis] / t->spacing_m - 1e-9)), ua = (axis + 1) % 3, va = (axis + 2) % 3;
    double piece = half[axis] / pieces;
    for (int k = 0; k < 4; k++) {
        double side[3] = {0.0}, pos[3];
        side[ua] = k & 1 ? 1.0 : -1.0;
        side[va] = k & 2 ? 1.0 : -1.0;
        pos[ua] = centre[ua] + side[ua] * half[ua];
        pos[va] = centre[va] + side[va] * half[va];
        for (int i = 0; i < pieces; i++) {
            pos[axis] = centre[axis] - half[axis] + (2 * i + 1) * piece;
            add_feature(t, pos, side, axis, piece);
            if (i % CR_LANES == CR_LANES - 1 || i == pieces - 1) {
                end_cluster(t);
            }
        }
    }
}

void crt_add_box(crt_tool *t, const double centre[3], const double half[3]) {
    for (int axis = 0; axis < 3; axis++) {
        add_face(t, centre, half, axis, -1);
        add_face(t, centre, half, axis, 1);
        add_edges(t, centre, half, axis);
    }
    for (int k = 0; k < 8; k++) {
        double side[3], pos[3];
        for (int axis = 0; axis < 3; axis++) {
            side[axis] = (k >> axis) & 1 ? 1.0 : -1.0;
            pos[axis] = centre[axis] + side[axis] * half[axis];
        }
        add_feature(t, pos, side, 0, 0.0);
        end_cluster(t);
    }
}

void crt_add_ball(crt_tool *t, double radius) {
    int rings = (int)fmax(4.0, round(PI * radius / t->spacing_m));
    for (int i = 0; i < rings; i++) {
        double low = PI * i / rings, high = PI * (i + 1) / rings, middle = 0.5 * (low + high);
        int count = (int)fmax(3.0, round(2.0 * PI * sin(middle) * radius / t->spacing_m));
        for (int j = 0; j < count; j++) {
            double turn = 2.0 * PI * (j + 0.5 * (i % 2)) / count;
            crt_sample s = {{0},
                            {sin(middle) * cos(turn), sin(middle) * sin(turn), cos(middle)},
                            {cos(middle) * cos(turn), cos(middle) * sin(turn), -sin(middle)},
                            {-sin(turn), cos(turn), 0.0},
                            {0},
                            2.0 * PI * radius * radius * (cos(low) - cos(high)) / count,
                            0.0,
                            0.0,
                            0,
                            0};
            s.width_m[0] = s.width_m[1] = sqrt(s.area_m2);
            s.bow_m = radius - sqrt(radius * radius - 0.5 * s.area_m2); /* a corner of the square piece */
            for (int a = 0; a < 3; a++) {
                s.pos_m[a] = radius * s.normal[a];
            }
            add_sample(t, &s);
            if (t->sample_count - t->start[t->cluster_count] == CR_LANES) {
                end_cluster(t);
            }
        }
    }
    if (t->sample_count > t->start[t->cluster_count]) {
        end_cluster(t);
    }
}

/* ---- the image ---------------------------------------------------------------------------------------------------- */

/* Sections as they are made: bytes, elements, bytes of one element. */
typedef struct {
    uint8_t *bytes[CR_SEC_COUNT + 1];
    uint32_t count[CR_SEC_COUNT + 1], stride[CR_SEC_COUNT + 1];
} parts;

static void *add_part(parts *p, uint32_t id, uint32_t count, size_t stride) {
    p->bytes[id] = calloc(count > 0u ? count : 1u, stride);
    p->count[id] = count;
    p->stride[id] = (uint32_t)stride;
    return p->bytes[id];
}

/* Facets that hold the nearest surface point of some probe of a cell, as bits. */
static uint32_t facets_of_cell(const crt_solid *s, const double planes[][4], const double low[3], double size) {
    uint32_t found = 0u;
    for (int k = 0; k < PROBES * PROBES * PROBES; k++) {
        int at[3] = {k % PROBES, k / PROBES % PROBES, k / (PROBES * PROBES)};
        double p[3], q[3];
        for (int a = 0; a < 3; a++) {
            p[a] = low[a] + size * ((1.0 + 2.0 * PROBE_MARGIN) * at[a] / (PROBES - 1) - PROBE_MARGIN);
        }
        (void)crt_nearest(s, p, q);
        for (int f = 0; f < crt_facets(s); f++) {
            const double *n = planes[f];
            found |= (uint32_t)(fabs(n[0] * q[0] + n[1] * q[1] + n[2] * q[2] - n[3]) < 1e-12) << f;
        }
    }
    return found;
}

/* Kinds are numbered by the set of their facets. */
static void fill_kind(const crt_solid *s, uint32_t set, struct cr_img_kind *kind) {
    for (uint32_t f = 0; f < FACETS_MAX; f++) {
        if ((set >> f) & 1u) {
            kind->facet[kind->count++] = f;
        }
    }
    kind->kind = s->ball_m > 0.0     ? CR_KIND_CURVED
                 : kind->count == 1u ? CR_KIND_PLANAR
                 : s->hollow         ? CR_KIND_CONCAVE
                                     : CR_KIND_CONVEX;
}

/* A rectangle that holds all of the solid, and so the facet, seen along its normal. */
static void fill_rectangle(const crt_solid *s, struct cr_img_facet *facet) {
    const float *n = facet->normal;
    double low[3], high[3], middle[3], size2 = 0.0;
    const cr_vec3 across = fabsf(n[0]) < 0.7f ? v3(0.0f, n[2], -n[1]) : v3(-n[2], 0.0f, n[0]);
    const cr_vec3 along = v3_scale(across, 1.0f / v3_norm(across));
    const float unit[3] = {along.x, along.y, along.z};
    crt_bounds(s, low, high);
    for (int a = 0; a < 3; a++) {
        facet->along[a] = (int16_t)lrintf(32767.0f * unit[a]);
        middle[a] = 0.5 * (low[a] + high[a]);
        size2 += (high[a] - low[a]) * (high[a] - low[a]);
    }
    const cr_vec3 side[2] = {along, v3_cross(v3(n[0], n[1], n[2]), along)};
    for (int k = 0; k < 2; k++) {
        const double at = side[k].x * middle[0] + side[k].y * middle[1] + side[k].z * middle[2];
        facet->low_m[k] = (float)(at - 0.5 * sqrt(size2));
        facet->high_m[k] = (float)(at + 0.5 * sqrt(size2));
    }
}

static void fill_features(const crt_solid *s, parts *p) {
    int facets = crt_facets(s), ball = s->ball_m > 0.0;
    struct cr_img_facet *facet = add_part(p, CR_SEC_FACETS, (uint32_t)facets, sizeof *facet);
    struct cr_img_kind *kind = add_part(p, CR_SEC_KINDS, 1u << facets, sizeof *kind);
    struct cr_img_pair *pair = add_part(p, CR_SEC_PAIRS, (uint32_t)(facets * facets), sizeof *pair);
    struct cr_img_edge *edge = add_part(p, CR_SEC_EDGES, (uint32_t)s->sides, sizeof *edge);
    uint32_t label = s->hollow ? CR_PAIR_CONCAVE : CR_PAIR_CONVEX, pairs = 0u;
    for (uint32_t set = 1u; set < 1u << facets; set++) {
        fill_kind(s, set, &kind[set]);
    }
    for (int f = 0; f < facets; f++) {
        double n[4];
        crt_plane(s, f, n);
        for (int a = 0; a < 3; a++) {
            facet[f].normal[a] = (float)n[a];
        }
        facet[f].offset_m = (float)n[3];
        facet[f].patch = (uint32_t)f;
        facet[f].curved = (uint8_t)ball;
        fill_rectangle(s, &facet[f]);
        for (int g = f + 1; g < facets; g++) {
            int apart = f < s->sides && g < s->sides && s->sides == 4 && g - f == 2;
            if (!apart && f != s->sides) {
                pair[pairs++] = (struct cr_img_pair){(uint32_t)f, (uint32_t)g, label};
            }
        }
    }
    p->count[CR_SEC_PAIRS] = pairs;
    for (int i = 0; i < s->sides; i++) {
        float x = (float)s->corner_m[i][0], z = (float)s->corner_m[i][1], y = (float)s->half_y_m;
        const uint32_t next = (uint32_t)((i + 1) % s->sides);
        const float *a = facet[i].normal, *b = facet[next].normal;
        const float angle_rad = acosf(fmaxf(-1.0f, fminf(1.0f, a[0] * b[0] + a[1] * b[1] + a[2] * b[2])));
        edge[i] = (struct cr_img_edge){{x, -y, z}, {x, y, z}, {(uint32_t)i, next}, label, angle_rad};
    }
}

static void fill_meta_of_grid(const crt_solid *s, struct cr_img_meta *m, double voxel_m) {
    double low[3], high[3];
    crt_bounds(s, low, high);
    m->brick_m = (float)(8.0 * voxel_m);
    m->voxel_m = m->brick_m / 8.0f;
    double pad = 1.4 * (double)m->brick_m + REACH_M; /* border bricks are far */
    for (int a = 0; a < 3; a++) {
        m->origin_m[a] = (float)(low[a] - pad);
        m->dims[a] = (uint32_t)ceil((high[a] + pad - (double)m->origin_m[a]) / (double)m->brick_m);
        m->static_min_m[a] = (float)low[a];
        m->static_max_m[a] = (float)high[a];
    }
    m->band_m = 2.0f * m->brick_m + (float)REACH_M;
    m->crease_m = (float)REACH_M;
    m->quantum_m = m->band_m / 32767.0f;
    /* Beyond crease_m the samples decide: where the nearest facet changes they are off by up to this. */
    double voxel = (double)m->voxel_m, error = 2.0 * (double)m->quantum_m;
    error += s->ball_m > 0.0 ? voxel * voxel / s->ball_m : 0.45 * voxel;
    m->error_out_m = m->error_in_m = (float)error;
    m->error_max_m = m->error_rms_m = (float)error;
    m->crease_angle_rad = 0.5236f;
    m->static_unit_m = m->tool_unit_m = 1.0f;
    m->patch_count = (uint32_t)crt_facets(s);
    m->piece_count = 1u;
}

/* Cells of one near brick whose low corner is given. */
static void fill_cells(const crt_solid *s, const struct cr_img_meta *m, const double low[3], struct cr_img_brick *brick,
                       uint16_t *cells) {
    double voxel = (double)m->brick_m / 8.0, planes[FACETS_MAX][4];
    for (int f = 0; f < crt_facets(s); f++) {
        crt_plane(s, f, planes[f]);
    }
    for (int k = 0; k < 512; k++) {
        double p[3] = {low[0] + k % 8 * voxel, low[1] + k / 8 % 8 * voxel, low[2] + k / 64 * voxel};
        uint32_t set = s->ball_m > 0.0 ? 1u : facets_of_cell(s, (const double(*)[4])planes, p, voxel);
        cells[k] = (uint16_t)set;
        brick->creased = (uint8_t)(brick->creased | ((set & (set - 1u)) != 0u));
    }
}

static void fill_voxmap(const crt_solid *s, const struct cr_img_meta *m, parts *p) {
    uint32_t tops = m->dims[0] * m->dims[1] * m->dims[2], near = 0u, tables = 0u, at = 0u;
    double brick_m = (double)m->brick_m, diagonal = 0.5 * sqrt(3.0) * brick_m, quantum = (double)m->quantum_m;
    uint32_t *top = add_part(p, CR_SEC_TOP, tops, sizeof *top);
    struct cr_img_brick *bricks = add_part(p, CR_SEC_BRICKS, tops, sizeof *bricks);
    int16_t *samples = add_part(p, CR_SEC_SAMPLES, tops * (s->fine ? CRT_BRICK_MOST : 729u), sizeof *samples);
    uint16_t *cells = add_part(p, CR_SEC_CELLS, tops * 512u, sizeof *cells);
    for (uint32_t i = 0; i < tops; i++) {
        uint32_t place[3] = {i % m->dims[0], i / m->dims[0] % m->dims[1], i / (m->dims[0] * m->dims[1])};
        double low[3], centre[3];
        for (int a = 0; a < 3; a++) {
            low[a] = (double)m->origin_m[a] + place[a] * brick_m;
            centre[a] = low[a] + 0.5 * brick_m;
        }
        double d = crt_distance(s, centre), bound = fabs(d) - diagonal;
        if (bound > REACH_M) {
            top[i] = CR_TOP_FAR | (d < 0.0 ? CR_TOP_INSIDE : 0u) | (uint32_t)floor(bound / quantum);
            continue;
        }
        struct cr_img_brick *b = &bricks[near];
        uint16_t *table = cells + 512u * tables;
        b->samples = at;
        at += crt_fill_samples(s, m, low, b, samples + at);
        fill_cells(s, m, low, b, table);
        b->cells = 512u * tables;
        int uniform = 1;
        for (int k = 1; k < 512; k++) {
            uniform = uniform && table[k] == table[0];
        }
        b->kind = uniform ? table[0] : 0u;
        b->cells = uniform && !b->creased ? CR_CELLS_NONE : 512u * tables++;
        top[i] = near++;
    }
    p->count[CR_SEC_BRICKS] = near;
    p->count[CR_SEC_SAMPLES] = at;
    p->count[CR_SEC_CELLS] = 512u * tables;
}

/* Largest width of a sample's piece of surface; a point still fades in over a tenth of a spacing. */
static double width_of(const crt_tool *t, const crt_sample *s) {
    return fmax(fmax(s->width_m[0], s->width_m[1]), 0.1 * t->spacing_m);
}

static void fill_lane(const crt_tool *t, struct cr_img_cluster *c, int lane, const crt_sample *s, int real) {
    double w[3][3], most = width_of(t, s);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            w[i][j] =
                s->width_m[0] * s->width_m[0] * s->u[i] * s->u[j] + s->width_m[1] * s->width_m[1] * s->v[i] * s->v[j];
        }
    }
    double area = real ? s->area_m2 : 0.0;
    c->x[lane] = (float)s->pos_m[0];
    c->y[lane] = (float)s->pos_m[1];
    c->z[lane] = (float)s->pos_m[2];
    c->ax[lane] = (float)(area * s->normal[0]);
    c->ay[lane] = (float)(area * s->normal[1]);
    c->az[lane] = (float)(area * s->normal[2]);
    c->area[lane] = (float)area;
    c->wxx[lane] = (float)w[0][0];
    c->wyy[lane] = (float)w[1][1];
    c->wzz[lane] = (float)w[2][2];
    c->wxy[lane] = (float)w[0][1];
    c->wyz[lane] = (float)w[1][2];
    c->wzx[lane] = (float)w[2][0];
    c->ramp[lane] = (float)(0.5 * most * (1.0 + 1e-6));
    c->reach[lane] = real ? (float)s->reach_m : 0.0f;
    c->bow[lane] = (float)s->bow_m;
}

/* Lanes of cluster b beside sample i. */
static uint16_t lanes_beside(const crt_tool *t, uint32_t i, uint32_t b) {
    double limit = 1.6 * t->spacing_m;
    uint32_t lanes = 0u;
    for (uint32_t j = t->start[b]; j < t->start[b + 1u]; j++) {
        const double *p = t->samples[i].pos_m, *q = t->samples[j].pos_m;
        double apart2 = pow(p[0] - q[0], 2) + pow(p[1] - q[1], 2) + pow(p[2] - q[2], 2);
        lanes |= (uint32_t)(i != j && apart2 < limit * limit) << (j - t->start[b]);
    }
    return (uint16_t)lanes;
}

static void fill_cluster(const crt_tool *t, uint32_t index, struct cr_img_cluster *c, struct cr_img_sum *sum) {
    uint32_t first = t->start[index], count = t->start[index + 1u] - first;
    double mean[3] = {0.0}, normal[3] = {0.0};
    float one[CR_LANES];
    c->count = (uint16_t)count;
    c->piece[0] = 0u;
    c->piece[1] = CR_PIECE_NONE;
    c->piece_lanes[0] = (uint16_t)((1u << count) - 1u);
    for (uint32_t i = 0; i < CR_LANES; i++) {
        const crt_sample *s = &t->samples[first + (i < count ? i : 0u)];
        fill_lane(t, c, (int)i, s, i < count);
        one[i] = 1.0f;
        c->vertex_mask |= (uint16_t)(i < count && s->vertex ? 1u << i : 0u);
        c->crease_mask |= (uint16_t)(i < count && s->crease ? 1u << i : 0u);
        for (int a = 0; a < 3 && i < count; a++) {
            mean[a] += s->pos_m[a] / count;
            normal[a] += s->area_m2 * s->normal[a];
        }
    }
    double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (int a = 0; a < 3; a++) {
        c->normal[a] = length > 0.0 ? (float)(normal[a] / length) : 0.0f;
    }
    for (uint32_t i = 0; i < count; i++) {
        const double *q = t->samples[first + i].pos_m;
        c->beside[i] = lanes_beside(t, first + i, index);
        double r = sqrt(pow(q[0] - mean[0], 2) + pow(q[1] - mean[1], 2) + pow(q[2] - mean[2], 2));
        c->radius_m = fmaxf(c->radius_m, (float)(r * (1.0 + 1e-6) + 1e-9));
    }
    cr_sum_cluster(c, one, sum);
}

/* Sphere, margin and reach from the origin of the samples of clusters [low, high). */
static void ball_of(const crt_tool *t, uint32_t low, uint32_t high, float centre[3], float *radius, float *margin,
                    float *rho) {
    double from[3] = {INFINITY, INFINITY, INFINITY}, to[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (uint32_t i = t->start[low]; i < t->start[high]; i++) {
        for (int a = 0; a < 3; a++) {
            from[a] = fmin(from[a], t->samples[i].pos_m[a]);
            to[a] = fmax(to[a], t->samples[i].pos_m[a]);
        }
    }
    double r = 0.0, most = 0.0, far = 0.0;
    for (int a = 0; a < 3; a++) {
        centre[a] = (float)(0.5 * (from[a] + to[a]));
    }
    for (uint32_t i = t->start[low]; i < t->start[high]; i++) {
        const crt_sample *s = &t->samples[i];
        double d2 = 0.0, o2 = 0.0;
        for (int a = 0; a < 3; a++) {
            d2 += pow(s->pos_m[a] - (double)centre[a], 2);
            o2 += pow(s->pos_m[a], 2);
        }
        r = fmax(r, sqrt(d2));
        far = fmax(far, sqrt(o2));
        most = fmax(most, 0.5 * width_of(t, s));
    }
    *radius = (float)(r * (1.0 + 1e-6) + 1e-8);
    *margin = (float)(most * (1.0 + 2e-6) + 1e-9);
    *rho = (float)(far * (1.0 + 1e-6) + 1e-8);
}

static void fill_tree(const crt_tool *t, parts *p, struct cr_img_meta *m) {
    uint32_t width[CR_TREE_DEPTH_MAX], spans[CR_TREE_DEPTH_MAX], levels = 0u, total = 0u, span = 1u;
    for (uint32_t n = t->cluster_count; levels == 0u || n > 1u;) {
        spans[levels] = span;
        n = (n + CR_LANES - 1u) / CR_LANES;
        width[levels++] = n;
        total += n;
        span *= CR_LANES;
    }
    struct cr_img_group *groups = add_part(p, CR_SEC_GROUPS, total, sizeof *groups);
    uint32_t first = 0u;
    for (uint32_t depth = 0; depth < levels; depth++) {
        uint32_t up = levels - 1u - depth, below = up == 0u ? t->cluster_count : width[up - 1u];
        for (uint32_t i = 0; i < width[up]; i++) {
            struct cr_img_group *g = &groups[first + i];
            g->count = below - i * CR_LANES < CR_LANES ? below - i * CR_LANES : CR_LANES;
            g->leaf = up == 0u;
            g->level = depth;
            for (uint32_t k = 0; k < CR_LANES; k++) {
                uint32_t child = i * CR_LANES + (k < g->count ? k : 0u);
                uint32_t low = child * spans[up], high = low + spans[up];
                float centre[3];
                high = high < t->cluster_count ? high : t->cluster_count;
                ball_of(t, low, high, centre, &g->radius[k], &g->margin[k], &g->rho[k]);
                g->x[k] = centre[0];
                g->y[k] = centre[1];
                g->z[k] = centre[2];
                g->first[k] = low;
                g->child[k] = up == 0u ? child : first + width[up] + child;
            }
        }
        first += width[up];
    }
    m->levels = levels;
    ball_of(t, 0u, t->cluster_count, m->root_centre_m, &m->root_radius_m, &m->ramp_max_m, &m->tool_radius_m);
}

static int spheres_far(const crt_tool *t, const struct cr_img_cluster *c, uint32_t a, uint32_t b) {
    const double *p = t->samples[t->start[a]].pos_m, *q = t->samples[t->start[b]].pos_m;
    double d = sqrt(pow(p[0] - q[0], 2) + pow(p[1] - q[1], 2) + pow(p[2] - q[2], 2));
    return d > 2.0 * (double)(c[a].radius_m + c[b].radius_m) + 2.0 * t->spacing_m;
}

#define NEIGHBOURS_MAX 256u

static void fill_neighbours(const crt_tool *t, parts *p) {
    const struct cr_img_cluster *clusters = (const struct cr_img_cluster *)(const void *)p->bytes[CR_SEC_CLUSTERS];
    uint32_t *start = add_part(p, CR_SEC_ADJ_START, t->cluster_count + 1u, sizeof *start);
    struct cr_img_neighbour *adj = add_part(p, CR_SEC_ADJ, t->cluster_count * NEIGHBOURS_MAX, sizeof *adj);
    uint32_t count = 0u;
    for (uint32_t a = 0; a < t->cluster_count; a++) {
        for (uint32_t b = 0; b < t->cluster_count; b++) {
            if (a == b || spheres_far(t, clusters, a, b)) {
                continue;
            }
            for (uint32_t i = t->start[a]; i < t->start[a + 1u]; i++) {
                struct cr_img_neighbour beside = {b, (uint16_t)(1u << (i - t->start[a])), lanes_beside(t, i, b)};
                if (beside.theirs != 0u) {
                    assert_true(count < t->cluster_count * NEIGHBOURS_MAX);
                    adj[count++] = beside;
                }
            }
        }
        start[a + 1u] = count;
    }
    p->count[CR_SEC_ADJ] = count;
}

static void fill_shell(const crt_tool *t, parts *p, struct cr_img_meta *m) {
    struct cr_img_cluster *clusters = add_part(p, CR_SEC_CLUSTERS, t->cluster_count, sizeof *clusters);
    struct cr_img_sum *sums = add_part(p, CR_SEC_SUMS, t->cluster_count, sizeof *sums);
    for (uint32_t i = 0; i < t->cluster_count; i++) {
        fill_cluster(t, i, &clusters[i], &sums[i]);
        m->shell_area_m2 += sums[i].area;
    }
    fill_tree(t, p, m);
    fill_neighbours(t, p);
    m->spacing_m = (float)t->spacing_m;
    m->point_count = t->sample_count;
    for (int a = 0; a < 3; a++) {
        m->tool_min_m[a] = m->root_centre_m[a] - m->root_radius_m;
        m->tool_max_m[a] = m->root_centre_m[a] + m->root_radius_m;
    }
}

static uint32_t round_up(uint32_t n) { return (n + CR_IMG_ALIGN - 1u) / CR_IMG_ALIGN * CR_IMG_ALIGN; }

static uint8_t *assemble(const parts *p, uint32_t *size_bytes) {
    uint32_t head = (uint32_t)(sizeof(struct cr_img_header) + CR_SEC_COUNT * sizeof(struct cr_img_section));
    uint32_t size = round_up(head);
    for (uint32_t id = 1; id <= CR_SEC_COUNT; id++) {
        size += round_up(p->count[id] * p->stride[id]);
    }
    uint8_t *image = aligned_alloc(CR_IMG_ALIGN, size);
    assert_non_null(image);
    memset(image, 0, size);
    struct cr_img_header *h = (struct cr_img_header *)(void *)image;
    memcpy(h->magic, CR_IMG_MAGIC, sizeof h->magic);
    h->version = CR_IMAGE_VERSION;
    h->size_bytes = size;
    h->section_count = CR_SEC_COUNT;
    uint32_t at = round_up(head);
    for (uint32_t id = 1; id <= CR_SEC_COUNT; id++) {
        uint32_t bytes = p->count[id] * p->stride[id];
        *crt_row(image, id) = (struct cr_img_section){id, at, p->count[id], p->stride[id]};
        memcpy(image + at, p->bytes[id], bytes);
        at += round_up(bytes);
    }
    crt_seal(image);
    *size_bytes = size;
    return image;
}

uint8_t *crt_image(const crt_solid *solid, const crt_tool *tool, double voxel_m, uint32_t *size_bytes) {
    parts p;
    memset(&p, 0, sizeof p);
    struct cr_img_meta *meta = add_part(&p, CR_SEC_META, 1u, sizeof *meta);
    fill_meta_of_grid(solid, meta, voxel_m);
    fill_features(solid, &p);
    fill_voxmap(solid, meta, &p);
    fill_shell(tool, &p, meta);
    uint8_t *image = assemble(&p, size_bytes);
    for (uint32_t id = 1; id <= CR_SEC_COUNT; id++) {
        free(p.bytes[id]);
    }
    return image;
}

struct cr_img_section *crt_row(uint8_t *image, uint32_t id) {
    return (struct cr_img_section *)(void *)(image + sizeof(struct cr_img_header)) + (id - 1u);
}

void *crt_section(uint8_t *image, uint32_t id) { return image + crt_row(image, id)->offset; }

void crt_seal(uint8_t *image) {
    struct cr_img_header *h = (struct cr_img_header *)(void *)image;
    h->crc32 = cr_image_crc(image, h->size_bytes);
}
