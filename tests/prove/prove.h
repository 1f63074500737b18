/* What the proofs share: numbers that may be anything, and what may be taken for granted of them. */
#ifndef PROVE_H
#define PROVE_H

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

/* Of the model checker: assume(x) leaves out all runs where x is 0, assert(x) fails where one is left. */
void __ESBMC_assume(_Bool holds);
void __ESBMC_assert(_Bool holds, const char *text);
#define ASSUME(x) __ESBMC_assume(x)
#define PROVE(x) __ESBMC_assert((x), #x)

/* Any value at all: the model checker gives functions without a body every result. */
uint8_t nondet_u8(void);
uint16_t nondet_u16(void);
uint32_t nondet_u32(void);
uint64_t nondet_u64(void);
float nondet_float(void);

/* Memory of any content, of `bytes` bytes to the byte: one beyond is found. */
static inline void *any_bytes(size_t bytes) {
    void *memory = malloc(bytes);
    ASSUME(memory != NULL);
    return memory;
}
#define ANY(type) ((type *)any_bytes(sizeof(type)))
#define ANY_ARRAY(type, count) ((type *)any_bytes((size_t)(count) * sizeof(type)))

#endif
