/* CR_ASSERT: what holds where it stands, whatever comes from outside. Where it does not, the fault is ours.
 * Checked where CR_ASSERTS is 1 (config.h), left out everywhere else. Internal: the sources include it, the public headers do not. */
#ifndef CR_ASSERTS_H
#define CR_ASSERTS_H

#include "config.h"

#if CR_ASSERTS
/* Purpose  the port's hook: what stands at this place does not hold. It stops the program or jumps out of it; after a return the
 *          next statement runs, on a state that is not sound. */
void cr_assert_failed(const char *file, int line);

#define CR_ASSERT(holds) ((holds) ? (void)0 : cr_assert_failed(__FILE__, __LINE__))
#else
/* The compiler reads it, and makes no code of it. */
#define CR_ASSERT(holds) ((void)sizeof(holds))
#endif

#endif
