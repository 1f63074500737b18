/* A mesh taken in and given back. */
#include "mesh.h"

#include <stdlib.h>

void crb_mesh_free(crb_mesh *m) {
    if (m != NULL) {
        free(m->vertices);
        free(m->triangles);
        free(m->neighbour);
        free(m->normal);
        free(m->face);
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
        free(m->reach);
        free(m);
    }
}

static int allocate(crb_mesh *m, int64_t nv, int64_t nt) {
    m->vertices = malloc((size_t)nv * sizeof *m->vertices);
    m->vertex_normal = calloc((size_t)nv, sizeof *m->vertex_normal);
    m->triangles = calloc((size_t)nt * 3, sizeof *m->triangles);
    m->neighbour = malloc((size_t)nt * 3 * sizeof *m->neighbour);
    m->normal = malloc((size_t)nt * sizeof *m->normal);
    m->face = malloc((size_t)nt * sizeof *m->face);
    m->area = malloc((size_t)nt * sizeof *m->area);
    m->facet_of = malloc((size_t)nt * sizeof *m->facet_of);
    m->patch_of = malloc((size_t)nt * sizeof *m->patch_of);
    return m->vertices && m->vertex_normal && m->triangles && m->neighbour && m->normal && m->face && m->area &&
           m->facet_of && m->patch_of;
}

crb_mesh *crb_mesh_new(const double *vertices_m, int64_t nv, const int32_t *triangles, int64_t nt,
                       double crease_angle_rad, double plane_tolerance_m, double thin_m) {
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
    if (!crb_find_features(m, plane_tolerance_m, thin_m) || !crb_build_trees(m)) {
        crb_mesh_free(m);
        return NULL;
    }
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
