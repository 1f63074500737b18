/* How much of the scene image each tick of a path reads, in lines of 32 bytes, by section.
 *
 *     touched IMAGE PATH RESPONSE COVERAGE COUNTS [LOOKUPS]
 *
 * PATH holds cr_path_row, COUNTS gets a struct touched for each row; LOOKUPS: work of a tick at most, as in cr_config. Everything is compiled with -fsanitize=kernel-address and calls
 * instead of checks: the compiler then puts a call before every access to memory. The calls end here, where there is no sanitizer,
 * and mark lines. The code that ships is the same source without these calls. */
#include "blob.h"
#include "contact/stages.h"
#include "replay.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define UNSEEN __attribute__((no_sanitize("kernel-address")))
#define LINE 32u

struct touched {
    uint32_t lines[CR_SEC_COUNT]; /* by section, in the order of ids */
    uint32_t rest;                /* header and table */
    uint32_t contacts;
    uint32_t nodes, points;
};

static struct {
    const uint8_t *image;
    size_t size;
    uint32_t *seen_in; /* of each line: the tick that read it last */
    uint32_t tick;     /* from 1 on; 0: nothing is counted */
    uint8_t *section;  /* of each line, from 1 on; 0: none */
    struct touched now;
} watch;

UNSEEN static void mark(uintptr_t at, size_t size) {
    const uintptr_t low = (uintptr_t)watch.image;
    if (watch.tick == 0u || size == 0u || at + size <= low || at >= low + watch.size) {
        return;
    }
    const size_t first = (at > low ? at - low : 0u) / LINE, last = (at + size - 1u - low) / LINE;
    for (size_t i = first; i <= last && i < watch.size / LINE; i++) {
        if (watch.seen_in[i] != watch.tick) {
            watch.seen_in[i] = watch.tick;
            if (watch.section[i] != 0u) {
                watch.now.lines[watch.section[i] - 1u]++;
            } else {
                watch.now.rest++;
            }
        }
    }
}

#define HOOKS(n)                                                                                                       \
    UNSEEN void __asan_load##n##_noabort(uintptr_t at);                                                                \
    UNSEEN void __asan_store##n##_noabort(uintptr_t at);                                                               \
    UNSEEN void __asan_load##n##_noabort(uintptr_t at) { mark(at, n); }                                                \
    UNSEEN void __asan_store##n##_noabort(uintptr_t at) { (void)at; }
HOOKS(1)
HOOKS(2)
HOOKS(4)
HOOKS(8)
HOOKS(16)
UNSEEN void __asan_loadN_noabort(uintptr_t at, size_t size);
UNSEEN void __asan_storeN_noabort(uintptr_t at, size_t size);
UNSEEN void __asan_handle_no_return(void);
UNSEEN void __asan_loadN_noabort(uintptr_t at, size_t size) { mark(at, size); }
UNSEEN void __asan_storeN_noabort(uintptr_t at, size_t size) {
    (void)at;
    (void)size;
}
UNSEEN void __asan_handle_no_return(void) {}

UNSEEN static void watch_image(const blob *image) {
    const struct cr_img_section *table =
        (const struct cr_img_section *)((const uint8_t *)image->bytes + sizeof(struct cr_img_header));
    watch.image = image->bytes;
    watch.size = image->size;
    watch.seen_in = calloc(image->size / LINE + 1u, sizeof *watch.seen_in);
    watch.section = calloc(image->size / LINE + 1u, 1u);
    if (watch.seen_in == NULL || watch.section == NULL) {
        fprintf(stderr, "no memory\n");
        exit(1);
    }
    for (uint32_t id = 1; id <= CR_SEC_COUNT; id++) {
        const size_t end = table[id - 1u].offset + (size_t)table[id - 1u].count * table[id - 1u].stride;
        for (size_t i = table[id - 1u].offset / LINE; i * LINE < end; i++) {
            watch.section[i] = (uint8_t)id;
        }
    }
}

UNSEEN static int write_counts(const char *name, cr_world *world, const blob *path) {
    const cr_path_row *rows = path->bytes;
    const size_t count = path->size / sizeof *rows;
    FILE *out = fopen(name, "wb");
    int good = out != NULL;
    for (size_t i = 0; i < count && good; i++) {
        cr_replay_row row;
        memset(&watch.now, 0, sizeof watch.now);
        watch.tick = (uint32_t)i + 1u;
        cr_replay_run(world, &rows[i], 1u, i == 0 ? 1e-3 : rows[i].t_s - rows[i - 1].t_s, &row);
        watch.tick = 0u;
        watch.now.contacts = row.contacts;
        watch.now.nodes = row.nodes;
        watch.now.points = row.points;
        good = fwrite(&watch.now, sizeof watch.now, 1, out) == 1u;
    }
    return good && fclose(out) == 0;
}

UNSEEN int main(int argc, char **argv) {
    if (argc != 6 && argc != 7) {
        fprintf(stderr, "usage: %s IMAGE PATH RESPONSE COVERAGE COUNTS [LOOKUPS]\n", argv[0]);
        return 2;
    }
    const blob image = blob_read(argv[1]), path = blob_read(argv[2]);
    cr_scene scene;
    cr_world *world;
    cr_config config = cr_config_default();
    config.response = (uint32_t)atoi(argv[3]);
    config.coverage = (uint32_t)atoi(argv[4]);
    config.lookups_max = argc > 6 ? (uint32_t)atoi(argv[6]) : config.lookups_max;
    cr_err err = cr_scene_open(&scene, image.bytes, image.size);
    if (err != CR_OK) {
        fprintf(stderr, "%s: %s\n", argv[1], cr_err_text(err));
        return 1;
    }
    const blob memory = blob_make(cr_world_size(&scene, &config));
    err = cr_world_init(&world, memory.bytes, memory.size, &scene, &config);
    if (err != CR_OK) {
        fprintf(stderr, "world: %s\n", cr_err_text(err));
        return 1;
    }
    watch_image(&image);
    if (!write_counts(argv[5], world, &path)) {
        perror(argv[5]);
        return 1;
    }
    return 0;
}
