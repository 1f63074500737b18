/* Small images for tests that try every bit, and for the fuzzer: see image_builder.h. */
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define CORNERS 9u /* samples along a side of the bricks that crt_image makes */
#define TABLE (CR_CELLS_SIDE * CR_CELLS_SIDE * CR_CELLS_SIDE)

/* Sections while they grow. */
typedef struct {
    uint8_t *bytes[CR_SEC_COUNT + 1];
    uint32_t count[CR_SEC_COUNT + 1], stride[CR_SEC_COUNT + 1];
} parts;

/* Where `count` elements lie in section `id`: those that are there already, or new ones. */
static uint32_t keep(parts *p, uint32_t id, const void *elements, uint32_t count) {
    uint32_t bytes = count * p->stride[id];
    for (uint32_t at = 0; at + count <= p->count[id]; at++) {
        if (memcmp(p->bytes[id] + at * p->stride[id], elements, bytes) == 0) {
            return at;
        }
    }
    p->bytes[id] = realloc(p->bytes[id], (p->count[id] + count) * p->stride[id]);
    assert_non_null(p->bytes[id]);
    memcpy(p->bytes[id] + p->count[id] * p->stride[id], elements, bytes);
    p->count[id] += count;
    return p->count[id] - count;
}

static void keep_all(parts *p, uint8_t *image, uint32_t id) {
    p->bytes[id] = malloc((size_t)crt_row(image, id)->count * p->stride[id] + 1u);
    assert_non_null(p->bytes[id]);
    p->count[id] = crt_row(image, id)->count;
    memcpy(p->bytes[id], crt_section(image, id), (size_t)p->count[id] * p->stride[id]);
}

static uint32_t keep_kind(parts *p, uint8_t *image, uint32_t kind) {
    const struct cr_img_kind *kinds = crt_section(image, CR_SEC_KINDS);
    return keep(p, CR_SEC_KINDS, &kinds[kind], 1u);
}

/* A brick with its samples and cells. Bricks that see one facet keep their corners only, which is exact for a plane. */
static uint32_t keep_brick(parts *p, uint8_t *image, uint32_t index) {
    struct cr_img_brick b = ((const struct cr_img_brick *)crt_section(image, CR_SEC_BRICKS))[index];
    const int16_t *samples = (const int16_t *)crt_section(image, CR_SEC_SAMPLES) + b.samples;
    if (b.cells == CR_CELLS_NONE && b.fine) {
        b.samples = keep(p, CR_SEC_SAMPLES, samples, crt_samples_of(&b, samples));
        b.kind = (uint16_t)keep_kind(p, image, b.kind);
    } else if (b.cells == CR_CELLS_NONE) {
        int16_t corner[8];
        for (uint32_t k = 0; k < 8u; k++) {
            corner[k] = samples[8u * ((k & 1u) + CORNERS * (k >> 1 & 1u) + CORNERS * CORNERS * (k >> 2))];
        }
        b.side = 1u;
        b.samples = keep(p, CR_SEC_SAMPLES, corner, 8u);
        b.kind = (uint16_t)keep_kind(p, image, b.kind);
    } else {
        const uint16_t *cells = (const uint16_t *)crt_section(image, CR_SEC_CELLS) + b.cells;
        uint16_t table[TABLE];
        for (uint32_t k = 0; k < TABLE; k++) {
            table[k] = (uint16_t)keep_kind(p, image, cells[k]);
        }
        b.samples = keep(p, CR_SEC_SAMPLES, samples, crt_samples_of(&b, samples));
        b.cells = keep(p, CR_SEC_CELLS, table, TABLE);
        b.kind = b.planes != 0u ? (uint16_t)keep_kind(p, image, b.kind) : 0u;
    }
    b.planes = b.planes != 0u ? (uint16_t)keep_kind(p, image, b.planes) : 0u;
    return keep(p, CR_SEC_BRICKS, &b, 1u);
}

static void keep_grid(parts *p, uint8_t *image, const uint32_t low[3], const uint32_t high[3]) {
    struct cr_img_meta *m = (struct cr_img_meta *)(void *)p->bytes[CR_SEC_META];
    const uint32_t *top = crt_section(image, CR_SEC_TOP),
                   *dims = ((struct cr_img_meta *)crt_section(image, CR_SEC_META))->dims;
    uint32_t entries = 0u, grid[4096];
    keep_kind(p, image, 0u);
    for (uint32_t z = low[2]; z < high[2]; z++) {
        for (uint32_t y = low[1]; y < high[1]; y++) {
            for (uint32_t x = low[0]; x < high[0]; x++) {
                uint32_t entry = top[(z * dims[1] + y) * dims[0] + x];
                assert_true(entries < sizeof grid / sizeof *grid);
                grid[entries++] = (entry & CR_TOP_FAR) != 0u ? entry : keep_brick(p, image, entry);
            }
        }
    }
    p->bytes[CR_SEC_TOP] = malloc(entries * sizeof *grid);
    assert_non_null(p->bytes[CR_SEC_TOP]);
    memcpy(p->bytes[CR_SEC_TOP], grid, entries * sizeof *grid);
    p->count[CR_SEC_TOP] = entries;
    for (int a = 0; a < 3; a++) {
        m->origin_m[a] += (float)low[a] * m->brick_m;
        m->dims[a] = high[a] - low[a];
    }
}

/* A root above the leaf groups, so that the walk goes down and up also in a small tool. */
static void add_root(parts *p) {
    struct cr_img_meta *m = (struct cr_img_meta *)(void *)p->bytes[CR_SEC_META];
    struct cr_img_group *leaf = (struct cr_img_group *)(void *)p->bytes[CR_SEC_GROUPS];
    struct cr_img_group *g = calloc(3u, sizeof *g);
    uint32_t half = leaf->count / 2u;
    assert_true(g != NULL && p->count[CR_SEC_GROUPS] == 1u && leaf->count > 1u);
    g[0] = *leaf;
    g[0].count = 2u;
    g[0].leaf = 0u;
    for (uint32_t k = 0; k < CR_LANES; k++) {
        g[0].child[k] = 1u + k % 2u;
        g[0].x[k] = m->root_centre_m[0];
        g[0].y[k] = m->root_centre_m[1];
        g[0].z[k] = m->root_centre_m[2];
        g[0].radius[k] = m->root_radius_m;
        g[0].margin[k] = m->ramp_max_m;
        g[0].rho[k] = m->tool_radius_m;
    }
    for (uint32_t i = 1; i <= 2u; i++) {
        uint32_t from = i == 1u ? 0u : half, count = i == 1u ? half : leaf->count - half;
        g[i].count = count;
        g[i].leaf = g[i].level = 1u;
        for (uint32_t k = 0; k < CR_LANES; k++) {
            uint32_t lane = from + (k < count ? k : 0u);
            g[i].x[k] = leaf->x[lane];
            g[i].y[k] = leaf->y[lane];
            g[i].z[k] = leaf->z[lane];
            g[i].radius[k] = leaf->radius[lane];
            g[i].margin[k] = leaf->margin[lane];
            g[i].rho[k] = leaf->rho[lane];
            g[i].child[k] = g[i].first[k] = leaf->child[lane];
        }
    }
    free(p->bytes[CR_SEC_GROUPS]);
    p->bytes[CR_SEC_GROUPS] = (uint8_t *)g;
    p->count[CR_SEC_GROUPS] = 3u;
    m->levels = 2u;
}

static uint32_t round_up(uint32_t n) { return (n + CR_IMG_ALIGN - 1u) / CR_IMG_ALIGN * CR_IMG_ALIGN; }

uint8_t *crt_shrink(uint8_t *image, const uint32_t low[3], const uint32_t high[3], uint32_t *size_bytes) {
    static const uint32_t whole[] = {CR_SEC_META, CR_SEC_FACETS, CR_SEC_PAIRS,     CR_SEC_EDGES, CR_SEC_CLUSTERS,
                                     CR_SEC_SUMS, CR_SEC_GROUPS, CR_SEC_ADJ_START, CR_SEC_ADJ};
    parts p;
    memset(&p, 0, sizeof p);
    for (uint32_t id = 1; id <= CR_SEC_COUNT; id++) {
        p.stride[id] = crt_row(image, id)->stride;
    }
    for (size_t i = 0; i < sizeof whole / sizeof *whole; i++) {
        keep_all(&p, image, whole[i]);
    }
    keep_grid(&p, image, low, high);
    add_root(&p);
    uint32_t head = (uint32_t)(sizeof(struct cr_img_header) + CR_SEC_COUNT * sizeof(struct cr_img_section));
    uint32_t size = round_up(head), at = size;
    for (uint32_t id = 1; id <= CR_SEC_COUNT; id++) {
        size += round_up(p.count[id] * p.stride[id]);
    }
    uint8_t *small = aligned_alloc(CR_IMG_ALIGN, size);
    assert_non_null(small);
    memset(small, 0, size);
    memcpy(small, image, sizeof(struct cr_img_header));
    ((struct cr_img_header *)(void *)small)->size_bytes = size;
    for (uint32_t id = 1; id <= CR_SEC_COUNT; id++) {
        *crt_row(small, id) = (struct cr_img_section){id, at, p.count[id], p.stride[id]};
        if (p.count[id] > 0u) {
            memcpy(small + at, p.bytes[id], (size_t)p.count[id] * p.stride[id]);
        }
        at += round_up(p.count[id] * p.stride[id]);
        free(p.bytes[id]);
    }
    crt_seal(small);
    *size_bytes = size;
    return small;
}

/* ---- a small tool: the lower half of a plate ------------------------------------------------------------------------ */

#define PLATE_HALF_M 3e-3
#define PLATE_SPACING_M 1.5e-3

static crt_sample sample_at(double x, double y, double nx, double ny) {
    crt_sample s;
    memset(&s, 0, sizeof s);
    s.pos_m[0] = x;
    s.pos_m[1] = y;
    const double nz = nx != 0.0 || ny != 0.0 ? -0.5 : -1.0, length = sqrt(nx * nx + ny * ny + nz * nz);
    s.normal[0] = nx / length;
    s.normal[1] = ny / length;
    s.normal[2] = nz / length;
    s.area_m2 = 1e-3 * PLATE_SPACING_M * PLATE_SPACING_M;
    return s;
}

crt_tool crt_plate(void) {
    static const double side[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
    crt_tool t = {calloc(24, sizeof(crt_sample)), calloc(4, sizeof(uint32_t)), 24u, 3u, PLATE_SPACING_M};
    assert_true(t.samples != NULL && t.start != NULL);
    for (int k = 0; k < 16; k++) { /* the face */
        crt_sample *s = &t.samples[k];
        *s = sample_at(PLATE_SPACING_M * (k % 4 - 1.5), PLATE_SPACING_M * (k / 4 - 1.5), 0.0, 0.0);
        s->u[0] = s->v[1] = 1.0;
        s->width_m[0] = s->width_m[1] = PLATE_SPACING_M;
        s->area_m2 = PLATE_SPACING_M * PLATE_SPACING_M;
    }
    for (int k = 0; k < 4; k++) { /* its edges, each in one piece, and its corners */
        crt_sample *s = &t.samples[16 + k];
        *s = sample_at(PLATE_HALF_M * side[k][0], PLATE_HALF_M * side[k][1], side[k][0], side[k][1]);
        s->u[side[k][0] != 0.0 ? 1 : 0] = 1.0;
        s->width_m[0] = 2.0 * PLATE_HALF_M;
        s->reach_m = PLATE_HALF_M;
        s->crease = 1;
        double x = k & 1 ? 1.0 : -1.0, y = k & 2 ? 1.0 : -1.0;
        t.samples[20 + k] = sample_at(PLATE_HALF_M * x, PLATE_HALF_M * y, x, y);
        t.samples[20 + k].u[0] = 1.0;
        t.samples[20 + k].vertex = 1;
    }
    t.start[1] = 16u;
    t.start[2] = 20u;
    t.start[3] = 24u;
    return t;
}
