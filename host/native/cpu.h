/* What this processor can run. */
#ifndef CR_CPU_H
#define CR_CPU_H

/* Purpose  level of the x86-64 psABI: 3 with AVX2, 1 without.   Output  1 on other machines.
 * Cost     asked of the processor once, then of memory. */
int cr_cpu_level(void);

#endif
