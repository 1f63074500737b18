#include "slcan.h"

#define ID_DIGITS 3u
#define DATA_AT 5u

static char digit_of(uint32_t value) { return "0123456789ABCDEF"[value & 15u]; }

uint32_t slcan_write(const cr_frame *frame, char *out) {
    uint32_t n = 0u;
    if (frame->id > 0x7ffu || frame->size > 8u) {
        return 0u;
    }
    out[n++] = 't';
    for (uint32_t shift = 4u * ID_DIGITS; shift > 0u; shift -= 4u) {
        out[n++] = digit_of((uint32_t)frame->id >> (shift - 4u));
    }
    out[n++] = digit_of(frame->size);
    for (uint32_t i = 0; i < frame->size; i++) {
        out[n++] = digit_of((uint32_t)frame->data[i] >> 4);
        out[n++] = digit_of(frame->data[i]);
    }
    out[n++] = '\r';
    return n;
}

/* Up to 4 hexadecimal digits.   Output  0: all are. */
static int read_hex(const char *text, uint32_t digits, uint32_t *value) {
    *value = 0u;
    for (uint32_t i = 0; i < digits; i++) {
        const char c = text[i];
        const int decimal = c >= '0' && c <= '9', upper = c >= 'A' && c <= 'F', lower = c >= 'a' && c <= 'f';
        if (!decimal && !upper && !lower) {
            return -1;
        }
        *value = *value << 4 | (uint32_t)(c - (decimal ? '0' : upper ? 'A' - 10 : 'a' - 10));
    }
    return 0;
}

static int read_frame(const char *line, uint32_t used, cr_frame *frame) {
    uint32_t id, size, byte;
    if (used < DATA_AT || read_hex(line + 1, ID_DIGITS, &id) != 0 || read_hex(line + 1u + ID_DIGITS, 1u, &size) != 0) {
        return 0;
    }
    if (id > 0x7ffu || size > 8u || used != DATA_AT + 2u * size) {
        return 0;
    }
    *frame = (cr_frame){.id = (uint16_t)id, .size = (uint8_t)size};
    for (uint32_t i = 0; i < size; i++) {
        if (read_hex(line + DATA_AT + (size_t)2u * i, 2u, &byte) != 0) {
            return 0;
        }
        frame->data[i] = (uint8_t)byte;
    }
    return 1;
}

int slcan_read(slcan *in, char character, cr_frame *frame) {
    if (character != '\r') {
        if (in->used < SLCAN_LINE_MAX) {
            in->line[in->used++] = character;
        }
        return 0;
    }
    const uint32_t used = in->used;
    char kind = '\0';
    if (used > 0u) {
        kind = in->line[0];
    }
    in->used = 0u;
    in->open = kind == 'O' ? 1u : kind == 'C' ? 0u : in->open;
    if (kind != 't') {
        return 0;
    }
    const int whole = read_frame(in->line, used, frame);
    in->refused += whole ? 0u : 1u;
    return whole;
}
