#include "intersect.h"

#include "exact.h"
#include "vec.h"

#include <math.h>
#include <stdlib.h>

#define LEAF_TRIANGLES 4u
#define STACK_NODES 64u

typedef struct {
    double low[3], high[3];
} box;

typedef struct {
    uint64_t key;
    int32_t triangle;
} keyed;

/* Implicit binary tree over the triangles in Morton order: node i has children 2i and 2i + 1, leaves start at leaf_first. */
typedef struct {
    const double *vertices;
    const int32_t *triangles;
    size_t triangle_count;
    keyed *order;
    box *boxes; /* of nodes */
    size_t leaf_first;
    double tolerance_m;
} surface;

static int side_of(vec a, vec b, vec c, vec d) {
    const double p[4][3] = {{a.x, a.y, a.z}, {b.x, b.y, b.z}, {c.x, c.y, c.z}, {d.x, d.y, d.z}};
    return cr_exact_side(p[0], p[1], p[2], p[3]);
}

static vec corner(const surface *s, int32_t triangle, int k) {
    const double *v = s->vertices + 3 * (size_t)s->triangles[3 * (size_t)triangle + (size_t)k];
    vec p = {v[0], v[1], v[2]};
    return p;
}

static box empty_box(void) {
    box b = {{HUGE_VAL, HUGE_VAL, HUGE_VAL}, {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}};
    return b;
}

static void grow_point(box *b, vec p) {
    const double v[3] = {p.x, p.y, p.z};
    for (int k = 0; k < 3; k++) {
        b->low[k] = v[k] < b->low[k] ? v[k] : b->low[k];
        b->high[k] = v[k] > b->high[k] ? v[k] : b->high[k];
    }
}

static void grow_box(box *b, const box *other) {
    for (int k = 0; k < 3; k++) {
        b->low[k] = other->low[k] < b->low[k] ? other->low[k] : b->low[k];
        b->high[k] = other->high[k] > b->high[k] ? other->high[k] : b->high[k];
    }
}

static box triangle_box(const surface *s, int32_t triangle) {
    box b = empty_box();
    for (int k = 0; k < 3; k++) {
        grow_point(&b, corner(s, triangle, k));
    }
    return b;
}

static int overlap(const box *a, const box *b) {
    return a->low[0] <= b->high[0] && b->low[0] <= a->high[0] && a->low[1] <= b->high[1] && b->low[1] <= a->high[1] &&
           a->low[2] <= b->high[2] && b->low[2] <= a->high[2];
}

/* 21 bits to every third bit of 63. */
static uint64_t spread_bits(uint64_t v) {
    v &= 0x1fffffu;
    v = (v | v << 32) & 0x1f00000000ffffu;
    v = (v | v << 16) & 0x1f0000ff0000ffu;
    v = (v | v << 8) & 0x100f00f00f00f00fu;
    v = (v | v << 4) & 0x10c30c30c30c30c3u;
    return (v | v << 2) & 0x1249249249249249u;
}

static int compare_keys(const void *a, const void *b) {
    const uint64_t left = ((const keyed *)a)->key;
    const uint64_t right = ((const keyed *)b)->key;
    if (left != right) {
        return left > right ? 1 : -1;
    }
    return ((const keyed *)a)->triangle > ((const keyed *)b)->triangle ? 1 : -1;
}

static void sort_triangles(surface *s) {
    box all = empty_box();
    for (size_t i = 0; i < s->triangle_count; i++) {
        const box b = triangle_box(s, (int32_t)i);
        grow_box(&all, &b);
    }
    for (size_t i = 0; i < s->triangle_count; i++) {
        const box b = triangle_box(s, (int32_t)i);
        uint64_t key = 0;
        for (int k = 0; k < 3; k++) {
            const double side = all.high[k] - all.low[k];
            const double at = side > 0.0 ? (0.5 * (b.low[k] + b.high[k]) - all.low[k]) / side : 0.0;
            key |= spread_bits((uint64_t)(at * 2097151.0)) << k;
        }
        s->order[i].key = key;
        s->order[i].triangle = (int32_t)i;
    }
    qsort(s->order, s->triangle_count, sizeof *s->order, compare_keys);
}

static void build_boxes(surface *s) {
    for (size_t leaf = 0; leaf < s->leaf_first; leaf++) {
        box b = empty_box();
        for (size_t i = leaf * LEAF_TRIANGLES; i < (leaf + 1) * LEAF_TRIANGLES && i < s->triangle_count; i++) {
            const box t = triangle_box(s, s->order[i].triangle);
            grow_box(&b, &t);
        }
        s->boxes[s->leaf_first + leaf] = b;
    }
    for (size_t node = s->leaf_first - 1; node >= 1; node--) {
        box b = s->boxes[2 * node];
        grow_box(&b, &s->boxes[2 * node + 1]);
        s->boxes[node] = b;
    }
}

/* The edge p q passes through triangle t: both ends are clear of its plane, and the passage is inside or on its rim. The rim
 * counts because symmetric shapes cross exactly edge on edge, and no other test would see that. Inside or not is decided
 * exactly: any room for rounding at the rim, taken along a shallow edge, is as long as the edge. */
static int edge_passes(vec p, vec q, const vec t[3], double tolerance_m) {
    const vec normal = cross(sub(t[1], t[0]), sub(t[2], t[0]));
    const double deep = tolerance_m * norm(normal);
    const double above = dot(normal, sub(p, t[0]));
    const double below = dot(normal, sub(q, t[0]));
    if (!((above > deep && below < -deep) || (above < -deep && below > deep))) {
        return 0;
    }
    const int turn = above > 0.0 ? -1 : 1;
    for (int k = 0; k < 3; k++) {
        if (turn * side_of(p, q, t[k], t[(k + 1) % 3]) < 0) {
            return 0;
        }
    }
    return 1;
}

/* Edges of `from` that touch the corner shared by both triangles cannot pass; skip holds that corner, or -1. */
static int any_edge_passes(const vec from[3], int skip, const vec through[3], double tolerance_m) {
    for (int k = 0; k < 3; k++) {
        if (k != skip && (k + 1) % 3 != skip && edge_passes(from[k], from[(k + 1) % 3], through, tolerance_m)) {
            return 1;
        }
    }
    return 0;
}

static int triangles_cross(const surface *s, int32_t a, int32_t b) {
    int shared = 0, skip_a = -1, skip_b = -1;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            if (s->triangles[3 * (size_t)a + (size_t)i] == s->triangles[3 * (size_t)b + (size_t)j]) {
                shared++;
                skip_a = i;
                skip_b = j;
            }
        }
    }
    if (shared > 1) {
        return 0;
    }
    const vec ta[3] = {corner(s, a, 0), corner(s, a, 1), corner(s, a, 2)};
    const vec tb[3] = {corner(s, b, 0), corner(s, b, 1), corner(s, b, 2)};
    return any_edge_passes(ta, skip_a, tb, s->tolerance_m) || any_edge_passes(tb, skip_b, ta, s->tolerance_m);
}

typedef struct {
    int32_t *pairs;
    size_t room;
    int64_t count;
} found;

static void note_pair(found *f, int32_t a, int32_t b) {
    if ((size_t)f->count < f->room) {
        f->pairs[2 * f->count] = a;
        f->pairs[2 * f->count + 1] = b;
    }
    f->count++;
}

static void look_in_leaf(const surface *s, size_t leaf, size_t after, int32_t triangle, found *f) {
    const box own = triangle_box(s, triangle);
    for (size_t i = leaf * LEAF_TRIANGLES; i < (leaf + 1) * LEAF_TRIANGLES && i < s->triangle_count; i++) {
        const int32_t other = s->order[i].triangle;
        const box theirs = triangle_box(s, other);
        if (i > after && overlap(&own, &theirs) && triangles_cross(s, triangle, other)) {
            note_pair(f, triangle, other);
        }
    }
}

/* Pairs of the triangle at place `at` of the order with those behind it. */
static void look_behind(const surface *s, size_t at, found *f) {
    const int32_t triangle = s->order[at].triangle;
    const box own = triangle_box(s, triangle);
    size_t stack[STACK_NODES];
    size_t depth = 0;
    stack[depth++] = 1;
    while (depth > 0) {
        const size_t node = stack[--depth];
        if (!overlap(&own, &s->boxes[node])) {
            continue;
        }
        if (node >= s->leaf_first) {
            look_in_leaf(s, node - s->leaf_first, at, triangle, f);
        } else {
            stack[depth++] = 2 * node;
            stack[depth++] = 2 * node + 1;
        }
    }
}

int64_t cr_mesh_self_intersections(const double *vertices, const int32_t *triangles, size_t triangle_count,
                                   double tolerance_m, int32_t *pairs, size_t pairs_max) {
    surface s = {vertices, triangles, triangle_count, NULL, NULL, 1, tolerance_m};
    while (s.leaf_first * LEAF_TRIANGLES < triangle_count) {
        s.leaf_first *= 2;
    }
    s.order = malloc(sizeof *s.order * (triangle_count + 1));
    s.boxes = malloc(sizeof *s.boxes * 2 * s.leaf_first);
    found f = {.room = pairs_max, .count = -1};
    f.pairs = pairs;
    if (s.order != NULL && s.boxes != NULL) {
        sort_triangles(&s);
        build_boxes(&s);
        f.count = 0;
        for (size_t i = 0; i < triangle_count; i++) {
            look_behind(&s, i, &f);
        }
    }
    free(s.order);
    free(s.boxes);
    return f.count;
}
