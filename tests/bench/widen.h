/* The firmware in double precision: included before every file (-include) of the reference build of `crease bench precision`.
 *
 * Types and square roots are widened, literals keep their float32 value: the same algorithm with the same constants, only the rounding
 * goes. System headers come first, so that they are not touched. */
#ifndef BENCH_WIDEN_H
#define BENCH_WIDEN_H

#include <inttypes.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define float double
#define sqrtf sqrt
#define fabsf fabs

#endif
