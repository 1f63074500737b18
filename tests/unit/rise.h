/* Which feels are felt in full: late answers rise over as many feels as they are old, and one more where they looked ahead. */
#ifndef CRT_RISE_H
#define CRT_RISE_H

#include <stdint.h>

typedef struct {
    uint32_t rises, felt;
    int whole;
    uint32_t answers; /* in contact: the first cannot have looked ahead */
} crt_rise;

/* Purpose  take in the age of the next feel.   Output  1 from the first answer in contact on that was felt in full.
 * Shapes   late_before, late: age of the contact at the feel before, and at this one. */
static inline int crt_has_risen(crt_rise *r, int in_contact, uint32_t late_before, uint32_t late) {
    const int newer = late <= late_before;
    r->rises = newer ? late : r->rises;
    r->felt = newer ? 1u : r->felt + 1u;
    r->answers += (uint32_t)(in_contact && newer);
    r->whole =
        r->whole || (in_contact && r->rises > 0u && r->felt >= r->rises + (uint32_t)(r->answers > 1u && r->rises > 1u));
    return r->whole;
}

#endif
