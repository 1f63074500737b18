/* modes: what moves the servo from mode to mode, and what modes, limits and faults are called. */
#include "servo/servo_stages.h"

int cr_mode_is_rendering(uint32_t mode) { return mode == CR_MODE_RENDERING || mode == CR_MODE_LIMITED; }

static uint32_t mode_if(uint32_t events, uint32_t event, uint32_t then, uint32_t otherwise) {
    return (events & event) != 0u ? then : otherwise;
}

uint32_t cr_mode_next(uint32_t mode, uint32_t events) {
    if ((events & CR_EVENT_FAULT) != 0u) {
        return CR_MODE_FAULT;
    }
    switch (mode) {
    case CR_MODE_INIT:
        return mode_if(events, CR_EVENT_DRIVES_SEEN, CR_MODE_BUS_UP, mode);
    case CR_MODE_BUS_UP:
        return mode_if(events, CR_EVENT_DRIVES_ENABLED, CR_MODE_CALIBRATING, mode);
    case CR_MODE_CALIBRATING:
        return mode_if(events, CR_EVENT_RESTED, CR_MODE_IDLE, mode);
    case CR_MODE_IDLE:
        return mode_if(events, CR_EVENT_STOP, mode, mode_if(events, CR_EVENT_START, CR_MODE_RENDERING, mode));
    case CR_MODE_RENDERING:
    case CR_MODE_LIMITED:
        mode = mode_if(events, CR_EVENT_LIMIT, CR_MODE_LIMITED, CR_MODE_RENDERING);
        return mode_if(events, CR_EVENT_STOP, CR_MODE_IDLE, mode);
    case CR_MODE_FAULT:
        return mode_if(events, CR_EVENT_CLEAR, CR_MODE_INIT, mode);
    default:
        return CR_MODE_FAULT; /* a mode that does not exist */
    }
}

/* -------------------------------------------------------------------------------------------------------- names */

const char *cr_mode_text(uint32_t mode) {
    static const char *const names[CR_MODE_COUNT] = {"init",      "bus-up",  "calibrating", "idle",
                                                     "rendering", "limited", "fault"};
    return mode < CR_MODE_COUNT ? names[mode] : "unknown";
}

static const char *bit_text(uint32_t bit, const char *const *names, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        if (bit == 1u << i) {
            return names[i];
        }
    }
    return "unknown";
}

const char *cr_limit_text(uint32_t bit) {
    static const char *const names[CR_LIMIT_COUNT] = {"force", "rate",      "torque",    "power",
                                                      "speed", "passivity", "workspace", "stale"};
    return bit_text(bit, names, CR_LIMIT_COUNT);
}

const char *cr_servo_fault_text(uint32_t bit) {
    static const char *const names[CR_FAULT_COUNT] = {
        "silent",  "heartbeat", "reset", "drive",  "drive-state", "emcy", "jump",  "range",    "not-finite",
        "overrun", "bad-state", "alien", "babble", "bus-off",     "sdo",  "stuck", "mismatch", "late"};
    return bit_text(bit, names, CR_FAULT_COUNT);
}
