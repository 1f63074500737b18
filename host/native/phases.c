#include "phases.h"

#include "contact/stages.h"

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
    cr_search search;
    cr_contact_set set, unmeasured;
    cr_area_set areas;
    cr_area answers[CR_AREAS_MAX];
    cr_stats stats;
    uint16_t *hit_of_cluster;
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

static void time_pose(bench *b, const cr_scene *scene, const cr_config *config, const cr_pose *pose,
                      cr_phases_row *row) {
    const cr_detect_options options = {config->skip, config->coverage, config->lookups_max, 0u};
    const xform now = xform_from_pose(pose);
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
    cr_zones(scene, b->hit_of_cluster, &b->set, &b->areas, &b->stats);
    row->zones_ns = since(start);
    /* Without hits the response finds nothing to measure depth with; zones keep their touches. */
    b->unmeasured = b->set;
    b->unmeasured.hit_count = 0u;
    in.set = &b->unmeasured;
    start = now_ns();
    cr_respond(&in, &b->areas, b->answers, CR_AREAS_MAX, &b->stats);
    row->normal_ns = since(start);
    in.set = &b->set;
    start = now_ns();
    row->areas = cr_respond(&in, &b->areas, b->answers, CR_AREAS_MAX, &b->stats);
    uint32_t both_ns = since(start);
    row->penetration_ns = both_ns > row->normal_ns ? both_ns - row->normal_ns : 0u;
}

static uint32_t least(uint32_t a, uint32_t b) { return a < b ? a : b; }

static void run(bench *b, const cr_scene *scene, const cr_config *config, const cr_path_row *path, size_t count,
                uint32_t repeat, cr_phases_row *rows) {
    for (uint32_t pass = 0; pass < repeat; pass++) {
        b->motion.valid = 0u;
        for (size_t i = 0; i < count; i++) {
            const cr_pose pose = pose_of(&path[i]);
            cr_phases_row row;
            time_pose(b, scene, config, &pose, &row);
            if (pass > 0u) {
                row.detect_ns = least(row.detect_ns, rows[i].detect_ns);
                row.zones_ns = least(row.zones_ns, rows[i].zones_ns);
                row.normal_ns = least(row.normal_ns, rows[i].normal_ns);
                row.penetration_ns = least(row.penetration_ns, rows[i].penetration_ns);
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
    /* Two responses have a path through respond.c that can be cut in two; the others do not. */
    if (cr_world_size(scene, config) == 0u || config->response > CR_RESPONSE_FIXED45) {
        return CR_ERR_CONFIG;
    }
    bench *b = calloc(1, sizeof *b);
    float *wake = calloc((size_t)scene->group_count * CR_LANES, sizeof *wake);
    uint16_t *hit_of_cluster = malloc(((size_t)scene->cluster_count + 1u) * sizeof *hit_of_cluster);
    cr_err err = b != NULL && wake != NULL && hit_of_cluster != NULL ? CR_OK : CR_ERR_NULL;
    if (err == CR_OK) {
        cr_field_init(&b->field, scene);
        b->motion.wake_m = wake;
        b->motion.wake_count = scene->group_count * CR_LANES;
        b->hit_of_cluster = hit_of_cluster;
        for (uint32_t i = 0; i < scene->cluster_count; i++) {
            hit_of_cluster[i] = CR_HIT_NONE;
        }
        run(b, scene, config, path, count, repeat, rows);
    }
    free(hit_of_cluster);
    free(wake);
    free(b);
    return err;
}
