/* rerun: the ticks of a recording again. */
#include "contact/world.h"
#include "servo/servo_stages.h"

#include <stddef.h>
#include <string.h>

_Static_assert((CR_LATE_MAX & (CR_LATE_MAX + 1u)) == 0u, "a ring by a mask");

/* What the search had answered by this tick, if that is another answer than the one in hand. */
static void answer_as_recorded(cr_servo *s, const cr_record *r, const cr_pose *felt) {
    cr_felt at = s->world->felt;
    const uint32_t late = r->contact_late_ticks;
    if (late < 1u || late > s->config.late_max_ticks) {
        return;
    }
    at.stamp = at.stamp + 1u - late;
    at.pose = felt[at.stamp & CR_LATE_MAX];
    if (at.stamp != s->world->hand.stamp) {
        cr_answer(s->world, &at);
    }
}

static void feed(cr_servo *s, const cr_record *r) {
    cr_tx tx;
    uint32_t count = r->frame_count < CR_RX_MAX ? r->frame_count : CR_RX_MAX;
    for (uint32_t i = 0; i < count; i++) {
        if ((r->frames[i].flags & CR_FRAME_EARLY) != 0u) {
            cr_servo_rx(s, &r->frames[i]);
        }
    }
    if ((r->inputs & CR_INPUT_NO_SYNC) == 0u) {
        cr_servo_sync(s, r->sync_ns, &tx);
    }
    for (uint32_t i = 0; i < count; i++) {
        if ((r->frames[i].flags & CR_FRAME_EARLY) == 0u) {
            cr_servo_rx(s, &r->frames[i]);
        }
    }
    s->rx_babbled = r->rx_babbled;
    cr_servo_rx_drops(s, r->rx_drops);
    cr_servo_input(s, r->inputs);
    cr_servo_tick(s, r->now_ns, r->period_s, &tx);
}

cr_err cr_servo_rerun(cr_servo *s, const cr_record *records, size_t count, cr_rerun *result, cr_record *out) {
    if (s == NULL || records == NULL || result == NULL) {
        return CR_ERR_NULL;
    }
    for (size_t i = 0; i < count && !result->gap; i++) {
        if (records[i].tick != s->ticks) {
            result->gap = 1u;
            break;
        }
        result->felt[s->world->felt.stamp & CR_LATE_MAX] = s->world->felt.pose;
        answer_as_recorded(s, &records[i], result->felt);
        feed(s, &records[i]);
        result->records++;
        if (memcmp(&s->record, &records[i], offsetof(cr_record, wake_late_ns)) != 0) {
            result->first = result->different == 0u ? records[i].tick : result->first;
            result->different++;
        }
        if (out != NULL) {
            out[i] = s->record;
        }
    }
    return CR_OK;
}
