/* Proof    the head of a recording, of any content: nothing outside is read, and what is taken has the sizes of this version
 * Entry    cr_record_head_read
 * Bounds   none: every content of the 1,024 bytes
 * Unwind   9 */
#include "prove.h"

#include "servo/servo_stages.h"

/* Bytes of any content, copied into a structure that is not set: it may be anything already. What is proved is that they are there. */
static void any_copy(const uint8_t *from, size_t count) {
    PROVE(from[0] == from[0] && from[count - 1u] == from[count - 1u]);
}
#define memcpy(to, from, count) any_copy((const uint8_t *)(from), count)

#include "servo/record.c"

/* Proved by itself: record_config.c. */
const char *cr_servo_config_error(const cr_servo_config *config) {
    PROVE(config != NULL);
    return nondet_u8() != 0u ? "" : NULL;
}

int main(void) {
    uint8_t bytes[CR_RECORDS_AT]; /* not set: anything */
    cr_record_head head;
    cr_servo_config config;
    if (cr_record_head_read(bytes, &head, &config) == CR_OK) {
        PROVE(head.record_bytes == CR_RECORD_BYTES && head.records_at == CR_RECORDS_AT);
        PROVE(head.version == CR_RECORD_VERSION && head.config_bytes == sizeof config);
    }
    return 0;
}
