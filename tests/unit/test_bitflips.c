/* Every bit of three small images, one after the other: the checksum finds the flip; sealed again, the image is refused, or
 * every tick answers within the limits. Built with sanitizers (make sanitize) any wild read shows. */
#include "image_builder.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define POSES 5
#define POLYNOMIAL 0xedb88320u /* IEEE 802.3, reflected */

typedef struct {
    const char *name;
    uint8_t *image;
    uint32_t size_bytes;
    cr_pose pose[POSES];
    void *memory; /* of a world, with room for as many groups and clusters as the image could hold */
    size_t memory_bytes;
    uint32_t opened, tried;
} subject;

static cr_config config_of(uint32_t turn) {
    cr_config c = cr_config_default();
    c.damping_Ns_m = 2.0f;
    c.lookups_max = turn % 2u == 0u ? c.lookups_max : 40u;
    c.skip = turn % 3u == 0u ? 0u : CR_SKIP_ALL;
    return c;
}

/* Poses in contact, the last one free of it: found by trying. */
static void find_poses(subject *s) {
    uint64_t seed = 7u;
    cr_scene scene;
    cr_world *world = NULL;
    const cr_config config = cr_config_default();
    assert_int_equal(cr_scene_open(&scene, s->image, s->size_bytes), CR_OK);
    s->memory_bytes = cr_world_size(&scene, &config) + s->size_bytes / CR_IMG_ALIGN * CR_IMG_ALIGN;
    s->memory = aligned_alloc(CR_IMG_ALIGN, s->memory_bytes);
    assert_non_null(s->memory);
    assert_int_equal(cr_world_init(&world, s->memory, s->memory_bytes, &scene, &config), CR_OK);
    for (uint32_t found = 0u, tried = 0u; found < POSES; tried++) {
        const struct cr_img_meta *m = scene.meta;
        cr_output out;
        cr_pose p;
        float at[3];
        for (int a = 0; a < 3; a++) {
            const double side = (double)(m->brick_m * (float)m->dims[a]);
            at[a] = m->origin_m[a] + (float)crt_uniform(&seed, 0.0, side);
        }
        assert_true(tried < 100000u);
        p.pos_m = v3_from(at);
        p.rot = crt_random_rotation(&seed);
        cr_tick(world, &p, 1e-3f, &out);
        /* One zone, several zones, and once nothing. */
        const uint32_t least = found < 2u ? 2u : 1u;
        const int wanted = found + 1u < POSES ? out.zone_count >= least : out.area_count == 0u;
        if (wanted || (tried > 20000u && out.area_count > 0u)) {
            s->pose[found++] = p;
        }
    }
}

static subject make(const char *name, const crt_solid *solid, double voxel_m, const uint32_t low[3],
                    const uint32_t high[3]) {
    subject s = {.name = name};
    uint32_t whole_bytes = 0u;
    crt_tool tool = crt_plate();
    uint8_t *whole = crt_image(solid, &tool, voxel_m, &whole_bytes);
    s.image = crt_shrink(whole, low, high, &s.size_bytes);
    crt_tool_free(&tool);
    free(whole);
    find_poses(&s);
    return s;
}

static void drop(subject *s) {
    free(s->image);
    free(s->memory);
}

/* All poses with one of the settings, so that neighbouring flips see all of them. */
static int answers_are_sound(subject *s, const cr_scene *scene, uint32_t turn) {
    const cr_config config = config_of(turn);
    cr_world *world = NULL;
    const size_t need = cr_world_size(scene, &config);
    assert_true(need <= s->memory_bytes);
    assert_int_equal(cr_world_init(&world, s->memory, need, scene, &config), CR_OK);
    for (int i = 0; i < POSES; i++) {
        cr_output out;
        cr_tick(world, &s->pose[i], 1e-3f, &out);
        if (!crt_is_sound(&out, &config)) {
            return 0;
        }
    }
    return 1;
}

/* What the checksum changes by when bit k of a byte does, the byte being `after` bytes before the end: k-th row of delta. */
static void step_back(uint32_t delta[8]) {
    for (int k = 0; k < 8; k++) {
        for (int i = 0; i < 8; i++) {
            delta[k] = delta[k] >> 1 ^ ((delta[k] & 1u) != 0u ? POLYNOMIAL : 0u);
        }
    }
}

static void flip_every_bit(subject *s) {
    struct cr_img_header *h = (struct cr_img_header *)(void *)s->image;
    const size_t field = offsetof(struct cr_img_header, crc32);
    const uint32_t good = h->crc32;
    uint32_t delta[8], turn = 0u;
    for (uint32_t k = 0; k < 8u; k++) {
        delta[k] = 1u << k;
    }
    step_back(delta);
    for (uint32_t at = s->size_bytes; at-- > 0u; step_back(delta)) {
        for (uint32_t k = 0; k < 8u; k++) {
            cr_scene scene;
            const int in_crc = at >= field && at < field + 4u;
            s->image[at] ^= (uint8_t)(1u << k);
            if (in_crc ||
                k == at % 8u) { /* the checksum is the same polynomial for the others: a bit of every byte will do */
                assert_int_not_equal(cr_scene_open(&scene, s->image, s->size_bytes), CR_OK);
            }
            h->crc32 = in_crc ? h->crc32 : good ^ delta[k];
            s->tried++;
            if (!in_crc && cr_scene_open(&scene, s->image, s->size_bytes) == CR_OK) {
                s->opened++;
                if (!answers_are_sound(s, &scene, turn++)) {
                    print_message("%s: byte %u, bit %u: opens, and the answer is not sound\n", s->name, at, k);
                    fail();
                }
            }
            s->image[at] ^= (uint8_t)(1u << k);
            h->crc32 = good;
        }
    }
    cr_scene scene;
    assert_int_equal(cr_scene_open(&scene, s->image, s->size_bytes), CR_OK);
    print_message("%s: %u bytes, %u flips, %u of them open\n", s->name, s->size_bytes, s->tried, s->opened);
    /* A checksum of this test's own that were wrong would let none through; one not asked for, all. */
    assert_true(s->opened > s->tried / 10u && s->opened < s->tried);
}

static void every_bit_of_a_convex_edge(void **state) {
    (void)state;
    const crt_solid box = crt_box(-8e-3, 4.8e-3, 16e-3, -4.8e-3, 0.0);
    const uint32_t low[3] = {3u, 3u, 1u}, high[3] = {4u, 5u, 3u};
    subject s = make("convex edge", &box, 1e-3, low, high);
    flip_every_bit(&s);
    drop(&s);
}

static void every_bit_of_a_concave_edge(void **state) {
    (void)state;
    const crt_solid room = crt_room(-8e-3, 4.8e-3, 16e-3, -4.8e-3, 0.0);
    const uint32_t low[3] = {3u, 3u, 2u}, high[3] = {4u, 5u, 3u};
    subject s = make("concave edge", &room, 1e-3, low, high);
    flip_every_bit(&s);
    drop(&s);
}

static void every_bit_of_a_curved_surface(void **state) {
    (void)state;
    const crt_solid ball = crt_ball(10e-3);
    const uint32_t low[3] = {1u, 1u, 2u}, high[3] = {3u, 3u, 4u};
    subject s = make("ball", &ball, 2e-3, low, high);
    flip_every_bit(&s);
    drop(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_bit_of_a_convex_edge),
        cmocka_unit_test(every_bit_of_a_concave_edge),
        cmocka_unit_test(every_bit_of_a_curved_surface),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
