/* Triangles that pass through each other, cut along the lines where they do. */
#ifndef CR_ARRANGE_H
#define CR_ARRANGE_H

#include <stddef.h>
#include <stdint.h>

typedef struct crx_cuts crx_cuts;

/* Purpose  cut every triangle that another one passes through, so that the pieces meet only in edges and corners.
 * Shapes   vertices[vertex_count * 3], triangles[triangle_count * 3], pairs[pair_count * 2]: the pairs that cross, from
 *          cr_mesh_self_intersections with tolerance 0. Vertices in general position: what lies exactly in the plane of another
 *          triangle, or on its rim, is not cut there.
 * Output   to be freed with crx_free, or null when memory ran out. New vertices follow the old ones; a vertex on a line of two
 *          triangles, or in a point of three, is one vertex in all of them.
 * Cost     O(k^2) for a triangle with k lines; 20 us for a triangle with two.
 * Source   Zhou, Grinspun, Zorin, Jacobson 2016, Mesh Arrangements for Solid Geometry (in floating point, with exact signs); lines
 *          are enforced by flips after Sloan 1993. */
crx_cuts *crx_cut(const double *vertices, size_t vertex_count, const int32_t *triangles, size_t triangle_count,
                  const int32_t *pairs, size_t pair_count);
void crx_free(crx_cuts *cuts);

/* Sizes of what crx_read gives; failed: triangles left whole because rounding contradicted itself. */
typedef struct {
    int64_t vertices, triangles, lines, failed;
} crx_counts;
void crx_count(const crx_cuts *cuts, crx_counts *counts);

/* Shapes  vertices[counts.vertices * 3]; triangles[counts.triangles * 3]; parent[counts.triangles]: the triangle it is a piece of;
 *         lines[counts.lines * 2]: edges between pieces that lie on another triangle. */
void crx_read(const crx_cuts *cuts, double *vertices, int32_t *triangles, int32_t *parent, int32_t *lines);

#endif
