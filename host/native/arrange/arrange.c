/* Every triangle cut along its lines, and the result handed out. */
#include "cuts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void aim(sheet *s, const int32_t *corners) {
    const double *a = position(s->cuts, corners[0]), *b = position(s->cuts, corners[1]),
                 *c = position(s->cuts, corners[2]);
    double best = 0.0;
    for (int k = 0; k < 3; k++) {
        const int x = (k + 1) % 3, y = (k + 2) % 3;
        const double area = (b[x] - a[x]) * (c[y] - a[y]) - (b[y] - a[y]) * (c[x] - a[x]);
        if (fabs(area) > best) {
            best = fabs(area);
            s->axis[0] = area > 0.0 ? x : y;
            s->axis[1] = area > 0.0 ? y : x;
        }
    }
}

typedef struct {
    int32_t id;
    double along;
} stop;

static int by_along(const void *a, const void *b) {
    const stop *p = a, *q = b;
    return p->along != q->along ? (p->along > q->along ? 1 : -1) : (p->id > q->id) - (p->id < q->id);
}

static int32_t partner(const segment *g, int32_t triangle) { return g->of[g->of[0] == triangle]; }

/* Where other triangles pass through a side of the parent: the vertex with that key, -1 when there is none. */
static int32_t stop_at(const crx_cuts *c, int32_t a, int32_t b, int32_t through) {
    const int32_t key[3] = {a < b ? a : b, a < b ? b : a, through};
    return c->on_edge.used > 0 ? c->on_edge.slot[crx_place_of(&c->on_edge, key)].id : -1;
}

static int insert_on_side(sheet *s, int k, stop *stops) {
    const crx_cuts *c = s->cuts;
    const int32_t *corners = c->corners + 3 * (int64_t)s->parent;
    const int32_t from = corners[k], to = corners[(k + 1) % 3];
    size_t n = 0;
    for (int64_t i = c->first[s->parent]; i < c->first[s->parent + 1]; i++) {
        const int32_t id = stop_at(c, from, to, partner(&c->segments[c->mine[i]], s->parent));
        if (id >= 0) {
            stops[n].id = id;
            stops[n].along = 0.0;
            for (int m = 0; m < 3; m++) {
                stops[n].along +=
                    (position(c, id)[m] - position(c, from)[m]) * (position(c, to)[m] - position(c, from)[m]);
            }
            n++;
        }
    }
    qsort(stops, n, sizeof *stops, by_along);
    int32_t before = k;
    for (size_t i = 0; i < n; i++) {
        const int32_t m = crx_local_of(s, stops[i].id) >= 0 ? -1 : crx_add_local(s, stops[i].id);
        if (m < 0 || !crx_split_edge(s, before, (k + 1) % 3, m)) {
            return 0;
        }
        before = m;
    }
    return 1;
}

static int cut_up(sheet *s, way *w, stop *stops) {
    const crx_cuts *c = s->cuts;
    for (int k = 0; k < 3; k++) {
        if (crx_add_local(s, c->corners[3 * (int64_t)s->parent + k]) < 0) {
            return 0;
        }
    }
    if (turn_of(s, 0, 1, 2) <= 0 || !crx_add_triangle(s, 0, 1, 2)) {
        return 0;
    }
    for (int k = 0; k < 3; k++) {
        if (!insert_on_side(s, k, stops)) {
            return 0;
        }
    }
    for (int64_t i = c->first[s->parent]; i < c->first[s->parent + 1]; i++) {
        const segment *g = &c->segments[c->mine[i]];
        for (int end = 0; end < 2; end++) {
            if (g->ends[end] >= 0 && crx_local_of(s, g->ends[end]) < 0) {
                const int32_t m = crx_add_local(s, g->ends[end]);
                if (m < 0 || !crx_insert_inside(s, m)) {
                    return 0;
                }
            }
        }
    }
    for (int64_t i = c->first[s->parent]; i < c->first[s->parent + 1]; i++) {
        const segment *g = &c->segments[c->mine[i]];
        if (g->ends[0] >= 0 &&
            !crx_enforce(s, crx_local_of(s, g->ends[0]), crx_local_of(s, g->ends[1]), partner(g, s->parent), w)) {
            return 0;
        }
    }
    return 1;
}

static int add_piece(crx_cuts *c, int32_t parent, const int32_t *corners) {
    if (!GROW(c->pieces, c->piece_count, c->piece_room)) {
        return 0;
    }
    if (!GROW(c->parents, c->piece_count, c->parent_room)) {
        return 0;
    }
    memcpy(c->pieces[c->piece_count], corners, sizeof c->pieces[0]);
    c->parents[c->piece_count++] = parent;
    return 1;
}

static int keep_pieces(crx_cuts *c, const sheet *s) {
    for (int64_t t = 0; t < s->tri_count; t++) {
        const int32_t corners[3] = {s->id[s->tri[t][0]], s->id[s->tri[t][1]], s->id[s->tri[t][2]]};
        if (!add_piece(c, s->parent, corners)) {
            return 0;
        }
    }
    for (int64_t i = 0; i < s->line_count; i++) {
        for (int end = 0; end < 2; end++) {
            if (!GROW(c->lines, c->line_count, c->line_room)) {
                return 0;
            }
            c->lines[c->line_count++] = s->id[s->lines[i].ends[end]];
        }
    }
    return 1;
}

static int cut_all(crx_cuts *c, size_t triangle_count) {
    sheet s = {.cuts = c};
    way w = {.crossed = NULL};
    int64_t most = 1;
    for (size_t t = 0; t < triangle_count; t++) {
        most = c->first[t + 1] - c->first[t] > most ? c->first[t + 1] - c->first[t] : most;
    }
    stop *stops = malloc((size_t)most * sizeof *stops);
    int fine = stops != NULL;
    for (size_t t = 0; fine && t < triangle_count; t++) {
        const int32_t *whole = c->corners + 3 * t;
        if (c->first[t + 1] == c->first[t]) {
            fine = add_piece(c, (int32_t)t, whole);
            continue;
        }
        s.parent = (int32_t)t;
        s.count = s.tri_count = s.line_count = 0;
        s.axis[0] = 0;
        s.axis[1] = 1;
        aim(&s, whole);
        if (cut_up(&s, &w, stops)) {
            fine = keep_pieces(c, &s);
        } else {
            c->failed++;
            fine = add_piece(c, (int32_t)t, whole);
        }
    }
    free(stops);
    free(s.id);
    free(s.at);
    free(s.tri);
    free(s.lines);
    free(w.left.at);
    free(w.right.at);
    free(w.crossed);
    return fine;
}

crx_cuts *crx_cut(const double *vertices, size_t vertex_count, const int32_t *triangles, size_t triangle_count,
                  const int32_t *pairs, size_t pair_count) {
    crx_cuts *c = calloc(1, sizeof *c);
    if (c == NULL) {
        return NULL;
    }
    c->corners = triangles;
    c->vertices = malloc((vertex_count + 1) * sizeof *c->vertices);
    if (c->vertices != NULL) {
        memcpy(c->vertices, vertices, vertex_count * sizeof *c->vertices);
        c->vertex_count = (int64_t)vertex_count;
        c->vertex_room = (int64_t)vertex_count + 1;
    }
    if (c->vertices == NULL || !crx_find_segments(c, triangle_count, pairs, pair_count) ||
        !cut_all(c, triangle_count)) {
        crx_free(c);
        return NULL;
    }
    c->corners = NULL;
    return c;
}

void crx_free(crx_cuts *c) {
    if (c != NULL) {
        free(c->vertices);
        free(c->pieces);
        free(c->parents);
        free(c->lines);
        free(c->on_edge.slot);
        free(c->of_three.slot);
        free(c->segments);
        free(c->first);
        free(c->mine);
        free(c);
    }
}

void crx_count(const crx_cuts *c, crx_counts *counts) {
    counts->vertices = c->vertex_count;
    counts->triangles = c->piece_count;
    counts->lines = c->line_count / 2;
    counts->failed = c->failed;
}

void crx_read(const crx_cuts *c, double *vertices, int32_t *triangles, int32_t *parent, int32_t *lines) {
    memcpy(vertices, c->vertices, (size_t)c->vertex_count * sizeof *c->vertices);
    memcpy(triangles, c->pieces, (size_t)c->piece_count * sizeof *c->pieces);
    memcpy(parent, c->parents, (size_t)c->piece_count * sizeof *parent);
    if (c->line_count > 0) {
        memcpy(lines, c->lines, (size_t)c->line_count * sizeof *lines);
    }
}
