/* scene: opens an image once. Every offset, count, index and number that a tick will trust is checked here.
 * Comparisons of numbers are written so that not-a-number fails them. */
#include "contact/stages.h"

#include <string.h>

/* Largest length, area or second moment that an image may hold, in SI units: so far from overflow that no sum or product in a tick
 * gets there. */
#define VALUE_MAX 1e4f
/* Smallest length that something is divided by, m. */
#define LENGTH_MIN 1e-6f
#define UNIT_MIN 1e-12f
#define PI_UP 3.1415928f
/* What single precision and the bake's rounding up may differ by. */
#define LOOSE 1.001f
#define LOOSE_M 1e-8f
#define LOOSE_M2 1e-12f
/* Least ramp in spacings: SPEC.md has 0.05. */
#define RAMP_MIN 0.0499f
#define RAMP_MAX 16.0f

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

static int all_in(const float *values, size_t count, float low, float high) {
    for (size_t i = 0; i < count; i++) {
        if (!cr_in_range(values[i], low, high)) {
            return 0;
        }
    }
    return 1;
}

static int floats_are_finite(const float *values, size_t count) { return all_in(values, count, -VALUE_MAX, VALUE_MAX); }

static int is_unit(const float normal[3]) {
    const cr_vec3 n = v3_from(normal);
    return cr_in_range(v3_dot(n, n), 1.0f - 1e-5f, 1.0f + 1e-5f);
}

static int is_box(const float low_m[3], const float high_m[3]) {
    return floats_are_finite(low_m, 3) && floats_are_finite(high_m, 3) && low_m[0] <= high_m[0] &&
           low_m[1] <= high_m[1] && low_m[2] <= high_m[2];
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
    /* Bytes of an element of each. */
    static const uint16_t strides[CR_SEC_COUNT + 1] = {
        [CR_SEC_META] = sizeof(struct cr_img_meta),
        [CR_SEC_TOP] = 4u,
        [CR_SEC_BRICKS] = sizeof(struct cr_img_brick),
        [CR_SEC_SAMPLES] = 2u,
        [CR_SEC_CELLS] = 2u,
        [CR_SEC_KINDS] = sizeof(struct cr_img_kind),
        [CR_SEC_FACETS] = sizeof(struct cr_img_facet),
        [CR_SEC_PAIRS] = sizeof(struct cr_img_pair),
        [CR_SEC_EDGES] = sizeof(struct cr_img_edge),
        [CR_SEC_CLUSTERS] = sizeof(struct cr_img_cluster),
        [CR_SEC_SUMS] = sizeof(struct cr_img_sum),
        [CR_SEC_GROUPS] = sizeof(struct cr_img_group),
        [CR_SEC_ADJ_START] = 4u,
        [CR_SEC_ADJ] = sizeof(struct cr_img_neighbour),
    };
    const void *at[CR_SEC_COUNT + 1];
    uint32_t count[CR_SEC_COUNT + 1];
    for (uint32_t id = 1u; id <= CR_SEC_COUNT; id++) {
        at[id] = find_section(image, size, id, strides[id], &count[id]);
        if (at[id] == NULL) {
            return CR_ERR_SECTION;
        }
    }
    s->meta = at[CR_SEC_META];
    s->top = at[CR_SEC_TOP];
    s->bricks = at[CR_SEC_BRICKS];
    s->samples = at[CR_SEC_SAMPLES];
    s->cells = at[CR_SEC_CELLS];
    s->kinds = at[CR_SEC_KINDS];
    s->facets = at[CR_SEC_FACETS];
    s->pairs = at[CR_SEC_PAIRS];
    s->edges = at[CR_SEC_EDGES];
    s->clusters = at[CR_SEC_CLUSTERS];
    s->sums = at[CR_SEC_SUMS];
    s->groups = at[CR_SEC_GROUPS];
    s->adj_start = at[CR_SEC_ADJ_START];
    s->adj = at[CR_SEC_ADJ];
    s->brick_count = count[CR_SEC_BRICKS];
    s->sample_count = count[CR_SEC_SAMPLES];
    s->cell_count = count[CR_SEC_CELLS];
    s->kind_count = count[CR_SEC_KINDS];
    s->facet_count = count[CR_SEC_FACETS];
    s->pair_count = count[CR_SEC_PAIRS];
    s->edge_count = count[CR_SEC_EDGES];
    s->cluster_count = count[CR_SEC_CLUSTERS];
    s->group_count = count[CR_SEC_GROUPS];
    s->adj_count = count[CR_SEC_ADJ];
    if (count[CR_SEC_META] != 1u || s->sample_count < 8u || s->kind_count < 1u || s->brick_count < 1u ||
        s->cluster_count < 1u || s->group_count < 1u || count[CR_SEC_SUMS] != s->cluster_count ||
        count[CR_SEC_ADJ_START] != s->cluster_count + 1u) {
        return CR_ERR_SECTION;
    }
    uint64_t cells = (uint64_t)s->meta->dims[0] * s->meta->dims[1];
    if (s->meta->dims[0] > 65536u || s->meta->dims[1] > 65536u || s->meta->dims[2] > 65536u ||
        cells * s->meta->dims[2] != count[CR_SEC_TOP] || count[CR_SEC_TOP] == 0u ||
        cells * s->meta->dims[2] > 0x7fffffffu) {
        return CR_ERR_SECTION;
    }
    return CR_OK;
}

/* Numbers that fit each other: an image whose lengths are of different units is none. */
static int lengths_agree(const struct cr_img_meta *m) {
    const float brick = 8.0f * m->voxel_m, band = 32767.0f * m->quantum_m; /* no sample is beyond the band */
    return cr_in_range(m->brick_m, brick / LOOSE, brick * LOOSE) &&
           cr_in_range(m->band_m, band / LOOSE, band * LOOSE) && m->crease_m <= m->band_m &&
           m->error_out_m <= m->band_m && m->error_in_m <= m->band_m && m->error_max_m <= m->band_m &&
           m->error_rms_m <= m->band_m && cr_in_range(m->ramp_max_m, RAMP_MIN * m->spacing_m, RAMP_MAX * m->spacing_m);
}

static cr_err check_meta(const struct cr_img_meta *m) {
    const struct {
        const float *values;
        size_t count;
        float low, high;
    } ranges[] = {{m->origin_m, 3, -VALUE_MAX, VALUE_MAX},
                  {&m->brick_m, 1, LENGTH_MIN, VALUE_MAX},
                  {&m->voxel_m, 1, LENGTH_MIN, VALUE_MAX},
                  {&m->band_m, 1, LENGTH_MIN, VALUE_MAX},
                  {&m->crease_m, 1, 0.0f, VALUE_MAX},
                  {&m->quantum_m, 1, LENGTH_MIN / 32768.0f, VALUE_MAX},
                  {&m->error_out_m, 4, 0.0f, VALUE_MAX},
                  {&m->crease_angle_rad, 1, 0.0f, PI_UP},
                  {&m->spacing_m, 1, LENGTH_MIN, VALUE_MAX},
                  {&m->tool_radius_m, 1, 0.0f, VALUE_MAX},
                  {m->root_centre_m, 3, -VALUE_MAX, VALUE_MAX},
                  {&m->root_radius_m, 1, 0.0f, VALUE_MAX},
                  {&m->shell_area_m2, 1, 0.0f, VALUE_MAX * VALUE_MAX},
                  {&m->ramp_max_m, 1, 0.0f, VALUE_MAX},
                  {&m->static_unit_m, 2, UNIT_MIN, VALUE_MAX}};
    for (size_t i = 0; i < sizeof ranges / sizeof *ranges; i++) {
        if (!all_in(ranges[i].values, ranges[i].count, ranges[i].low, ranges[i].high)) {
            return CR_ERR_VALUE;
        }
    }
    if (!lengths_agree(m) || !is_box(m->static_min_m, m->static_max_m) || !is_box(m->tool_min_m, m->tool_max_m) ||
        m->levels < 1u || m->levels > CR_TREE_DEPTH_MAX || m->piece_count > CR_PIECE_NONE ||
        m->patch_count > CR_PATCHES_MAX) {
        return CR_ERR_VALUE;
    }
    return CR_OK;
}

static int is_of_planes(const struct cr_img_kind *k) {
    return k->count > 0u && (k->kind == CR_KIND_PLANAR || k->kind == CR_KIND_CONVEX || k->kind == CR_KIND_CONCAVE);
}

static cr_err check_top(const cr_scene *s) {
    const struct cr_img_meta *m = s->meta;
    const uint32_t tops = m->dims[0] * m->dims[1] * m->dims[2];
    /* The surface is within the grid: nothing is further off than along its three sides. */
    const float far_m = m->brick_m * (float)(m->dims[0] + m->dims[1] + m->dims[2]) + m->band_m;
    for (uint32_t i = 0; i < tops; i++) {
        const uint32_t entry = s->top[i];
        if (!(entry & CR_TOP_FAR)) {
            if (entry >= s->brick_count) {
                return CR_ERR_INDEX;
            }
        } else if (!(m->quantum_m * (float)(int32_t)(entry & CR_TOP_BOUND) <= far_m)) {
            return CR_ERR_VALUE;
        }
    }
    return CR_OK;
}

/* A fine brick, after the brick before it: its table and the blocks that it names. Fine bricks lie in their order and apart, so that
 * this work is no more than the samples are. */
static cr_err check_fine(const cr_scene *s, const struct cr_img_brick *b, uint32_t *next) {
    const uint32_t room = s->sample_count - b->samples, voxels = CR_CELLS_SIDE * CR_CELLS_SIDE * CR_CELLS_SIDE;
    if (b->side != CR_BRICK_SIDE_MAX) {
        return CR_ERR_VALUE;
    }
    if (b->samples < *next || room < CR_FINE_BLOCKS) {
        return CR_ERR_INDEX;
    }
    for (uint32_t i = 0; i < voxels; i++) {
        const int32_t entry = s->samples[b->samples + CR_FINE_TABLE + i];
        const uint32_t bits = (uint32_t)entry & 0xffffu, at = (bits & CR_FINE_AT) * CR_FINE_UNIT;
        const uint32_t need = (bits & CR_FINE_QUARTERS) != 0u ? 125u : 27u;
        if (entry != 0 && (entry < 0 || at < CR_FINE_BLOCKS || at > room || need > room - at)) {
            return CR_ERR_INDEX;
        }
    }
    *next = b->samples + CR_FINE_BLOCKS;
    return CR_OK;
}

static cr_err check_brick(const cr_scene *s, const struct cr_img_brick *b, uint32_t *next_fine) {
    const uint32_t cells = b->side, side = cells + 1u, need = side * side * side;
    const uint32_t table = CR_CELLS_SIDE * CR_CELLS_SIDE * CR_CELLS_SIDE;
    if (cells < 1u || cells > CR_BRICK_SIDE_MAX || (cells & (cells - 1u)) != 0u || b->creased > 1u || b->fine > 1u) {
        return CR_ERR_VALUE;
    }
    if (b->samples > s->sample_count || need > s->sample_count - b->samples || b->kind >= s->kind_count ||
        b->planes >= s->kind_count) {
        return CR_ERR_INDEX;
    }
    if (b->planes != 0u && !(is_of_planes(&s->kinds[b->planes]) && is_of_planes(&s->kinds[b->kind]))) {
        return CR_ERR_VALUE;
    }
    if (b->cells != CR_CELLS_NONE && (b->cells > s->cell_count || table > s->cell_count - b->cells)) {
        return CR_ERR_INDEX;
    }
    return b->fine != 0u ? check_fine(s, b, next_fine) : CR_OK;
}

static cr_err check_voxmap(const cr_scene *s) {
    cr_err err = check_top(s);
    uint32_t next_fine = 0u;
    for (uint32_t i = 0; i < s->brick_count && err == CR_OK; i++) {
        err = check_brick(s, &s->bricks[i], &next_fine);
    }
    for (uint32_t i = 0; i < s->sample_count && err == CR_OK; i++) {
        err = s->samples[i] < -32767 ? CR_ERR_VALUE : CR_OK; /* beyond the band */
    }
    for (uint32_t i = 0; i < s->cell_count && err == CR_OK; i++) {
        err = s->cells[i] >= s->kind_count ? CR_ERR_INDEX : CR_OK;
    }
    return err;
}

static cr_err check_kind(const cr_scene *s, uint32_t index) {
    const struct cr_img_kind *k = &s->kinds[index];
    static const uint8_t least[] = {0u, 1u, 1u, 2u, 2u, 1u};
    static const uint8_t most[] = {0u, 1u, 1u, CR_KIND_FACETS_MAX, CR_KIND_FACETS_MAX, CR_KIND_FACETS_MAX};
    if (k->kind > CR_KIND_MIXED || k->count < least[k->kind] || k->count > most[k->kind] ||
        (index == 0u && k->kind != CR_KIND_EMPTY)) {
        return CR_ERR_VALUE;
    }
    for (uint32_t j = 0; j < k->count; j++) {
        if (k->facet[j] >= s->facet_count) {
            return CR_ERR_INDEX;
        }
    }
    return CR_OK;
}

static cr_err check_facet(const cr_scene *s, uint32_t index) {
    const struct cr_img_facet *f = &s->facets[index];
    if (!floats_are_finite(f->normal, 4) || !is_unit(f->normal) || f->curved > CR_FACET_OF_CURVED ||
        f->ends >> CR_FACET_SIDES != 0u || !floats_are_finite(f->low_m, 4) || f->low_m[0] > f->high_m[0] ||
        f->low_m[1] > f->high_m[1]) {
        return CR_ERR_VALUE;
    }
    return f->patch >= s->meta->patch_count ? CR_ERR_INDEX : CR_OK;
}

static cr_err check_pair(const cr_scene *s, uint32_t index) {
    const struct cr_img_pair *p = &s->pairs[index];
    if (p->first >= p->second || p->second >= s->meta->patch_count) {
        return CR_ERR_INDEX;
    }
    if (index > 0u && (p[-1].first > p->first || (p[-1].first == p->first && p[-1].second >= p->second))) {
        return CR_ERR_INDEX;
    }
    return p->label < CR_PAIR_CONVEX || p->label > (CR_PAIR_CONVEX | CR_PAIR_CONCAVE) ? CR_ERR_VALUE : CR_OK;
}

static cr_err check_edge(const cr_scene *s, uint32_t index) {
    const struct cr_img_edge *e = &s->edges[index];
    if (!floats_are_finite(e->a_m, 3) || !floats_are_finite(e->b_m, 3) || !cr_in_range(e->angle_rad, 0.0f, PI_UP) ||
        (e->label != CR_PAIR_CONVEX && e->label != CR_PAIR_CONCAVE)) {
        return CR_ERR_VALUE;
    }
    return e->patch[0] >= s->meta->patch_count || e->patch[1] >= s->meta->patch_count ? CR_ERR_INDEX : CR_OK;
}

static cr_err check_features(const cr_scene *s) {
    cr_err err = CR_OK;
    for (uint32_t i = 0; i < s->kind_count && err == CR_OK; i++) {
        err = check_kind(s, i);
    }
    for (uint32_t i = 0; i < s->facet_count && err == CR_OK; i++) {
        err = check_facet(s, i);
    }
    for (uint32_t i = 0; i < s->pair_count && err == CR_OK; i++) {
        err = check_pair(s, i);
    }
    for (uint32_t i = 0; i < s->edge_count && err == CR_OK; i++) {
        err = check_edge(s, i);
    }
    return err;
}

/* The next child that a tree written in order names. */
typedef struct {
    uint32_t group, cluster;
} reached;

/* Children are numbered in the order of their parents: when all are there, each group and each cluster has one parent, before it. The
 * traversal stack cannot overflow, and no cluster is visited twice. */
static cr_err check_children(const cr_scene *s, uint32_t index, reached *next) {
    const struct cr_img_group *g = &s->groups[index];
    for (uint32_t i = 0; i < g->count; i++) {
        const uint32_t child = g->child[i], first = g->leaf != 0u ? next->cluster : next->group;
        const uint32_t count = g->leaf != 0u ? s->cluster_count : s->group_count;
        if (child != first || child >= count) {
            return CR_ERR_INDEX;
        }
        if (g->leaf != 0u) {
            next->cluster++;
        } else {
            next->group++;
        }
        if (g->leaf == 0u && (child <= index || s->groups[child].level != g->level + 1u)) {
            return CR_ERR_INDEX;
        }
        if (g->first[i] != (g->leaf != 0u ? child : s->groups[child].first[0])) {
            return CR_ERR_INDEX;
        }
    }
    return CR_OK;
}

static cr_err check_group(const cr_scene *s, uint32_t index, reached *next) {
    const struct cr_img_group *g = &s->groups[index];
    const struct cr_img_meta *m = s->meta;
    if (!floats_are_finite(g->x, (size_t)3u * CR_LANES) || !all_in(g->radius, CR_LANES, 0.0f, VALUE_MAX) ||
        !all_in(g->margin, CR_LANES, 0.0f, LOOSE * m->ramp_max_m + LOOSE_M) ||
        !all_in(g->rho, CR_LANES, 0.0f, LOOSE * m->tool_radius_m + LOOSE_M)) {
        return CR_ERR_VALUE;
    }
    if (g->count < 1u || g->count > CR_LANES || g->leaf > 1u || g->level >= m->levels ||
        (index == 0u && g->level != 0u)) {
        return CR_ERR_VALUE;
    }
    return check_children(s, index, next);
}

static cr_err check_tree(const cr_scene *s) {
    reached next = {1u, 0u};
    cr_err err = CR_OK;
    for (uint32_t i = 0; i < s->group_count && err == CR_OK; i++) {
        err = check_group(s, i, &next);
    }
    return err == CR_OK && (next.group != s->group_count || next.cluster != s->cluster_count) ? CR_ERR_INDEX : err;
}

/* Does one lane have a ramp for its spacing, a second moment no wider than that, and the area of its vector? */
static int lane_is_sound(const struct cr_img_meta *m, const struct cr_img_cluster *c, uint32_t i) {
    const float ramp = c->ramp[i], most = LOOSE * 4.0f * ramp * ramp, area = c->area[i];
    const cr_vec3 a = v3(c->ax[i], c->ay[i], c->az[i]);
    const int used = i < c->count;
    const uint32_t others = used ? first_lanes(c->count) & ~(1u << i) : 0u;
    return cr_in_range(ramp, RAMP_MIN * m->spacing_m, LOOSE * m->ramp_max_m + LOOSE_M) &&
           cr_in_range(c->wxx[i], 0.0f, most) && cr_in_range(c->wyy[i], 0.0f, most) &&
           cr_in_range(c->wzz[i], 0.0f, most) && cr_in_range(c->wxy[i], -most, most) &&
           cr_in_range(c->wyz[i], -most, most) && cr_in_range(c->wzx[i], -most, most) &&
           cr_in_range(area, 0.0f, VALUE_MAX) &&
           cr_in_range(v3_norm(a), area / LOOSE - LOOSE_M2, area * LOOSE + LOOSE_M2) &&
           cr_in_range(c->bow[i], 0.0f, VALUE_MAX) && cr_in_range(c->reach[i], 0.0f, used ? LOOSE * ramp : 0.0f) &&
           (used || area <= 0.0f) && (c->beside[i] & ~others) == 0u;
}

/* Pieces that there are, no piece twice, every lane in one. */
static int pieces_are_sound(const struct cr_img_meta *m, const struct cr_img_cluster *c) {
    uint32_t lanes = 0u;
    for (uint32_t i = 0; i < CR_PIECES; i++) {
        const int none = c->piece[i] == CR_PIECE_NONE;
        if ((!none && c->piece[i] >= m->piece_count) || none != (c->piece_lanes[i] == 0u)) {
            return 0;
        }
        lanes |= c->piece_lanes[i];
    }
    return lanes == first_lanes(c->count) && c->piece[0] != CR_PIECE_NONE && c->piece[0] != c->piece[1];
}

static int cluster_is_sound(const cr_scene *s, uint32_t index) {
    const struct cr_img_cluster *c = &s->clusters[index];
    const cr_vec3 n = v3_from(c->normal);
    if (c->count < 1u || c->count > CR_LANES || !floats_are_finite(c->x, (size_t)6u * CR_LANES) ||
        ((c->vertex_mask | c->crease_mask) & ~first_lanes(c->count)) != 0u || (c->vertex_mask & c->crease_mask) != 0u ||
        (c->inner_mask & (c->vertex_mask | c->crease_mask | ~first_lanes(c->count))) != 0u ||
        !(is_unit(c->normal) || v3_dot(n, n) <= 0.0f) || !cr_in_range(c->radius_m, 0.0f, VALUE_MAX) ||
        !pieces_are_sound(s->meta, c)) {
        return 0;
    }
    for (uint32_t i = 0; i < CR_LANES; i++) {
        if (!lane_is_sound(s->meta, c, i)) {
            return 0;
        }
    }
    return 1;
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

/* The list of a cluster's neighbours: of bounded length, in order, of lanes that both have. */
static cr_err check_neighbours(const cr_scene *s, uint32_t cluster) {
    const uint32_t from = s->adj_start[cluster], end = s->adj_start[cluster + 1u];
    if (from > end || end > s->adj_count || end - from > CR_IMG_BESIDE_MAX) {
        return CR_ERR_INDEX;
    }
    for (uint32_t i = from; i < end; i++) {
        const struct cr_img_neighbour *n = &s->adj[i];
        if (n->cluster >= s->cluster_count || n->cluster == cluster) {
            return CR_ERR_INDEX;
        }
        if (i > from && (n[-1].cluster > n->cluster || (n[-1].cluster == n->cluster && n[-1].mine >= n->mine))) {
            return CR_ERR_INDEX;
        }
        const uint32_t mine = n->mine, theirs = n->theirs;
        if (mine == 0u || theirs == 0u || (mine & ~first_lanes(s->clusters[cluster].count)) != 0u ||
            (theirs & ~first_lanes(s->clusters[n->cluster].count)) != 0u) {
            return CR_ERR_VALUE;
        }
    }
    return CR_OK;
}

static cr_err check_shell(const cr_scene *s) {
    uint64_t points = 0u;
    cr_err err = check_tree(s);
    for (uint32_t i = 0; i < s->cluster_count && err == CR_OK; i++) {
        const int sound = cluster_is_sound(s, i) && floats_are_finite(&s->sums[i].ax, 7) && sums_match(s, i);
        err = sound ? CR_OK : CR_ERR_VALUE;
        points += s->clusters[i].count;
    }
    for (uint32_t i = 0; i < s->cluster_count && err == CR_OK; i++) {
        err = check_neighbours(s, i);
    }
    if (err == CR_OK && (s->adj_start[0] != 0u || s->adj_start[s->cluster_count] != s->adj_count)) {
        err = CR_ERR_INDEX;
    }
    return err == CR_OK && points != s->meta->point_count ? CR_ERR_VALUE : err;
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
    const uint32_t index = 0u - (uint32_t)err;
    return index < sizeof text / sizeof text[0] ? text[index] : "unknown error";
}
