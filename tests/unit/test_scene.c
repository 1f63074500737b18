/* Opening an image: a valid one is taken, damage of each kind has its own code, nothing is written on failure. Flipped bits: test_bitflips. */
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static uint8_t *good, *damaged;
static uint32_t good_size;

/* A small image with a tree of two levels, and room for a damaged copy. */
static int make_image(void **state) {
    (void)state;
    const double centre[3] = {0.0, 0.0, 0.0}, half[3] = {4e-3, 4e-3, 4e-3};
    crt_solid block = crt_box(-6e-3, 6e-3, 6e-3, -12e-3, 0.0);
    crt_tool tool = crt_tool_new(1e-3);
    crt_add_box(&tool, centre, half);
    good = crt_image(&block, &tool, 4e-3, &good_size);
    crt_tool_free(&tool);
    damaged = aligned_alloc(CR_IMG_ALIGN, good_size);
    return damaged == NULL;
}

static int drop_image(void **state) {
    (void)state;
    free(good);
    free(damaged);
    return 0;
}

static struct cr_img_header *header(void) { return (struct cr_img_header *)(void *)damaged; }

static void restore(void) { memcpy(damaged, good, good_size); }

static cr_err open_damaged(void) {
    cr_scene scene, before;
    memset(&scene, 0xa5, sizeof scene);
    before = scene;
    cr_err err = cr_scene_open(&scene, damaged, good_size);
    assert_true(err == CR_OK || memcmp(&scene, &before, sizeof scene) == 0);
    return err;
}

static cr_err open_sealed(void) {
    crt_seal(damaged);
    return open_damaged();
}

static void scene_opens_a_valid_image(void **state) {
    (void)state;
    cr_scene s;
    assert_int_equal(cr_scene_open(&s, good, good_size), CR_OK);
    assert_int_equal(s.meta->levels, 2);
    assert_int_equal(s.cluster_count, 24 + 12 + 8);
    assert_int_equal(s.facet_count, 6);
    assert_int_equal(s.pair_count, 12);
    assert_ptr_equal(s.meta, crt_section(good, CR_SEC_META));
    assert_int_equal(s.adj_start[s.cluster_count], s.adj_count);
}

static void scene_takes_a_tool_as_large_as_a_hall(void **state) {
    (void)state;
    restore();
    ((struct cr_img_meta *)crt_section(damaged, CR_SEC_META))->shell_area_m2 = 2e4f;
    assert_int_equal(open_sealed(), CR_OK);
}

static void scene_takes_memory_longer_than_the_image(void **state) {
    (void)state;
    uint8_t *longer = aligned_alloc(CR_IMG_ALIGN, good_size + 64u);
    cr_scene s;
    memcpy(longer, good, good_size);
    memset(longer + good_size, 0xff, 64);
    assert_int_equal(cr_scene_open(&s, longer, good_size + 64u), CR_OK);
    free(longer);
}

static void scene_refuses_null(void **state) {
    (void)state;
    cr_scene s;
    assert_int_equal(cr_scene_open(NULL, good, good_size), CR_ERR_NULL);
    assert_int_equal(cr_scene_open(&s, NULL, good_size), CR_ERR_NULL);
}

static void scene_refuses_an_unaligned_image(void **state) {
    (void)state;
    uint8_t *room = aligned_alloc(CR_IMG_ALIGN, good_size + 64u);
    cr_scene s;
    memcpy(room + 4, good, good_size);
    assert_int_equal(cr_scene_open(&s, room + 4, good_size), CR_ERR_ALIGN);
    free(room);
}

/* The memory ends where it says, so that a sanitizer sees any read beyond. */
static void scene_refuses_every_shorter_image(void **state) {
    (void)state;
    for (uint32_t size = 0; size < good_size; size += size < 400u ? 1u : 977u) {
        uint8_t *cut = aligned_alloc(CR_IMG_ALIGN, (size / 64u + 1u) * 64u);
        cr_scene s;
        memcpy(cut, good, size);
        cr_err err = cr_scene_open(&s, cut, size);
        assert_int_equal(err, size < 8u ? CR_ERR_MAGIC : CR_ERR_SIZE);
        free(cut);
    }
}

static void scene_refuses_foreign_bytes(void **state) {
    (void)state;
    restore();
    damaged[7] = '\0';
    assert_int_equal(open_sealed(), CR_ERR_MAGIC);
    memset(damaged, 0, good_size);
    assert_int_equal(open_damaged(), CR_ERR_MAGIC);
}

static void scene_refuses_another_version(void **state) {
    (void)state;
    restore();
    header()->version = CR_IMAGE_VERSION + 1u;
    assert_int_equal(open_sealed(), CR_ERR_VERSION);
}

static void scene_refuses_a_size_beyond_the_memory(void **state) {
    (void)state;
    restore();
    header()->size_bytes = good_size + 64u;
    assert_int_equal(open_damaged(), CR_ERR_SIZE);
    header()->size_bytes = 64u;
    assert_int_equal(open_damaged(), CR_ERR_SIZE);
}

static void scene_refuses_one_changed_byte_anywhere(void **state) {
    (void)state;
    uint64_t seed = 11u;
    for (int i = 0; i < 300; i++) {
        restore();
        damaged[(uint32_t)crt_uniform(&seed, 64.0, good_size)] ^= (uint8_t)(1u << (i % 8));
        assert_int_equal(open_damaged(), CR_ERR_CRC);
    }
}

static void scene_refuses_a_wrong_number_of_sections(void **state) {
    (void)state;
    for (int step = -1; step <= 1; step += 2) {
        restore();
        header()->section_count = (uint32_t)(CR_SEC_COUNT + step);
        assert_int_equal(open_sealed(), CR_ERR_SECTION);
    }
}

static void scene_refuses_a_bad_row_of_every_section(void **state) {
    (void)state;
    for (uint32_t id = 1; id <= CR_SEC_COUNT; id++) {
        struct {
            uint32_t id, offset, count, stride;
        } bad[] = {{1, 0, 0, 0}, {0, 32, 0, 0}, {0, 0x80000000u, 0, 0}, {0, 0, 0x7fffffffu, 0}, {0, 0, 0, 4}};
        for (size_t k = 0; k < sizeof bad / sizeof *bad; k++) {
            restore();
            struct cr_img_section *row = crt_row(damaged, id);
            row->id += bad[k].id;
            row->offset += bad[k].offset;
            row->count += bad[k].count;
            row->stride += bad[k].stride;
            assert_int_equal(open_sealed(), CR_ERR_SECTION);
        }
        restore();
        crt_row(damaged, id)->offset = 0u;
        assert_int_equal(open_sealed(), CR_ERR_SECTION);
    }
}

static void scene_refuses_sections_that_must_not_be_empty(void **state) {
    (void)state;
    const uint32_t needed[] = {CR_SEC_META,     CR_SEC_TOP,  CR_SEC_SAMPLES, CR_SEC_KINDS,
                               CR_SEC_CLUSTERS, CR_SEC_SUMS, CR_SEC_GROUPS,  CR_SEC_ADJ_START};
    for (size_t i = 0; i < sizeof needed / sizeof *needed; i++) {
        restore();
        crt_row(damaged, needed[i])->count = 0u;
        assert_int_equal(open_sealed(), CR_ERR_SECTION);
    }
}

static void scene_refuses_tables_that_disagree_on_their_length(void **state) {
    (void)state;
    const uint32_t tables[] = {CR_SEC_TOP, CR_SEC_SUMS, CR_SEC_ADJ_START};
    for (size_t i = 0; i < sizeof tables / sizeof *tables; i++) {
        restore();
        crt_row(damaged, tables[i])->count--;
        assert_int_equal(open_sealed(), CR_ERR_SECTION);
    }
    const uint32_t dims[][3] = {{0xffffffffu, 1u, 1u}, {65537u, 1u, 1u}, {0u, 3u, 3u}, {65536u, 65536u, 65536u}};
    for (size_t i = 0; i < sizeof dims / sizeof *dims; i++) {
        restore();
        struct cr_img_meta *m = crt_section(damaged, CR_SEC_META);
        memcpy(m->dims, dims[i], sizeof m->dims);
        assert_int_equal(open_sealed(), CR_ERR_SECTION);
    }
}

/* Write one word of a section and see what opening says. */
static cr_err with_word(uint32_t id, size_t offset_bytes, uint32_t word) {
    restore();
    memcpy((uint8_t *)crt_section(damaged, id) + offset_bytes, &word, sizeof word);
    return open_sealed();
}

/* An index of field `at` of the last record of section `id` that is just past its table. */
#define PAST(id, type, at, word)                                                                                       \
    with_word(id, (crt_row(good, id)->count - 1u) * sizeof(type) + offsetof(type, at), (uint32_t)(word))

static void scene_refuses_an_index_past_every_table(void **state) {
    (void)state;
    cr_scene s;
    assert_int_equal(cr_scene_open(&s, good, good_size), CR_OK);
    assert_int_equal(with_word(CR_SEC_TOP, 0, s.brick_count), CR_ERR_INDEX);
    assert_int_equal(PAST(CR_SEC_BRICKS, struct cr_img_brick, samples, s.sample_count - 728u), CR_ERR_INDEX);
    assert_int_equal(PAST(CR_SEC_BRICKS, struct cr_img_brick, samples, 0xfffffff0u), CR_ERR_INDEX);
    assert_int_equal(PAST(CR_SEC_BRICKS, struct cr_img_brick, cells, s.cell_count - 511u), CR_ERR_INDEX);
    assert_int_equal(PAST(CR_SEC_BRICKS, struct cr_img_brick, cells, 0xfffffffeu), CR_ERR_INDEX);
    assert_int_equal(PAST(CR_SEC_BRICKS, struct cr_img_brick, kind, s.kind_count), CR_ERR_INDEX);
    assert_int_equal(PAST(CR_SEC_BRICKS, struct cr_img_brick, kind, s.kind_count << 16), CR_ERR_INDEX);
    assert_int_equal(with_word(CR_SEC_CELLS, 0, s.kind_count), CR_ERR_INDEX);
    assert_int_equal(PAST(CR_SEC_KINDS, struct cr_img_kind, facet[0], s.facet_count), CR_ERR_INDEX);
    assert_int_equal(PAST(CR_SEC_FACETS, struct cr_img_facet, patch, s.meta->patch_count), CR_ERR_INDEX);
    assert_int_equal(PAST(CR_SEC_PAIRS, struct cr_img_pair, second, s.meta->patch_count), CR_ERR_INDEX);
    assert_int_equal(PAST(CR_SEC_GROUPS, struct cr_img_group, child[0], s.cluster_count), CR_ERR_INDEX);
    assert_int_equal(with_word(CR_SEC_ADJ_START, 4, s.adj_count + 1u), CR_ERR_INDEX);
    assert_int_equal(with_word(CR_SEC_ADJ_START, 8, 0u), CR_ERR_INDEX);
    assert_int_equal(with_word(CR_SEC_ADJ, 0, s.cluster_count), CR_ERR_INDEX);
}

/* A ball of fine bricks in place of the block; `spoil` changes its bricks or samples. */
static cr_err open_fine(void (*spoil)(struct cr_img_brick *first, struct cr_img_brick *second, int16_t *samples,
                                      uint32_t count)) {
    crt_solid ball = crt_ball(6e-3);
    crt_tool tool = crt_plate();
    uint32_t bytes = 0u;
    cr_scene s;
    ball.fine = 1;
    uint8_t *image = crt_image(&ball, &tool, 1e-3, &bytes);
    struct cr_img_brick *bricks = crt_section(image, CR_SEC_BRICKS), *fine[2] = {NULL, NULL};
    for (uint32_t i = 0, found = 0; i < crt_row(image, CR_SEC_BRICKS)->count && found < 2u; i++) {
        if (bricks[i].fine) {
            fine[found++] = &bricks[i];
        }
    }
    assert_non_null(fine[1]);
    spoil(fine[0], fine[1], crt_section(image, CR_SEC_SAMPLES), crt_row(image, CR_SEC_SAMPLES)->count);
    crt_seal(image);
    const cr_err err = cr_scene_open(&s, image, bytes);
    crt_tool_free(&tool);
    free(image);
    return err;
}

#define SPOIL(name, body)                                                                                              \
    static void name(struct cr_img_brick *first, struct cr_img_brick *second, int16_t *samples, uint32_t count) {      \
        int16_t *table = samples + first->samples + CR_FINE_TABLE;                                                     \
        (void)second;                                                                                                  \
        (void)table;                                                                                                   \
        (void)count;                                                                                                   \
        body;                                                                                                          \
    }
SPOIL(leave, (void)0)
SPOIL(coarser, first->side = 4u)
SPOIL(negative, table[0] = -1)
SPOIL(into_the_table, table[0] = (int16_t)(CR_FINE_BLOCKS / CR_FINE_UNIT - 1u))
SPOIL(first_block, table[0] = (int16_t)(CR_FINE_BLOCKS / CR_FINE_UNIT))
SPOIL(past_the_samples, table[511] = (int16_t)((count - first->samples - 27u) / CR_FINE_UNIT + 1u))
SPOIL(last_halves, table[511] = (int16_t)((count - first->samples - 27u) / CR_FINE_UNIT))
SPOIL(last_quarters, table[511] = (int16_t)(((count - first->samples - 27u) / CR_FINE_UNIT) | CR_FINE_QUARTERS))
SPOIL(shared, second->samples = first->samples)
SPOIL(overlapping, second->samples = first->samples + CR_FINE_BLOCKS - 1u)
SPOIL(no_room, first->samples = second->samples = count - CR_FINE_BLOCKS + 1u)

static void scene_refuses_fine_bricks_that_name_samples_of_others_or_none(void **state) {
    (void)state;
    assert_int_equal(open_fine(leave), CR_OK);
    assert_int_equal(open_fine(first_block), CR_OK);
    assert_int_equal(open_fine(last_halves), CR_OK);
    assert_int_equal(open_fine(coarser), CR_ERR_VALUE);
    assert_int_equal(open_fine(negative), CR_ERR_INDEX);
    assert_int_equal(open_fine(into_the_table), CR_ERR_INDEX);
    assert_int_equal(open_fine(past_the_samples), CR_ERR_INDEX);
    assert_int_equal(open_fine(last_quarters), CR_ERR_INDEX);
    assert_int_equal(open_fine(shared), CR_ERR_INDEX);
    assert_int_equal(open_fine(overlapping), CR_ERR_INDEX);
    assert_int_equal(open_fine(no_room), CR_ERR_INDEX);
}

static void scene_refuses_pairs_out_of_order(void **state) {
    (void)state;
    assert_int_equal(with_word(CR_SEC_PAIRS, 0, 5u), CR_ERR_INDEX);
    assert_int_equal(with_word(CR_SEC_PAIRS, sizeof(struct cr_img_pair), 0u), CR_OK);
    const struct cr_img_pair *first = crt_section(good, CR_SEC_PAIRS);
    restore();
    struct cr_img_pair *pairs = crt_section(damaged, CR_SEC_PAIRS);
    pairs[1] = first[0];
    assert_int_equal(open_sealed(), CR_ERR_INDEX);
}

static void scene_refuses_groups_in_a_cycle(void **state) {
    (void)state;
    size_t child = offsetof(struct cr_img_group, child);
    assert_int_equal(with_word(CR_SEC_GROUPS, child, 0u), CR_ERR_INDEX);
    assert_int_equal(with_word(CR_SEC_GROUPS, child + 4u, 4u), CR_ERR_INDEX);
    /* A child at the wrong level, and one that is its own child. */
    size_t level = sizeof(struct cr_img_group) + offsetof(struct cr_img_group, level);
    assert_int_equal(with_word(CR_SEC_GROUPS, level, 0u), CR_ERR_INDEX);
    assert_int_equal(with_word(CR_SEC_GROUPS, level, 2u), CR_ERR_INDEX);
    restore();
    struct cr_img_group *g = crt_section(damaged, CR_SEC_GROUPS);
    g[1].leaf = 0u;
    g[1].child[0] = 1u;
    assert_int_equal(open_sealed(), CR_ERR_INDEX);
}

static void scene_refuses_a_tree_deeper_than_the_stack(void **state) {
    (void)state;
    size_t levels = offsetof(struct cr_img_meta, levels);
    assert_int_equal(with_word(CR_SEC_META, levels, CR_TREE_DEPTH_MAX + 1u), CR_ERR_VALUE);
    assert_int_equal(with_word(CR_SEC_META, levels, 0u), CR_ERR_VALUE);
    assert_int_equal(with_word(CR_SEC_META, levels, 1u), CR_ERR_VALUE);
    assert_int_equal(with_word(CR_SEC_GROUPS, offsetof(struct cr_img_group, level), 1u), CR_ERR_VALUE);
}

static void scene_refuses_counts_out_of_range(void **state) {
    (void)state;
    assert_int_equal(with_word(CR_SEC_GROUPS, offsetof(struct cr_img_group, count), 0u), CR_ERR_VALUE);
    assert_int_equal(with_word(CR_SEC_GROUPS, offsetof(struct cr_img_group, count), CR_LANES + 1u), CR_ERR_VALUE);
    assert_int_equal(with_word(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, count), 0u), CR_ERR_VALUE);
    assert_int_equal(with_word(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, count), CR_LANES + 1u), CR_ERR_VALUE);
    const uint32_t sides[] = {0u, 3u, 64u};
    for (size_t i = 0; i < sizeof sides / sizeof *sides; i++) {
        assert_int_equal(with_word(CR_SEC_BRICKS, offsetof(struct cr_img_brick, side), sides[i]), CR_ERR_VALUE);
    }
    assert_int_equal(with_word(CR_SEC_BRICKS, offsetof(struct cr_img_brick, side), 16u), CR_ERR_VALUE);
    assert_int_equal(with_word(CR_SEC_BRICKS, offsetof(struct cr_img_brick, side), 8u | 2u << 16), CR_ERR_VALUE);
    assert_int_equal(with_word(CR_SEC_BRICKS, offsetof(struct cr_img_brick, side), 8u | 2u << 24), CR_ERR_VALUE);
    /* A flat face goes on round faces alone, and round lanes that there are: the first cluster has 16 of them, the last are corners. */
    restore();
    struct cr_img_cluster *c = crt_section(damaged, CR_SEC_CLUSTERS);
    c->inner_mask = 0xffffu;
    assert_int_equal(open_sealed(), CR_OK);
    c += crt_row(damaged, CR_SEC_CLUSTERS)->count - 1u;
    assert_true(c->vertex_mask != 0u);
    c->inner_mask = c->vertex_mask;
    assert_int_equal(open_sealed(), CR_ERR_VALUE);
    c->inner_mask = (uint16_t)~first_lanes(c->count);
    assert_int_equal(open_sealed(), c->count == CR_LANES ? CR_OK : CR_ERR_VALUE);
    /* Planes have to be those of a kind that has some, and so has the kind then. */
    assert_int_equal(PAST(CR_SEC_BRICKS, struct cr_img_brick, kind, 1u << 16), CR_ERR_VALUE);
    assert_int_equal(PAST(CR_SEC_BRICKS, struct cr_img_brick, kind, 1u << 16 | 1u), CR_OK);
    assert_int_equal(PAST(CR_SEC_KINDS, struct cr_img_kind, count, CR_KIND_FACETS_MAX + 1u), CR_ERR_VALUE);
    assert_int_equal(PAST(CR_SEC_KINDS, struct cr_img_kind, count, 0u), CR_ERR_VALUE);
    assert_int_equal(PAST(CR_SEC_KINDS, struct cr_img_kind, kind, CR_KIND_MIXED + 1u), CR_ERR_VALUE);
    assert_int_equal(with_word(CR_SEC_KINDS, 0, CR_KIND_PLANAR), CR_ERR_VALUE);
}

/* What a number may be: any place; none below zero; a length that something is divided by; not more than a half turn. */
typedef enum { PLACE, RADIUS, AREA, LENGTH, TURN } sort;

static void refuse(uint32_t id, size_t offset_bytes, float value) {
    uint32_t word;
    memcpy(&word, &value, sizeof word);
    if (id == CR_SEC_CLUSTERS) { /* with its sum, so that not only that is found wrong */
        float one[CR_LANES];
        for (int i = 0; i < CR_LANES; i++) {
            one[i] = 1.0f;
        }
        restore();
        struct cr_img_cluster *c = crt_section(damaged, id);
        memcpy((uint8_t *)c + offset_bytes, &word, sizeof word);
        cr_sum_cluster(c, one, crt_section(damaged, CR_SEC_SUMS));
    } else {
        restore();
        memcpy((uint8_t *)crt_section(damaged, id) + offset_bytes, &word, sizeof word);
    }
    cr_err err = open_sealed();
    if (err != CR_ERR_VALUE) {
        fail_msg("section %u, byte %zu, %g: %d", id, offset_bytes, (double)value, err);
    }
}

static void spoil(uint32_t id, size_t first, size_t count, sort of) {
    for (size_t i = 0; i < count; i++) {
        const size_t at = first + 4u * i;
        const float never[] = {NAN, -NAN, INFINITY, -INFINITY, 1e30f, -1e30f, of == AREA ? 1.1e8f : 1.1e4f};
        for (size_t k = 0; k < sizeof never / sizeof *never; k++) {
            refuse(id, at, never[k]);
        }
        if (of != PLACE) {
            refuse(id, at, -1e-3f);
            refuse(id, at, -1e-40f);
        }
        if (of == LENGTH) {
            refuse(id, at, 0.0f);
            refuse(id, at, -0.0f);
            refuse(id, at, 1e-40f);
            refuse(id, at, 1e-20f);
        }
        if (of == TURN) {
            refuse(id, at, 3.2f);
        }
    }
}

#define META(field, count, of) spoil(CR_SEC_META, offsetof(struct cr_img_meta, field), count, of)
#define CLUSTER(field, of) spoil(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, field), CR_LANES, of)
#define GROUP(field, of) spoil(CR_SEC_GROUPS, offsetof(struct cr_img_group, field), CR_LANES, of)

static void scene_refuses_every_number_of_meta_outside_its_range(void **state) {
    (void)state;
    META(origin_m, 3, PLACE);
    META(brick_m, 1, LENGTH);
    META(voxel_m, 1, LENGTH);
    META(band_m, 1, LENGTH);
    META(crease_m, 1, RADIUS);
    META(quantum_m, 1, LENGTH);
    META(error_out_m, 4, RADIUS);
    META(crease_angle_rad, 1, TURN);
    META(spacing_m, 1, LENGTH);
    META(tool_radius_m, 1, RADIUS);
    META(root_centre_m, 3, PLACE);
    META(root_radius_m, 1, RADIUS);
    META(shell_area_m2, 1, AREA);
    META(ramp_max_m, 1, LENGTH);
    META(static_unit_m, 1, LENGTH);
    META(tool_unit_m, 1, LENGTH);
    META(static_min_m, 12, PLACE);
}

static void scene_refuses_every_number_of_the_surface_outside_its_range(void **state) {
    (void)state;
    spoil(CR_SEC_FACETS, sizeof(struct cr_img_facet), 4, PLACE);
    spoil(CR_SEC_FACETS, offsetof(struct cr_img_facet, low_m), 4, PLACE);
    spoil(CR_SEC_EDGES, 0, 6, PLACE);
    spoil(CR_SEC_EDGES, offsetof(struct cr_img_edge, angle_rad), 1, TURN);
}

static void scene_refuses_every_number_of_the_tool_outside_its_range(void **state) {
    (void)state;
    CLUSTER(x, PLACE);
    CLUSTER(y, PLACE);
    CLUSTER(z, PLACE);
    CLUSTER(ax, PLACE);
    CLUSTER(ay, PLACE);
    CLUSTER(az, PLACE);
    CLUSTER(area, RADIUS);
    CLUSTER(wxx, RADIUS);
    CLUSTER(wyy, RADIUS);
    CLUSTER(wzz, RADIUS);
    CLUSTER(wxy, PLACE);
    CLUSTER(wyz, PLACE);
    CLUSTER(wzx, PLACE);
    CLUSTER(ramp, LENGTH);
    CLUSTER(reach, RADIUS);
    CLUSTER(bow, RADIUS);
    spoil(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, normal), 3, PLACE);
    spoil(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, radius_m), 1, RADIUS);
    spoil(CR_SEC_SUMS, 0, 8, PLACE);
    GROUP(x, PLACE);
    GROUP(y, PLACE);
    GROUP(z, PLACE);
    GROUP(radius, RADIUS);
    GROUP(margin, RADIUS);
    GROUP(rho, RADIUS);
}

/* Each is a number by itself, and none of an image whose other numbers are these. */
static void scene_refuses_numbers_that_do_not_fit_the_others(void **state) {
    (void)state;
    const struct {
        size_t at;
        float value;
    } bad[] = {{offsetof(struct cr_img_meta, brick_m), 1.0f},        {offsetof(struct cr_img_meta, voxel_m), 1.0f},
               {offsetof(struct cr_img_meta, band_m), 1.0f},         {offsetof(struct cr_img_meta, quantum_m), 1.0f},
               {offsetof(struct cr_img_meta, crease_m), 1.0f},       {offsetof(struct cr_img_meta, error_out_m), 1.0f},
               {offsetof(struct cr_img_meta, error_in_m), 1.0f},     {offsetof(struct cr_img_meta, error_max_m), 1.0f},
               {offsetof(struct cr_img_meta, spacing_m), 1.0f},      {offsetof(struct cr_img_meta, spacing_m), 1e-5f},
               {offsetof(struct cr_img_meta, ramp_max_m), 1.0f},     {offsetof(struct cr_img_meta, ramp_max_m), 1e-5f},
               {offsetof(struct cr_img_meta, tool_radius_m), 1e-3f}, {offsetof(struct cr_img_meta, static_min_m), 1.0f},
               {offsetof(struct cr_img_meta, tool_max_m), -1.0f}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        refuse(CR_SEC_META, bad[i].at, bad[i].value);
    }
    refuse(CR_SEC_FACETS, 0, 3.0f);
    refuse(CR_SEC_GROUPS, offsetof(struct cr_img_group, margin), 1.0f);
    refuse(CR_SEC_GROUPS, offsetof(struct cr_img_group, rho), 1.0f);
    refuse(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, area), 1.0f);
    refuse(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, ramp), 1.0f);
    refuse(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, ramp), 1e-5f);
    refuse(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, wxx), 1.0f);
    refuse(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, wxy), -1.0f);
    refuse(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, reach), 1.0f);
    refuse(CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, normal), 2.0f);
    refuse(CR_SEC_FACETS, offsetof(struct cr_img_facet, high_m), -1.0f);
    refuse(CR_SEC_FACETS, offsetof(struct cr_img_facet, high_m) + 4u, -1.0f);
}

static void scene_refuses_words_without_meaning(void **state) {
    (void)state;
    const uint32_t band = 1u << 29;
    const struct {
        uint32_t id;
        size_t at;
        uint32_t word;
    } bad[] = {{CR_SEC_TOP, 0, CR_TOP_FAR | band},
               {CR_SEC_SAMPLES, 0, 0x8000u},
               {CR_SEC_FACETS, offsetof(struct cr_img_facet, curved), 3u},
               {CR_SEC_FACETS, offsetof(struct cr_img_facet, curved), 0x1000u}, /* ends of a fifth side */
               {CR_SEC_PAIRS, offsetof(struct cr_img_pair, label), 0u},
               {CR_SEC_PAIRS, offsetof(struct cr_img_pair, label), 4u},
               {CR_SEC_EDGES, offsetof(struct cr_img_edge, label), 3u},
               {CR_SEC_GROUPS, offsetof(struct cr_img_group, leaf), 2u},
               {CR_SEC_META, offsetof(struct cr_img_meta, point_count), 1u},
               {CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, count), 1u << 31}, /* a vertex in a lane not in use */
               {CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, crease_mask), 1u << 15},
               {CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, piece_lanes), 1u},          /* lanes of no piece */
               {CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, piece_lanes), 0xffff000fu}, /* of none */
               {CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, beside), 1u},               /* beside itself */
               {CR_SEC_META, offsetof(struct cr_img_meta, piece_count), 0u},
               {CR_SEC_META, offsetof(struct cr_img_meta, piece_count), 65536u},
               {CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, piece), 0xffffffffu}, /* of no piece */
               {CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, piece), 0xffff0007u}, /* a piece that is not */
               {CR_SEC_CLUSTERS, offsetof(struct cr_img_cluster, piece), 0u},          /* one twice */
               {CR_SEC_ADJ, offsetof(struct cr_img_neighbour, mine), 1u},              /* theirs: none */
               {CR_SEC_ADJ, offsetof(struct cr_img_neighbour, mine), 1u << 16}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        if (with_word(bad[i].id, bad[i].at, bad[i].word) != CR_ERR_VALUE) {
            fail_msg("row %zu", i);
        }
    }
    assert_int_equal(with_word(CR_SEC_EDGES, offsetof(struct cr_img_edge, patch), 6u), CR_ERR_INDEX);
    assert_int_equal(with_word(CR_SEC_ADJ_START, 0, 1u), CR_ERR_INDEX);
}

static void scene_refuses_neighbours_out_of_order(void **state) {
    (void)state;
    restore();
    struct cr_img_neighbour *n = crt_section(damaged, CR_SEC_ADJ), first = n[0];
    n[1] = first;
    assert_int_equal(open_sealed(), CR_ERR_INDEX);
    restore();
    n[0] = n[1];
    n[1] = first;
    assert_int_equal(open_sealed(), CR_ERR_INDEX);
    assert_int_equal(with_word(CR_SEC_ADJ, 0, 0u), CR_ERR_INDEX); /* of cluster 0: its own */
}

static void scene_error_texts_are_all_there(void **state) {
    (void)state;
    for (int err = CR_ERR_CONFIG; err <= 1; err++) {
        assert_true(strlen(cr_err_text((cr_err)err)) > 5u);
    }
    assert_string_equal(cr_err_text((cr_err)-99), cr_err_text((cr_err)(-2147483647 - 1)));
}

static void library_knows_its_version(void **state) {
    (void)state;
    assert_int_equal(cr_version(), CR_VERSION);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(library_knows_its_version),
        cmocka_unit_test(scene_opens_a_valid_image),
        cmocka_unit_test(scene_takes_a_tool_as_large_as_a_hall),
        cmocka_unit_test(scene_takes_memory_longer_than_the_image),
        cmocka_unit_test(scene_refuses_null),
        cmocka_unit_test(scene_refuses_an_unaligned_image),
        cmocka_unit_test(scene_refuses_every_shorter_image),
        cmocka_unit_test(scene_refuses_foreign_bytes),
        cmocka_unit_test(scene_refuses_another_version),
        cmocka_unit_test(scene_refuses_a_size_beyond_the_memory),
        cmocka_unit_test(scene_refuses_one_changed_byte_anywhere),
        cmocka_unit_test(scene_refuses_a_wrong_number_of_sections),
        cmocka_unit_test(scene_refuses_a_bad_row_of_every_section),
        cmocka_unit_test(scene_refuses_sections_that_must_not_be_empty),
        cmocka_unit_test(scene_refuses_tables_that_disagree_on_their_length),
        cmocka_unit_test(scene_refuses_an_index_past_every_table),
        cmocka_unit_test(scene_refuses_fine_bricks_that_name_samples_of_others_or_none),
        cmocka_unit_test(scene_refuses_pairs_out_of_order),
        cmocka_unit_test(scene_refuses_groups_in_a_cycle),
        cmocka_unit_test(scene_refuses_a_tree_deeper_than_the_stack),
        cmocka_unit_test(scene_refuses_counts_out_of_range),
        cmocka_unit_test(scene_refuses_every_number_of_meta_outside_its_range),
        cmocka_unit_test(scene_refuses_every_number_of_the_surface_outside_its_range),
        cmocka_unit_test(scene_refuses_every_number_of_the_tool_outside_its_range),
        cmocka_unit_test(scene_refuses_numbers_that_do_not_fit_the_others),
        cmocka_unit_test(scene_refuses_words_without_meaning),
        cmocka_unit_test(scene_refuses_neighbours_out_of_order),
        cmocka_unit_test(scene_error_texts_are_all_there),
    };
    return cmocka_run_group_tests(tests, make_image, drop_image);
}
