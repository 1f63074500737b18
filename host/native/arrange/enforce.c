/* Lines become edges: the way from end to end is followed, opened, and closed again by cutting ears. */
#include "cuts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static int32_t meeting_point(sheet *s, int32_t a, int32_t b, int32_t other, const line *across) {
    const double *pa = s->at[a], *pb = s->at[b], *pc = s->at[across->ends[0]], *pd = s->at[across->ends[1]];
    const double dx = pd[0] - pc[0], dy = pd[1] - pc[1];
    const double whole = (pb[0] - pa[0]) * dy - (pb[1] - pa[1]) * dx,
                 part = (pc[0] - pa[0]) * dy - (pc[1] - pa[1]) * dx;
    const double share = whole != 0.0 ? fmin(fmax(part / whole, 0.0), 1.0) : 0.5;
    const double *from = position(s->cuts, s->id[a]), *to = position(s->cuts, s->id[b]);
    const double at[3] = {from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1]),
                          from[2] + share * (to[2] - from[2])};
    int32_t key[3] = {s->parent, other, across->other};
    for (int i = 1; i < 3; i++) {
        for (int j = i; j > 0 && key[j] < key[j - 1]; j--) {
            const int32_t swap = key[j];
            key[j] = key[j - 1];
            key[j - 1] = swap;
        }
    }
    const int32_t id = crx_vertex_of(s->cuts, &s->cuts->of_three, key, at);
    return id < 0 || crx_local_of(s, id) >= 0 ? -1 : crx_add_local(s, id);
}

static int pass(chain *side, int32_t v) {
    if (!GROW(side->at, side->count, side->room)) {
        return 0;
    }
    side->at[side->count++] = v;
    return 1;
}

static int cross_triangle(way *w, int64_t t) {
    if (!GROW(w->crossed, w->crossed_count, w->crossed_room)) {
        return 0;
    }
    w->crossed[w->crossed_count++] = t;
    return 1;
}

/* How the way from a leaves its first triangle: through the edge *u (right) to *v (left), or along it to *through. */
static int64_t way_out(const sheet *s, int32_t a, int32_t b, int32_t *u, int32_t *v, int32_t *through) {
    *through = -1;
    for (int64_t t = 0; t < s->tri_count; t++) {
        for (int k = 0; k < 3; k++) {
            if (s->tri[t][k] != a) {
                continue;
            }
            *u = s->tri[t][(k + 1) % 3];
            *v = s->tri[t][(k + 2) % 3];
            const int to_u = turn_of(s, a, b, *u), to_v = turn_of(s, a, b, *v);
            const int32_t on = to_u == 0 ? *u : to_v == 0 ? *v : -1;
            if (to_u < 0 && to_v > 0) {
                return t;
            }
            if (on >= 0 && on != b) {
                const double *p = s->at[a], *q = s->at[b], *r = s->at[on];
                if ((q[0] - p[0]) * (r[0] - p[0]) + (q[1] - p[1]) * (r[1] - p[1]) > 0.0) {
                    *through = on;
                    return t;
                }
            }
        }
    }
    return -1;
}

enum { LOST, FREE, STOPPED };

/* Follow the way from a to b. STOPPED: it goes through the vertex *stop, which may be new: where it meets another line. */
static int follow(sheet *s, int32_t a, int32_t b, int32_t other, way *w, int32_t *stop) {
    int32_t u, v, q;
    w->left.count = w->right.count = w->crossed_count = 0;
    int64_t t = way_out(s, a, b, &u, &v, stop);
    if (t < 0 || *stop >= 0) {
        return t < 0 ? LOST : STOPPED;
    }
    if (!pass(&w->right, u) || !pass(&w->left, v)) {
        return LOST;
    }
    for (int64_t step = 0; step <= s->tri_count && cross_triangle(w, t); step++) {
        const int64_t on = crx_line_at(s, u, v);
        if (on >= 0 && s->lines != NULL) {
            const line across = s->lines[on];
            *stop = meeting_point(s, a, b, other, &across);
            return *stop >= 0 && crx_split_edge(s, u, v, *stop) ? STOPPED : LOST;
        }
        t = crx_side_at(s, v, u, &q);
        if (t < 0) {
            return LOST;
        }
        if (q == b) {
            return cross_triangle(w, t) ? FREE : LOST;
        }
        const int turn = turn_of(s, a, b, q);
        if (turn == 0) {
            *stop = q;
            return STOPPED;
        }
        if (turn < 0 ? !pass(&w->right, q) : !pass(&w->left, q)) {
            return LOST;
        }
        *(turn < 0 ? &u : &v) = q;
    }
    return LOST;
}

static int is_ear(const sheet *s, const int32_t *rim, int64_t n, int64_t i) {
    const int32_t a = rim[(i + n - 1) % n], b = rim[i], c = rim[(i + 1) % n];
    if (turn_of(s, a, b, c) <= 0) {
        return 0;
    }
    for (int64_t k = 0; k < n; k++) {
        const int32_t p = rim[k];
        if (p != a && p != b && p != c && turn_of(s, a, b, p) >= 0 && turn_of(s, b, c, p) >= 0 &&
            turn_of(s, c, a, p) >= 0) {
            return 0;
        }
    }
    return 1;
}

/* Triangles over a rim, counter-clockwise, by cutting ears off; spoils it. 0: failed. */
static int cut_ears(sheet *s, int32_t *rim, int64_t n) {
    while (n > 2) {
        int64_t ear = 0;
        while (ear < n && !is_ear(s, rim, n, ear)) {
            ear++;
        }
        if (ear == n || !crx_add_triangle(s, rim[(ear + n - 1) % n], rim[ear], rim[(ear + 1) % n])) {
            return 0;
        }
        memmove(rim + ear, rim + ear + 1, (size_t)(n - ear - 1) * sizeof *rim);
        n--;
    }
    return 1;
}

static int by_index_down(const void *a, const void *b) {
    const int64_t p = *(const int64_t *)a, q = *(const int64_t *)b;
    return (p < q) - (p > q);
}

/* The triangles on the way from a to b make room for an edge between the two. */
static int open_way(sheet *s, int32_t a, int32_t b, way *w) {
    if (!pass(&w->left, b) || !pass(&w->left, a)) {
        return 0;
    }
    for (int64_t i = 0, j = w->left.count - 3; i < j; i++, j--) { /* against the way: b, a, then from the far end */
        const int32_t swap = w->left.at[i];
        w->left.at[i] = w->left.at[j];
        w->left.at[j] = swap;
    }
    w->left.at[w->left.count - 2] = a;
    w->left.at[w->left.count - 1] = b;
    if (!pass(&w->right, b) || !pass(&w->right, a)) {
        return 0;
    }
    qsort(w->crossed, (size_t)w->crossed_count, sizeof *w->crossed, by_index_down);
    for (int64_t i = 0; i < w->crossed_count; i++) {
        memmove(s->tri[w->crossed[i]], s->tri[--s->tri_count], sizeof *s->tri);
    }
    return cut_ears(s, w->left.at, w->left.count) && cut_ears(s, w->right.at, w->right.count);
}

int crx_enforce(sheet *s, int32_t a, int32_t b, int32_t other, way *w) {
    for (int64_t guard = 0; guard < 4 * (s->count + s->line_count) + 64; guard++) {
        int32_t third, to = b;
        for (int tries = 0; tries < 64; tries++) {
            if (crx_side_at(s, a, to, &third) >= 0 || crx_side_at(s, to, a, &third) >= 0) {
                break;
            }
            int32_t stop = -1;
            const int how = follow(s, a, to, other, w, &stop);
            if (how == LOST || (how == FREE && !open_way(s, a, to, w))) {
                return 0;
            }
            if (how == STOPPED) {
                to = stop;
            }
        }
        if ((crx_side_at(s, a, to, &third) < 0 && crx_side_at(s, to, a, &third) < 0) ||
            (crx_line_at(s, a, to) < 0 && !crx_add_line(s, a, to, other))) {
            return 0;
        }
        if (to == b) {
            return 1;
        }
        a = to;
    }
    return 0;
}
