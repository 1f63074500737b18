/* Replays a path through a scene and prints one hash of every answer: the same for every compiler and option.
 *
 *     replay_hash SCENE.crs PATH.bin RESPONSE COVERAGE SKIP
 *
 * PATH.bin holds rows of eight doubles, as cr_path_row. The cost of a tick is left out of the hash. */
#include "crease.h"
#include "replay.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    void *bytes;
    size_t size;
} blob;

/* The file at an address that is a multiple of 64; exits when there is none. */
static blob read_blob(const char *name) {
    blob b = {NULL, 0};
    FILE *file = fopen(name, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        perror(name);
        exit(1);
    }
    const long size = ftell(file);
    rewind(file);
    b.size = (size_t)size;
    b.bytes = aligned_alloc(64, (b.size + 63) / 64 * 64);
    if (b.bytes == NULL || fread(b.bytes, 1, b.size, file) != b.size) {
        perror(name);
        exit(1);
    }
    fclose(file);
    return b;
}

static uint64_t fnv1a(uint64_t hash, const void *bytes, size_t size) {
    const unsigned char *p = bytes;
    for (size_t i = 0; i < size; i++) {
        hash = (hash ^ p[i]) * 0x100000001b3u;
    }
    return hash;
}

int main(int argc, char **argv) {
    if (argc != 6) {
        fprintf(stderr, "usage: %s SCENE.crs PATH.bin RESPONSE COVERAGE SKIP\n", argv[0]);
        return 2;
    }
    const blob image = read_blob(argv[1]);
    const blob path = read_blob(argv[2]);
    const size_t count = path.size / sizeof(cr_path_row);
    cr_config config = cr_config_default();
    config.response = (uint32_t)strtoul(argv[3], NULL, 10);
    config.coverage = (uint32_t)strtoul(argv[4], NULL, 10);
    config.skip = (uint32_t)strtoul(argv[5], NULL, 10);
    config.damping_Ns_m = 2.0f;
    cr_scene scene;
    cr_err err = cr_scene_open(&scene, image.bytes, image.size);
    const size_t size = err == CR_OK ? cr_world_size(&scene, &config) : 0;
    void *memory = aligned_alloc(64, (size + 63) / 64 * 64 + 64);
    cr_world *world = NULL;
    err = err == CR_OK ? cr_world_init(&world, memory, size, &scene, &config) : err;
    cr_replay_row *rows = calloc(count + 1, sizeof *rows);
    if (err != CR_OK || rows == NULL) {
        fprintf(stderr, "%s: %s\n", argv[1], cr_err_text(err));
        return 1;
    }
    cr_replay_run(world, path.bytes, count, 1e-3, rows);
    uint64_t hash = 0xcbf29ce484222325u;
    for (size_t i = 0; i < count; i++) {
        hash = fnv1a(hash, &rows[i], offsetof(cr_replay_row, nodes)); /* from there on skipping shows, and the cost */
    }
    printf("%016" PRIx64 "\n", hash);
    free(rows);
    free(memory);
    free(path.bytes);
    free(image.bytes);
    return 0;
}
