#include "wire.h"

#include <stdlib.h>
#include <string.h>

#define DRIVE_QUEUE_MAX CR_SIM_QUEUE_MAX
/* How often the drives look at their clock while the wire is idle. */
#define POLL_NS 250000u
/* CRC delimiter, acknowledge slot and delimiter, end of frame, interframe space: never stuffed. */
#define TAIL_BITS 13u
#define CRC_POLYNOMIAL 0x4599u
#define NOBODY (-1)

typedef struct {
    cr_sim_frame frame;
    uint64_t ready_ns;
    uint8_t late; /* 1: after whatever else is ready, by order of the fault table */
} waiting;

struct cr_wire {
    cr_sim *sim;
    uint32_t bit_ns, reaction_ns;
    uint64_t free_ns, polled_ns; /* the wire is free from then on; the drives' clock */
    waiting host[CR_WIRE_HOST_MAX], drive[DRIVE_QUEUE_MAX];
    uint32_t host_count, drive_count;
    int busy; /* 1: `current` is on the wire until free_ns */
    int from_host;
    cr_sim_frame current;
};

/* -------------------------------------------------------------------------------------------------------------------- bits */

typedef struct {
    uint32_t bits, crc, run;
    uint32_t last; /* 2: none yet */
} stuffer;

/* One bit before stuffing: a sixth equal one cannot be, the fifth is followed by its opposite. */
static void put_bit(stuffer *s, uint32_t bit, int into_crc) {
    const uint32_t invert = bit ^ (s->crc >> 14 & 1u);
    if (into_crc) {
        s->crc = (s->crc << 1 & 0x7FFFu) ^ (invert ? CRC_POLYNOMIAL : 0u);
    }
    s->run = bit == s->last ? s->run + 1u : 1u;
    s->last = bit;
    s->bits++;
    if (s->run == 5u) {
        s->bits++;
        s->last = 1u - bit;
        s->run = 1u;
    }
}

static void put_bits(stuffer *s, uint32_t value, uint32_t count, int into_crc) {
    for (uint32_t i = count; i > 0u; i--) {
        put_bit(s, value >> (i - 1u) & 1u, into_crc);
    }
}

uint32_t cr_wire_bits(const cr_sim_frame *frame) {
    stuffer s = {0u, 0u, 0u, 2u};
    put_bits(&s, 0u, 1u, 1); /* start of frame */
    put_bits(&s, frame->id, 11u, 1);
    put_bits(&s, 0u, 3u, 1); /* RTR, IDE, reserved */
    put_bits(&s, frame->len, 4u, 1);
    for (uint32_t i = 0; i < frame->len && i < 8u; i++) {
        put_bits(&s, frame->data[i], 8u, 1);
    }
    put_bits(&s, s.crc, 15u, 0);
    return s.bits + TAIL_BITS;
}

/* ------------------------------------------------------------------------------------------------------------------- queues */

/* What the drives have to say now, in the order in which they would; out of order means held back on purpose. */
static void listen(cr_wire *w, uint64_t ready_ns) {
    cr_sim_frame frame;
    uint32_t highest = 0u;
    while (w->drive_count < DRIVE_QUEUE_MAX && cr_sim_send(w->sim, &frame, 1) == 1u) {
        const uint8_t late = frame.id < highest ? 1u : 0u;
        highest = frame.id > highest ? frame.id : highest;
        w->drive[w->drive_count++] = (waiting){frame, ready_ns, late};
    }
}

static void poll_drives(cr_wire *w, uint64_t now_ns, uint32_t reaction_ns) {
    w->polled_ns = now_ns;
    cr_sim_poll(w->sim, now_ns / 1000u);
    listen(w, now_ns + reaction_ns);
}

/* Never before the frame that is just over: the drives' time does not go back. */
static uint64_t next_poll(const cr_wire *w) {
    const uint64_t due_ns = w->polled_ns + POLL_NS;
    return w->bit_ns == 0u ? UINT64_MAX : due_ns > w->free_ns ? due_ns : w->free_ns;
}

cr_wire *cr_wire_create(cr_sim *sim, uint32_t bit_ns, uint32_t reaction_ns, uint64_t now_ns) {
    cr_wire *w = calloc(1, sizeof *w);
    if (w != NULL) {
        w->sim = sim;
        w->bit_ns = bit_ns;
        w->reaction_ns = reaction_ns;
        w->free_ns = w->polled_ns = now_ns;
        cr_sim_on_wire(sim);
        listen(w, now_ns);
    }
    return w;
}

void cr_wire_destroy(cr_wire *wire) { free(wire); }

int cr_wire_put(cr_wire *wire, const cr_sim_frame *frame, uint64_t now_ns) {
    if (wire->host_count == CR_WIRE_HOST_MAX) {
        return -1;
    }
    wire->host[wire->host_count++] = (waiting){*frame, now_ns, 0u};
    return 0;
}

/* -------------------------------------------------------------------------------------------------------------- arbitration */

static int goes_before(const waiting *a, const waiting *b) {
    return a->late < b->late || (a->late == b->late && a->frame.id < b->frame.id);
}

/* The drive's frame that wins among those ready at start_ns. */
static int best_drive(const cr_wire *w, uint64_t start_ns) {
    int best = NOBODY;
    for (uint32_t i = 0; i < w->drive_count; i++) {
        if (w->drive[i].ready_ns <= start_ns && (best == NOBODY || goes_before(&w->drive[i], &w->drive[best]))) {
            best = (int)i;
        }
    }
    return best;
}

/* When the next frame starts; UINT64_MAX: none waits. */
static uint64_t next_start(const cr_wire *w) {
    uint64_t ready_ns = w->host_count > 0u ? w->host[0].ready_ns : UINT64_MAX;
    for (uint32_t i = 0; i < w->drive_count; i++) {
        ready_ns = w->drive[i].ready_ns < ready_ns ? w->drive[i].ready_ns : ready_ns;
    }
    return ready_ns == UINT64_MAX || ready_ns > w->free_ns ? ready_ns : w->free_ns;
}

static void start(cr_wire *w, uint64_t start_ns) {
    const int at = best_drive(w, start_ns);
    const int host = w->host_count > 0u && w->host[0].ready_ns <= start_ns;
    w->from_host = host && (at == NOBODY || !goes_before(&w->drive[at], &w->host[0]));
    waiting *from = w->from_host ? w->host : w->drive + at;
    uint32_t *count = w->from_host ? &w->host_count : &w->drive_count;
    const uint32_t index = w->from_host ? 0u : (uint32_t)at;
    w->current = from->frame;
    (*count)--;
    memmove(from, from + 1, (*count - index) * sizeof *from);
    w->busy = 1;
    w->free_ns = start_ns + (uint64_t)w->bit_ns * cr_wire_bits(&w->current);
}

int cr_wire_get(cr_wire *w, uint64_t until_ns, cr_sim_frame *frame, uint64_t *at_ns) {
    for (;;) {
        if (w->busy) {
            if (w->free_ns > until_ns) {
                return 0;
            }
            w->busy = 0;
            if (!w->from_host) {
                *frame = w->current;
                *at_ns = w->free_ns;
                return 1;
            }
            cr_sim_receive(w->sim, &w->current, w->free_ns / 1000u);
            poll_drives(w, w->free_ns, w->reaction_ns);
            continue;
        }
        const uint64_t start_ns = next_start(w), poll_ns = next_poll(w);
        if (poll_ns <= until_ns && poll_ns <= start_ns) {
            poll_drives(w, poll_ns, 0u);
        } else if (start_ns <= until_ns) {
            start(w, start_ns);
        } else {
            return 0;
        }
    }
}
