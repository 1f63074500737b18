#include "blob.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ALIGN 64u

blob blob_make(size_t size) {
    const size_t whole = (size + ALIGN - 1u) / ALIGN * ALIGN + ALIGN;
    blob b = {aligned_alloc(ALIGN, whole), size};
    if (b.bytes == NULL) {
        fprintf(stderr, "no memory for %zu bytes\n", size);
        exit(1);
    }
    memset(b.bytes, 0, whole);
    return b;
}

blob blob_read(const char *name) {
    FILE *file = fopen(name, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        perror(name);
        exit(1);
    }
    const long size = ftell(file);
    rewind(file);
    blob b = blob_make(size > 0 ? (size_t)size : 0u);
    if (fread(b.bytes, 1, b.size, file) != b.size) {
        perror(name);
        exit(1);
    }
    fclose(file);
    return b;
}
