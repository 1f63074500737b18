/* Nearest triangle, exact distance and its sign.
 * Our own, because libraries take longer for the same numbers. One thread, the 4.1 million points that the bake of the 45,000-triangle
 * block asks for, us a point: 0.42 here, 0.67 Embree 3.13 (point query in single precision, distances in double in its callback), 0.86
 * libigl 2.6 (AABB), 152 trimesh 5.2; on a part of 3,476 triangles 0.77 against libigl's 5.0. tests/host/test_surface.py asks libigl.
 * That was with boxes alone, one at a time; planes beside them, and eight at once, take 0.4 to 0.55 of it. */
#include "mesh.h"

#include <float.h>
#include <string.h>

#define TIED_MAX 16    /* triangles round a vertex, mostly */
#define STACK_WIDE 512 /* seven for each level of the tree at most */

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

/* Of slots that are exactly as near, the first that a search would come to that takes the nearer half of the tree first. */
static int32_t first_of(const crb_mesh *m, vec p, int32_t *slot, int32_t count) {
    int32_t i = 0;
    while (count > 1 && m->nodes[i].right >= 0) {
        const int32_t left = i + 1, right = m->nodes[i].right, middle = m->nodes[right].first;
        int32_t low = 0;
        for (int32_t k = 0; k < count; k++) {
            low += slot[k] < middle;
        }
        const int goes_left =
            low == count || (low > 0 && box_distance2(&m->nodes[left], p) <= box_distance2(&m->nodes[right], p));
        int32_t kept = 0;
        for (int32_t k = 0; k < count; k++) {
            if ((slot[k] < middle) == goes_left) {
                slot[kept++] = slot[k];
            }
        }
        count = kept;
        i = goes_left ? left : right;
    }
    int32_t first = slot[0];
    for (int32_t k = 1; k < count; k++) {
        first = slot[k] < first ? slot[k] : first;
    }
    return first;
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

/* ---- the search ----------------------------------------------------------------------------------------------------
 * A tree with eight children a node, boxes and planes in single precision, eight at once. Where several triangles are exactly as
 * near, the binary tree it was made of says which of them is taken. */

/* On squares: above the rounding of single precision, of which boxes and triangles have different shares. */
#define ROOM (1.0 + 1e-5)
#define LEAN 4e-6f  /* on squares: above the rounding of normals and of places from a line along one */
#define GRAIN 4e-7f /* of the coordinates: rounding of boxes and points to single precision */

/* Eight numbers at once, by an extension of gcc and clang: neither makes such instructions of loops that choose. */
typedef float lanes __attribute__((vector_size(4 * WIDE)));
typedef int32_t lane_bits __attribute__((vector_size(4 * WIDE)));

/* The larger of each, in a. */
static inline void take_more(lanes *a, const lanes *b) {
    const lane_bits is_more = *a > *b;
    *a = (lanes)((is_more & (lane_bits)*a) | (~is_more & (lane_bits)*b));
}

/* How far a place is below low or above high; no less than zero. */
static inline void set_gap(lanes *gap, const float *low, const float *high, const lanes *place, float slack) {
    const lanes none = {0.0f};
    lanes under, over;
    memcpy(&under, low, sizeof under);
    memcpy(&over, high, sizeof over);
    under -= *place;
    over = *place - over;
    take_more(&under, &over);
    *gap = under - slack;
    take_more(gap, &none);
}

/* Squares of how far a point is outside of boxes, or of planes: the larger. up: how far outside of the planes. */
static void gaps2(const wide_node *w, const float *p, float slack, lanes *sum, lanes *up) {
    const lanes none = {0.0f};
    lanes height = none, gap;
    *sum = none;
    for (int a = 0; a < 3; a++) {
        const lanes place = none + p[a];
        lanes normal;
        set_gap(&gap, w->low[a], w->high[a], &place, slack);
        *sum += gap * gap;
        memcpy(&normal, w->normal[a], sizeof normal);
        height += normal * place;
    }
    set_gap(up, w->under, w->over, &height, 3.0f * slack);
    gap = *up * *up;
    take_more(sum, &gap);
}

/* The same with how far it is outside of cylinders between the planes. */
static void add_reach(const wide_node *w, const wide_reach *r, const float *p, float slack, const lanes *up,
                      lanes *sum) {
    const lanes none = {0.0f};
    lanes far2 = none, along = none, across;
    for (int a = 0; a < 3; a++) {
        lanes normal, way;
        memcpy(&normal, w->normal[a], sizeof normal);
        memcpy(&way, r->centre[a], sizeof way);
        way = p[a] - way;
        far2 += way * way;
        along += normal * way;
    }
    far2 = far2 * (1.0f - LEAN) - along * along * (1.0f + LEAN);
    take_more(&far2, &none);
    for (int lane = 0; lane < WIDE; lane++) {
        far2[lane] = sqrtf(far2[lane]);
    }
    memcpy(&across, r->across, sizeof across);
    far2 -= across + 3.0f * slack;
    take_more(&far2, &none);
    far2 = far2 * far2 + *up * *up;
    take_more(sum, &far2);
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

/* One more slot that is as near as those before; of more than there is room for only the first stays, as of all. */
static int32_t keep_tied(const crb_mesh *m, vec p, int32_t slot, int32_t *tied, int32_t count) {
    if (count == TIED_MAX) {
        tied[0] = first_of(m, p, tied, count);
        count = 1;
    }
    tied[count] = slot;
    return count + 1;
}

/* Betters `best`, whose slot is a first guess. */
static void search_wide(const crb_mesh *m, vec p, nearest *best) {
    const vec from = sub(p, m->middle);
    const float at[3] = {(float)from.x, (float)from.y, (float)from.z};
    const float slack = GRAIN * (m->extent + fmaxf(fabsf(at[0]), fmaxf(fabsf(at[1]), fabsf(at[2]))));
    const int32_t guess = best->slot;
    int32_t tied[TIED_MAX], tied_count = 1;
    todo t; /* not set to zero: that takes as long as a search */
    t.depth = 1;
    t.node[0] = 0;
    t.gap2[0] = 0.0f;
    while (t.depth > 0) {
        t.depth--;
        if ((double)t.gap2[t.depth] > best->distance2 * ROOM) {
            continue;
        }
        const wide_node *w = &m->wide[t.node[t.depth]];
        float gap2[WIDE];
        lanes sum, up;
        gaps2(w, at, slack, &sum, &up);
        if (m->reach != NULL) {
            add_reach(w, &m->reach[t.node[t.depth]], at, slack, &up, &sum);
        }
        memcpy(gap2, &sum, sizeof sum);
        for (int lane = 0; lane < WIDE; lane++) {
            const int32_t slot = -1 - w->child[lane];
            if (slot < 0 || slot == guess || (double)gap2[lane] > best->distance2 * ROOM) {
                continue;
            }
            nearest one = {DBL_MAX, 0, 6, p};
            try_slot(m, p, slot, &one);
            if (one.distance2 < best->distance2) {
                *best = one;
                tied[0] = slot;
                tied_count = 1;
            } else if (one.distance2 == best->distance2 && best->slot != guess) {
                tied_count = keep_tied(m, p, slot, tied, tied_count);
            }
        }
        push_sorted(&t, w, gap2, best->distance2 * ROOM);
    }
    if (tied_count > 1) {
        const int32_t first = first_of(m, p, tied, tied_count);
        best->distance2 = DBL_MAX;
        try_slot(m, p, first, best);
    }
}

double crb_distance_at(const crb_mesh *m, vec p, int32_t *slot) {
    nearest best = {DBL_MAX, 0, 6, p};
    try_slot(m, p, *slot, &best);
    search_wide(m, p, &best);
    *slot = best.slot;
    const double d = sqrt(best.distance2);
    return dot(sub(p, best.point), pseudo_normal(m, &best)) < 0.0 ? -d : d;
}

void crb_signed_distance(const crb_mesh *m, const double *points_m, int64_t n, double *phi_m, int32_t *triangle) {
    int32_t slot = 0;
    for (int64_t i = 0; i < n; i++) {
        phi_m[i] = crb_distance_at(m, (vec){points_m[3 * i], points_m[3 * i + 1], points_m[3 * i + 2]}, &slot);
        triangle[i] = m->order[slot];
    }
}
