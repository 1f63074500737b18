/* An emulator's console, files and end, by Arm semihosting. */
#ifndef CORTEX_SEMIHOST_H
#define CORTEX_SEMIHOST_H

#include <stddef.h>
#include <stdint.h>

void semihost_print(const char *text);
void semihost_print_hex(uint64_t value, int digits);
void semihost_print_decimal(uint32_t value);

/* Purpose  a file for writing in the emulator's working directory.   Output  its handle, below 0: not writable. */
int semihost_create(const char *name);
/* Output   0: all written. */
int semihost_write(int file, const void *bytes, size_t size);
void semihost_close(int file);

#endif
