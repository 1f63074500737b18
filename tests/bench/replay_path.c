/* One replay of a path, as a program of its own: to be counted by valgrind, or built in double precision (widen.h).
 *
 *     replay_path IMAGE PATH RESPONSE COVERAGE ROWS
 *
 * PATH holds cr_path_row, ROWS gets cr_replay_row, RESPONSE and COVERAGE are numbers of crease.h. The sums of the image are made anew:
 * those of a widened image were added up in float32. */
#include "blob.h"
#include "contact/stages.h"
#include "replay.h"

#include <stdio.h>
#include <stdlib.h>

static void make_sums(uint8_t *image) {
    struct cr_img_header *head = (struct cr_img_header *)image;
    const struct cr_img_section *table = (const struct cr_img_section *)(image + sizeof *head);
    const struct cr_img_section *clusters = &table[CR_SEC_CLUSTERS - 1], *sums = &table[CR_SEC_SUMS - 1];
    float full[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        full[i] = 1.0f;
    }
    for (uint32_t i = 0; i < clusters->count; i++) {
        cr_sum_cluster((const struct cr_img_cluster *)(image + clusters->offset) + i, full,
                       (struct cr_img_sum *)(image + sums->offset) + i);
    }
    head->crc32 = cr_image_crc(image, head->size_bytes);
}

static void fail(const char *what, cr_err err) {
    fprintf(stderr, "%s: %s\n", what, cr_err_text(err));
    exit(1);
}

int main(int argc, char **argv) {
    if (argc != 6) {
        fprintf(stderr, "usage: %s IMAGE PATH RESPONSE COVERAGE ROWS\n", argv[0]);
        return 2;
    }
    const blob image = blob_read(argv[1]), path = blob_read(argv[2]);
    cr_scene scene;
    cr_config config = cr_config_default();
    config.response = (uint32_t)atoi(argv[3]);
    config.coverage = (uint32_t)atoi(argv[4]);
    make_sums(image.bytes);
    cr_err err = cr_scene_open(&scene, image.bytes, image.size);
    if (err != CR_OK) {
        fail(argv[1], err);
    }
    const blob memory = blob_make(cr_world_size(&scene, &config));
    cr_world *world;
    err = cr_world_init(&world, memory.bytes, memory.size, &scene, &config);
    if (err != CR_OK) {
        fail("world", err);
    }
    const size_t count = path.size / sizeof(cr_path_row);
    const blob rows = blob_make(count * sizeof(cr_replay_row));
    cr_replay_run(world, path.bytes, count, 1e-3, rows.bytes);
    FILE *out = fopen(argv[5], "wb");
    if (out == NULL || fwrite(rows.bytes, 1, rows.size, out) != rows.size || fclose(out) != 0) {
        perror(argv[5]);
        return 1;
    }
    free(image.bytes);
    free(path.bytes);
    free(memory.bytes);
    free(rows.bytes);
    return 0;
}
