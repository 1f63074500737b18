/* A check that stays in every build, also where no test framework is linked. */
#ifndef CR_CHECK_HOLDS_H
#define CR_CHECK_HOLDS_H

#include <stdio.h>
#include <stdlib.h>

/* Purpose  an invariant: what breaks it ends the program, with the text; a crash for a fuzzer. */
#define HOLDS(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: does not hold: %s\n", __FILE__, __LINE__, #condition);                             \
            abort();                                                                                                   \
        }                                                                                                              \
    } while (0)

#endif
