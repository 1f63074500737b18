/* velocity: counts of one joint in, its speed out. */
#include "servo/servo_stages.h"

#include <string.h>

void cr_velocity_reset(cr_velocity *velocity) { memset(velocity, 0, sizeof *velocity); }

/* Counts gained since `back` periods ago. Wraps like the encoder does. */
static float rise_since(const cr_velocity *v, uint32_t back) {
    CR_ASSERT(back < v->filled);
    uint32_t at = (v->head + CR_WINDOW_MAX + 1u - back) % (CR_WINDOW_MAX + 1u);
    return (float)(int32_t)((uint32_t)v->counts[v->head] - (uint32_t)v->counts[at]);
}

/* Longest window whose end-to-end line has every sample within one count: a sample i back allows the slopes
 * (rise_i +- 1) / i, and the line has to be in all of them. */
static uint32_t find_window(const cr_velocity *v, uint32_t limit) {
    float low = -1e30f, high = 1e30f;
    uint32_t good = 0u;
    for (uint32_t n = 1u; n <= limit; n++) {
        float rise = rise_since(v, n), periods = (float)n;
        float slope = rise / periods;
        if (slope < low || slope > high) {
            break;
        }
        good = n;
        low = max_f(low, (rise - 1.0f) / periods);
        high = min_f(high, (rise + 1.0f) / periods);
    }
    return good;
}

static void push_counts(cr_velocity *v, int32_t counts) {
    v->head = (v->head + 1u) % (CR_WINDOW_MAX + 1u);
    v->counts[v->head] = counts;
    v->filled += v->filled <= CR_WINDOW_MAX ? 1u : 0u;
}

/* The samples that did not come, on the straight line between those that did, to the nearest count: within the one count
 * that the window allows anyway. */
static void bridge_gap(cr_velocity *v, int32_t counts, uint32_t periods) {
    CR_ASSERT(periods > 0u && periods <= CR_WINDOW_MAX);
    const int32_t from = v->counts[v->head];
    const int32_t rise = (int32_t)((uint32_t)counts - (uint32_t)from), n = (int32_t)periods;
    /* The whole steps apart, so that 32 bits do: a board has no division of 64. */
    const int32_t whole = rise / n, rest = rise % n, half = rise < 0 ? -n : n;
    for (int32_t i = 1; i < n; i++) {
        const int32_t part = whole * i + (2 * rest * i + half) / (2 * n);
        push_counts(v, (int32_t)((uint32_t)from + (uint32_t)part));
    }
}

float cr_velocity_step(cr_velocity *v, int32_t counts, uint32_t periods, uint32_t window) {
    CR_ASSERT(v->head <= CR_WINDOW_MAX && v->filled <= CR_WINDOW_MAX + 1u);
    if (periods > CR_WINDOW_MAX) {
        cr_velocity_reset(v); /* too long ago to say anything */
    } else if (v->filled > 0u) {
        bridge_gap(v, counts, periods);
    }
    push_counts(v, counts);
    uint32_t most = v->filled - 1u < window ? v->filled - 1u : window;
    uint32_t n = find_window(v, most < CR_WINDOW_MAX ? most : CR_WINDOW_MAX);
    if (n == 0u) {
        return 0.0f;
    }
    float centre = 0.5f * (float)n, sum = 0.0f;
    for (uint32_t i = 1u; i <= n; i++) {
        sum += ((float)i - centre) * rise_since(v, i);
    }
    return sum * 12.0f / ((float)n * (float)(n + 1u) * (float)(n + 2u));
}
