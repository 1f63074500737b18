/* Edges and their triangles, normals, facets (flat), patches (smooth), creases. */
#include "mesh.h"

#include <stdlib.h>
#include <string.h>

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

static double edge_length(const crb_mesh *m, int32_t t, int k) {
    return norm(sub(corner_at(m, t, k + 1), corner_at(m, t, k)));
}

/* What is thinner than rounding has no face of its own: it belongs to the one that reaches it first. */
static void find_normals(crb_mesh *m, double thin) {
    for (int32_t t = 0; t < m->triangle_count; t++) {
        vec a = corner_at(m, t, 0), b = corner_at(m, t, 1), c = corner_at(m, t, 2);
        vec n = cross(sub(b, a), sub(c, a));
        m->area[t] = 0.5 * norm(n);
        m->normal[t] = unit(n);
        double longest = fmax(fmax(edge_length(m, t, 0), edge_length(m, t, 1)), edge_length(m, t, 2));
        m->face[t] = norm(n) <= thin * longest ? (vec){0.0, 0.0, 0.0} : m->normal[t];
        for (int k = 0; k < 3; k++) {
            vec u = unit(sub(corner_at(m, t, k + 1), corner_at(m, t, k)));
            vec v = unit(sub(corner_at(m, t, k + 2), corner_at(m, t, k)));
            double angle = acos(fmax(-1.0, fmin(1.0, dot(u, v))));
            int32_t at = corner(m, t, k);
            m->vertex_normal[at] = add(m->vertex_normal[at], mul(m->normal[t], angle));
        }
    }
}

static int has_face(const crb_mesh *m, int32_t t) { return dot(m->face[t], m->face[t]) > 0.0; }

/* Angle between the faces of a triangle and its neighbour; convex tells which way the edge bends. */
static double edge_angle(const crb_mesh *m, int32_t t, int k, int *convex) {
    int32_t o = m->neighbour[3 * (int64_t)t + k];
    vec a = m->face[t], b = m->face[o], along = sub(corner_at(m, t, k + 1), corner_at(m, t, k));
    *convex = dot(cross(a, b), along) > 0.0;
    return atan2(norm(cross(a, b)), dot(a, b));
}

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
    return !has_face(m, t) || dot(m->face[t], n) > 0.99;
}

/* Grow the set of label from seed: across edges of less than smooth_angle, or, where that is 0, as far as its plane goes. What
 * is no longer than point is no edge. */
static int64_t flood(crb_mesh *m, int32_t seed, int32_t label, int32_t *label_of, int32_t *queue,
                     double plane_tolerance, double point, double smooth_angle) {
    int64_t head = 0, tail = 0;
    vec n = m->face[seed];
    double offset = dot(n, corner_at(m, seed, 0));
    queue[tail++] = seed;
    label_of[seed] = label;
    while (head < tail) {
        int32_t t = queue[head++];
        for (int k = 0; k < 3; k++) {
            int32_t o = m->neighbour[3 * (int64_t)t + k];
            int convex;
            if (o < 0 || label_of[o] >= 0 || edge_length(m, t, k) <= point) {
                continue;
            }
            int ok = smooth_angle > 0.0 ? !has_face(m, o) || edge_angle(m, t, k, &convex) < smooth_angle
                                        : lies_in_plane(m, o, n, offset, plane_tolerance);
            if (ok) {
                if (smooth_angle > 0.0 && !has_face(m, o)) {
                    m->face[o] = m->face[t];
                }
                label_of[o] = label;
                queue[tail++] = o;
            }
        }
    }
    return tail;
}

static int find_facets(crb_mesh *m, double plane_tolerance, double thin) {
    int64_t n = m->triangle_count;
    int32_t *queue = malloc((size_t)n * sizeof *queue);
    flood_seed *seeds = malloc((size_t)n * sizeof *seeds);
    if (queue == NULL || seeds == NULL) {
        free(queue);
        free(seeds);
        return 0;
    }
    for (int32_t t = 0; t < n; t++) {
        seeds[t] = (flood_seed){has_face(m, t) ? m->area[t] : -1.0, t};
        m->facet_of[t] = m->patch_of[t] = -1;
    }
    qsort(seeds, (size_t)n, sizeof *seeds, by_area);
    for (int64_t i = 0; i < n; i++) {
        int32_t seed = seeds[i].triangle;
        if (seeds[i].area < 0.0) { /* what no face has reached has but its own normal, and so has all that is left */
            for (int64_t k = i; k < n; k++) {
                m->face[seeds[k].triangle] =
                    has_face(m, seeds[k].triangle) ? m->face[seeds[k].triangle] : m->normal[seeds[k].triangle];
                seeds[k].area = 0.0;
            }
        }
        if (m->facet_of[seed] < 0) {
            flood(m, seed, m->facet_count++, m->facet_of, queue, plane_tolerance, thin, 0.0);
        }
        if (m->patch_of[seed] < 0) {
            flood(m, seed, m->patch_count++, m->patch_of, queue, plane_tolerance, thin, m->crease_angle);
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
    return *angle >= m->crease_angle;
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

int crb_find_features(crb_mesh *m, double plane_tolerance_m, double thin_m) {
    find_normals(m, thin_m);
    if (!find_neighbours(m) || !find_facets(m, plane_tolerance_m, thin_m)) {
        return 0;
    }
    fit_planes(m);
    count_edges(m);
    return 1;
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
