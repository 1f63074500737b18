/* Press the tool into the part and print what the hand feels: example SCENE.crs X Y Z, metres; the tool comes from 5 mm above.
 *
 *     cc example.c $(pkg-config --cflags --libs crease) -o example */
#include <crease.h>
#include <stdio.h>
#include <stdlib.h>

/* Whether a word is a number, and no more than that. */
static int read_number(const char *word, float *number) {
    char *end;
    *number = strtof(word, &end);
    return end != word && *end == '\0';
}

/* A file in memory as crease wants it: 64-byte aligned. */
static void *load(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    void *bytes = NULL;
    if (file != NULL && fseek(file, 0, SEEK_END) == 0) {
        *size = (size_t)ftell(file);
        rewind(file);
        bytes = aligned_alloc(64, (*size + 63) / 64 * 64);
        if (bytes != NULL && fread(bytes, 1, *size, file) != *size) {
            free(bytes);
            bytes = NULL;
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    return bytes;
}

int main(int argc, char **argv) {
    cr_pose pose = {{0.0f, 0.0f, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}};
    if (argc != 5 || !read_number(argv[2], &pose.pos_m.x) || !read_number(argv[3], &pose.pos_m.y) ||
        !read_number(argv[4], &pose.pos_m.z)) {
        fprintf(stderr, "usage: example SCENE.crs X Y Z, in metres\n");
        return 2;
    }
    size_t size = 0;
    void *image = load(argv[1], &size);
    if (image == NULL) {
        fprintf(stderr, "error: %s: cannot be read\n", argv[1]);
        return 1;
    }
    const cr_config config = cr_config_default(); /* 1000 N/m */
    cr_scene scene;
    cr_world *world = NULL;
    void *memory = NULL;
    cr_err err = cr_scene_open(&scene, image, size);
    if (err == CR_OK) {
        size = (cr_world_size(&scene, &config) + 63) / 64 * 64;
        memory = aligned_alloc(64, size);
        err = cr_world_init(&world, memory, size, &scene, &config);
    }
    if (err != CR_OK) {
        fprintf(stderr, "error: %s: %s\n", argv[1], cr_err_text(err));
        return 1;
    }
    int status = 0;
    pose.pos_m.z += 5e-3f;
    for (int ms = 0; ms <= 50 && status == 0; ms++) {
        static cr_output out; /* 6 KB: not on a small stack */
        cr_tick(world, &pose, 1e-3f, &out);
        if (out.faults != 0) { /* latched: until cr_world_clear_fault all output is zero */
            fprintf(stderr, "error: fault %u, such as a pose that is no number\n", (unsigned)out.faults);
            status = 1;
        } else if (ms % 10 == 0) {
            printf("%2d ms: %.3f %.3f %.3f N, %u areas\n", ms, (double)out.force_world_N.x, (double)out.force_world_N.y,
                   (double)out.force_world_N.z, (unsigned)out.area_count);
        }
        pose.pos_m.z -= 1e-4f;
    }
    free(memory);
    free(image);
    return status;
}
