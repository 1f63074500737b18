/* A replay in one block of bytes: scene, settings and inputs. The same C code runs it on every target, so that the hash of its
 * outputs can be compared between compilers and processors. tests/device/jobs.py writes such blocks. No I/O, no heap.
 *
 *     0    job_head, little-endian
 *     64   cr_config of a path job; of a held tool its cr_couple_config behind it
 *     ..   the scene image at scene_at, a multiple of 64
 *     ..   at data_at: rows of a path (job_row), or a recording of the servo (.crr) */
#ifndef CHECK_JOB_H
#define CHECK_JOB_H

#include "couple.h"
#include "crease.h"
#include "servo.h"

#define JOB_CONFIG_AT 64u
#define JOB_PATH 0u
#define JOB_RECORDING 1u
#define JOB_STEPS 2u /* a path at two rates: a tick feels, then searches one step */
#define JOB_HELD 3u  /* a path of the hand that holds the tool by springs */

typedef struct {
    char magic[8]; /* "CRJOB001" */
    uint32_t kind; /* JOB_* */
    uint32_t scene_at, scene_bytes;
    uint32_t data_at, data_bytes;
} job_head;

/* One tick of a path. */
typedef struct {
    cr_pose world_from_tool;
    float period_s;
} job_row;

typedef struct {
    const uint8_t *bytes;
    const job_row *rows;      /* of a path, else null */
    const cr_record *records; /* of a recording, else null */
    uint32_t ticks;           /* rows or records of the job */
    uint32_t steps;           /* 1: JOB_STEPS */
    cr_world *world;
    cr_servo *servo;
    cr_coupled *coupled;   /* of a held tool, else null */
    cr_couple_output held; /* of its last tick */
    cr_output out;         /* of the last tick of a path */
    cr_rerun rerun;        /* of a recording: how many records came out other than they were */
    uint64_t answers;      /* hash of all that the ticks answered, without the work they report */
    uint64_t all;          /* hash of every output of every tick */
    uint32_t state_bytes;  /* memory of the world, or of the servo with its world */
    uint32_t overflows;    /* drops of all ticks */
    uint32_t touching;     /* ticks with an area */
} job;

/* Purpose  check the block and build its world or servo in the caller's memory (64-byte aligned, as `bytes`).
 * Output   null, or what is wrong. */
const char *job_open(job *j, const void *bytes, size_t size, void *memory, size_t memory_bytes);

/* Purpose  run tick i; in order, each once.   Output  world or servo; nothing is hashed yet. */
void job_tick(job *j, uint32_t i);

/* Purpose  add what the last tick put out to the hashes. */
void job_hash(job *j);

#endif
