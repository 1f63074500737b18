#include "job.h"

#include <string.h>

#define FNV_START 0xcbf29ce484222325u
#define FNV_PRIME 0x100000001b3u

/* FNV-1a over words: every output is made of 4-byte members, and a device takes a quarter of the time that bytes take. */
static uint64_t hash_words(uint64_t hash, const void *words, size_t size) {
    const uint8_t *p = words;
    for (size_t i = 0; i + 4u <= size; i += 4u) {
        uint32_t word;
        memcpy(&word, p + i, sizeof word);
        hash = (hash ^ word) * FNV_PRIME;
    }
    return hash;
}

static const char *open_path(job *j, const job_head *head, const cr_scene *scene, void *memory, size_t memory_bytes) {
    cr_config config;
    memcpy(&config, j->bytes + JOB_CONFIG_AT, sizeof config);
    j->rows = (const job_row *)(const void *)(j->bytes + head->data_at);
    j->ticks = head->data_bytes / (uint32_t)sizeof(job_row);
    j->state_bytes = (uint32_t)cr_world_size(scene, &config);
    const cr_err err = cr_world_init(&j->world, memory, memory_bytes, scene, &config);
    return err == CR_OK ? NULL : cr_err_text(err);
}

/* The coupling lies behind the world, whose scene it looks in. */
static const char *open_held(job *j, uint8_t *memory, size_t memory_bytes) {
    cr_couple_config config;
    const size_t at = (j->state_bytes + 63u) & ~(size_t)63u;
    if (memory_bytes < at + sizeof(cr_coupled)) {
        return "no room for a coupling";
    }
    memcpy(&config, j->bytes + JOB_CONFIG_AT + sizeof(cr_config), sizeof config);
    j->coupled = (cr_coupled *)(void *)(memory + at);
    j->state_bytes = (uint32_t)(at + sizeof(cr_coupled));
    const cr_err err = cr_coupled_init(j->coupled, &config);
    return err == CR_OK ? NULL : cr_err_text(err);
}

static const char *open_recording(job *j, const job_head *head, const cr_scene *scene, void *memory,
                                  size_t memory_bytes) {
    cr_record_head found;
    cr_servo_config config;
    const uint8_t *at = j->bytes + head->data_at;
    cr_err err = head->data_bytes < CR_RECORDS_AT ? CR_ERR_SIZE : cr_record_head_read(at, &found, &config);
    if (err != CR_OK) {
        return cr_err_text(err);
    }
    j->records = (const cr_record *)(const void *)(at + CR_RECORDS_AT);
    j->ticks = (head->data_bytes - CR_RECORDS_AT) / (uint32_t)sizeof(cr_record);
    j->state_bytes = (uint32_t)cr_servo_size(scene, &config);
    err = cr_servo_init(&j->servo, memory, memory_bytes, scene, &config);
    return err == CR_OK ? NULL : cr_err_text(err);
}

const char *job_open(job *j, const void *bytes, size_t size, void *memory, size_t memory_bytes) {
    job_head head;
    cr_scene scene;
    memset(j, 0, sizeof *j);
    j->bytes = bytes;
    j->answers = j->all = FNV_START;
    if (size < JOB_CONFIG_AT + sizeof(cr_config) + sizeof(cr_couple_config)) {
        return "no job: too short";
    }
    memcpy(&head, bytes, sizeof head);
    if (memcmp(head.magic, "CRJOB001", sizeof head.magic) != 0) {
        return "no job: its first bytes are not CRJOB001";
    }
    if (head.scene_at % 64u != 0u || head.data_at % 64u != 0u || head.scene_at > size || head.data_at > size ||
        head.scene_bytes > size - head.scene_at || head.data_bytes > size - head.data_at) {
        return "no job: its sections lie outside of it";
    }
    const cr_err err = cr_scene_open(&scene, j->bytes + head.scene_at, head.scene_bytes);
    if (err != CR_OK) {
        return cr_err_text(err);
    }
    j->steps = head.kind == JOB_STEPS;
    if (head.kind == JOB_RECORDING) {
        return open_recording(j, &head, &scene, memory, memory_bytes);
    }
    const char *wrong = open_path(j, &head, &scene, memory, memory_bytes);
    return wrong == NULL && head.kind == JOB_HELD ? open_held(j, memory, memory_bytes) : wrong;
}

void job_tick(job *j, uint32_t i) {
    if (j->coupled != NULL) {
        cr_couple_tick(j->coupled, j->world, &j->rows[i].world_from_tool, j->rows[i].period_s, &j->held);
    } else if (j->steps) {
        cr_feel(j->world, &j->rows[i].world_from_tool, j->rows[i].period_s, &j->out);
        (void)cr_search(j->world, 1u);
    } else if (j->rows != NULL) {
        cr_tick(j->world, &j->rows[i].world_from_tool, j->rows[i].period_s, &j->out);
    } else {
        cr_servo_rerun(j->servo, &j->records[i], 1u, &j->rerun, NULL);
    }
}

static void hash_output(job *j, const cr_output *out) {
    uint64_t hash = hash_words(j->answers, out, offsetof(cr_output, stats));
    for (uint32_t a = 0; a < out->area_count; a++) {
        const cr_area *area = &out->areas[a];
        hash = hash_words(hash, area, offsetof(cr_area, zones) + area->zone_count * sizeof area->zones[0]);
    }
    j->answers = hash;
    j->all = hash_words(hash_words(j->all, &hash, sizeof hash), &out->stats, sizeof out->stats);
    const cr_stats *s = &out->stats;
    j->overflows += s->late_ticks + s->clusters_dropped + s->touches_dropped + s->areas_merged + s->zones_dropped;
    j->touching += out->area_count > 0u;
}

static void hash_held(job *j) {
    const cr_couple_stats *s = &j->coupled->stats;
    j->answers = hash_words(j->answers, &j->held, sizeof j->held);
    j->all = hash_words(hash_words(j->all, &j->answers, sizeof j->answers), s, sizeof *s);
    j->overflows += s->dropped + s->refused;
    j->touching += j->held.pressing > 0u;
}

void job_hash(job *j) {
    if (j->coupled != NULL) {
        hash_held(j);
        return;
    }
    if (j->rows != NULL) {
        hash_output(j, &j->out);
        return;
    }
    const cr_record *record = cr_servo_get_record(j->servo);
    j->answers = hash_words(j->answers, record, offsetof(cr_record, wake_late_ns));
    j->all = j->answers;
    j->touching += record->area_count > 0u;
}
