#include "cpu.h"

#ifdef __x86_64__
#define HAS(feature) (__builtin_cpu_supports(feature) != 0)

/* BMI1, LZCNT, MOVBE and F16C come with these on every processor that was made. The operating system's part (XSAVE) is asked for along. */
static int is_v3(void) { return HAS("avx2") && HAS("fma") && HAS("bmi") && HAS("bmi2"); }

int cr_cpu_level(void) {
    __builtin_cpu_init();
    return is_v3() ? 3 : 1;
}
#else
int cr_cpu_level(void) { return 1; }
#endif
