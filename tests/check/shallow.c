/* Hits that are passed over, on the poses of a job (job.h).
 *
 *     shallow JOB
 *
 * Prints `hits N deep N work N alone N short_um N`: shallow.h says of what. */
#include "shallow.h"

#include "blob.h"
#include "job.h"

#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv) {
    static shallow hits;
    static cr_scene scene;
    static cr_field field;
    static cr_motion motion;
    shallow_tally t = {0};
    if (argc != 2) {
        fprintf(stderr, "usage: %s JOB\n", argv[0]);
        return 2;
    }
    const blob file = blob_read(argv[1]);
    const uint8_t *bytes = file.bytes;
    const job_head *head = file.bytes;
    const job_row *rows = (const job_row *)(const void *)(bytes + head->data_at);
    if (cr_scene_open(&scene, bytes + head->scene_at, head->scene_bytes) != CR_OK) {
        fprintf(stderr, "%s: its scene cannot be opened\n", argv[1]);
        return 1;
    }
    cr_field_init(&field, &scene);
    motion.wake_count = scene.group_count * CR_LANES;
    motion.wake_m = calloc(motion.wake_count, sizeof(float));
    if (motion.wake_m == NULL) {
        fprintf(stderr, "%s: no memory for its spheres\n", argv[1]);
        return 1;
    }
    hits.field = &field;
    hits.motion = &motion;
    for (uint32_t i = 0; i < head->data_bytes / sizeof *rows; i++) {
        shallow_compare(&hits, &rows[i].world_from_tool, &t);
    }
    printf("hits %u deep %u work %.0f alone %.0f short_um %.4f\n", (unsigned)t.hits, (unsigned)t.deep, t.together,
           t.alone, t.short_m * 1e6);
    free(motion.wake_m);
    free(file.bytes);
    return 0;
}
