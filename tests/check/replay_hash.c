/* Runs a job (job.h) and prints its hashes: the same for every compiler, option and processor.
 *
 *     replay_hash JOB [MADE.bin]
 *
 * MADE.bin gets what each tick made: of a recording its record, 512 bytes; of a path 18 words: cr_stats, areas, zones, force in N.
 * Prints `answers HASH all HASH ticks N touching N overflows N different N state N`. */
#include "blob.h"
#include "job.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#define STATE_MAX (256u * 1024u)

/* What the last tick made. */
static int write_tick(const job *j, FILE *made) {
    if (j->records != NULL) {
        return fwrite(cr_servo_get_record(j->servo), sizeof(cr_record), 1, made) == 1;
    }
    const uint32_t answered[2] = {j->out.area_count, j->out.zone_count};
    return fwrite(&j->out.stats, sizeof j->out.stats, 1, made) == 1 &&
           fwrite(answered, sizeof answered, 1, made) == 1 &&
           fwrite(&j->out.force_world_N, sizeof j->out.force_world_N, 1, made) == 1;
}

int main(int argc, char **argv) {
    static job j;
    if (argc != 2 && argc != 3) {
        fprintf(stderr, "usage: %s JOB [MADE.bin]\n", argv[0]);
        return 2;
    }
    const blob bytes = blob_read(argv[1]), memory = blob_make(STATE_MAX);
    const char *wrong = job_open(&j, bytes.bytes, bytes.size, memory.bytes, memory.size);
    FILE *made = wrong == NULL && argc == 3 ? fopen(argv[2], "wb") : NULL;
    if (wrong != NULL || (argc == 3 && made == NULL)) {
        fprintf(stderr, "%s: %s\n", argv[wrong != NULL ? 1 : 2], wrong != NULL ? wrong : "cannot be written");
        return 1;
    }
    for (uint32_t i = 0; i < j.ticks; i++) {
        job_tick(&j, i);
        job_hash(&j);
        if (made != NULL && !write_tick(&j, made)) {
            perror(argv[2]);
            return 1;
        }
    }
    printf("answers %016" PRIx64 " all %016" PRIx64 " ticks %" PRIu32 " touching %" PRIu32 " overflows %" PRIu32
           " different %" PRIu32 " state %" PRIu32 "\n",
           j.answers, j.all, j.ticks, j.touching, j.overflows, j.rerun.different, j.state_bytes);
    free(bytes.bytes);
    free(memory.bytes);
    return made != NULL && fclose(made) != 0;
}
