/* mailbox: what one side writes and another reads, in threads or in an interrupt and what it interrupts, without a lock.
 *
 * Two places are filled in turn. `put` counts what was put; the last lies in place put & 1. Who reads takes the count, the words and the count again: when it
 * is still the same, nothing was written where it read. Neither side waits for the other: who reads tries TRIES times and else keeps what it has. An interrupt that
 * reads is never disturbed; what it interrupts is disturbed at most once for each time that it is interrupted. Source  H.-J. Boehm, "Can seqlocks get along with
 * programming language memory models?", MSPC 2012. tests/unit/test_mailbox.c tries every interleaving. */
#ifndef CR_MAILBOX_H
#define CR_MAILBOX_H

#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* A test may put its own step between any two accesses. */
#ifndef CR_MAILBOX_STEP
#define CR_MAILBOX_STEP()
#endif
#define CR_MAILBOX_TRIES 2u

/* Purpose  put count words of a letter as the newest.   Shapes  place[2][count].   Errors  none.   Cost  O(count), no waiting. */
static inline void cr_mailbox_put(_Atomic uint32_t *put, _Atomic uint32_t *place, const void *letter, uint32_t count) {
    const uint32_t next = atomic_load_explicit(put, memory_order_relaxed) + 1u;
    _Atomic uint32_t *to = &place[(size_t)(next & 1u) * count];
    /* what was put before is seen before anything of this is */
    atomic_thread_fence(memory_order_release);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t word;
        memcpy(&word, (const uint8_t *)letter + (size_t)i * sizeof word, sizeof word);
        CR_MAILBOX_STEP();
        atomic_store_explicit(&to[i], word, memory_order_relaxed);
    }
    CR_MAILBOX_STEP();
    atomic_store_explicit(put, next, memory_order_release);
}

/* Purpose  the newest letter, if one was put since *seen.   Output  1: count words of it, and *seen; 0: nothing new, or written each time it was read: letter
 *          holds anything, *seen stays.   Cost  O(count), TRIES times at most. */
static inline int cr_mailbox_take(const _Atomic uint32_t *put, const _Atomic uint32_t *place, void *letter,
                                  uint32_t count, uint32_t *seen) {
    int whole = 0;
    for (uint32_t tries = 0; tries < CR_MAILBOX_TRIES && !whole; tries++) {
        CR_MAILBOX_STEP();
        const uint32_t before = atomic_load_explicit(put, memory_order_acquire);
        if (before == *seen) {
            break;
        }
        const _Atomic uint32_t *from = &place[(size_t)(before & 1u) * count];
        for (uint32_t i = 0; i < count; i++) {
            CR_MAILBOX_STEP();
            const uint32_t word = atomic_load_explicit(&from[i], memory_order_relaxed);
            memcpy((uint8_t *)letter + (size_t)i * sizeof word, &word, sizeof word);
        }
        atomic_thread_fence(memory_order_acquire);
        CR_MAILBOX_STEP();
        whole = atomic_load_explicit(put, memory_order_relaxed) == before;
        *seen = whole ? before : *seen;
    }
    return whole;
}

#endif
