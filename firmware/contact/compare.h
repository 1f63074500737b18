/* What the responses of rivals/ get besides: the surfaces that hits touch, contact areas and zones. Part of stages.h with CR_RIVALS;
 * no device library has it. */
#ifndef CR_COMPARE_H
#define CR_COMPARE_H

#include "contact/image.h"
#include "contact/math3.h"
#include "crease.h"

/* What a cluster touches of one static patch. */
typedef struct {
    uint16_t hit;
    uint16_t mixed;        /* 1: more than one facet */
    uint32_t facet;        /* the first facet */
    float area_m2;         /* coverage times tool area, projected on the surface */
    cr_vec3 normal_sum_m2; /* area times surface normal, world */
    cr_vec3 point_sum_m3;  /* area times nearest surface point, world */
    cr_vec3 tool_sum_m2;   /* covered area vectors of the tool there, tool frame */
} cr_touch;

/* (cluster, surface) pairs one tick may keep: a cluster on a crease touches two or three surfaces. */
#ifndef CR_TOUCHES_MAX
#define CR_TOUCHES_MAX 382
#endif
#if CR_TOUCHES_MAX < 16 || CR_TOUCHES_MAX > 65535
#error "CR_TOUCHES_MAX: 16..65535 touches"
#endif

/* Surface state of a zone that the response needs and the report does not. */
typedef struct {
    uint32_t curved;     /* 1: more than one facet, plane found by support */
    uint32_t facet;      /* the facet, when there is one */
    float spread_rad;    /* standard deviation of its normals; 0 when planar */
    cr_vec3 tool_sum_m2; /* covered area vectors of the tool next to the zone, tool frame */
} cr_zone_shape;

/* A contact area, sums in the tool frame. */
typedef struct {
    struct cr_img_sum sum;
    uint32_t zone_count;
    cr_zone zones[CR_ZONES_MAX];
    cr_zone_shape shapes[CR_ZONES_MAX];
} cr_area_work;

typedef struct {
    uint32_t count;
    cr_area_work areas[CR_AREAS_MAX];
} cr_area_set;

/* Coverage where rivals are asked: of strips, at static corners too. */
static inline uint32_t cr_coverage_of(uint32_t coverage, uint32_t touches) {
    return touches != 0u && coverage == CR_COVERAGE_SOFT ? CR_COVERAGE_STRIPS : coverage;
}

/* Where a proxy rests while the tool is inside: state of the proxy responses (rivals/README.md). */
typedef struct {
    cr_vec3 pos_m;
    cr_vec3 device_m; /* the tool's place at the search before */
    uint32_t held;    /* 1: pos_m is the proxy's; 0: it starts from device_m */
} cr_proxy;

#endif
