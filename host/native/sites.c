#include "sites.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LIFTED 6
#define TIE (1.0 + 1e-12) /* on squares: far above the rounding of a distance */
#define ROOM (1.0 + 1e-9) /* on squares: above the rounding of where a cell begins */

typedef struct {
    int64_t key[3];
    int32_t first, count, filled; /* sites in the order of cells; count 0: a free place of the table */
} bucket;

struct crs_grid {
    const double *sites;
    double *sorted; /* [count][width] in the order of cells */
    int32_t *index; /* which site that is */
    bucket *table;
    uint64_t mask;
    int64_t count;
    double cell_m;
    int32_t width;
};

static void key_of(const crs_grid *g, const double *p, int64_t *key) {
    for (int k = 0; k < 3; k++) {
        key[k] = (int64_t)floor(p[k] / g->cell_m);
    }
}

/* The bucket of a cell, or the free one where it would be. */
static bucket *find_bucket(const crs_grid *g, const int64_t *key) {
    uint64_t h = (uint64_t)key[0] * 0x9E3779B97F4A7C15u;
    h = (h ^ h >> 32 ^ (uint64_t)key[1]) * 0xC2B2AE3D27D4EB4Fu;
    h = (h ^ h >> 32 ^ (uint64_t)key[2]) * 0x165667B19E3779F9u;
    for (h ^= h >> 32;; h++) {
        bucket *b = &g->table[h & g->mask];
        if (b->count == 0 || (b->key[0] == key[0] && b->key[1] == key[1] && b->key[2] == key[2])) {
            return b;
        }
    }
}

static const double *site_of(const crs_grid *g, int64_t i) { return g->sites + i * g->width; }

/* Sites in the order of the cells they are in; within a cell they keep theirs. */
static void fill_cells(crs_grid *g) {
    int64_t key[3];
    for (int64_t i = 0; i < g->count; i++) {
        key_of(g, site_of(g, i), key);
        bucket *b = find_bucket(g, key);
        memcpy(b->key, key, sizeof key);
        b->count++;
    }
    int32_t at = 0;
    for (uint64_t i = 0; i <= g->mask; i++) {
        g->table[i].first = at;
        at += g->table[i].count;
    }
    for (int64_t i = 0; i < g->count; i++) {
        key_of(g, site_of(g, i), key);
        bucket *b = find_bucket(g, key);
        const int32_t slot = b->first + b->filled++;
        g->index[slot] = (int32_t)i;
        memcpy(g->sorted + (int64_t)slot * g->width, site_of(g, i), (size_t)g->width * sizeof(double));
    }
}

crs_grid *crs_new(const double *sites, int32_t width, int64_t count, double cell_m) {
    crs_grid *g = malloc(sizeof *g);
    if (g == NULL) {
        return NULL;
    }
    uint64_t size = 16;
    while (size < 2 * (uint64_t)count) {
        size *= 2;
    }
    *g = (crs_grid){.sites = sites, .width = width, .count = count, .cell_m = cell_m, .mask = size - 1};
    g->sorted = malloc((size_t)(count + 1) * (size_t)width * sizeof(double));
    g->index = malloc((size_t)(count + 1) * sizeof(int32_t));
    g->table = calloc((size_t)size, sizeof(bucket));
    if (g->sorted == NULL || g->index == NULL || g->table == NULL) {
        crs_free(g);
        return NULL;
    }
    fill_cells(g);
    return g;
}

void crs_free(crs_grid *grid) {
    if (grid != NULL) {
        free(grid->sorted);
        free(grid->index);
        free(grid->table);
        free(grid);
    }
}

/* ---- which cells a search looks into ------------------------------------------------------------------------------ */

typedef struct {
    int64_t low[3], high[3], at[3];
} cell_range;

/* The cells that a ball touches, the first of them next. */
static cell_range cells_round(const crs_grid *g, const double *p, double distance2) {
    const double r = sqrt(distance2) * ROOM + 1e-9 * g->cell_m;
    const double from[3] = {p[0] - r, p[1] - r, p[2] - r}, to[3] = {p[0] + r, p[1] + r, p[2] + r};
    cell_range c;
    key_of(g, from, c.low);
    key_of(g, to, c.high);
    memcpy(c.at, c.low, sizeof c.at);
    return c;
}

/* Whether there is a next one; the last has none. */
static int next_cell(cell_range *c) {
    for (int k = 0; k < 3; k++) {
        if (c->at[k] < c->high[k]) {
            c->at[k]++;
            return 1;
        }
        c->at[k] = c->low[k];
    }
    return 0;
}

/* Square of a lower bound of the distance from p to a cell. */
static double gap2(const crs_grid *g, const double *p, const int64_t *key) {
    double sum = 0.0;
    for (int k = 0; k < 3; k++) {
        const double low = (double)key[k] * g->cell_m, high = (double)(key[k] + 1) * g->cell_m;
        const double gap = fmax(fmax(low - p[k], p[k] - high) - 1e-9 * g->cell_m, 0.0);
        sum += gap * gap;
    }
    return sum;
}

/* ---- the site nearest to a point ---------------------------------------------------------------------------------- */

static double lifted_distance2(const double *a, const double *b) {
    double sum = 0.0;
    for (int k = 0; k < LIFTED; k++) {
        const double d = a[k] - b[k];
        sum += d * d;
    }
    return sum;
}

typedef struct {
    double distance2;
    int32_t label;
    uint8_t tied;
} best_site;

static void try_sites(const crs_grid *g, const bucket *b, const double *p, best_site *best) {
    for (int32_t slot = b->first; slot < b->first + b->count; slot++) {
        const double d2 = lifted_distance2(p, g->sorted + (int64_t)slot * LIFTED);
        const int32_t label = g->index[slot];
        if (d2 > best->distance2 * TIE || label == best->label) {
            continue;
        }
        const uint8_t tied = best->distance2 <= d2 * TIE;
        if (d2 < best->distance2 || (d2 == best->distance2 && label < best->label)) {
            *best = (best_site){d2, label, tied};
        } else {
            best->tied = tied;
        }
    }
}

static void lift(const crs_points *points, int64_t i, double *p) {
    memcpy(p, points->point_m + 3 * i, 3 * sizeof *p);
    const double *normal = points->normal + 3 * (int64_t)points->triangle[i];
    for (int k = 0; k < 3; k++) {
        p[3 + k] = points->lift_m * normal[k];
    }
}

void crs_nearest(const crs_grid *grid, const crs_points *points, int64_t first, int64_t end, int32_t *label,
                 uint8_t *tied) {
    for (int64_t i = first; i < end; i++) {
        double p[LIFTED];
        lift(points, i, p);
        best_site best = {lifted_distance2(p, site_of(grid, label[i])), label[i], 0};
        cell_range c = cells_round(grid, p, best.distance2);
        do {
            if (gap2(grid, p, c.at) <= best.distance2 * ROOM) {
                try_sites(grid, find_bucket(grid, c.at), p, &best);
            }
        } while (next_cell(&c));
        label[i] = best.label;
        tied[i] = best.tied;
    }
}

/* ---- sums over the points of a label, in their order -------------------------------------------------------------- */

void crs_means(const crs_points *points, const int32_t *label, int64_t count, double *mean, double *weight_m2) {
    memset(mean, 0, (size_t)count * LIFTED * sizeof *mean);
    memset(weight_m2, 0, (size_t)count * sizeof *weight_m2);
    for (int64_t i = 0; i < points->count; i++) {
        double p[LIFTED];
        lift(points, i, p);
        const double w = points->weight_m2[points->triangle[i]];
        double *sum = mean + (int64_t)label[i] * LIFTED;
        weight_m2[label[i]] += w;
        for (int k = 0; k < LIFTED; k++) {
            sum[k] += w * p[k];
        }
    }
    for (int64_t s = 0; s < count; s++) {
        for (int k = 0; k < LIFTED; k++) {
            mean[s * LIFTED + k] /= fmax(weight_m2[s], 1e-300);
        }
    }
}

void crs_spreads(const crs_points *points, const int32_t *label, double fine_spread, const double *middle_m,
                 int64_t count, double *spread_m4) {
    memset(spread_m4, 0, (size_t)count * 9 * sizeof *spread_m4);
    for (int64_t i = 0; i < points->count; i++) {
        const int64_t t = points->triangle[i], s = label[i];
        const double w = points->weight_m2[t], *n = points->normal + 3 * t;
        double d[3];
        for (int k = 0; k < 3; k++) {
            d[k] = points->point_m[3 * i + k] - middle_m[3 * s + k];
        }
        for (int k = 0; k < 9; k++) {
            const int row = k / 3, column = k % 3;
            const double across = (row == column ? 1.0 : 0.0) - n[row] * n[column];
            spread_m4[9 * s + k] += w * (d[row] * d[column] + fine_spread * w * across);
        }
    }
}

void crs_bows(const crs_points *points, const int32_t *label, const double *site_m, const double *normal, int64_t count,
              double *bow_m) {
    memset(bow_m, 0, (size_t)count * sizeof *bow_m);
    for (int64_t i = 0; i < points->count; i++) {
        const int64_t t = points->triangle[i], s = label[i];
        const double *u = points->normal + 3 * t, *n = normal + 3 * s;
        const double *p = points->point_m + 3 * i, *o = site_m + 3 * s;
        const double c[3] = {u[1] * n[2] - u[2] * n[1], u[2] * n[0] - u[0] * n[2], u[0] * n[1] - u[1] * n[0]};
        const double tilt = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
        const double over = (p[0] - o[0]) * n[0] + (p[1] - o[1]) * n[1] + (p[2] - o[2]) * n[2];
        bow_m[s] = fmax(bow_m[s], sqrt(points->weight_m2[t]) * tilt - over);
    }
}

/* ---- the point nearest to a site ---------------------------------------------------------------------------------- */

static double place_distance2(const double *a, const double *b) {
    const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return x * x + y * y + z * z;
}

static void better_sites(const crs_grid *g, const bucket *b, const double *p, int64_t i, int64_t *nearest,
                         double *distance2_m2) {
    for (int32_t slot = b->first; slot < b->first + b->count; slot++) {
        const double d2 = place_distance2(p, g->sorted + 3 * (int64_t)slot);
        const int32_t s = g->index[slot];
        if (d2 < distance2_m2[s] || (d2 == distance2_m2[s] && i < nearest[s])) {
            distance2_m2[s] = d2;
            nearest[s] = i;
        }
    }
}

void crs_closest(const crs_grid *grid, const crs_points *points, const int32_t *label, int64_t *nearest,
                 double *distance2_m2) {
    for (int64_t s = 0; s < grid->count; s++) {
        distance2_m2[s] = DBL_MAX;
        nearest[s] = -1;
    }
    for (int64_t i = 0; i < points->count; i++) {
        const double d2 = place_distance2(points->point_m + 3 * i, site_of(grid, label[i]));
        if (d2 < distance2_m2[label[i]]) {
            distance2_m2[label[i]] = d2;
            nearest[label[i]] = i;
        }
    }
    double widest2 = 0.0;
    for (int64_t s = 0; s < grid->count; s++) {
        if (nearest[s] < 0 && points->count > 0) { /* no points of its own: any is a guess */
            nearest[s] = 0;
            distance2_m2[s] = place_distance2(points->point_m, site_of(grid, s));
        }
        widest2 = fmax(widest2, distance2_m2[s]);
    }
    for (int64_t i = 0; i < points->count; i++) {
        const double *p = points->point_m + 3 * i;
        cell_range c = cells_round(grid, p, widest2);
        do {
            if (gap2(grid, p, c.at) <= widest2 * ROOM) {
                better_sites(grid, find_bucket(grid, c.at), p, i, nearest, distance2_m2);
            }
        } while (next_cell(&c));
    }
}
