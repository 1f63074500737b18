/* Sums over the lanes of a cluster, in one order on every target. */
#ifndef CR_LANES_H
#define CR_LANES_H

#include "crease.h"

#if CR_SCALAR
/* Sum of w v in the same order of addition as with vectors, in one expression, so that all of it stays in registers. */
static inline float cr_sum_products(const float *w, const float *v) {
    float a = (w[0] * v[0] + w[8] * v[8]) + (w[4] * v[4] + w[12] * v[12]);
    float b = (w[2] * v[2] + w[10] * v[10]) + (w[6] * v[6] + w[14] * v[14]);
    float c = (w[1] * v[1] + w[9] * v[9]) + (w[5] * v[5] + w[13] * v[13]);
    float d = (w[3] * v[3] + w[11] * v[11]) + (w[7] * v[7] + w[15] * v[15]);
    return (a + b) + (c + d);
}
#else
/* Fixed order of addition: lane i with lane i + 8, then 4, 2, 1. */
static inline float cr_sum_products(const float *w, const float *v) {
    float t[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        t[i] = w[i] * v[i];
    }
    for (int width = CR_LANES / 2; width > 0; width /= 2) {
        for (int i = 0; i < width; i++) {
            t[i] += t[i + width];
        }
    }
    return t[0];
}
#endif

#endif
