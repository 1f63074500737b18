/* How often a surface winds round a point, whether it is closed or not. */
#ifndef CR_WINDING_H
#define CR_WINDING_H

#include <stdint.h>

typedef struct crw_tree crw_tree;

/* Purpose  the generalised winding number of any triangles: 1 inside, 0 outside, parts between where the surface is open.
 * Shapes   vertices[][3]; triangles[triangle_count][3], counter-clockwise seen from outside. Both are copied.
 * Output   to be freed with crw_free, or null when memory ran out.   Cost  O(n log n); 0.5 s for a million triangles.
 * Source   Jacobson, Kavan, Sorkine-Hornung 2013; Barill et al. 2018 (first order, beta 3). */
crw_tree *crw_new(const double *vertices, const int32_t *triangles, int64_t triangle_count);
void crw_free(crw_tree *tree);

/* Shapes  points[n][3], winding[n]; without[n] or null: a triangle that does not count for the point, such as the one it lies on.
 * Output  within 0.03 of the exact sum, 0.005 RMS.   Cost  O(log n) a point, about 4 us. Thread-safe on one tree. */
void crw_winding(const crw_tree *tree, const double *points, int64_t n, const int32_t *without, double *winding);

#endif
