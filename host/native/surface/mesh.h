/* A mesh of bake.h from inside: what each file of this room adds to it. */
#ifndef CRB_SURFACE_MESH_H
#define CRB_SURFACE_MESH_H

#include "bake.h"
#include "vec.h"

typedef struct {
    vec low, high;
    int32_t right;        /* inner: index of the right child (the left one follows); leaf: -1 */
    int32_t first, count; /* leaf: range of order[] */
} node;

#define WIDE 8

/* What a child holds lies in a box, and between two planes across its mean normal: on a fine curved surface these are much closer. */
typedef struct {
    float low[3][WIDE], high[3][WIDE]; /* from the middle of the mesh */
    float normal[3][WIDE], under[WIDE], over[WIDE];
    int32_t child[WIDE]; /* a wide node, or -1 - slot of a triangle, or 0: none */
} wide_node;

/* Of a wide node's children besides: how far what they hold lies from a line along the mean normal. On fine flat or curved surfaces,
 * askew in the axes, that leaves a third of the nodes; a mesh that fits into the cache has none: there it costs more than it saves. */
typedef struct {
    float centre[3][WIDE], across[WIDE];
} wide_reach;

struct crb_mesh {
    int64_t vertex_count, triangle_count;
    vec *vertices;
    int32_t *triangles; /* [n][3] */
    int32_t *neighbour; /* [n][3] triangle across edge k (from corner k to k + 1), -1 when open */
    vec *normal;        /* unit, per triangle */
    vec *face;          /* the same, of slivers that of the face they belong to; 0 until it is known */
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
    wide_reach *reach; /* [wide_count] or null */
    int32_t wide_count;
    vec middle;
    float extent;
};

static inline int corner(const crb_mesh *m, int32_t t, int k) { return m->triangles[3 * (int64_t)t + k % 3]; }
static inline vec corner_at(const crb_mesh *m, int32_t t, int k) { return m->vertices[corner(m, t, k)]; }

/* Each fills in its own part of a mesh. Output  0: out of memory. */
int crb_find_features(crb_mesh *m, double plane_tolerance_m, double thin_m); /* features.c */
int crb_build_trees(crb_mesh *m);                                            /* trees.c */

/* Signed distance at p; slot: in, where the search starts; out, of the nearest triangle. nearest.c */
double crb_distance_at(const crb_mesh *m, vec p, int32_t *slot);

#endif
