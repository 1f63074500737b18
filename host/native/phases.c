#include "phases.h"

#include "contact/way_out.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

static uint64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

/* What a world holds, laid open. */
typedef struct {
    cr_field field;
    cr_motion motion;
    cr_descent search;
    cr_contact_set set;
    cr_way_work work;
    cr_area answers[CR_AREAS_MAX];
    cr_stats stats;
} bench;

static cr_pose pose_of(const cr_path_row *row) {
    cr_pose p = {{(float)row->pos_m[0], (float)row->pos_m[1], (float)row->pos_m[2]},
                 {(float)row->rot[0], (float)row->rot[1], (float)row->rot[2], (float)row->rot[3]}};
    float scale = 1.0f / sqrtf(p.rot.w * p.rot.w + p.rot.x * p.rot.x + p.rot.y * p.rot.y + p.rot.z * p.rot.z);
    p.rot.w *= scale;
    p.rot.x *= scale;
    p.rot.y *= scale;
    p.rot.z *= scale;
    return p;
}

static uint32_t since(uint64_t start_ns) { return (uint32_t)(now_ns() - start_ns); }

static void time_pose(bench *b, const cr_config *config, const cr_pose *pose, cr_phases_row *row) {
    const cr_detect_options options = {.skip = config->skip,
                                       .coverage = config->coverage,
                                       .lookups_max = config->lookups_max,
                                       .slices_max = CR_SEARCH_TICKS_MAX};
    const xform now = cr_xform_from_pose(pose);
    cr_respond_input in = {.field = &b->field, .world_from_tool = &now, .set = &b->set, .config = config};
    memset(&b->stats, 0, sizeof b->stats);
    memset(row, 0, sizeof *row);
    uint64_t start = now_ns();
    cr_motion_advance(&b->motion, pose);
    while (!cr_detect(&b->field, &now, &options, &b->motion, &b->search, &b->set, &b->stats)) {
    }
    row->detect_ns = since(start);
    row->points = b->stats.points;
    row->nodes = b->stats.nodes;
    row->contacts = b->set.contacts;
    if (b->set.hit_count == 0u) {
        return;
    }
    start = now_ns();
    cr_way_begin(&in, &b->work);
    row->relate_ns = since(start);
    start = now_ns();
    cr_way_measure(&in, &b->work, UINT32_MAX);
    row->depth_ns = since(start);
    start = now_ns();
    cr_way_push(&b->work, UINT32_MAX);
    row->areas = cr_way_answer(&in, &b->work, b->answers, CR_AREAS_MAX, &b->stats);
    row->resolve_ns = since(start);
}

static uint32_t least(uint32_t a, uint32_t b) { return a < b ? a : b; }

static void run(bench *b, const cr_config *config, const cr_path_row *path, size_t count, uint32_t repeat,
                cr_phases_row *rows) {
    for (uint32_t pass = 0; pass < repeat; pass++) {
        b->motion.valid = 0u;
        for (size_t i = 0; i < count; i++) {
            const cr_pose pose = pose_of(&path[i]);
            cr_phases_row row;
            time_pose(b, config, &pose, &row);
            if (pass > 0u) {
                row.detect_ns = least(row.detect_ns, rows[i].detect_ns);
                row.relate_ns = least(row.relate_ns, rows[i].relate_ns);
                row.depth_ns = least(row.depth_ns, rows[i].depth_ns);
                row.resolve_ns = least(row.resolve_ns, rows[i].resolve_ns);
            }
            rows[i] = row;
        }
    }
}

cr_err cr_phases_run(const cr_scene *scene, const cr_config *config, const cr_path_row *path, size_t count,
                     uint32_t repeat, cr_phases_row *rows) {
    if (scene == NULL || config == NULL || path == NULL || rows == NULL) {
        return CR_ERR_NULL;
    }
    /* The stages are those of the product's own response. */
    if (cr_world_size(scene, config) == 0u || config->response != CR_RESPONSE_WAY_OUT) {
        return CR_ERR_CONFIG;
    }
    bench *b = calloc(1, sizeof *b);
    float *wake = calloc((size_t)scene->group_count * CR_LANES, sizeof *wake);
    cr_err err = b != NULL && wake != NULL ? CR_OK : CR_ERR_NULL;
    if (err == CR_OK) {
        cr_field_init(&b->field, scene);
        b->motion.wake_m = wake;
        b->motion.wake_count = scene->group_count * CR_LANES;
        run(b, config, path, count, repeat, rows);
    }
    free(wake);
    free(b);
    return err;
}
