/* The two search trees: a binary one in double precision, and from it one of eight children in single. */
#include "mesh.h"

#include <float.h>
#include <stdlib.h>

#define LEAF_MAX 4
#define REACH_LEAST 65536 /* triangles from which on a mesh has wide_reach */
#define MEAN_LEAST 0.1    /* length of the mean of unit normals below which it is no direction */

typedef struct {
    crb_mesh *m;
    vec *centre;
    int32_t *order;
} builder;

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

/* ---- eight children a node ---------------------------------------------------------------------------------------- */

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

/* How far the corners of slots first..end - 1 lie from a line through their middle. */
static void set_reach(const crb_mesh *m, wide_reach *r, int32_t lane, int32_t first, int32_t end, vec along) {
    vec low = m->corners[3 * (int64_t)first], high = low;
    for (int64_t i = 3 * (int64_t)first; i < 3 * (int64_t)end; i++) {
        grow(&low, &high, m->corners[i]);
    }
    const vec middle = sub(mul(add(low, high), 0.5), m->middle);
    for (int a = 0; a < 3; a++) {
        r->centre[a][lane] = (float)axis_of(middle, a);
    }
    const vec at = {(double)r->centre[0][lane], (double)r->centre[1][lane], (double)r->centre[2][lane]};
    double across2 = 0.0;
    for (int64_t i = 3 * (int64_t)first; i < 3 * (int64_t)end; i++) {
        const vec way = sub(sub(m->corners[i], m->middle), at);
        const double up = dot(along, way);
        across2 = fmax(across2, dot(way, way) - up * up);
    }
    r->across[lane] = (float)(sqrt(across2) * (1.0 + 1e-6));
}

/* Two planes that hold the triangles of slots first..end - 1, across their mean normal; none, where they look all ways. */
static void set_planes(const crb_mesh *m, int32_t index, int32_t lane, int32_t first, int32_t end) {
    wide_node *w = &m->wide[index];
    vec sum = {0.0, 0.0, 0.0};
    double area = 0.0;
    for (int32_t slot = first; slot < end; slot++) {
        const int32_t t = m->order[slot];
        sum = add(sum, mul(m->normal[t], m->area[t]));
        area += m->area[t];
    }
    /* Rounded to single precision it stays below length 1, so that no height is overstated. */
    const vec n = norm(sum) > MEAN_LEAST * area ? mul(unit(sum), 1.0 - 1e-6) : (vec){0.0, 0.0, 0.0};
    const vec along = {(double)(float)n.x, (double)(float)n.y, (double)(float)n.z};
    double under = DBL_MAX, over = -DBL_MAX;
    for (int64_t i = 3 * (int64_t)first; i < 3 * (int64_t)end; i++) {
        const double height = dot(along, sub(m->corners[i], m->middle));
        under = fmin(under, height);
        over = fmax(over, height);
    }
    for (int a = 0; a < 3; a++) {
        w->normal[a][lane] = (float)axis_of(n, a);
    }
    w->under[lane] = (float)under;
    w->over[lane] = (float)over;
    if (m->reach != NULL) {
        set_reach(m, &m->reach[index], lane, first, end, along);
    }
}

static int32_t build_wide(crb_mesh *m, int32_t root) {
    entry part[WIDE];
    const int32_t index = m->wide_count++, n = open_up(m, root, part);
    wide_node *w = &m->wide[index];
    for (int32_t lane = 0; lane < WIDE; lane++) {
        const double far = 1e18;
        set_box(w, lane, (vec){far, far, far}, (vec){far, far, far}, (vec){0.0, 0.0, 0.0});
        for (int a = 0; a < 3; a++) {
            w->normal[a][lane] = 0.0f;
        }
        w->under[lane] = w->over[lane] = 0.0f;
        w->child[lane] = 0;
    }
    for (int32_t lane = 0; lane < n; lane++) {
        if (part[lane].count > 0) {
            const node *own = &m->nodes[part[lane].index];
            set_box(w, lane, own->low, own->high, m->middle);
            set_planes(m, index, lane, own->first, own->first + own->count);
            w->child[lane] = build_wide(m, part[lane].index);
        } else {
            const vec *c = m->corners + 3 * (int64_t)part[lane].index;
            vec low = c[0], high = c[0];
            grow(&low, &high, c[1]);
            grow(&low, &high, c[2]);
            set_box(w, lane, low, high, m->middle);
            set_planes(m, index, lane, part[lane].index, part[lane].index + 1);
            w->child[lane] = -1 - part[lane].index;
        }
    }
    return index;
}

static int build_wide_tree(crb_mesh *m) {
    const node *root = &m->nodes[0];
    m->middle = mul(add(root->low, root->high), 0.5);
    m->extent = (float)norm(sub(root->high, root->low));
    const int has_reach = m->triangle_count >= REACH_LEAST;
    m->wide = malloc((size_t)m->node_count * sizeof *m->wide);
    m->reach = has_reach ? calloc((size_t)m->node_count, sizeof *m->reach) : NULL;
    if (m->wide == NULL || (has_reach && m->reach == NULL)) {
        return 0;
    }
    (void)build_wide(m, 0);
    return 1;
}

int crb_build_trees(crb_mesh *m) { return build_tree(m) && build_wide_tree(m); }
