/* settings: of a world, and what they may hold. */
#include "contact/stages.h"

#include <stddef.h>

#define LOOKUPS_LEAST 32u
#define LOOKUPS_MOST 1048576u

cr_config cr_config_default(void) {
    cr_config c = {1000.0f, 0.0f, 100.0f, CR_RESPONSE_WAY_OUT, CR_COVERAGE_SOFT, CR_SKIP_ALL, 0u, CR_LOOKUPS_MAX};
    return c;
}

const char *cr_config_error(const cr_config *c) {
    if (c == NULL) {
        return cr_err_text(CR_ERR_NULL);
    }
    if (!cr_in_range(c->stiffness_N_m, 0.0f, 1e6f) || !cr_in_range(c->damping_Ns_m, 0.0f, 1e4f) ||
        !cr_in_range(c->force_max_N, 1e-6f, 1e6f)) {
        return "stiffness_N_m: 0..1e6; damping_Ns_m: 0..1e4; force_max_N of the world: above 0, up to 1e6";
    }
    if (c->response >= CR_RESPONSE_COUNT || c->coverage > CR_COVERAGE_HARD ||
        (c->skip & ~(uint32_t)CR_SKIP_ALL) != 0u || c->vertices_only > 1u) {
        return "response, coverage, skip, vertices_only: a value that this version knows";
    }
    if (c->response == CR_RESPONSE_WAY_OUT && (c->coverage != CR_COVERAGE_SOFT || c->vertices_only != 0u)) {
        return "coverage, vertices_only: 0 with way_out";
    }
    if (c->lookups_max < LOOKUPS_LEAST || c->lookups_max > LOOKUPS_MOST) {
        return "lookups_max: 32..1048576";
    }
    return NULL;
}
