/* world: the caller's memory made into a world. */
#include "contact/world.h"

#include <string.h>

static size_t round_up(size_t n) { return (n + CR_IMG_ALIGN - 1u) / CR_IMG_ALIGN * CR_IMG_ALIGN; }

size_t cr_world_size(const cr_scene *scene, const cr_config *config) {
    if (scene == NULL || config == NULL || scene->meta == NULL || cr_config_error(config) != NULL) {
        return 0u;
    }
    size_t size = round_up(sizeof(cr_world)) + round_up((size_t)scene->group_count * CR_LANES * sizeof(float));
#ifdef CR_RIVALS
    size += round_up((size_t)scene->cluster_count * sizeof(uint16_t));
#endif
    return size;
}

cr_err cr_world_init(cr_world **world, void *memory, size_t size_bytes, const cr_scene *scene,
                     const cr_config *config) {
    if (world == NULL || memory == NULL || scene == NULL || config == NULL) {
        return CR_ERR_NULL;
    }
    if ((uintptr_t)memory % CR_IMG_ALIGN != 0u) {
        return CR_ERR_ALIGN;
    }
    size_t need = cr_world_size(scene, config);
    if (need == 0u) {
        return CR_ERR_CONFIG;
    }
    if (size_bytes < need) {
        return CR_ERR_SIZE;
    }
    uint8_t *at = memory;
    memset(at, 0, need);
    cr_world *w = memory;
    at += round_up(sizeof *w);
    w->motion.wake_m = (float *)(void *)at;
    w->motion.wake_count = scene->group_count * CR_LANES;
#ifdef CR_RIVALS
    at += round_up((size_t)w->motion.wake_count * sizeof(float));
    w->hit_of_cluster = (uint16_t *)(void *)at;
    for (uint32_t i = 0; i < scene->cluster_count; i++) {
        w->hit_of_cluster[i] = CR_HIT_NONE;
    }
#endif
    w->scene = *scene;
    w->config = *config;
    w->late_max = CR_LATE_MOST;
    cr_field_init(&w->field, &w->scene);
    *world = w;
    return CR_OK;
}

cr_err cr_world_configure(cr_world *world, const cr_config *config) {
    if (world == NULL || config == NULL) {
        return CR_ERR_NULL;
    }
    if (cr_config_error(config) != NULL) {
        return CR_ERR_CONFIG;
    }
#ifdef CR_RIVALS
    world->motion.valid &=
        (uint32_t)(world->config.response == config->response); /* what sleeps hangs on how far each reaches */
#endif
    world->config = *config;
    cr_drop_search(world);
#ifdef CR_RIVALS
    world->proxy.held = 0u;
#endif
    return CR_OK;
}

const cr_contact_set *cr_world_contacts(const cr_world *world) { return &world->set; }
