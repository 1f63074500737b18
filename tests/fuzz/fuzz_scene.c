/* Scene images: whatever opens ticks soundly. The mutator knows the sections and repairs sums and checksum, so that mutants get
 * past the header; it starts from small images of an edge, a room, a ball and a ball of fine voxels, made here, so that no image is kept as a seed. */
#include "fuzz.h"
#include "image_builder.h"

#include <math.h>

#define BASES 4
#define TICKS 12
#define WORLD_MAX (1u << 26)

/* ---- the target -------------------------------------------------------------------------------------------------- */

static cr_pose pose_in(const cr_scene *scene, uint64_t *seed) {
    const struct cr_img_meta *m = scene->meta;
    float at[3];
    cr_pose p;
    for (int a = 0; a < 3; a++) {
        const double side = (double)m->brick_m * (double)m->dims[a];
        at[a] = m->origin_m[a] + (float)crt_uniform(seed, -0.1 * side, 1.1 * side);
    }
    p.pos_m = v3_from(at);
    p.rot = crt_random_rotation(seed);
    return p;
}

static void tick_through(const cr_scene *scene, uint32_t turn) {
    cr_config config = cr_config_default();
    config.skip = (turn & 1u) != 0u ? CR_SKIP_ALL : 0u;
    config.lookups_max = (turn >> 1 & 1u) != 0u ? 32u : config.lookups_max; /* answers of several ticks */
    config.damping_Ns_m = 3.0f;
    const size_t bytes = cr_world_size(scene, &config);
    if (bytes > WORLD_MAX) {
        return;
    }
    void *memory = aligned_alloc(CR_IMG_ALIGN, bytes);
    cr_world *world = NULL;
    HOLDS(memory != NULL && cr_world_init(&world, memory, bytes, scene, &config) == CR_OK);
    uint64_t seed = 99u;
    cr_pose pose = pose_in(scene, &seed);
    for (int i = 0; i < TICKS; i++) {
        cr_output out;
        cr_tick(world, &pose, 1e-3f, &out);
        HOLDS(crt_is_sound(&out, &config));
        if (i % 3 == 2) {
            pose = pose_in(scene, &seed);
        } else { /* near enough for spheres to sleep */
            pose.pos_m.z -= 1e-3f;
        }
    }
    free(memory);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    void *image = NULL;
    cr_scene scene;
    if (size == 0u || posix_memalign(&image, CR_IMG_ALIGN, size) != 0) { /* of this very size: a byte beyond is seen */
        return 0;
    }
    memcpy(image, data, size);
    if (cr_scene_open(&scene, image, size) == CR_OK) {
        for (uint32_t turn = 0; turn < 4u; turn++) {
            tick_through(&scene, turn);
        }
    }
    free(image);
    return 0;
}

/* ---- the mutator ------------------------------------------------------------------------------------------------- */

static uint8_t *bases[BASES];
static uint32_t base_bytes[BASES];

static void make_base(int at, const crt_solid *solid, double voxel_m, const uint32_t low[3], const uint32_t high[3]) {
    uint32_t whole_bytes;
    crt_tool tool = crt_plate();
    uint8_t *whole = crt_image(solid, &tool, voxel_m, &whole_bytes);
    bases[at] = crt_shrink(whole, low, high, &base_bytes[at]);
    crt_tool_free(&tool);
    free(whole);
}

static void make_bases(void) {
    const crt_solid box = crt_box(-8e-3, 4.8e-3, 16e-3, -4.8e-3, 0.0), ball = crt_ball(10e-3);
    crt_solid fine = ball;
    fine.fine = 1;
    const crt_solid room = crt_room(-8e-3, 4.8e-3, 16e-3, -4.8e-3, 0.0);
    const uint32_t low[2][3] = {{3u, 3u, 1u}, {1u, 1u, 2u}}, high[2][3] = {{4u, 5u, 3u}, {3u, 3u, 4u}};
    make_base(0, &box, 1e-3, low[0], high[0]);
    make_base(1, &room, 1e-3, low[0], high[0]);
    make_base(2, &ball, 2e-3, low[1], high[1]);
    make_base(3, &fine, 2e-3, low[1], high[1]);
}

#define HEAD (sizeof(struct cr_img_header) + CR_SEC_COUNT * sizeof(struct cr_img_section))

/* The elements of a section that lie in the data; null when there are none. */
static uint8_t *elements_of(uint8_t *data, size_t size, uint32_t id, uint32_t *count, uint32_t *stride) {
    const struct cr_img_section *row = crt_row(data, id);
    if (row->stride == 0u || row->offset % 4u != 0u || row->offset >= size) {
        return NULL;
    }
    const size_t most = (size - row->offset) / row->stride;
    *count = row->count < most ? row->count : (uint32_t)most;
    *stride = row->stride;
    return *count > 0u ? data + row->offset : NULL;
}

static uint32_t odd_word(uint8_t *data, uint64_t *seed) {
    static const float floats[] = {0.0f,  -0.0f,  1e-38f, 1e-20f, -1e-6f, 1e-3f,    0.5f,      1.0f,
                                   -1.0f, 9.9e3f, -1e4f,  1e30f,  NAN,    INFINITY, -INFINITY, 3e-39f};
    uint32_t word = 0u;
    switch (crf_random(seed, 4u)) {
    case 0: /* a count, or near one */
        return crt_row(data, 1u + crf_random(seed, CR_SEC_COUNT))->count + crf_random(seed, 3u) - 1u;
    case 1:
        memcpy(&word, &floats[crf_random(seed, sizeof floats / sizeof *floats)], 4u);
        return word;
    case 2:
        return 1u << crf_random(seed, 32u);
    default:
        return crf_random(seed, 40u) - 8u;
    }
}

static void change_elements(uint8_t *data, size_t size, uint64_t *seed) {
    uint32_t count = 0u, stride = 0u;
    uint8_t *at = elements_of(data, size, 1u + crf_random(seed, CR_SEC_COUNT), &count, &stride);
    if (at == NULL) {
        return;
    }
    uint8_t *one = at + (size_t)crf_random(seed, count) * stride;
    const uint32_t field = stride >= 4u ? 4u * crf_random(seed, stride / 4u) : 0u;
    uint32_t word;
    float value;
    switch (crf_random(seed, 6u)) {
    case 0:
        memcpy(one, at + (size_t)crf_random(seed, count) * stride, stride);
        break;
    case 1:
        LLVMFuzzerMutate(one, stride, stride);
        break;
    case 2:
        one[crf_random(seed, stride)] ^= (uint8_t)(1u << crf_random(seed, 8u));
        break;
    case 3:
        word = odd_word(data, seed);
        memcpy(one + field, &word, stride < 4u ? stride : 4u);
        break;
    case 4: /* a number, somewhat other */
        if (stride >= 4u) {
            memcpy(&value, one + field, 4u);
            value *= (float)crf_random(seed, 2000u) * 2e-3f - 2.0f;
            memcpy(one + field, &value, 4u);
        }
        break;
    default: /* a run of elements all alike */
        for (uint32_t i = 0, n = crf_random(seed, count); i < n; i++) {
            memmove(at + (size_t)i * stride, one, stride);
        }
        break;
    }
}

static void change_table(uint8_t *data, uint64_t *seed) {
    struct cr_img_section *row = crt_row(data, 1u + crf_random(seed, CR_SEC_COUNT));
    uint32_t *fields[] = {&row->offset, &row->count, &row->count, &row->stride};
    uint32_t *field = fields[crf_random(seed, 4u)];
    switch (crf_random(seed, 3u)) {
    case 0: /* two sections in one place */
        row->offset = crt_row(data, 1u + crf_random(seed, CR_SEC_COUNT))->offset;
        break;
    case 1:
        *field += crf_random(seed, 3u) - 1u;
        break;
    default:
        *field = odd_word(data, seed);
        break;
    }
}

/* What is asked of an image beyond single values: unit normals, sums of clusters, the checksum. */
static void repair(uint8_t *data, size_t size, uint64_t *seed) {
    struct cr_img_header *h = (struct cr_img_header *)(void *)data;
    uint32_t count = 0u, stride = 0u, clusters = 0u;
    uint8_t *at = elements_of(data, size, CR_SEC_FACETS, &count, &stride);
    for (uint32_t i = 0; at != NULL && stride == sizeof(struct cr_img_facet) && i < count && crf_random(seed, 8u) > 0u;
         i++) {
        struct cr_img_facet *f = (struct cr_img_facet *)(void *)at + i;
        const double n = hypot(hypot((double)f->normal[0], (double)f->normal[1]), (double)f->normal[2]);
        for (int a = 0; a < 3 && n > 0.0 && isfinite(n); a++) {
            f->normal[a] = (float)((double)f->normal[a] / n);
        }
    }
    uint8_t *shell = elements_of(data, size, CR_SEC_CLUSTERS, &clusters, &stride);
    const int whole = shell != NULL && stride == sizeof(struct cr_img_cluster);
    uint8_t *sums = elements_of(data, size, CR_SEC_SUMS, &count, &stride);
    for (uint32_t i = 0; whole && sums != NULL && stride == sizeof(struct cr_img_sum) && i < count && i < clusters;
         i++) {
        float one[CR_LANES];
        struct cr_img_cluster c;
        struct cr_img_sum sum;
        for (int k = 0; k < CR_LANES; k++) {
            one[k] = 1.0f;
        }
        memcpy(&c, shell + (size_t)i * sizeof c, sizeof c);
        cr_sum_cluster(&c, one, &sum);
        memcpy(sums + (size_t)i * sizeof sum, &sum, sizeof sum);
    }
    h->size_bytes = (uint32_t)size;
    h->crc32 = cr_image_crc(data, h->size_bytes);
}

size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned start) {
    uint64_t seed = start;
    if (bases[0] == NULL) {
        make_bases();
    }
    if (size < HEAD || crf_random(&seed, 200u) == 0u) {
        const uint32_t base = crf_random(&seed, BASES);
        size = base_bytes[base] <= max_size ? base_bytes[base] : max_size;
        memcpy(data, bases[base], size);
    }
    if (size < HEAD) {
        return size;
    }
    /* An aligned copy: the sections are read as what they are. */
    uint8_t *image = aligned_alloc(CR_IMG_ALIGN, (max_size + CR_IMG_ALIGN - 1u) / CR_IMG_ALIGN * CR_IMG_ALIGN);
    HOLDS(image != NULL);
    memcpy(image, data, size);
    const uint32_t kind = crf_random(&seed, 40u);
    for (uint32_t n = 1u + crf_random(&seed, 4u); n > 0u && kind > 2u; n--) {
        change_elements(image, size, &seed);
    }
    if (kind == 0u) {
        size = LLVMFuzzerMutate(image, size, max_size);
    } else if (kind <= 2u) {
        change_table(image, &seed);
    }
    if (size >= HEAD && crf_random(&seed, 50u) > 0u) {
        repair(image, size, &seed);
    }
    memcpy(data, image, size);
    free(image);
    return size;
}
