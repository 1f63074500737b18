/* Samples of the bricks that crt_image makes, those of fine voxels included: see image_builder.h. */
#include "image_builder.h"

#include <math.h>
#include <string.h>

#define SIDE ((int)CR_CELLS_SIDE)

/* Distances at (n + 1)^3 corners of a cube. */
static void fill_cube(const crt_solid *s, const struct cr_img_meta *m, const double low[3], double size, int n,
                      int16_t *samples) {
    const int row = n + 1;
    for (int k = 0; k < row * row * row; k++) {
        const double part = size / n;
        const double p[3] = {low[0] + k % row * part, low[1] + k / row % row * part, low[2] + k / (row * row) * part};
        samples[k] = (int16_t)lround(crt_distance(s, p) / (double)m->quantum_m);
    }
}

static uint32_t fill_fine(const crt_solid *s, const struct cr_img_meta *m, const double low[3], int16_t *samples) {
    const double voxel = (double)m->brick_m / SIDE;
    uint32_t at = CR_FINE_BLOCKS;
    memset(samples + 9 * 9 * 9, 0, (CRT_BRICK_MOST - 9u * 9u * 9u) * sizeof *samples);
    for (int k = 0; k < SIDE * SIDE * SIDE; k++) {
        const double corner[3] = {low[0] + k % SIDE * voxel, low[1] + k / SIDE % SIDE * voxel,
                                  low[2] + k / (SIDE * SIDE) * voxel};
        const double middle[3] = {corner[0] + 0.5 * voxel, corner[1] + 0.5 * voxel, corner[2] + 0.5 * voxel};
        if (fabs(crt_distance(s, middle)) > 0.9 * voxel) {
            continue;
        }
        const int quarters = k % 2;
        fill_cube(s, m, corner, voxel, quarters ? 4 : 2, samples + at);
        samples[CR_FINE_TABLE + (uint32_t)k] = (int16_t)(at / CR_FINE_UNIT | (quarters ? CR_FINE_QUARTERS : 0u));
        at += quarters ? 128u : 32u;
    }
    return at;
}

uint32_t crt_fill_samples(const crt_solid *solid, const struct cr_img_meta *meta, const double low[3],
                          struct cr_img_brick *brick, int16_t *samples) {
    brick->side = 8u;
    fill_cube(solid, meta, low, (double)meta->brick_m, SIDE, samples);
    const uint32_t count = solid->fine ? fill_fine(solid, meta, low, samples) : 0u;
    brick->fine = count > CR_FINE_BLOCKS;
    return brick->fine ? count : 9u * 9u * 9u;
}

uint32_t crt_samples_of(const struct cr_img_brick *brick, const int16_t *samples) {
    const uint32_t row = brick->side + 1u;
    uint32_t count = brick->fine ? CR_FINE_BLOCKS : row * row * row;
    for (uint32_t k = 0; brick->fine && k < 512u; k++) {
        const uint32_t entry = (uint32_t)samples[CR_FINE_TABLE + k];
        const uint32_t end = (entry & CR_FINE_AT) * CR_FINE_UNIT + ((entry & CR_FINE_QUARTERS) != 0u ? 125u : 27u);
        count = entry != 0u && end > count ? end : count;
    }
    return count;
}
