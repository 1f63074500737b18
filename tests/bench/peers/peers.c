/* ODE and libccd (peers.h). */
#include "peers.h"

#include <ccd/ccd.h>
#include <math.h>
#include <ode/ode.h>
#include <stdarg.h>
#include <stdlib.h>

#define CONTACTS_MAX 1024

void peers_add(peers_contacts *c, const double normal[3], double depth) {
    for (int k = 0; k < 3; k++) {
        c->normal_sum[k] += depth * normal[k];
    }
    c->deepest = fmax(c->deepest, depth);
    c->count++;
}

void peers_answer(const peers_contacts *c, double least_us, double *out) {
    const double *s = c->normal_sum;
    const double length = sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]);
    for (int k = 0; k < 3; k++) {
        out[k] = length > 0.0 ? s[k] / length : 0.0;
    }
    out[3] = c->deepest;
    out[4] = (double)c->count;
    out[5] = least_us;
}

static dGeomID make_ode(const peers_mesh *m, dTriIndex *index) {
    for (int i = 0; i < 3 * m->triangle_count; i++) {
        index[i] = (dTriIndex)m->triangles[i];
    }
    dTriMeshDataID data = dGeomTriMeshDataCreate();
    dGeomTriMeshDataBuildDouble(data, m->vertices, 3 * (int)sizeof(double), m->vertex_count, index,
                                3 * m->triangle_count, 3 * (int)sizeof(dTriIndex));
    return dCreateTriMesh(0, data, NULL, NULL, NULL);
}

/* ODE tells on stderr, within the query, that its table of near contacts is full: none is lost, some are told twice. */
static void stay_silent(int number, const char *text, va_list words) {
    (void)number;
    (void)text;
    (void)words;
}

void peers_ode(const peers_mesh *fixed, const peers_mesh *tool, const double *poses, int count, int repeat,
               double *out) {
    static dContactGeom contact[CONTACTS_MAX];
    dInitODE2(0);
    dSetMessageHandler(stay_silent);
    dTriIndex *index[2] = {malloc(sizeof(dTriIndex) * 3 * (size_t)fixed->triangle_count),
                           malloc(sizeof(dTriIndex) * 3 * (size_t)tool->triangle_count)};
    dGeomID a = make_ode(tool, index[1]), b = make_ode(fixed, index[0]);
    for (int i = 0; i < count; i++) {
        const double *p = poses + 7 * i;
        const dQuaternion q = {p[3], p[4], p[5], p[6]};
        double least_us = 1e30;
        int found = 0;
        for (int r = 0; r < repeat; r++) {
            const double start_us = peers_now_us();
            dGeomSetPosition(a, p[0], p[1], p[2]);
            dGeomSetQuaternion(a, q);
            found = dCollide(a, b, CONTACTS_MAX, contact, (int)sizeof(dContactGeom));
            least_us = fmin(least_us, peers_now_us() - start_us);
        }
        peers_contacts contacts = {{0.0, 0.0, 0.0}, 0.0, 0};
        for (int c = 0; c < found; c++) {
            const double normal[3] = {contact[c].normal[0], contact[c].normal[1], contact[c].normal[2]};
            peers_add(&contacts, normal, contact[c].depth);
        }
        peers_answer(&contacts, least_us, out + PEERS_ANSWER * i);
    }
    dGeomDestroy(a);
    dGeomDestroy(b);
    free(index[0]);
    free(index[1]);
    dCloseODE();
}

typedef struct {
    const peers_mesh *m;
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

static body placed(const peers_mesh *m, const double *p) {
    const double w = p[3], x = p[4], y = p[5], z = p[6];
    const body b = {m,
                    {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z),
                     1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 2 * (x * z - w * y), 2 * (y * z + w * x),
                     1 - 2 * (x * x + y * y)},
                    {p[0], p[1], p[2]}};
    return b;
}

void peers_ccd(const peers_mesh *fixed, const peers_mesh *tool, const double *poses, int count, int repeat,
               double *out) {
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
            const double start_us = peers_now_us();
            miss = ccdMPRPenetration(&a, &b, &ccd, &depth, &dir, &at);
            least_us = fmin(least_us, peers_now_us() - start_us);
        }
        peers_contacts contacts = {{0.0, 0.0, 0.0}, 0.0, 0};
        if (miss == 0) {
            const double normal[3] = {dir.v[0], dir.v[1], dir.v[2]};
            peers_add(&contacts, normal, depth);
        }
        peers_answer(&contacts, least_us, out + PEERS_ANSWER * i);
    }
}
