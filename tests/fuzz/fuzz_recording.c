/* Recordings: a head is refused or its configuration runs; hostile records run again without harm. The mutator starts from a
 * recording made here, and repairs what the head says of itself. */
#include "fuzz.h"
#include "servo_rig.h"

#define RECORDS_MAX 400u
#define PERIOD_NS 12000000u /* longer than the space between two SDOs: the set-up takes few records */

static void run(const cr_servo_config *config, const uint8_t *bytes, uint32_t count) {
    static cr_record out[RECORDS_MAX];
    const size_t size = cr_servo_size(crt_plate_scene(), config);
    cr_record *records = malloc(count * sizeof *records);
    void *memory = aligned_alloc(64, size);
    cr_servo *servo = NULL;
    cr_rerun result = {0};
    HOLDS(size > 0u && records != NULL && memory != NULL);
    memcpy(records, bytes, count * sizeof *records);
    HOLDS(cr_servo_init(&servo, memory, size, crt_plate_scene(), config) == CR_OK);
    HOLDS(cr_servo_rerun(servo, records, count, &result, out) == CR_OK);
    HOLDS(result.records <= count && result.different <= result.records);
    HOLDS(result.records == count || result.gap == 1u);
    for (uint32_t i = 0; i < result.records; i++) {
        crt_check_record(config, &out[i]);
    }
    free(memory);
    free(records);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    cr_record_head head;
    cr_servo_config config;
    if (size < CR_RECORDS_AT) {
        return 0; /* the caller reads so much or says that the file is short */
    }
    uint8_t *bytes = malloc(size);
    HOLDS(bytes != NULL);
    memcpy(bytes, data, size);
    if (cr_record_head_read(bytes, &head, &config) == CR_OK) {
        uint32_t count = (uint32_t)((size - CR_RECORDS_AT) / sizeof(cr_record));
        count = count < RECORDS_MAX ? count : RECORDS_MAX;
        HOLDS(cr_servo_config_error(&config) == NULL);
        if (count > 0u) {
            run(&config, bytes + CR_RECORDS_AT, count);
        }
    }
    free(bytes);
    return 0;
}

/* ---- the mutator ------------------------------------------------------------------------------------------------- */

static size_t good_recording(uint8_t *data, size_t max_size) {
    static crt_servo_rig rig;
    static int made;
    cr_servo_config config = cr_servo_config_default();
    config.period_s = 12e-3f;
    config.overrun_s = 20e-3f;
    config.bus.listen_ms = config.bus.rest_ticks = 0u;
    config.late_max_ticks = 8u;
    for (int a = 0; a < CR_AXES; a++) {
        config.axis[a].jump_max *= 10.0f;
    }
    if (!made) {
        HOLDS(crt_servo_start(&rig, &config) && crt_servo_bring_up(&rig, PERIOD_NS, RECORDS_MAX));
        for (int k = 0; k < 30; k++) {
            rig.drives[k % 3].counts += k % 5 - 2;
            crt_servo_period(&rig, PERIOD_NS);
        }
        made = 1;
    }
    size_t count = max_size < CR_RECORDS_AT ? 0u : (max_size - CR_RECORDS_AT) / sizeof(cr_record);
    count = count < rig.record_count ? count : rig.record_count;
    if (max_size < CR_RECORDS_AT) {
        return 0u;
    }
    cr_record_head_write(&config, NULL, 0u, data);
    memcpy(data + CR_RECORDS_AT, rig.records, count * sizeof(cr_record));
    return CR_RECORDS_AT + count * sizeof(cr_record);
}

size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned start) {
    uint64_t seed = start;
    if (size < CR_RECORDS_AT || crf_random(&seed, 100u) == 0u) {
        size = good_recording(data, max_size);
    }
    if (size < CR_RECORDS_AT) {
        return size;
    }
    const uint32_t records = (uint32_t)((size - CR_RECORDS_AT) / sizeof(cr_record));
    for (uint32_t n = 1u + crf_random(&seed, 3u); n > 0u; n--) {
        uint8_t *record = data + CR_RECORDS_AT + (size_t)crf_random(&seed, records) * sizeof(cr_record);
        uint8_t *config = data + sizeof(cr_record_head);
        switch (crf_random(&seed, 7u)) {
        case 2:
            if (records > 0u) {
                LLVMFuzzerMutate(record + offsetof(cr_record, contact_late_ticks), 4u, 4u);
            }
            break;
        case 0:
            LLVMFuzzerMutate(config + 4u * crf_random(&seed, sizeof(cr_servo_config) / 4u), 4u, 4u);
            break;
        case 1:
            size = LLVMFuzzerMutate(data, size, max_size);
            break;
        default: /* the inputs of a record come first in it */
            if (records > 0u) {
                LLVMFuzzerMutate(record + 4u, offsetof(cr_record, mode) - 4u, offsetof(cr_record, mode) - 4u);
            }
            break;
        }
        if (size < CR_RECORDS_AT) {
            return size;
        }
    }
    if (crf_random(&seed, 50u) > 0u) {
        cr_servo_config config;
        memcpy(&config, data + sizeof(cr_record_head), sizeof config);
        cr_record_head_write(&config, NULL, 0u, data);
    }
    return size;
}
