/* The kernel's answer about an interface: any bytes at all. */
#include "can.h"
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    uint8_t *message = malloc(size + 1u);
    HOLDS(message != NULL);
    memcpy(message, data, size);
    const uint32_t rate = can_bitrate_of(message, size);
    HOLDS(rate == 0u || size >= 4u); /* a rate is read from bytes that are there; the sanitizer watches that */
    free(message);
    return 0;
}
