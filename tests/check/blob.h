/* A whole file in memory, for the check programs. */
#ifndef CHECK_BLOB_H
#define CHECK_BLOB_H

#include <stddef.h>

typedef struct {
    void *bytes; /* the caller's to free */
    size_t size;
} blob;

/* Purpose  the file at an address that is a multiple of 64.   Errors  none: exits 1 with one line when it cannot be read. */
blob blob_read(const char *name);

/* Purpose  memory at an address that is a multiple of 64, zeroed.   Errors  none: exits 1 when there is none. */
blob blob_make(size_t size);

#endif
