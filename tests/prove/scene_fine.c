/* Proof    a fine brick that is taken has its table among the samples, and every block that its table names
 * Entry    check_fine of cr_scene_open
 * Bounds   1,600 samples, the first 8 of the 512 entries of the table; every brick, every content
 * Long     minutes on a busy machine
 * Unwind   10 */
#include "prove.h"

#include "contact/stages.h"

#undef CR_CELLS_SIDE
#define CR_CELLS_SIDE 2u

#include "contact/scene.c"

void cr_sum_cluster(const struct cr_img_cluster *c, const float share[CR_LANES], struct cr_img_sum *out) {
    (void)c, (void)share, (void)out;
}

#define SAMPLES 1600u

int cr_in_range(float v, float low, float high) { return v >= low && v <= high; }

int main(void) {
    cr_scene s = {0};
    int16_t samples[SAMPLES]; /* not set: anything */
    struct cr_img_brick b;
    uint32_t next = nondet_u32();
    s.samples = samples;
    s.sample_count = SAMPLES;
    ASSUME(b.samples <= SAMPLES); /* check_brick */
    if (check_fine(&s, &b, &next) == CR_OK) {
        PROVE(b.side == CR_BRICK_SIDE_MAX && b.samples + CR_FINE_BLOCKS <= SAMPLES &&
              next == b.samples + CR_FINE_BLOCKS);
        for (uint32_t i = 0; i < 8u; i++) {
            const int32_t entry = samples[b.samples + CR_FINE_TABLE + i];
            const uint32_t at = ((uint32_t)entry & CR_FINE_AT) * CR_FINE_UNIT;
            const uint32_t need = ((uint32_t)entry & CR_FINE_QUARTERS) != 0u ? 125u : 27u;
            PROVE(entry == 0 || (entry > 0 && b.samples + at + need <= SAMPLES));
        }
    }
    return 0;
}
