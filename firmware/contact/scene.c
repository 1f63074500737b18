/* scene: opens an image once. Every offset, count, index and number that a tick will trust is checked here. */
#include "contact/stages.h"

#include <string.h>

/* Largest length, area or second moment that an image may hold, in SI units. */
#define VALUE_MAX 1e4f

static uint32_t crc32_of(const uint8_t *bytes, size_t count, uint32_t crc) {
    static const uint32_t nibble[16] = {0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u,
                                        0x4db26158u, 0x5005713cu, 0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu,
                                        0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu};
    for (size_t i = 0; i < count; i++) {
        crc = nibble[(crc ^ bytes[i]) & 15u] ^ (crc >> 4);
        crc = nibble[(crc ^ (uint32_t)(bytes[i] >> 4)) & 15u] ^ (crc >> 4);
    }
    return crc;
}

uint32_t cr_image_crc(const uint8_t *image, uint32_t size_bytes) {
    static const uint8_t zero[4] = {0u, 0u, 0u, 0u};
    size_t at = offsetof(struct cr_img_header, crc32);
    uint32_t crc = crc32_of(image, at, 0xffffffffu);
    crc = crc32_of(zero, sizeof zero, crc);
    crc = crc32_of(image + at + 4u, size_bytes - at - 4u, crc);
    return crc ^ 0xffffffffu;
}

/* Finite, and so far from overflow that no sum or product in a tick can get there. */
static int floats_are_finite(const float *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (!(values[i] >= -VALUE_MAX && values[i] <= VALUE_MAX)) {
            return 0;
        }
    }
    return 1;
}

/* Where section id lies; null unless it is in the table with this stride and inside the image. */
static const void *find_section(const uint8_t *image, uint32_t size_bytes, uint32_t id, uint32_t stride,
                                uint32_t *count) {
    const struct cr_img_section *table = (const struct cr_img_section *)(image + sizeof(struct cr_img_header));
    const struct cr_img_section *s = &table[id - 1u];
    uint64_t end = (uint64_t)s->offset + (uint64_t)s->count * s->stride;
    uint32_t head = (uint32_t)(sizeof(struct cr_img_header) + CR_SEC_COUNT * sizeof *table);
    if (s->id != id || s->stride != stride || s->offset % CR_IMG_ALIGN != 0u || s->offset < head || end > size_bytes) {
        return NULL;
    }
    *count = s->count;
    return image + s->offset;
}

static cr_err find_sections(cr_scene *s, const uint8_t *image, uint32_t size) {
    uint32_t metas = 0u, tops = 0u, starts = 0u, sums = 0u;
    s->meta = find_section(image, size, CR_SEC_META, sizeof(struct cr_img_meta), &metas);
    s->top = find_section(image, size, CR_SEC_TOP, 4u, &tops);
    s->bricks = find_section(image, size, CR_SEC_BRICKS, sizeof(struct cr_img_brick), &s->brick_count);
    s->samples = find_section(image, size, CR_SEC_SAMPLES, 2u, &s->sample_count);
    s->cells = find_section(image, size, CR_SEC_CELLS, 2u, &s->cell_count);
    s->kinds = find_section(image, size, CR_SEC_KINDS, sizeof(struct cr_img_kind), &s->kind_count);
    s->facets = find_section(image, size, CR_SEC_FACETS, sizeof(struct cr_img_facet), &s->facet_count);
    s->pairs = find_section(image, size, CR_SEC_PAIRS, sizeof(struct cr_img_pair), &s->pair_count);
    s->edges = find_section(image, size, CR_SEC_EDGES, sizeof(struct cr_img_edge), &s->edge_count);
    s->clusters = find_section(image, size, CR_SEC_CLUSTERS, sizeof(struct cr_img_cluster), &s->cluster_count);
    s->sums = find_section(image, size, CR_SEC_SUMS, sizeof(struct cr_img_sum), &sums);
    s->groups = find_section(image, size, CR_SEC_GROUPS, sizeof(struct cr_img_group), &s->group_count);
    s->adj_start = find_section(image, size, CR_SEC_ADJ_START, 4u, &starts);
    s->adj = find_section(image, size, CR_SEC_ADJ, sizeof(struct cr_img_neighbour), &s->adj_count);
    if (s->meta == NULL || s->top == NULL || s->bricks == NULL || s->samples == NULL || s->cells == NULL ||
        s->kinds == NULL || s->facets == NULL || s->pairs == NULL || s->edges == NULL || s->clusters == NULL ||
        s->sums == NULL || s->groups == NULL || s->adj_start == NULL || s->adj == NULL) {
        return CR_ERR_SECTION;
    }
    if (metas != 1u || s->sample_count < 8u || s->kind_count < 1u || s->brick_count < 1u || s->cluster_count < 1u ||
        s->group_count < 1u || sums != s->cluster_count || starts != s->cluster_count + 1u) {
        return CR_ERR_SECTION;
    }
    uint64_t cells = (uint64_t)s->meta->dims[0] * s->meta->dims[1];
    if (s->meta->dims[0] > 65536u || s->meta->dims[1] > 65536u || s->meta->dims[2] > 65536u ||
        cells * s->meta->dims[2] != tops || tops == 0u || cells * s->meta->dims[2] > 0x7fffffffu) {
        return CR_ERR_SECTION;
    }
    return CR_OK;
}

static cr_err check_meta(const struct cr_img_meta *m) {
    if (!floats_are_finite(m->origin_m, 4) || !floats_are_finite(&m->voxel_m, 13) ||
        !floats_are_finite(m->root_centre_m, 6)) {
        return CR_ERR_VALUE;
    }
    if (!(m->brick_m > 1e-6f) || !(m->brick_m < 1e4f) || !(m->band_m > 0.0f) || !(m->quantum_m > 0.0f) ||
        !(m->error_out_m >= 0.0f) || !(m->error_in_m >= 0.0f) || !(m->crease_m >= 0.0f) ||
        !(m->root_radius_m >= 0.0f) || !(m->tool_radius_m >= 0.0f) || !(m->ramp_max_m >= 0.0f) || m->levels < 1u ||
        m->levels > CR_TREE_DEPTH_MAX) {
        return CR_ERR_VALUE;
    }
    /* Samples span the band: no distance is beyond it. */
    if (abs_f(m->quantum_m * 32767.0f - m->band_m) > 1e-3f * m->band_m) {
        return CR_ERR_VALUE;
    }
    return CR_OK;
}

static int is_of_planes(const struct cr_img_kind *k) {
    return k->count > 0u && (k->kind == CR_KIND_PLANAR || k->kind == CR_KIND_CONVEX || k->kind == CR_KIND_CONCAVE);
}

static cr_err check_voxmap(const cr_scene *s) {
    uint32_t tops = s->meta->dims[0] * s->meta->dims[1] * s->meta->dims[2];
    for (uint32_t i = 0; i < tops; i++) {
        if (!(s->top[i] & CR_TOP_FAR) && s->top[i] >= s->brick_count) {
            return CR_ERR_INDEX;
        }
    }
    for (uint32_t i = 0; i < s->brick_count; i++) {
        const struct cr_img_brick *b = &s->bricks[i];
        uint32_t cells = b->side;
        if (cells < 1u || cells > CR_BRICK_SIDE_MAX || (cells & (cells - 1u)) != 0u || b->creased > 1u) {
            return CR_ERR_VALUE;
        }
        uint32_t side = cells + 1u;
        uint32_t need = side * side * side;
        if (b->samples > s->sample_count || need > s->sample_count - b->samples || b->kind >= s->kind_count ||
            b->planes >= s->kind_count) {
            return CR_ERR_INDEX;
        }
        if (b->planes != 0u && !(is_of_planes(&s->kinds[b->planes]) && is_of_planes(&s->kinds[b->kind]))) {
            return CR_ERR_VALUE;
        }
        uint32_t table = CR_CELLS_SIDE * CR_CELLS_SIDE * CR_CELLS_SIDE;
        if (b->cells != CR_CELLS_NONE && (b->cells > s->cell_count || table > s->cell_count - b->cells)) {
            return CR_ERR_INDEX;
        }
    }
    for (uint32_t i = 0; i < s->cell_count; i++) {
        if (s->cells[i] >= s->kind_count) {
            return CR_ERR_INDEX;
        }
    }
    return CR_OK;
}

static cr_err check_features(const cr_scene *s) {
    for (uint32_t i = 0; i < s->kind_count; i++) {
        const struct cr_img_kind *k = &s->kinds[i];
        uint32_t least = k->kind == CR_KIND_EMPTY ? 0u : 1u;
        if (k->kind > CR_KIND_MIXED || k->count > CR_KIND_FACETS_MAX || k->count < least ||
            (i == 0u && k->kind != 0u)) {
            return CR_ERR_VALUE;
        }
        for (uint32_t j = 0; j < k->count; j++) {
            if (k->facet[j] >= s->facet_count) {
                return CR_ERR_INDEX;
            }
        }
    }
    for (uint32_t i = 0; i < s->facet_count; i++) {
        const struct cr_img_facet *f = &s->facets[i];
        cr_vec3 n = v3_from(f->normal);
        if (!floats_are_finite(f->normal, 4) || abs_f(v3_dot(n, n) - 1.0f) > 1e-5f) {
            return CR_ERR_VALUE;
        }
        if (f->patch >= s->meta->patch_count) {
            return CR_ERR_INDEX;
        }
    }
    for (uint32_t i = 0; i < s->pair_count; i++) {
        const struct cr_img_pair *p = &s->pairs[i];
        if (p->first >= p->second || p->second >= s->meta->patch_count) {
            return CR_ERR_INDEX;
        }
        if (i > 0u && (p[-1].first > p->first || (p[-1].first == p->first && p[-1].second >= p->second))) {
            return CR_ERR_INDEX;
        }
    }
    for (uint32_t i = 0; i < s->edge_count; i++) {
        if (!floats_are_finite(s->edges[i].a_m, 6)) {
            return CR_ERR_VALUE;
        }
    }
    return CR_OK;
}

static cr_err check_group(const cr_scene *s, uint32_t index) {
    const struct cr_img_group *g = &s->groups[index];
    if (!floats_are_finite(g->x, (size_t)6u * CR_LANES)) {
        return CR_ERR_VALUE;
    }
    if (g->count < 1u || g->count > CR_LANES || g->level >= s->meta->levels || (index == 0u && g->level != 0u)) {
        return CR_ERR_VALUE;
    }
    for (uint32_t i = 0; i < g->count; i++) {
        uint32_t child = g->child[i];
        /* Children lie after their parent and one level down: no cycle, and the traversal stack cannot overflow. */
        if (g->leaf ? child >= s->cluster_count
                    : (child >= s->group_count || child <= index || s->groups[child].level != g->level + 1u)) {
            return CR_ERR_INDEX;
        }
    }
    return CR_OK;
}

/* Are the full-coverage sums what the tick would add up? */
static int sums_match(const cr_scene *s, uint32_t cluster) {
    float full[CR_LANES];
    struct cr_img_sum sum;
    for (int i = 0; i < CR_LANES; i++) {
        full[i] = 1.0f;
    }
    cr_sum_cluster(&s->clusters[cluster], full, &sum);
    const struct cr_img_sum *stored = &s->sums[cluster];
    return sum.ax == stored->ax && sum.ay == stored->ay && sum.az == stored->az && sum.px == stored->px &&
           sum.py == stored->py && sum.pz == stored->pz && sum.area == stored->area && sum.peak == stored->peak;
}

static cr_err check_shell(const cr_scene *s) {
    for (uint32_t i = 0; i < s->group_count; i++) {
        cr_err err = check_group(s, i);
        if (err != CR_OK) {
            return err;
        }
    }
    for (uint32_t i = 0; i < s->cluster_count; i++) {
        const struct cr_img_cluster *c = &s->clusters[i];
        if (!floats_are_finite(c->x, (size_t)16u * CR_LANES) || !floats_are_finite(c->normal, 4) ||
            !floats_are_finite(&s->sums[i].ax, 7) || c->count < 1u || c->count > CR_LANES) {
            return CR_ERR_VALUE;
        }
        if (!sums_match(s, i)) {
            return CR_ERR_VALUE;
        }
        if (s->adj_start[i] > s->adj_start[i + 1u] || s->adj_start[i + 1u] > s->adj_count) {
            return CR_ERR_INDEX;
        }
    }
    for (uint32_t i = 0; i < s->adj_count; i++) {
        if (s->adj[i].cluster >= s->cluster_count) {
            return CR_ERR_INDEX;
        }
    }
    return CR_OK;
}

cr_err cr_scene_open(cr_scene *scene, const void *image, size_t size_bytes) {
    if (scene == NULL || image == NULL) {
        return CR_ERR_NULL;
    }
    if ((uintptr_t)image % CR_IMG_ALIGN != 0u) {
        return CR_ERR_ALIGN;
    }
    size_t head = sizeof(struct cr_img_header) + CR_SEC_COUNT * sizeof(struct cr_img_section);
    const struct cr_img_header *h = image;
    if (size_bytes < 8u || memcmp(h->magic, CR_IMG_MAGIC, 8) != 0) {
        return CR_ERR_MAGIC;
    }
    if (size_bytes < head || h->size_bytes < head || h->size_bytes > size_bytes) {
        return CR_ERR_SIZE;
    }
    if (h->version != CR_IMAGE_VERSION) {
        return CR_ERR_VERSION;
    }
    if (h->crc32 != cr_image_crc(image, h->size_bytes)) {
        return CR_ERR_CRC;
    }
    cr_scene s;
    cr_err err = h->section_count == CR_SEC_COUNT ? find_sections(&s, image, h->size_bytes) : CR_ERR_SECTION;
    err = err != CR_OK ? err : check_meta(s.meta);
    err = err != CR_OK ? err : check_voxmap(&s);
    err = err != CR_OK ? err : check_features(&s);
    err = err != CR_OK ? err : check_shell(&s);
    if (err == CR_OK) {
        *scene = s;
    }
    return err;
}

const char *cr_err_text(cr_err err) {
    static const char *const text[] = {"no error",
                                       "a required pointer is null",
                                       "memory is not 64-byte aligned",
                                       "too short: image cut off, or memory smaller than cr_world_size",
                                       "not a crease scene image",
                                       "scene image of another format version: bake it again",
                                       "scene image is corrupt (checksum): bake it again",
                                       "scene image has a missing or misplaced section",
                                       "scene image has an index outside its table",
                                       "scene image has a number out of range",
                                       "a world setting is out of range"};
    int index = -(int)err;
    return index >= 0 && index < (int)(sizeof text / sizeof text[0]) ? text[index] : "unknown error";
}
