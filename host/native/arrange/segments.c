/* Where two triangles pass through each other. */
#include "cuts.h"

#include <math.h>
#include <stdlib.h>

static double height(const double *a, const double *b, const double *c, const double *p) {
    const double u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, v[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    return (u[1] * v[2] - u[2] * v[1]) * (p[0] - a[0]) + (u[2] * v[0] - u[0] * v[2]) * (p[1] - a[1]) +
           (u[0] * v[1] - u[1] * v[0]) * (p[2] - a[2]);
}

/* Vertex where edge k of triangle `from` passes through triangle `to`; -1: it does not, -2: out of memory. */
static int32_t passage(crx_cuts *c, int32_t from, int k, int32_t to) {
    const int32_t *f = c->corners + 3 * (int64_t)from, *t = c->corners + 3 * (int64_t)to;
    const int32_t p = f[k] < f[(k + 1) % 3] ? f[k] : f[(k + 1) % 3], q = f[k] < f[(k + 1) % 3] ? f[(k + 1) % 3] : f[k];
    const double *a = position(c, t[0]), *b = position(c, t[1]), *d = position(c, t[2]);
    const int above = cr_exact_side(a, b, d, position(c, p)), below = cr_exact_side(a, b, d, position(c, q));
    if (above * below >= 0) {
        return -1;
    }
    for (int m = 0; m < 3; m++) {
        if (cr_exact_side(position(c, p), position(c, q), position(c, t[m]), position(c, t[(m + 1) % 3])) * above > 0) {
            return -1;
        }
    }
    const double hp = fabs(height(a, b, d, position(c, p))), hq = fabs(height(a, b, d, position(c, q)));
    const double part = hp + hq > 0.0 ? hp / (hp + hq) : 0.5;
    double at[3];
    for (int m = 0; m < 3; m++) {
        at[m] = position(c, p)[m] + part * (position(c, q)[m] - position(c, p)[m]);
    }
    const int32_t key[3] = {p, q, to};
    const int32_t id = crx_vertex_of(c, &c->on_edge, key, at);
    return id < 0 ? -2 : id;
}

/* Ends of the line that two triangles have in common; 0: out of memory. */
static int find_segment(crx_cuts *c, int32_t a, int32_t b, segment *s) {
    int n = 0;
    s->of[0] = a;
    s->of[1] = b;
    const int32_t sides[2][2] = {{a, b}, {b, a}};
    const int32_t *ca = c->corners + 3 * (int64_t)a, *cb = c->corners + 3 * (int64_t)b;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            if (ca[i] == cb[j] && n < 2) {
                s->ends[n++] = ca[i];
            }
        }
    }
    for (int turn = 0; turn < 2; turn++) {
        const int32_t *own = c->corners + 3 * (int64_t)sides[turn][0],
                      *other = c->corners + 3 * (int64_t)sides[turn][1];
        for (int k = 0; k < 3; k++) {
            int touches = 0;
            for (int m = 0; m < 3; m++) {
                touches |= own[k] == other[m] || own[(k + 1) % 3] == other[m];
            }
            const int32_t id = touches ? -1 : passage(c, sides[turn][0], k, sides[turn][1]);
            if (id == -2) {
                return 0;
            }
            if (id >= 0 && n < 2) {
                s->ends[n++] = id;
            }
        }
    }
    if (n < 2) {
        s->ends[0] = s->ends[1] = -1;
    }
    return 1;
}

int crx_find_segments(crx_cuts *c, size_t triangle_count, const int32_t *pairs, size_t pair_count) {
    c->segments = malloc((pair_count + 1) * sizeof *c->segments);
    c->first = calloc(triangle_count + 2, sizeof *c->first);
    c->mine = malloc((2 * pair_count + 1) * sizeof *c->mine);
    if (c->segments == NULL || c->first == NULL || c->mine == NULL) {
        return 0;
    }
    for (size_t i = 0; i < pair_count; i++) {
        if (!find_segment(c, pairs[2 * i], pairs[2 * i + 1], &c->segments[i])) {
            return 0;
        }
        c->first[pairs[2 * i] + 2]++;
        c->first[pairs[2 * i + 1] + 2]++;
    }
    for (size_t t = 2; t < triangle_count + 2; t++) {
        c->first[t] += c->first[t - 1];
    }
    for (size_t i = 0; i < pair_count; i++) {
        c->mine[c->first[pairs[2 * i] + 1]++] = (int64_t)i;
        c->mine[c->first[pairs[2 * i + 1] + 1]++] = (int64_t)i;
    }
    return 1;
}
