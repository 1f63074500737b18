/* Geometry work of `crease bake` that is too heavy for Python: features, exact signed distance, brick marking.
 * Host code: doubles, heap and libm are fine here. Lengths in m. Arrays are C-contiguous and the caller's.
 * Python calls all of it without the interpreter's lock: nothing here is static, any number of threads may be in it. */
#ifndef CREASE_BAKE_H
#define CREASE_BAKE_H

#include <stdint.h>

typedef struct crb_mesh crb_mesh;

typedef struct {
    int32_t triangles, vertices, facets, patches;
    int32_t smooth_edges, convex_edges, concave_edges;
    int32_t open_edges; /* edges without exactly two triangles: 0 for a closed mesh */
} crb_counts;

/* Purpose  take in a closed, outward-oriented mesh; find facets, patches, creases; build the search tree.
 * Units    vertices_m [vertex_count][3] in m; crease_angle_rad between normals; plane_tolerance_m: how far the vertices of
 *          a merged facet may lie from its plane.
 * Shapes   triangles [triangle_count][3], indices into vertices.
 * Output   a mesh to be freed with crb_mesh_free, or null when memory ran out or an index is out of range.
 * Cost     O(n log n); 1,000,000 triangles about 2 s. */
crb_mesh *crb_mesh_new(const double *vertices_m, int64_t vertex_count, const int32_t *triangles, int64_t triangle_count,
                       double crease_angle_rad, double plane_tolerance_m);
void crb_mesh_free(crb_mesh *mesh);
void crb_mesh_counts(const crb_mesh *mesh, crb_counts *counts);

/* Purpose  copy out the features.
 * Shapes   facet_of, patch_of [triangles]; facet_plane [facets][4]: unit normal and offset (normal . x = offset);
 *          facet_patch [facets]; facet_area_m2 [facets]. */
void crb_mesh_features(const crb_mesh *mesh, int32_t *facet_of, int32_t *patch_of, double *facet_plane,
                       int32_t *facet_patch, double *facet_area_m2);

/* Purpose  copy out the creases: edges whose normals differ by the crease angle or more.
 * Shapes   n = convex_edges + concave_edges; ends_m [n][2][3]; patch [n][2]; convex [n] (1 convex, 0 concave); angle_rad [n]. */
void crb_mesh_creases(const crb_mesh *mesh, double *ends_m, int32_t *patch, uint8_t *convex, double *angle_rad);

/* Purpose  exact signed distance (negative inside, by angle-weighted pseudo-normals) and nearest triangle of each point.
 * Shapes   points_m [n][3]; phi_m, triangle [n]. Neighbouring points should follow each other: each search starts from the
 *          last result. Thread-safe on one mesh.
 * Cost     about 1 us a point.   Source  Baerentzen, Aanaes 2005 (sign); Ericson 2004, 5.1.5 (point and triangle). */
void crb_signed_distance(const crb_mesh *mesh, const double *points_m, int64_t n, double *phi_m, int32_t *triangle);

/* Distances at the middles of a grid of boxes, from low_m on; phi_m [dims[2]][dims[1]][dims[0]], NaN where not yet known. */
typedef struct {
    double low_m[3], box_m;
    int32_t dims[3];
    double *phi_m;
} crb_known;

/* Purpose  whether the signed distance is below below_m at all of n points.
 * Shapes   points_m [n][3]. known: filled in as it is needed; the caller keeps it from call to call. Not for two threads at once.
 * Output   1 or 0: what crb_signed_distance would say at each point. No point is looked at behind the first that is not.
 * Cost     about 20 ns a point farther from the surface than a box is long, 1 us for others. */
int32_t crb_all_below(const crb_mesh *mesh, const crb_known *known, const double *points_m, int64_t n, double below_m);

/* Purpose  mark the bricks of a grid that any triangle comes within reach_m of (per axis).
 * Shapes   origin_m [3]; dims [3]; near [dims[2]][dims[1]][dims[0]], set to 1 where marked, else unchanged. */
void crb_mark_bricks(const crb_mesh *mesh, const double *origin_m, double brick_m, const int32_t *dims, double reach_m,
                     uint8_t *near);

#endif
