/* Press the tool into the part and print what the hand feels: example SCENE.crs X Y Z, metres; the tool comes from 5 mm above.
 *
 *     cc example.c $(pkg-config --cflags --libs crease) -o example */
#include <crease.h>
#include <stdio.h>
#include <stdlib.h>

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
    if (argc != 5) {
        fprintf(stderr, "usage: example SCENE.crs X Y Z\n");
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
    cr_pose pose = {{strtof(argv[2], NULL), strtof(argv[3], NULL), strtof(argv[4], NULL)}, {1.0f, 0.0f, 0.0f, 0.0f}};
    pose.pos_m.z += 5e-3f;
    for (int ms = 0; ms <= 50; ms++) {
        static cr_output out; /* 6 KB: not on a small stack */
        cr_tick(world, &pose, 1e-3f, &out);
        if (ms % 10 == 0) {
            printf("%2d ms: %.3f %.3f %.3f N, %u areas\n", ms, (double)out.force_world_N.x, (double)out.force_world_N.y,
                   (double)out.force_world_N.z, (unsigned)out.area_count);
        }
        pose.pos_m.z -= 1e-4f;
    }
    free(memory);
    free(image);
    return 0;
}
