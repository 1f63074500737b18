/* The fine points of a tool's surface gathered into cells: Lloyd's steps of host/crease/bake/cells.py.
 * Sums are taken in the order of the points, so that their last bit does not depend on who works: threads may share a search only. */
#ifndef CR_SITES_H
#define CR_SITES_H

#include <stdint.h>

/* Fine points, and what those of one triangle have in common.
 * Shapes   point_m [count][3]; triangle [count], an index into normal [][3], of length 1, and weight_m2 [].
 * A point and lift_m times its normal are a place in six dimensions. */
typedef struct {
    int64_t count;
    const double *point_m;
    const int32_t *triangle;
    const double *normal, *weight_m2;
    double lift_m;
} crs_points;

typedef struct crs_grid crs_grid;

/* Purpose  a search over sites of `width` numbers, 3 or 6, of which the first three are a place.
 * Shapes   sites [count][width], which must stay; cell_m: about the distance between sites, whatever it is the answer is the same.
 * Output   to be freed with crs_free, or null when memory ran out.   Cost  O(count); 0.1 us each. */
crs_grid *crs_new(const double *sites, int32_t width, int64_t count, double cell_m);
void crs_free(crs_grid *grid);

/* Purpose  nearest site of fine points first..end - 1 in six dimensions.
 * Shapes   label [points->count]: in, any site, better a near one; out, the nearest, of equally near ones the first. tied
 *          [points->count]: set to 1 where another site is as near but for rounding, else to 0.
 * Cost     about 0.1 us a point.   Thread-safe on one grid. */
void crs_nearest(const crs_grid *grid, const crs_points *points, int64_t first, int64_t end, int32_t *label,
                 uint8_t *tied);

/* Purpose  weighted means of the points of each label.
 * Shapes   label [points->count] below count; mean [count][6]: place and lift; weight_m2 [count]. */
void crs_means(const crs_points *points, const int32_t *label, int64_t count, double *mean, double *weight_m2);

/* Purpose  sums of second moments about the middle of each label, by weight; each fine piece adds fine_spread of its area in its plane.
 * Shapes   label as in crs_means; middle_m [count][3]; spread_m4 [count][9]. */
void crs_spreads(const crs_points *points, const int32_t *label, double fine_spread, const double *middle_m,
                 int64_t count, double *spread_m4);

/* Purpose  how far the fine pieces of each label reach behind the plane through its site, at least 0.
 * Shapes   site_m, normal [count][3]; bow_m [count]. */
void crs_bows(const crs_points *points, const int32_t *label, const double *site_m, const double *normal, int64_t count,
              double *bow_m);

/* Purpose  the fine point nearest to each site of a grid of width 3, of equally near ones the first.
 * Shapes   label [points->count]: a guess; a site may have no points; nearest, distance2_m2 [count of the grid]. */
void crs_closest(const crs_grid *grid, const crs_points *points, const int32_t *label, int64_t *nearest,
                 double *distance2_m2);

#endif
