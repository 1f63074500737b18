/* What the fuzz targets share: invariants, and random numbers of the mutators. */
#ifndef CRF_FUZZ_H
#define CRF_FUZZ_H

#include "../check/holds.h"

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed);
size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t max_size); /* of libFuzzer */

/* Purpose  a number below `below` (at least 1) from the mutator's seed. */
static inline uint32_t crf_random(uint64_t *state, uint32_t below) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((*state >> 33) % (below > 0u ? below : 1u));
}

#endif
