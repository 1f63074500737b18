#include "bake.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    double x, y, z;
} vec;

static vec sub(vec a, vec b) { return (vec){a.x - b.x, a.y - b.y, a.z - b.z}; }
static vec add(vec a, vec b) { return (vec){a.x + b.x, a.y + b.y, a.z + b.z}; }
static vec mul(vec a, double s) { return (vec){a.x * s, a.y * s, a.z * s}; }
static double dot(vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static vec cross(vec a, vec b) { return (vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
static double norm(vec a) { return sqrt(dot(a, a)); }
static vec unit(vec a) {
    double n = norm(a);
    return n > 0.0 ? mul(a, 1.0 / n) : (vec){0.0, 0.0, 0.0};
}

typedef struct {
    vec low, high;
    int32_t right;        /* inner: index of the right child (the left one follows); leaf: -1 */
    int32_t first, count; /* leaf: range of order[] */
} node;

#define LEAF_MAX 4
#define STACK_MAX 96
#define WIDE 8
#define STACK_WIDE 512 /* seven for each level of the tree at most */

typedef struct {
    float low[3][WIDE], high[3][WIDE]; /* from the middle of the mesh */
    int32_t child[WIDE];               /* a wide node, or -1 - slot of a triangle, or 0: none */
} wide_node;

struct crb_mesh {
    int64_t vertex_count, triangle_count;
    vec *vertices;
    int32_t *triangles; /* [n][3] */
    int32_t *neighbour; /* [n][3] triangle across edge k (from corner k to k + 1), -1 when open */
    vec *normal;        /* unit, per triangle */
    double *area;
    vec *vertex_normal; /* angle-weighted */
    int32_t *facet_of, *patch_of;
    int32_t facet_count, patch_count;
    double *facet_plane;
    int32_t *facet_patch;
    double *facet_area;
    double crease_angle;
    int64_t smooth, convex, concave, open;
    node *nodes;
    int32_t node_count;
    int32_t *order; /* triangles in tree order */
    vec *corners;   /* [n][3] in tree order */
    wide_node *wide;
    int32_t wide_count;
    vec middle;
    float extent;
};

/* ---- adjacency ---------------------------------------------------------------------------------------------------- */

typedef struct {
    uint64_t key; /* smaller vertex in the high half, larger in the low half */
    int32_t triangle, side;
} half_edge;

static int by_key(const void *a, const void *b) {
    const half_edge *p = a, *q = b;
    if (p->key != q->key) {
        return p->key < q->key ? -1 : 1;
    }
    return p->triangle < q->triangle ? -1 : p->triangle > q->triangle;
}

static int corner(const crb_mesh *m, int32_t t, int k) { return m->triangles[3 * (int64_t)t + k % 3]; }
static vec corner_at(const crb_mesh *m, int32_t t, int k) { return m->vertices[corner(m, t, k)]; }

static int find_neighbours(crb_mesh *m) {
    int64_t n = 3 * m->triangle_count;
    half_edge *h = malloc((size_t)n * sizeof *h);
    if (h == NULL) {
        return 0;
    }
    for (int64_t i = 0; i < n; i++) {
        int32_t t = (int32_t)(i / 3), k = (int32_t)(i % 3);
        uint64_t a = (uint64_t)corner(m, t, k), b = (uint64_t)corner(m, t, k + 1);
        h[i].key = a < b ? a << 32 | b : b << 32 | a;
        h[i].triangle = t;
        h[i].side = k;
    }
    qsort(h, (size_t)n, sizeof *h, by_key);
    for (int64_t i = 0; i < n;) {
        int64_t end = i + 1;
        while (end < n && h[end].key == h[i].key) {
            end++;
        }
        int paired = end - i == 2;
        for (int64_t j = i; j < end; j++) {
            m->neighbour[3 * (int64_t)h[j].triangle + h[j].side] = paired ? h[i + (j == i)].triangle : -1;
        }
        m->open += paired ? 0 : 1;
        i = end;
    }
    free(h);
    return 1;
}

static void find_normals(crb_mesh *m) {
    for (int32_t t = 0; t < m->triangle_count; t++) {
        vec a = corner_at(m, t, 0), b = corner_at(m, t, 1), c = corner_at(m, t, 2);
        vec n = cross(sub(b, a), sub(c, a));
        m->area[t] = 0.5 * norm(n);
        m->normal[t] = unit(n);
        for (int k = 0; k < 3; k++) {
            vec u = unit(sub(corner_at(m, t, k + 1), corner_at(m, t, k)));
            vec v = unit(sub(corner_at(m, t, k + 2), corner_at(m, t, k)));
            double angle = acos(fmax(-1.0, fmin(1.0, dot(u, v))));
            int32_t at = corner(m, t, k);
            m->vertex_normal[at] = add(m->vertex_normal[at], mul(m->normal[t], angle));
        }
    }
}

/* Angle between the normals of a triangle and its neighbour; convex tells which way the edge bends. */
static double edge_angle(const crb_mesh *m, int32_t t, int k, int *convex) {
    int32_t o = m->neighbour[3 * (int64_t)t + k];
    vec a = m->normal[t], b = m->normal[o], along = sub(corner_at(m, t, k + 1), corner_at(m, t, k));
    *convex = dot(cross(a, b), along) > 0.0;
    return atan2(norm(cross(a, b)), dot(a, b));
}

/* ---- facets and patches ------------------------------------------------------------------------------------------- */

typedef struct {
    double area; /* beside the index: the comparison has no other way to it that threads would not share */
    int32_t triangle;
} flood_seed;

static int by_area(const void *a, const void *b) {
    const flood_seed *p = a, *q = b;
    if (p->area != q->area) {
        return p->area > q->area ? -1 : 1;
    }
    return p->triangle < q->triangle ? -1 : p->triangle > q->triangle;
}

static int lies_in_plane(const crb_mesh *m, int32_t t, vec n, double offset, double tolerance) {
    for (int k = 0; k < 3; k++) {
        if (fabs(dot(n, corner_at(m, t, k)) - offset) > tolerance) {
            return 0;
        }
    }
    return m->area[t] <= 0.0 || dot(m->normal[t], n) > 0.99;
}

/* Grow the set of label from seed across edges that accept lets through. */
static int64_t flood(const crb_mesh *m, int32_t seed, int32_t label, int32_t *label_of, int32_t *queue,
                     double plane_tolerance, double smooth_angle) {
    int64_t head = 0, tail = 0;
    vec n = m->normal[seed];
    double offset = dot(n, corner_at(m, seed, 0));
    queue[tail++] = seed;
    label_of[seed] = label;
    while (head < tail) {
        int32_t t = queue[head++];
        for (int k = 0; k < 3; k++) {
            int32_t o = m->neighbour[3 * (int64_t)t + k];
            int convex;
            if (o < 0 || label_of[o] >= 0) {
                continue;
            }
            int ok = smooth_angle > 0.0
                         ? m->area[o] <= 0.0 || m->area[t] <= 0.0 || edge_angle(m, t, k, &convex) < smooth_angle
                         : lies_in_plane(m, o, n, offset, plane_tolerance);
            if (ok) {
                label_of[o] = label;
                queue[tail++] = o;
            }
        }
    }
    return tail;
}

static int find_facets(crb_mesh *m, double plane_tolerance) {
    int64_t n = m->triangle_count;
    int32_t *queue = malloc((size_t)n * sizeof *queue);
    flood_seed *seeds = malloc((size_t)n * sizeof *seeds);
    if (queue == NULL || seeds == NULL) {
        free(queue);
        free(seeds);
        return 0;
    }
    for (int32_t t = 0; t < n; t++) {
        seeds[t] = (flood_seed){m->area[t], t};
        m->facet_of[t] = m->patch_of[t] = -1;
    }
    qsort(seeds, (size_t)n, sizeof *seeds, by_area);
    for (int64_t i = 0; i < n; i++) {
        int32_t seed = seeds[i].triangle;
        if (m->facet_of[seed] < 0) {
            flood(m, seed, m->facet_count++, m->facet_of, queue, plane_tolerance, 0.0);
        }
        if (m->patch_of[seed] < 0) {
            flood(m, seed, m->patch_count++, m->patch_of, queue, 0.0, m->crease_angle);
        }
    }
    free(queue);
    free(seeds);
    m->facet_plane = calloc((size_t)m->facet_count * 4, sizeof *m->facet_plane);
    m->facet_patch = calloc((size_t)m->facet_count, sizeof *m->facet_patch);
    m->facet_area = calloc((size_t)m->facet_count, sizeof *m->facet_area);
    return m->facet_plane != NULL && m->facet_patch != NULL && m->facet_area != NULL;
}

static void fit_planes(crb_mesh *m) {
    for (int32_t t = 0; t < m->triangle_count; t++) {
        double *p = m->facet_plane + 4 * (int64_t)m->facet_of[t];
        p[0] += m->normal[t].x * m->area[t];
        p[1] += m->normal[t].y * m->area[t];
        p[2] += m->normal[t].z * m->area[t];
        m->facet_area[m->facet_of[t]] += m->area[t];
        m->facet_patch[m->facet_of[t]] = m->patch_of[t];
    }
    for (int32_t f = 0; f < m->facet_count; f++) {
        double *p = m->facet_plane + 4 * (int64_t)f;
        vec n = unit((vec){p[0], p[1], p[2]});
        n = norm(n) > 0.5 ? n : (vec){0.0, 0.0, 1.0};
        p[0] = n.x;
        p[1] = n.y;
        p[2] = n.z;
    }
    for (int32_t t = 0; t < m->triangle_count; t++) {
        double *p = m->facet_plane + 4 * (int64_t)m->facet_of[t];
        vec c = mul(add(add(corner_at(m, t, 0), corner_at(m, t, 1)), corner_at(m, t, 2)), 1.0 / 3.0);
        double share = m->facet_area[m->facet_of[t]] > 0.0 ? m->area[t] / m->facet_area[m->facet_of[t]] : 0.0;
        p[3] += share * dot((vec){p[0], p[1], p[2]}, c);
    }
}

static int is_crease(const crb_mesh *m, int32_t t, int k, int *convex, double *angle) {
    int32_t o = m->neighbour[3 * (int64_t)t + k];
    if (o < t) { /* open edge, or counted from the other side */
        return 0;
    }
    *angle = edge_angle(m, t, k, convex);
    return *angle >= m->crease_angle && m->area[t] > 0.0 && m->area[o] > 0.0;
}

static void count_edges(crb_mesh *m) {
    for (int32_t t = 0; t < m->triangle_count; t++) {
        for (int k = 0; k < 3; k++) {
            int convex;
            double angle;
            if (is_crease(m, t, k, &convex, &angle)) {
                *(convex ? &m->convex : &m->concave) += 1;
            } else if (m->neighbour[3 * (int64_t)t + k] > t) {
                m->smooth++;
            }
        }
    }
}

/* ---- search tree -------------------------------------------------------------------------------------------------- */

typedef struct {
    crb_mesh *m;
    vec *centre;
    int32_t *order;
} builder;

static double axis_of(vec v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

/* Partial sort: the middle element of order[first, end) in place. */
static void split_middle(const builder *b, int32_t first, int32_t end, int32_t middle, int axis) {
    while (end - first > 1) {
        double pivot = axis_of(b->centre[b->order[first + (end - first) / 2]], axis);
        int32_t i = first, j = end - 1;
        while (i <= j) {
            while (axis_of(b->centre[b->order[i]], axis) < pivot) {
                i++;
            }
            while (axis_of(b->centre[b->order[j]], axis) > pivot) {
                j--;
            }
            if (i <= j) {
                int32_t swap = b->order[i];
                b->order[i++] = b->order[j];
                b->order[j--] = swap;
            }
        }
        if (middle <= j) {
            end = j + 1;
        } else if (middle >= i) {
            first = i;
        } else {
            return;
        }
    }
}

static void grow(vec *low, vec *high, vec p) {
    low->x = fmin(low->x, p.x);
    low->y = fmin(low->y, p.y);
    low->z = fmin(low->z, p.z);
    high->x = fmax(high->x, p.x);
    high->y = fmax(high->y, p.y);
    high->z = fmax(high->z, p.z);
}

static int32_t build_node(const builder *b, int32_t first, int32_t end) {
    crb_mesh *m = b->m;
    int32_t index = m->node_count++;
    node *n = &m->nodes[index];
    n->low = (vec){DBL_MAX, DBL_MAX, DBL_MAX};
    n->high = (vec){-DBL_MAX, -DBL_MAX, -DBL_MAX};
    vec low = n->low, high = n->high;
    for (int32_t i = first; i < end; i++) {
        for (int k = 0; k < 3; k++) {
            grow(&n->low, &n->high, corner_at(m, b->order[i], k));
        }
        grow(&low, &high, b->centre[b->order[i]]);
    }
    n->first = first;
    n->count = end - first;
    n->right = -1;
    if (end - first > LEAF_MAX) {
        vec size = sub(high, low);
        int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
        int32_t middle = first + (end - first) / 2;
        split_middle(b, first, end, middle, axis);
        build_node(b, first, middle);
        int32_t right = build_node(b, middle, end);
        m->nodes[index].right = right;
    }
    return index;
}

static int build_tree(crb_mesh *m) {
    int64_t n = m->triangle_count;
    builder b = {m, malloc((size_t)n * sizeof(vec)), malloc((size_t)n * sizeof(int32_t))};
    m->nodes = malloc((size_t)(2 * n + 1) * sizeof *m->nodes);
    m->corners = malloc((size_t)n * 3 * sizeof *m->corners);
    m->order = b.order;
    if (b.centre == NULL || b.order == NULL || m->nodes == NULL || m->corners == NULL) {
        free(b.centre);
        return 0;
    }
    for (int32_t t = 0; t < n; t++) {
        b.order[t] = t;
        b.centre[t] = mul(add(add(corner_at(m, t, 0), corner_at(m, t, 1)), corner_at(m, t, 2)), 1.0 / 3.0);
    }
    build_node(&b, 0, (int32_t)n);
    for (int64_t i = 0; i < n; i++) {
        for (int k = 0; k < 3; k++) {
            m->corners[3 * i + k] = corner_at(m, b.order[i], k);
        }
    }
    free(b.centre);
    return 1;
}

static int build_wide_tree(crb_mesh *m);

/* ---- set-up ------------------------------------------------------------------------------------------------------- */

void crb_mesh_free(crb_mesh *m) {
    if (m != NULL) {
        free(m->vertices);
        free(m->triangles);
        free(m->neighbour);
        free(m->normal);
        free(m->area);
        free(m->vertex_normal);
        free(m->facet_of);
        free(m->patch_of);
        free(m->facet_plane);
        free(m->facet_patch);
        free(m->facet_area);
        free(m->nodes);
        free(m->order);
        free(m->corners);
        free(m->wide);
        free(m);
    }
}

static int allocate(crb_mesh *m, int64_t nv, int64_t nt) {
    m->vertices = malloc((size_t)nv * sizeof *m->vertices);
    m->vertex_normal = calloc((size_t)nv, sizeof *m->vertex_normal);
    m->triangles = calloc((size_t)nt * 3, sizeof *m->triangles);
    m->neighbour = malloc((size_t)nt * 3 * sizeof *m->neighbour);
    m->normal = malloc((size_t)nt * sizeof *m->normal);
    m->area = malloc((size_t)nt * sizeof *m->area);
    m->facet_of = malloc((size_t)nt * sizeof *m->facet_of);
    m->patch_of = malloc((size_t)nt * sizeof *m->patch_of);
    return m->vertices && m->vertex_normal && m->triangles && m->neighbour && m->normal && m->area && m->facet_of &&
           m->patch_of;
}

crb_mesh *crb_mesh_new(const double *vertices_m, int64_t nv, const int32_t *triangles, int64_t nt,
                       double crease_angle_rad, double plane_tolerance_m) {
    crb_mesh *m = nv > 0 && nt > 0 && nt < INT32_MAX / 3 ? calloc(1, sizeof *m) : NULL;
    if (m == NULL || !allocate(m, nv, nt)) {
        crb_mesh_free(m);
        return NULL;
    }
    m->vertex_count = nv;
    m->triangle_count = nt;
    m->crease_angle = crease_angle_rad;
    for (int64_t i = 0; i < nv; i++) {
        m->vertices[i] = (vec){vertices_m[3 * i], vertices_m[3 * i + 1], vertices_m[3 * i + 2]};
    }
    for (int64_t i = 0; i < 3 * nt; i++) {
        if (triangles[i] < 0 || triangles[i] >= nv) {
            crb_mesh_free(m);
            return NULL;
        }
        m->triangles[i] = triangles[i];
    }
    find_normals(m);
    if (!find_neighbours(m) || !find_facets(m, plane_tolerance_m) || !build_tree(m) || !build_wide_tree(m)) {
        crb_mesh_free(m);
        return NULL;
    }
    fit_planes(m);
    count_edges(m);
    return m;
}

void crb_mesh_counts(const crb_mesh *m, crb_counts *c) {
    c->triangles = (int32_t)m->triangle_count;
    c->vertices = (int32_t)m->vertex_count;
    c->facets = m->facet_count;
    c->patches = m->patch_count;
    c->smooth_edges = (int32_t)m->smooth;
    c->convex_edges = (int32_t)m->convex;
    c->concave_edges = (int32_t)m->concave;
    c->open_edges = (int32_t)m->open;
}

void crb_mesh_features(const crb_mesh *m, int32_t *facet_of, int32_t *patch_of, double *facet_plane,
                       int32_t *facet_patch, double *facet_area_m2) {
    memcpy(facet_of, m->facet_of, (size_t)m->triangle_count * sizeof *facet_of);
    memcpy(patch_of, m->patch_of, (size_t)m->triangle_count * sizeof *patch_of);
    memcpy(facet_plane, m->facet_plane, (size_t)m->facet_count * 4 * sizeof *facet_plane);
    memcpy(facet_patch, m->facet_patch, (size_t)m->facet_count * sizeof *facet_patch);
    memcpy(facet_area_m2, m->facet_area, (size_t)m->facet_count * sizeof *facet_area_m2);
}

void crb_mesh_creases(const crb_mesh *m, double *ends_m, int32_t *patch, uint8_t *is_convex, double *angle_rad) {
    int64_t n = 0;
    for (int32_t t = 0; t < m->triangle_count; t++) {
        for (int k = 0; k < 3; k++) {
            int convex;
            double angle;
            if (!is_crease(m, t, k, &convex, &angle)) {
                continue;
            }
            vec a = corner_at(m, t, k), b = corner_at(m, t, k + 1);
            const double ends[6] = {a.x, a.y, a.z, b.x, b.y, b.z};
            memcpy(ends_m + 6 * n, ends, sizeof ends);
            patch[2 * n] = m->patch_of[t];
            patch[2 * n + 1] = m->patch_of[m->neighbour[3 * (int64_t)t + k]];
            is_convex[n] = (uint8_t)convex;
            angle_rad[n] = angle;
            n++;
        }
    }
}

/* ---- distance ----------------------------------------------------------------------------------------------------- */

/* Nearest point of a triangle; feature: 0..2 corner, 3..5 edge from corner k - 3, 6 face. */
static vec nearest_on_triangle(vec p, const vec *c, int *feature) {
    vec ab = sub(c[1], c[0]), ac = sub(c[2], c[0]), ap = sub(p, c[0]);
    double d1 = dot(ab, ap), d2 = dot(ac, ap);
    if (d1 <= 0.0 && d2 <= 0.0) {
        *feature = 0;
        return c[0];
    }
    vec bp = sub(p, c[1]);
    double d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0.0 && d4 <= d3) {
        *feature = 1;
        return c[1];
    }
    vec cp = sub(p, c[2]);
    double d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0.0 && d5 <= d6) {
        *feature = 2;
        return c[2];
    }
    double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
        *feature = 3;
        return add(c[0], mul(ab, d1 / (d1 - d3)));
    }
    if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        *feature = 4;
        return add(c[1], mul(sub(c[2], c[1]), (d4 - d3) / ((d4 - d3) + (d5 - d6))));
    }
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
        *feature = 5;
        return add(c[0], mul(ac, d2 / (d2 - d6)));
    }
    *feature = 6;
    double s = 1.0 / (va + vb + vc);
    return add(c[0], add(mul(ab, vb * s), mul(ac, vc * s)));
}

static double box_distance2(const node *n, vec p) {
    double x = fmax(fmax(n->low.x - p.x, 0.0), p.x - n->high.x);
    double y = fmax(fmax(n->low.y - p.y, 0.0), p.y - n->high.y);
    double z = fmax(fmax(n->low.z - p.z, 0.0), p.z - n->high.z);
    return x * x + y * y + z * z;
}

typedef struct {
    double distance2;
    int32_t slot; /* in tree order */
    int feature;
    vec point;
} nearest;

static void try_slot(const crb_mesh *m, vec p, int32_t slot, nearest *best) {
    int feature;
    vec q = nearest_on_triangle(p, m->corners + 3 * (int64_t)slot, &feature);
    vec d = sub(p, q);
    double d2 = dot(d, d);
    if (d2 < best->distance2) {
        *best = (nearest){d2, slot, feature, q};
    }
}

static void search(const crb_mesh *m, vec p, nearest *best) {
    int32_t stack[STACK_MAX];
    double bound[STACK_MAX];
    int depth = 0;
    stack[0] = 0;
    bound[0] = box_distance2(&m->nodes[0], p);
    depth = 1;
    while (depth > 0) {
        depth--;
        if (bound[depth] >= best->distance2) {
            continue;
        }
        int32_t i = stack[depth];
        const node *n = &m->nodes[i];
        if (n->right < 0) {
            for (int32_t s = n->first; s < n->first + n->count; s++) {
                try_slot(m, p, s, best);
            }
            continue;
        }
        double left = box_distance2(&m->nodes[i + 1], p), right = box_distance2(&m->nodes[n->right], p);
        int near_first = left <= right;
        stack[depth] = near_first ? n->right : i + 1;
        bound[depth++] = near_first ? right : left;
        stack[depth] = near_first ? i + 1 : n->right;
        bound[depth++] = near_first ? left : right;
    }
}

static vec pseudo_normal(const crb_mesh *m, const nearest *at) {
    int32_t t = m->order[at->slot];
    if (at->feature < 3) {
        return m->vertex_normal[corner(m, t, at->feature)];
    }
    if (at->feature == 6) {
        return m->normal[t];
    }
    static const int side_of[3] = {0, 1, 2}; /* features 3, 4, 5 are edges 01, 12, 20 */
    int32_t o = m->neighbour[3 * (int64_t)t + side_of[at->feature - 3]];
    return o >= 0 ? add(m->normal[t], m->normal[o]) : m->normal[t];
}

/* ---- the same, fast ------------------------------------------------------------------------------------------------
 * A tree with eight children a node, boxes in single precision, eight at once. It finds the same distance as the tree above. When
 * several triangles are exactly as near, which of them is taken follows from the order of that tree: then it is asked. */

#define ROOM                                                                                                           \
    (1.0 +                                                                                                             \
     1e-5) /* on squares: above the rounding of single precision, of which boxes and triangles have different shares */
#define GRAIN 4e-7f /* of the coordinates: rounding of boxes and points to single precision */

typedef struct {
    int32_t index, count; /* of a binary node, or a slot with count 0 */
} entry;

/* Children of a wide node: the binary node cut up, its largest part first, while there is room. */
static int32_t open_up(const crb_mesh *m, int32_t root, entry *part) {
    int32_t n = 1;
    part[0] = (entry){root, m->nodes[root].count};
    for (;;) {
        int32_t widest = -1;
        for (int32_t i = 0; i < n; i++) {
            const node *own = &m->nodes[part[i].count > 0 ? part[i].index : 0];
            const int32_t makes = own->right < 0 ? own->count : 2;
            if (part[i].count > 0 && n - 1 + makes <= WIDE && (widest < 0 || part[i].count > part[widest].count)) {
                widest = i;
            }
        }
        if (widest < 0) {
            return n;
        }
        const int32_t index = part[widest].index;
        const node *own = &m->nodes[index];
        part[widest] = part[--n];
        if (own->right >= 0) {
            part[n++] = (entry){index + 1, m->nodes[index + 1].count};
            part[n++] = (entry){own->right, m->nodes[own->right].count};
        } else {
            for (int32_t slot = own->first; slot < own->first + own->count; slot++) {
                part[n++] = (entry){slot, 0};
            }
        }
    }
}

static void set_box(wide_node *w, int32_t lane, vec low, vec high, vec origin) {
    for (int a = 0; a < 3; a++) {
        w->low[a][lane] = (float)(axis_of(low, a) - axis_of(origin, a));
        w->high[a][lane] = (float)(axis_of(high, a) - axis_of(origin, a));
    }
}

static int32_t build_wide(crb_mesh *m, int32_t root) {
    entry part[WIDE];
    const int32_t index = m->wide_count++, n = open_up(m, root, part);
    wide_node *w = &m->wide[index];
    for (int32_t lane = 0; lane < WIDE; lane++) {
        const double far = 1e18;
        set_box(w, lane, (vec){far, far, far}, (vec){far, far, far}, (vec){0.0, 0.0, 0.0});
        w->child[lane] = 0;
    }
    for (int32_t lane = 0; lane < n; lane++) {
        if (part[lane].count > 0) {
            set_box(w, lane, m->nodes[part[lane].index].low, m->nodes[part[lane].index].high, m->middle);
            w->child[lane] = build_wide(m, part[lane].index);
        } else {
            const vec *c = m->corners + 3 * (int64_t)part[lane].index;
            vec low = c[0], high = c[0];
            grow(&low, &high, c[1]);
            grow(&low, &high, c[2]);
            set_box(w, lane, low, high, m->middle);
            w->child[lane] = -1 - part[lane].index;
        }
    }
    return index;
}

static void gaps2(const wide_node *w, const float *p, float slack, float *gap2) {
    for (int i = 0; i < WIDE; i++) {
        float sum = 0.0f;
        for (int a = 0; a < 3; a++) {
            const float below = w->low[a][i] - p[a], above = p[a] - w->high[a][i];
            const float gap = (below > above ? below : above) - slack;
            sum += gap > 0.0f ? gap * gap : 0.0f;
        }
        gap2[i] = sum;
    }
}

typedef struct {
    int32_t node[STACK_WIDE];
    float gap2[STACK_WIDE];
    int32_t depth;
} todo;

/* Children that may hold something as near: onto the stack, the nearest on top. */
static void push_sorted(todo *t, const wide_node *w, const float *gap2, double limit) {
    const int32_t bottom = t->depth;
    for (int lane = 0; lane < WIDE; lane++) {
        if (w->child[lane] <= 0 || (double)gap2[lane] > limit) {
            continue;
        }
        int32_t at = t->depth++;
        while (at > bottom && t->gap2[at - 1] < gap2[lane]) {
            t->gap2[at] = t->gap2[at - 1];
            t->node[at] = t->node[at - 1];
            at--;
        }
        t->gap2[at] = gap2[lane];
        t->node[at] = w->child[lane];
    }
}

/* Betters `best`, whose slot is a first guess; tells whether another triangle is exactly as near. */
static int search_wide(const crb_mesh *m, vec p, nearest *best) {
    const vec from = sub(p, m->middle);
    const float at[3] = {(float)from.x, (float)from.y, (float)from.z};
    const float slack = GRAIN * (m->extent + fmaxf(fabsf(at[0]), fmaxf(fabsf(at[1]), fabsf(at[2]))));
    const int32_t guess = best->slot;
    int tied = 0;
    todo t = {.depth = 1, .node = {0}, .gap2 = {0.0f}};
    while (t.depth > 0) {
        t.depth--;
        if ((double)t.gap2[t.depth] > best->distance2 * ROOM) {
            continue;
        }
        const wide_node *w = &m->wide[t.node[t.depth]];
        float gap2[WIDE];
        gaps2(w, at, slack, gap2);
        for (int lane = 0; lane < WIDE; lane++) {
            const int32_t slot = -1 - w->child[lane];
            if (slot < 0 || slot == guess || (double)gap2[lane] > best->distance2 * ROOM) {
                continue;
            }
            nearest one = {DBL_MAX, 0, 6, p};
            try_slot(m, p, slot, &one);
            if (one.distance2 < best->distance2) {
                *best = one;
                tied = 0;
            } else if (one.distance2 == best->distance2) {
                tied = 1;
            }
        }
        push_sorted(&t, w, gap2, best->distance2 * ROOM);
    }
    return tied && best->slot != guess;
}

static int build_wide_tree(crb_mesh *m) {
    const node *root = &m->nodes[0];
    m->middle = mul(add(root->low, root->high), 0.5);
    m->extent = (float)norm(sub(root->high, root->low));
    m->wide = malloc((size_t)m->node_count * sizeof *m->wide);
    if (m->wide == NULL) {
        return 0;
    }
    (void)build_wide(m, 0);
    return 1;
}

void crb_signed_distance(const crb_mesh *m, const double *points_m, int64_t n, double *phi_m, int32_t *triangle) {
    int32_t last = 0;
    for (int64_t i = 0; i < n; i++) {
        const vec p = {points_m[3 * i], points_m[3 * i + 1], points_m[3 * i + 2]};
        nearest guess = {DBL_MAX, 0, 6, p};
        try_slot(m, p, last, &guess);
        nearest best = guess;
        if (search_wide(m, p, &best)) {
            best = guess;
            search(m, p, &best);
        }
        last = best.slot;
        const double d = sqrt(best.distance2);
        phi_m[i] = dot(sub(p, best.point), pseudo_normal(m, &best)) < 0.0 ? -d : d;
        triangle[i] = m->order[best.slot];
    }
}

/* ---- brick marking ------------------------------------------------------------------------------------------------ */

/* Separating-axis test of a triangle (relative to the box centre) with a box of half side h. Source Akenine-Moeller 2001. */
static int axis_separates(const vec *c, vec axis, double h) {
    double a = dot(c[0], axis), b = dot(c[1], axis), d = dot(c[2], axis);
    double r = h * (fabs(axis.x) + fabs(axis.y) + fabs(axis.z));
    return fmin(fmin(a, b), d) > r || fmax(fmax(a, b), d) < -r;
}

static int triangle_meets_box(const vec *corners, vec centre, double h) {
    vec c[3] = {sub(corners[0], centre), sub(corners[1], centre), sub(corners[2], centre)};
    static const vec axes[3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
    for (int i = 0; i < 3; i++) {
        if (axis_separates(c, axes[i], h)) {
            return 0;
        }
    }
    vec e[3] = {sub(c[1], c[0]), sub(c[2], c[1]), sub(c[0], c[2])};
    if (axis_separates(c, cross(e[0], e[1]), h)) {
        return 0;
    }
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            if (axis_separates(c, cross(axes[i], e[j]), h)) {
                return 0;
            }
        }
    }
    return 1;
}

static int64_t cell_of(double x, double origin, double side, int32_t count) {
    double c = floor((x - origin) / side);
    return c < 0.0 ? 0 : c > (double)(count - 1) ? count - 1 : (int64_t)c;
}

void crb_mark_bricks(const crb_mesh *m, const double *origin_m, double brick_m, const int32_t *dims, double reach_m,
                     uint8_t *near) {
    double h = 0.5 * brick_m + reach_m;
    for (int64_t t = 0; t < m->triangle_count; t++) {
        const vec *c = m->corners + 3 * t;
        vec low = c[0], high = c[0];
        grow(&low, &high, c[1]);
        grow(&low, &high, c[2]);
        int64_t lo[3] = {0}, hi[3] = {0};
        for (int a = 0; a < 3; a++) {
            lo[a] = cell_of(axis_of(low, a) - reach_m, origin_m[a], brick_m, dims[a]);
            hi[a] = cell_of(axis_of(high, a) + reach_m, origin_m[a], brick_m, dims[a]);
        }
        for (int64_t z = lo[2]; z <= hi[2]; z++) {
            for (int64_t y = lo[1]; y <= hi[1]; y++) {
                for (int64_t x = lo[0]; x <= hi[0]; x++) {
                    uint8_t *flag = &near[(z * dims[1] + y) * dims[0] + x];
                    vec centre = {origin_m[0] + ((double)x + 0.5) * brick_m, origin_m[1] + ((double)y + 0.5) * brick_m,
                                  origin_m[2] + ((double)z + 0.5) * brick_m};
                    if (!*flag && triangle_meets_box(c, centre, h)) {
                        *flag = 1;
                    }
                }
            }
        }
    }
}
