#include "winding.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LEAF_MAX 8
#define STACK_MAX 128
#define BETA 3.0 /* a node this many radii away is answered as one */

static const double FOUR_PI = 12.566370614359172;

typedef struct {
    double middle[3], dipole[3], spread[3][3]; /* sums of area normals, and of their places from the middle */
    double radius2;
    int32_t first, count, right; /* leaf: right -1; else the left child follows */
} part;

struct crw_tree {
    double (*corners)[3][3]; /* in tree order */
    int32_t *index;          /* of the triangle, by its place in the tree */
    part *parts;
    int32_t part_count;
};

typedef struct {
    double centre[3];
    int32_t index;
} placed;

static int compare_centres(const placed *p, const placed *q, int axis) {
    if (p->centre[axis] != q->centre[axis]) {
        return p->centre[axis] > q->centre[axis] ? 1 : -1;
    }
    return (p->index > q->index) - (p->index < q->index);
}

/* One function for each axis: qsort has no other way to tell that threads would not share. */
static int by_x(const void *a, const void *b) { return compare_centres(a, b, 0); }
static int by_y(const void *a, const void *b) { return compare_centres(a, b, 1); }
static int by_z(const void *a, const void *b) { return compare_centres(a, b, 2); }
static int (*const BY_CENTRE[3])(const void *, const void *) = {by_x, by_y, by_z};

static void area_normal(double (*c)[3], double *n) {
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        n[k] = 0.5 * ((c[1][i] - c[0][i]) * (c[2][j] - c[0][j]) - (c[1][j] - c[0][j]) * (c[2][i] - c[0][i]));
    }
}

/* Middle by area, radius, dipole and spread of a part, from its triangles. */
static void sum_up(const crw_tree *t, part *p) {
    double total = 0.0, plain[3] = {0.0, 0.0, 0.0};
    memset(p->middle, 0, sizeof p->middle);
    memset(p->dipole, 0, sizeof p->dipole);
    memset(p->spread, 0, sizeof p->spread);
    for (int32_t s = p->first; s < p->first + p->count; s++) {
        double n[3];
        area_normal(t->corners[s], n);
        const double area = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        total += area;
        for (int k = 0; k < 3; k++) {
            const double centre = (t->corners[s][0][k] + t->corners[s][1][k] + t->corners[s][2][k]) / 3.0;
            p->middle[k] += area * centre;
            plain[k] += centre / p->count;
            p->dipole[k] += n[k];
        }
    }
    for (int k = 0; k < 3; k++) {
        p->middle[k] = total > 0.0 ? p->middle[k] / total : plain[k];
    }
    p->radius2 = 0.0;
    for (int32_t s = p->first; s < p->first + p->count; s++) {
        double n[3];
        area_normal(t->corners[s], n);
        for (int c = 0; c < 3; c++) {
            double d2 = 0.0;
            for (int k = 0; k < 3; k++) {
                d2 += (t->corners[s][c][k] - p->middle[k]) * (t->corners[s][c][k] - p->middle[k]);
            }
            p->radius2 = d2 > p->radius2 ? d2 : p->radius2;
        }
        for (int i = 0; i < 3; i++) {
            const double centre = (t->corners[s][0][i] + t->corners[s][1][i] + t->corners[s][2][i]) / 3.0;
            for (int j = 0; j < 3; j++) {
                p->spread[i][j] += (centre - p->middle[i]) * n[j];
            }
        }
    }
}

static int32_t build(crw_tree *t, placed *order, int32_t first, int32_t count) {
    const int32_t index = t->part_count++;
    part *p = &t->parts[index];
    p->first = first;
    p->count = count;
    p->right = -1;
    if (count > LEAF_MAX) {
        double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
        for (int32_t i = first; i < first + count; i++) {
            for (int k = 0; k < 3; k++) {
                low[k] = fmin(low[k], order[i].centre[k]);
                high[k] = fmax(high[k], order[i].centre[k]);
            }
        }
        int axis = 0;
        for (int k = 1; k < 3; k++) {
            axis = high[k] - low[k] > high[axis] - low[axis] ? k : axis;
        }
        qsort(order + first, (size_t)count, sizeof *order, BY_CENTRE[axis]);
        (void)build(t, order, first, count / 2);
        const int32_t right = build(t, order, first + count / 2, count - count / 2);
        t->parts[index].right = right;
    }
    return index;
}

crw_tree *crw_new(const double *vertices, const int32_t *triangles, int64_t n) {
    crw_tree *t = n > 0 && n < INT32_MAX / 2 ? calloc(1, sizeof *t) : NULL;
    placed *order = malloc((size_t)(n > 0 ? n : 1) * sizeof *order);
    if (t != NULL) {
        t->corners = malloc((size_t)n * sizeof *t->corners);
        t->index = malloc((size_t)n * sizeof *t->index);
        t->parts = malloc((size_t)(2 * n) * sizeof *t->parts);
    }
    if (t == NULL || order == NULL || t->corners == NULL || t->index == NULL || t->parts == NULL) {
        free(order);
        crw_free(t);
        return NULL;
    }
    for (int32_t i = 0; i < n; i++) {
        order[i].index = i;
        for (int k = 0; k < 3; k++) {
            order[i].centre[k] = 0.0;
            for (int c = 0; c < 3; c++) {
                order[i].centre[k] += vertices[3 * (int64_t)triangles[3 * (int64_t)i + c] + k] / 3.0;
            }
        }
    }
    (void)build(t, order, 0, (int32_t)n);
    for (int32_t i = 0; i < n; i++) {
        t->index[i] = order[i].index;
        for (int c = 0; c < 3; c++) {
            memcpy(t->corners[i][c], vertices + 3 * (int64_t)triangles[3 * (int64_t)order[i].index + c],
                   3 * sizeof(double));
        }
    }
    for (int32_t i = 0; i < t->part_count; i++) {
        sum_up(t, &t->parts[i]);
    }
    free(order);
    return t;
}

void crw_free(crw_tree *t) {
    if (t != NULL) {
        free(t->corners);
        free(t->index);
        free(t->parts);
        free(t);
    }
}

/* Solid angle of a triangle (van Oosterom, Strackee 1983). */
static double solid_angle(double (*c)[3], const double *p) {
    double v[3][3], length[3];
    for (int i = 0; i < 3; i++) {
        double sum = 0.0;
        for (int k = 0; k < 3; k++) {
            v[i][k] = c[i][k] - p[k];
            sum += v[i][k] * v[i][k];
        }
        length[i] = sqrt(sum);
    }
    const double triple = v[0][0] * (v[1][1] * v[2][2] - v[1][2] * v[2][1]) +
                          v[0][1] * (v[1][2] * v[2][0] - v[1][0] * v[2][2]) +
                          v[0][2] * (v[1][0] * v[2][1] - v[1][1] * v[2][0]);
    if (triple == 0.0) {
        return 0.0;
    }
    double bottom = length[0] * length[1] * length[2];
    for (int i = 0; i < 3; i++) {
        const double *a = v[i], *b = v[(i + 1) % 3];
        bottom += (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) * length[(i + 2) % 3];
    }
    return 2.0 * atan2(triple, bottom);
}

static double far_part(const part *p, const double *r, double r2) {
    const double r1 = sqrt(r2), cubed = 1.0 / (r2 * r1);
    double sum = 0.0, trace = 0.0, along = 0.0;
    for (int i = 0; i < 3; i++) {
        sum += p->dipole[i] * r[i];
        trace += p->spread[i][i];
        for (int j = 0; j < 3; j++) {
            along += r[i] * p->spread[i][j] * r[j];
        }
    }
    return cubed * (sum + trace - 3.0 * along / r2);
}

static double winding_at(const crw_tree *t, const double *p, int32_t without) {
    int32_t stack[STACK_MAX];
    int depth = 1;
    double sum = 0.0;
    stack[0] = 0;
    while (depth > 0) {
        const int32_t i = stack[--depth];
        const part *q = &t->parts[i];
        const double r[3] = {q->middle[0] - p[0], q->middle[1] - p[1], q->middle[2] - p[2]};
        const double r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
        if (r2 > BETA * BETA * q->radius2) {
            sum += far_part(q, r, r2);
        } else if (q->right < 0) {
            for (int32_t s = q->first; s < q->first + q->count; s++) {
                sum += t->index[s] == without ? 0.0 : solid_angle(t->corners[s], p);
            }
        } else {
            stack[depth++] = q->right;
            stack[depth++] = i + 1;
        }
    }
    return sum / FOUR_PI;
}

void crw_winding(const crw_tree *t, const double *points, int64_t n, const int32_t *without, double *winding) {
    for (int64_t i = 0; i < n; i++) {
        winding[i] = winding_at(t, points + 3 * i, without != NULL ? without[i] : -1);
    }
}
