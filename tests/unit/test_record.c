/* The record ring between two threads, and the head of a recording. */
#include "servo.h"

#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static cr_record record_of(uint32_t tick) {
    cr_record r;
    memset(&r, 0, sizeof r);
    r.tick = tick;
    r.tick_ns = ~tick; /* first and last word: a torn copy shows */
    return r;
}

static cr_record_ring *make_ring(uint32_t records, void **memory) {
    cr_record_ring *ring = NULL;
    const size_t size = cr_record_ring_size(records);
    *memory = aligned_alloc(64, size);
    assert_non_null(*memory);
    assert_int_equal(cr_record_ring_init(&ring, *memory, size, records), CR_OK);
    return ring;
}

static void ring_refuses_bad_sizes(void **state) {
    (void)state;
    static _Alignas(64) uint8_t memory[8192];
    cr_record_ring *ring = NULL;
    const uint32_t bad[] = {0u, 1u, 3u, 1000u, (1u << 20) + 1u, 1u << 21};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(cr_record_ring_size(bad[i]), 0);
        assert_int_equal(cr_record_ring_init(&ring, memory, sizeof memory, bad[i]), CR_ERR_CONFIG);
    }
    assert_int_equal(cr_record_ring_init(&ring, memory + 4, sizeof memory - 4u, 2u), CR_ERR_ALIGN);
    assert_int_equal(cr_record_ring_init(&ring, memory, 1024u, 2u), CR_ERR_SIZE);
    assert_int_equal(cr_record_ring_init(NULL, memory, sizeof memory, 2u), CR_ERR_NULL);
    assert_null(ring);
}

static void ring_keeps_order_and_counts_what_does_not_fit(void **state) {
    (void)state;
    void *memory;
    cr_record out[8];
    cr_record_ring *ring = make_ring(4u, &memory);
    for (uint32_t i = 0; i < 7u; i++) {
        const cr_record r = record_of(i);
        cr_record_push(ring, &r);
    }
    assert_int_equal(cr_record_lost(ring), 3);
    assert_int_equal(cr_record_pop(ring, out, 3u), 3);
    assert_true(out[0].tick == 0u && out[2].tick == 2u);
    const cr_record more = record_of(9u);
    cr_record_push(ring, &more);
    assert_int_equal(cr_record_pop(ring, out, 8u), 2);
    assert_true(out[0].tick == 3u && out[1].tick == 9u);
    assert_int_equal(cr_record_pop(ring, out, 8u), 0);
    free(memory);
}

#define THREAD_RECORDS 200000u

static void *write_all(void *ring) {
    for (uint32_t i = 0; i < THREAD_RECORDS; i++) {
        const cr_record r = record_of(i);
        cr_record_push(ring, &r);
        if (i % 64u == 0u) {
            sched_yield();
        }
    }
    return NULL;
}

static void ring_between_two_threads_loses_only_what_it_counts(void **state) {
    (void)state;
    void *memory;
    static cr_record out[64];
    cr_record_ring *ring = make_ring(256u, &memory);
    pthread_t writer;
    assert_int_equal(pthread_create(&writer, NULL, write_all, ring), 0);
    uint32_t taken = 0u, next = 0u;
    while (taken + cr_record_lost(ring) < THREAD_RECORDS) {
        const uint32_t count = cr_record_pop(ring, out, 64u);
        for (uint32_t i = 0; i < count; i++) {
            assert_true(out[i].tick >= next && out[i].tick_ns == ~out[i].tick);
            next = out[i].tick + 1u;
        }
        taken += count;
        if (count == 0u) {
            sched_yield();
        }
    }
    pthread_join(writer, NULL);
    assert_true(taken > 0u && taken + cr_record_lost(ring) == THREAD_RECORDS);
    free(memory);
}

static void head_reads_back_as_written(void **state) {
    (void)state;
    static uint8_t bytes[CR_RECORDS_AT];
    cr_servo_config config = cr_servo_config_default(), back;
    cr_record_head head;
    config.control.force_max_N = 12.5f;
    cr_record_head_write(&config, NULL, 0u, bytes);
    assert_memory_equal(bytes, "CRRECORD", 8);
    assert_int_equal(cr_record_head_read(bytes, &head, &back), CR_OK);
    assert_memory_equal(&config, &back, sizeof back);
    assert_true(head.record_bytes == 512u && head.records_at == 1024u && head.scene_crc32 == 0u);
}

static void head_refuses_what_it_did_not_write(void **state) {
    (void)state;
    static uint8_t good[CR_RECORDS_AT], bytes[CR_RECORDS_AT];
    const cr_servo_config config = cr_servo_config_default();
    const struct {
        size_t at;
        cr_err err;
    } table[] = {{0u, CR_ERR_MAGIC},
                 {7u, CR_ERR_MAGIC},
                 {8u, CR_ERR_VERSION},
                 {12u, CR_ERR_SIZE},
                 {16u, CR_ERR_SIZE},
                 {20u, CR_ERR_SIZE},
                 {sizeof(cr_record_head) + offsetof(cr_servo_config, bus) + 3u, CR_ERR_CONFIG}};
    cr_record_head_write(&config, NULL, 0u, good);
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        cr_record_head head = {.version = 77u};
        cr_servo_config back;
        memcpy(bytes, good, sizeof bytes);
        bytes[table[i].at] ^= 0x5au;
        assert_int_equal(cr_record_head_read(bytes, &head, &back), table[i].err);
        assert_int_equal(head.version, 77);
    }
}

/* servo/SPEC.md: the layout that other programs read. */
static void record_layout_is_the_documented_one(void **state) {
    (void)state;
    assert_int_equal(sizeof(cr_record), 512);
    assert_int_equal(offsetof(cr_record, sync_ns), 8);
    assert_int_equal(offsetof(cr_record, frames), 40);
    assert_int_equal(offsetof(cr_record, mode), 184);
    assert_int_equal(offsetof(cr_record, counts), 196);
    assert_int_equal(offsetof(cr_record, target), 226);
    assert_int_equal(offsetof(cr_record, joints), 240);
    assert_int_equal(offsetof(cr_record, world_from_tool), 264);
    assert_int_equal(offsetof(cr_record, force_world_N), 328);
    assert_int_equal(offsetof(cr_record, counters), 372);
    assert_int_equal(offsetof(cr_record, wake_late_ns), 500);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ring_refuses_bad_sizes),
        cmocka_unit_test(ring_keeps_order_and_counts_what_does_not_fit),
        cmocka_unit_test(ring_between_two_threads_loses_only_what_it_counts),
        cmocka_unit_test(head_reads_back_as_written),
        cmocka_unit_test(head_refuses_what_it_did_not_write),
        cmocka_unit_test(record_layout_is_the_documented_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
