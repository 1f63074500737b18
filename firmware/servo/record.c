/* record: the ring between the loop and the file, and the head of the file. */
#include "contact/image.h"
#include "servo/servo_stages.h"

#include <stdatomic.h>
#include <string.h>

#define RING_MAX (1u << 20)
#define RING_ALIGN 64u

/* Each index has a cache line of its own and one writer; both only grow, and wrap as unsigned numbers do. */
struct cr_record_ring {
    _Alignas(RING_ALIGN) atomic_uint written;
    _Alignas(RING_ALIGN) atomic_uint taken;
    _Alignas(RING_ALIGN) atomic_uint lost;
    uint32_t mask;
    _Alignas(RING_ALIGN) cr_record records[];
};

size_t cr_record_ring_size(uint32_t records) {
    if (records < 2u || records > RING_MAX || (records & (records - 1u)) != 0u) {
        return 0u;
    }
    return sizeof(cr_record_ring) + (size_t)records * sizeof(cr_record);
}

cr_err cr_record_ring_init(cr_record_ring **ring, void *memory, size_t size_bytes, uint32_t records) {
    if (ring == NULL || memory == NULL) {
        return CR_ERR_NULL;
    }
    size_t need = cr_record_ring_size(records);
    if (need == 0u) {
        return CR_ERR_CONFIG;
    }
    if ((uintptr_t)memory % RING_ALIGN != 0u) {
        return CR_ERR_ALIGN;
    }
    if (size_bytes < need) {
        return CR_ERR_SIZE;
    }
    cr_record_ring *r = memory;
    memset(memory, 0, need);
    atomic_init(&r->written, 0u);
    atomic_init(&r->taken, 0u);
    atomic_init(&r->lost, 0u);
    r->mask = records - 1u;
    *ring = r;
    return CR_OK;
}

void cr_record_push(cr_record_ring *ring, const cr_record *record) {
    uint32_t written = atomic_load_explicit(&ring->written, memory_order_relaxed);
    uint32_t taken = atomic_load_explicit(&ring->taken, memory_order_acquire);
    if (written - taken > ring->mask) {
        atomic_fetch_add_explicit(&ring->lost, 1u, memory_order_relaxed);
        return;
    }
    ring->records[written & ring->mask] = *record;
    atomic_store_explicit(&ring->written, written + 1u, memory_order_release);
}

uint32_t cr_record_pop(cr_record_ring *ring, cr_record *out, uint32_t max) {
    uint32_t taken = atomic_load_explicit(&ring->taken, memory_order_relaxed);
    uint32_t written = atomic_load_explicit(&ring->written, memory_order_acquire);
    uint32_t count = written - taken < max ? written - taken : max;
    for (uint32_t i = 0; i < count; i++) {
        out[i] = ring->records[(taken + i) & ring->mask];
    }
    atomic_store_explicit(&ring->taken, taken + count, memory_order_release);
    return count;
}

uint32_t cr_record_lost(const cr_record_ring *ring) { return atomic_load_explicit(&ring->lost, memory_order_relaxed); }

static const char magic[8] = {'C', 'R', 'R', 'E', 'C', 'O', 'R', 'D'};

_Static_assert(sizeof(cr_record_head) + sizeof(cr_servo_config) <= CR_RECORDS_AT, "the head holds the configuration");

void cr_record_head_write(const cr_servo_config *config, const void *image, size_t image_bytes, uint8_t *out) {
    cr_record_head head = {{0}, CR_RECORD_VERSION, CR_RECORD_BYTES, sizeof *config, CR_RECORDS_AT, 0u, 0u};
    memcpy(head.magic, magic, sizeof magic);
    if (image != NULL && image_bytes >= sizeof(struct cr_img_header)) {
        struct cr_img_header image_head;
        memcpy(&image_head, image, sizeof image_head);
        head.scene_crc32 = image_head.crc32;
        head.scene_bytes = (uint32_t)image_bytes;
    }
    memset(out, 0, CR_RECORDS_AT);
    memcpy(out, &head, sizeof head);
    memcpy(out + sizeof head, config, sizeof *config);
}

cr_err cr_record_head_read(const uint8_t *bytes, cr_record_head *head, cr_servo_config *config) {
    cr_record_head found;
    cr_servo_config found_config;
    memcpy(&found, bytes, sizeof found);
    memcpy(&found_config, bytes + sizeof found, sizeof found_config);
    if (memcmp(found.magic, magic, sizeof magic) != 0) {
        return CR_ERR_MAGIC;
    }
    if (found.version != CR_RECORD_VERSION) {
        return CR_ERR_VERSION;
    }
    if (found.record_bytes != CR_RECORD_BYTES || found.config_bytes != sizeof found_config ||
        found.records_at != CR_RECORDS_AT) {
        return CR_ERR_SIZE;
    }
    if (cr_servo_config_error(&found_config) != NULL) {
        return CR_ERR_CONFIG;
    }
    *head = found;
    *config = found_config;
    return CR_OK;
}
