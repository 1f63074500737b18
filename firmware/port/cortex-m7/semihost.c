/* semihost: the emulated boards' console and files, and the end of their programs. */
#include "semihost.h"

#include "board.h"

#include <string.h>

enum { SYS_OPEN = 0x01, SYS_CLOSE = 0x02, SYS_WRITE0 = 0x04, SYS_WRITE = 0x05, SYS_EXIT_EXTENDED = 0x20 };
#define OPEN_WRITE_BINARY 5u
#define APPLICATION_EXIT 0x20026u

static int32_t ask(int32_t operation, const void *argument) {
    register int32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

_Noreturn void board_stop(uint32_t why) {
    const uint32_t block[2] = {APPLICATION_EXIT, why};
    for (;;) {
        ask(SYS_EXIT_EXTENDED, block);
    }
}

void semihost_print(const char *text) { ask(SYS_WRITE0, text); }

void semihost_print_hex(uint64_t value, int digits) {
    char text[17] = {0};
    for (int i = digits - 1; i >= 0; i--) {
        text[i] = "0123456789abcdef"[value & 15u];
        value >>= 4;
    }
    semihost_print(text);
}

void semihost_print_decimal(uint32_t value) {
    char text[11];
    int at = 10;
    text[at] = '\0';
    do {
        text[--at] = (char)('0' + value % 10u);
        value /= 10u;
    } while (value != 0u);
    semihost_print(text + at);
}

int semihost_create(const char *name) {
    const uint32_t block[3] = {(uint32_t)(uintptr_t)name, OPEN_WRITE_BINARY, (uint32_t)strlen(name)};
    return (int)ask(SYS_OPEN, block);
}

int semihost_write(int file, const void *bytes, size_t size) {
    const uint32_t block[3] = {(uint32_t)file, (uint32_t)(uintptr_t)bytes, (uint32_t)size};
    return (int)ask(SYS_WRITE, block);
}

void semihost_close(int file) {
    const uint32_t block[1] = {(uint32_t)file};
    ask(SYS_CLOSE, block);
}
