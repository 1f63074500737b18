/* assert_failed: what a program for Linux does where CR_ASSERT does not hold: it says where, and ends. Torques end with it: the drives
 * take their own to zero when no more come. */
#include "asserts.h"

#include <stdio.h>
#include <stdlib.h>

void cr_assert_failed(const char *file, int line);

void cr_assert_failed(const char *file, int line) {
    fprintf(stderr, "%s:%d: does not hold: please report this line\n", file, line);
    abort();
}
