#include "arrange.h"

#include "exact.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- growing arrays, and a table of points by three numbers -------------------------------------------------------- */

/* Twice the room, at least 64 elements of size bytes; null, and nothing kept: out of memory. */
static void *enlarged(void *array, int64_t *room, size_t size) {
    *room = *room > 0 ? 2 * *room : 64;
    void *more = realloc(array, (size_t)*room * size);
    if (more == NULL) {
        free(array);
        *room = 0;
    }
    return more;
}

/* Whether there is room for one more behind count, which may move the array. */
#define GROW(array, count, room) ((count) < (room) || ((array) = enlarged((array), &(room), sizeof *(array))) != NULL)

typedef struct {
    int32_t key[3], id;
} keyed_point;

typedef struct {
    keyed_point *slot; /* id -1: free */
    size_t room, used;
} point_table;

static size_t place_of(const point_table *t, const int32_t *key) {
    uint64_t hash = 0x9e3779b97f4a7c15u;
    for (int k = 0; k < 3; k++) {
        hash = (hash ^ (uint64_t)(uint32_t)key[k]) * 0xff51afd7ed558ccdu;
        hash ^= hash >> 32;
    }
    size_t at = (size_t)hash & (t->room - 1);
    while (t->slot[at].id >= 0 && memcmp(t->slot[at].key, key, sizeof t->slot[at].key) != 0) {
        at = (at + 1) & (t->room - 1);
    }
    return at;
}

static int reserve(point_table *t, size_t room) {
    point_table more = {malloc(room * sizeof *more.slot), room, t->used};
    if (more.slot == NULL) {
        return 0;
    }
    for (size_t i = 0; i < room; i++) {
        more.slot[i].id = -1;
    }
    for (size_t i = 0; i < t->room; i++) {
        if (t->slot[i].id >= 0) {
            more.slot[place_of(&more, t->slot[i].key)] = t->slot[i];
        }
    }
    free(t->slot);
    *t = more;
    return 1;
}

/* ---- the arrangement ------------------------------------------------------------------------------------------------ */

typedef struct {
    int32_t ends[2], of[2]; /* vertices, -1 when the two only touch; the two triangles */
} segment;

struct crx_cuts {
    const int32_t *corners; /* of the triangles given; not kept after crx_cut */
    double (*vertices)[3];
    int64_t vertex_count, vertex_room;
    int32_t (*pieces)[3], *parents;
    int64_t piece_count, piece_room, parent_room;
    int32_t *lines;
    int64_t line_count, line_room;
    int64_t failed;
    point_table on_edge;  /* key: edge (lower, higher vertex), triangle it passes through */
    point_table of_three; /* key: three triangles, ascending */
    segment *segments;    /* one for each pair */
    int64_t *first;       /* of the segments of each triangle in `mine` */
    int64_t *mine;        /* segment indices by triangle */
};

static const double *position(const crx_cuts *c, int32_t id) { return c->vertices[id]; }

static int32_t add_vertex(crx_cuts *c, const double *p) {
    if (!GROW(c->vertices, c->vertex_count, c->vertex_room)) {
        return -1;
    }
    memcpy(c->vertices[c->vertex_count], p, sizeof c->vertices[0]);
    return (int32_t)c->vertex_count++;
}

/* The vertex of a key, made at p when it is new; -1: out of memory. */
static int32_t vertex_of(crx_cuts *c, point_table *t, const int32_t *key, const double *p) {
    if (2 * (t->used + 1) > t->room && !reserve(t, t->room > 0 ? 2 * t->room : 256)) {
        return -1;
    }
    keyed_point *slot = &t->slot[place_of(t, key)];
    if (slot->id < 0) {
        const int32_t id = add_vertex(c, p);
        if (id < 0) {
            return -1;
        }
        memcpy(slot->key, key, sizeof slot->key);
        slot->id = id;
        t->used++;
    }
    return slot->id;
}

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
    const int32_t id = vertex_of(c, &c->on_edge, key, at);
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

/* ---- one triangle -------------------------------------------------------------------------------------------------- */

typedef struct {
    int32_t ends[2], other; /* local vertices */
} line;

typedef struct {
    crx_cuts *cuts;
    int32_t parent;
    int32_t *id; /* vertex of each local one */
    double (*at)[2];
    int32_t (*tri)[3];
    line *lines;
    int64_t count, id_room, at_room, tri_count, tri_room, line_count, line_room;
    int axis[2]; /* coordinates that make its plane, counter-clockwise */
} sheet;

static int turn_of(const sheet *s, int32_t a, int32_t b, int32_t c) {
    return cr_exact_turn(s->at[a], s->at[b], s->at[c]);
}

static int32_t local_of(sheet *s, int32_t id) {
    for (int32_t i = 0; i < s->count; i++) {
        if (s->id[i] == id) {
            return i;
        }
    }
    return -1;
}

static int32_t add_local(sheet *s, int32_t id) {
    if (!GROW(s->id, s->count, s->id_room) || !GROW(s->at, s->count, s->at_room)) {
        return -1;
    }
    s->id[s->count] = id;
    s->at[s->count][0] = position(s->cuts, id)[s->axis[0]];
    s->at[s->count][1] = position(s->cuts, id)[s->axis[1]];
    return (int32_t)s->count++;
}

static int add_triangle(sheet *s, int32_t a, int32_t b, int32_t c) {
    if (!GROW(s->tri, s->tri_count, s->tri_room)) {
        return 0;
    }
    s->tri[s->tri_count][0] = a;
    s->tri[s->tri_count][1] = b;
    s->tri[s->tri_count][2] = c;
    s->tri_count++;
    return 1;
}

static int add_line(sheet *s, int32_t a, int32_t b, int32_t other) {
    if (!GROW(s->lines, s->line_count, s->line_room)) {
        return 0;
    }
    s->lines[s->line_count++] = (line){{a, b}, other};
    return 1;
}

static int64_t line_at(const sheet *s, int32_t a, int32_t b) {
    for (int64_t i = 0; s->lines != NULL && i < s->line_count; i++) {
        const int32_t *e = s->lines[i].ends;
        if ((e[0] == a && e[1] == b) || (e[0] == b && e[1] == a)) {
            return i;
        }
    }
    return -1;
}

/* Triangle with the side a to b, and its third corner; -1: none. */
static int64_t side_at(const sheet *s, int32_t a, int32_t b, int32_t *third) {
    for (int64_t t = 0; t < s->tri_count; t++) {
        for (int k = 0; k < 3; k++) {
            if (s->tri[t][k] == a && s->tri[t][(k + 1) % 3] == b) {
                *third = s->tri[t][(k + 2) % 3];
                return t;
            }
        }
    }
    return -1;
}

static void set_triangle(sheet *s, int64_t t, int32_t a, int32_t b, int32_t c) {
    s->tri[t][0] = a;
    s->tri[t][1] = b;
    s->tri[t][2] = c;
}

/* Vertex m comes between a and b, on both sides of that edge. */
static int split_edge(sheet *s, int32_t a, int32_t b, int32_t m) {
    const int64_t on = line_at(s, a, b);
    if (on >= 0 && s->lines != NULL) {
        const line whole = s->lines[on];
        s->lines[on] = (line){{whole.ends[0], m}, whole.other};
        if (!add_line(s, m, whole.ends[1], whole.other)) {
            return 0;
        }
    }
    for (int way = 0; way < 2; way++) {
        const int32_t from = way ? b : a, to = way ? a : b;
        int32_t third;
        const int64_t t = side_at(s, from, to, &third);
        if (t >= 0) {
            set_triangle(s, t, from, m, third);
            if (!add_triangle(s, m, to, third)) {
                return 0;
            }
        }
    }
    return 1;
}

/* A vertex inside; 0: nowhere, or on another one. */
static int insert_inside(sheet *s, int32_t m) {
    for (int64_t t = 0; t < s->tri_count; t++) {
        const int32_t v[3] = {s->tri[t][0], s->tri[t][1], s->tri[t][2]};
        const int turn[3] = {turn_of(s, v[0], v[1], m), turn_of(s, v[1], v[2], m), turn_of(s, v[2], v[0], m)};
        if (turn[0] < 0 || turn[1] < 0 || turn[2] < 0) {
            continue;
        }
        if ((turn[0] == 0) + (turn[1] == 0) + (turn[2] == 0) > 1) {
            return 0;
        }
        for (int k = 0; k < 3; k++) {
            if (turn[k] == 0) {
                return split_edge(s, v[k], v[(k + 1) % 3], m);
            }
        }
        set_triangle(s, t, v[0], v[1], m);
        return add_triangle(s, v[1], v[2], m) && add_triangle(s, v[2], v[0], m);
    }
    return 0;
}

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
    const int32_t id = vertex_of(s->cuts, &s->cuts->of_three, key, at);
    return id < 0 || local_of(s, id) >= 0 ? -1 : add_local(s, id);
}

typedef struct {
    int32_t *at;
    int64_t count, room;
} chain;

/* Corners that the way from a to b passes on either side, and the triangles between them. */
typedef struct {
    chain left, right;
    int64_t *crossed;
    int64_t crossed_count, crossed_room;
} way;

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
        const int64_t on = line_at(s, u, v);
        if (on >= 0 && s->lines != NULL) {
            const line across = s->lines[on];
            *stop = meeting_point(s, a, b, other, &across);
            return *stop >= 0 && split_edge(s, u, v, *stop) ? STOPPED : LOST;
        }
        t = side_at(s, v, u, &q);
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
        if (ear == n || !add_triangle(s, rim[(ear + n - 1) % n], rim[ear], rim[(ear + 1) % n])) {
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

/* An edge from a to b, or edges through what lies on the way; marked as the line with triangle `other`. 0: failed. */
static int enforce(sheet *s, int32_t a, int32_t b, int32_t other, way *w) {
    for (int64_t guard = 0; guard < 4 * (s->count + s->line_count) + 64; guard++) {
        int32_t third, to = b;
        for (int tries = 0; tries < 64; tries++) {
            if (side_at(s, a, to, &third) >= 0 || side_at(s, to, a, &third) >= 0) {
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
        if ((side_at(s, a, to, &third) < 0 && side_at(s, to, a, &third) < 0) ||
            (line_at(s, a, to) < 0 && !add_line(s, a, to, other))) {
            return 0;
        }
        if (to == b) {
            return 1;
        }
        a = to;
    }
    return 0;
}

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
    return c->on_edge.used > 0 ? c->on_edge.slot[place_of(&c->on_edge, key)].id : -1;
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
        const int32_t m = local_of(s, stops[i].id) >= 0 ? -1 : add_local(s, stops[i].id);
        if (m < 0 || !split_edge(s, before, (k + 1) % 3, m)) {
            return 0;
        }
        before = m;
    }
    return 1;
}

static int cut_up(sheet *s, way *w, stop *stops) {
    const crx_cuts *c = s->cuts;
    for (int k = 0; k < 3; k++) {
        if (add_local(s, c->corners[3 * (int64_t)s->parent + k]) < 0) {
            return 0;
        }
    }
    if (turn_of(s, 0, 1, 2) <= 0 || !add_triangle(s, 0, 1, 2)) {
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
            if (g->ends[end] >= 0 && local_of(s, g->ends[end]) < 0) {
                const int32_t m = add_local(s, g->ends[end]);
                if (m < 0 || !insert_inside(s, m)) {
                    return 0;
                }
            }
        }
    }
    for (int64_t i = c->first[s->parent]; i < c->first[s->parent + 1]; i++) {
        const segment *g = &c->segments[c->mine[i]];
        if (g->ends[0] >= 0 &&
            !enforce(s, local_of(s, g->ends[0]), local_of(s, g->ends[1]), partner(g, s->parent), w)) {
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

/* Segments of all pairs, and which of them belong to each triangle. */
static int find_segments(crx_cuts *c, size_t triangle_count, const int32_t *pairs, size_t pair_count) {
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
    if (c->vertices == NULL || !find_segments(c, triangle_count, pairs, pair_count) || !cut_all(c, triangle_count)) {
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
