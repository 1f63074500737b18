/* Looking into an opened scene with the firmware's own distance lookup: for bake's error measurement and for tests. */
#ifndef CREASE_PROBE_H
#define CREASE_PROBE_H

#include "crease.h"

#include <stdint.h>

/* Purpose  distance, gradient, surface kind and facet that the tick would see at each point.
 * Units    m, world frame.   Shapes  points_m, gradient [n][3]; phi_m, kind, facet [n]. facet is UINT32_MAX where phi is from
 *          the samples. */
void crp_look_up(const cr_scene *scene, const float *points_m, int64_t n, float *phi_m, float *gradient, uint32_t *kind,
                 uint32_t *facet);

/* Purpose  the full-coverage sums of one cluster, added up in the order of the tick. */
struct cr_img_cluster;
struct cr_img_sum;
void crp_sum_cluster(const struct cr_img_cluster *cluster, struct cr_img_sum *sum);

/* Purpose  CRC-32 of an image with its checksum field taken as zero. */
uint32_t crp_image_crc(const uint8_t *image, uint32_t size_bytes);

#endif
