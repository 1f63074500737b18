/* ODE and libccd asked for the contact of two meshes, pose by pose: loaded by query.py.
 *
 * Answers  for each pose seven doubles: depth-weighted mean normal, out of the static object (3); depth of the deepest contact; contacts;
 *          least time of `repeat` queries in us; unused.
 * Shapes   vertices [count][3] double, triangles [count][3] int, poses [count][7]: x y z, quaternion w x y z. */
#include <ccd/ccd.h>
#include <math.h>
#include <ode/ode.h>
#include <stdlib.h>
#include <time.h>

#define CONTACTS_MAX 1024

typedef struct {
    const double *vertices;
    int vertex_count;
    const int *triangles;
    int triangle_count;
} mesh;

static double now_us(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

static dGeomID make_ode(const mesh *m, dTriIndex *index) {
    for (int i = 0; i < 3 * m->triangle_count; i++) {
        index[i] = (dTriIndex)m->triangles[i];
    }
    dTriMeshDataID data = dGeomTriMeshDataCreate();
    dGeomTriMeshDataBuildDouble(data, m->vertices, 3 * (int)sizeof(double), m->vertex_count, index,
                                3 * m->triangle_count, 3 * (int)sizeof(dTriIndex));
    return dCreateTriMesh(0, data, NULL, NULL, NULL);
}

static void reduce(const dContactGeom *contact, int count, double *out) {
    double sum[3] = {0.0, 0.0, 0.0}, deepest = 0.0;
    for (int i = 0; i < count; i++) {
        for (int k = 0; k < 3; k++) {
            sum[k] += contact[i].depth * contact[i].normal[k];
        }
        deepest = fmax(deepest, contact[i].depth);
    }
    const double length = sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    for (int k = 0; k < 3; k++) {
        out[k] = length > 0.0 ? sum[k] / length : 0.0;
    }
    out[3] = deepest;
    out[4] = (double)count;
}

void peers_ode(const mesh *fixed, const mesh *tool, const double *poses, int count, int repeat, double *out) {
    static dContactGeom contact[CONTACTS_MAX];
    dInitODE2(0);
    dTriIndex *index[2] = {malloc(sizeof(dTriIndex) * 3 * (size_t)fixed->triangle_count),
                           malloc(sizeof(dTriIndex) * 3 * (size_t)tool->triangle_count)};
    dGeomID a = make_ode(tool, index[1]), b = make_ode(fixed, index[0]);
    for (int i = 0; i < count; i++) {
        const double *p = poses + 7 * i;
        const dQuaternion q = {p[3], p[4], p[5], p[6]};
        double least_us = 1e30;
        int found = 0;
        for (int r = 0; r < repeat; r++) {
            const double start_us = now_us();
            dGeomSetPosition(a, p[0], p[1], p[2]);
            dGeomSetQuaternion(a, q);
            found = dCollide(a, b, CONTACTS_MAX, contact, (int)sizeof(dContactGeom));
            least_us = fmin(least_us, now_us() - start_us);
        }
        reduce(contact, found, out + 7 * i);
        out[7 * i + 5] = least_us;
    }
    dGeomDestroy(a);
    dGeomDestroy(b);
    free(index[0]);
    free(index[1]);
    dCloseODE();
}

typedef struct {
    const mesh *m;
    double rot[9], pos[3];
} body;

static void support(const void *object, const ccd_vec3_t *dir, ccd_vec3_t *v) {
    const body *b = object;
    double local[3], best = -1e300;
    const double *chosen = b->m->vertices;
    for (int k = 0; k < 3; k++) {
        local[k] = b->rot[k] * dir->v[0] + b->rot[3 + k] * dir->v[1] + b->rot[6 + k] * dir->v[2];
    }
    for (int i = 0; i < b->m->vertex_count; i++) {
        const double *p = b->m->vertices + 3 * i;
        const double along = p[0] * local[0] + p[1] * local[1] + p[2] * local[2];
        chosen = along > best ? p : chosen;
        best = fmax(best, along);
    }
    for (int k = 0; k < 3; k++) {
        v->v[k] = (ccd_real_t)(b->rot[3 * k] * chosen[0] + b->rot[3 * k + 1] * chosen[1] +
                               b->rot[3 * k + 2] * chosen[2] + b->pos[k]);
    }
}

static void centre(const void *object, ccd_vec3_t *c) {
    const body *b = object;
    double sum[3] = {0.0, 0.0, 0.0};
    for (int i = 0; i < 3 * b->m->vertex_count; i++) {
        sum[i % 3] += b->m->vertices[i] / b->m->vertex_count;
    }
    for (int k = 0; k < 3; k++) {
        c->v[k] =
            (ccd_real_t)(b->rot[3 * k] * sum[0] + b->rot[3 * k + 1] * sum[1] + b->rot[3 * k + 2] * sum[2] + b->pos[k]);
    }
}

static body placed(const mesh *m, const double *p) {
    const double w = p[3], x = p[4], y = p[5], z = p[6];
    const body b = {m,
                    {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z),
                     1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 2 * (x * z - w * y), 2 * (y * z + w * x),
                     1 - 2 * (x * x + y * y)},
                    {p[0], p[1], p[2]}};
    return b;
}

/* Both meshes have to be convex, and hold only the corners of their hulls. */
void peers_ccd(const mesh *fixed, const mesh *tool, const double *poses, int count, int repeat, double *out) {
    static const double still[7] = {0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0};
    const body a = placed(fixed, still);
    ccd_t ccd;
    CCD_INIT(&ccd);
    ccd.support1 = ccd.support2 = support;
    ccd.center1 = ccd.center2 = centre;
    ccd.max_iterations = 200;
    ccd.mpr_tolerance = 1e-7;
    for (int i = 0; i < count; i++) {
        const body b = placed(tool, poses + 7 * i);
        double least_us = 1e30;
        ccd_real_t depth = 0;
        ccd_vec3_t dir = {{0, 0, 0}}, at;
        int miss = -1;
        for (int r = 0; r < repeat; r++) {
            const double start_us = now_us();
            miss = ccdMPRPenetration(&a, &b, &ccd, &depth, &dir, &at);
            least_us = fmin(least_us, now_us() - start_us);
        }
        for (int k = 0; k < 3; k++) {
            out[7 * i + k] = miss ? 0.0 : (double)dir.v[k];
        }
        out[7 * i + 3] = miss ? 0.0 : (double)depth;
        out[7 * i + 4] = miss ? 0.0 : 1.0;
        out[7 * i + 5] = least_us;
    }
}
