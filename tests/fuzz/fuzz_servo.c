/* Every CAN frame entry of the servo: a script of frames, good and bad, of ticks in and out of time, of inputs and of settings,
 * from power-on or from the midst of contact, with contact searched for in the ticks or beside them, in time or not. Torque stays finite and within limits, or is zero; faults latch; and what was
 * recorded runs again to the bit. */
#include "fuzz.h"
#include "servo_rig.h"

#define TICKS_MAX 160u

/* What is left of the script; zeros when it is at its end. */
typedef struct {
    const uint8_t *at, *end;
} script;

static uint32_t take(script *s, int bytes) {
    uint32_t value = 0u;
    for (int k = 0; k < bytes && s->at < s->end; k++) {
        value |= (uint32_t)*s->at++ << 8 * k;
    }
    return value;
}

static float take_float(script *s) {
    const uint32_t word = take(s, 4);
    float value;
    memcpy(&value, &word, sizeof value);
    return value;
}

/* ---- where a script begins --------------------------------------------------------------------------------------- */

/* Rigs before their first tick, and in contact (bit 0), that search in the tick, and beside it (bit 1); memory as it was then. */
#define RIGS 4
static crt_servo_rig rigs[RIGS], saved[RIGS];
static uint8_t *memories[RIGS];

static void make_rigs(void) {
    for (int i = 0; i < RIGS; i++) {
        cr_servo_config config = cr_servo_config_default();
        config.world.stiffness_N_m = 800.0f;
        config.control.contact_damping_Ns_m = 2.0f;
        config.late_max_ticks = (i & 2) != 0 ? 5u : 0u;
        HOLDS(crt_servo_start(&rigs[i], &config));
        HOLDS((i & 1) == 0 || crt_servo_bring_up(&rigs[i], 1000000u, 3000u));
        rigs[i].record_count = 0u;
        saved[i] = rigs[i];
        memories[i] = malloc(rigs[i].memory_bytes);
        HOLDS(memories[i] != NULL);
        memcpy(memories[i], rigs[i].memory, rigs[i].memory_bytes);
    }
}

static crt_servo_rig *begin(int which) {
    if (memories[0] == NULL) {
        make_rigs();
    }
    rigs[which] = saved[which];
    memcpy(rigs[which].memory, memories[which], rigs[which].memory_bytes);
    return &rigs[which];
}

/* ---- the words of a script --------------------------------------------------------------------------------------- */

static void any_frame(crt_servo_rig *rig, script *s) {
    static const uint16_t ids[16] = {0x000, 0x080, 0x091, 0x181, 0x191, 0x192, 0x193, 0x211,
                                     0x591, 0x593, 0x611, 0x691, 0x701, 0x711, 0x712, 0x713};
    const uint32_t how = take(s, 1);
    cr_frame f = {how < 0xc0u ? ids[how & 15u] : (uint16_t)take(s, 2), 0u, (uint8_t)(how >> 4 & 1u), {0}};
    f.size = (uint8_t)(take(s, 1) % 10u); /* 9: none that is */
    for (int k = 0; k < 8; k++) {
        f.data[k] = (uint8_t)take(s, 1);
    }
    for (uint32_t n = 1u + ((how & 0x20u) != 0u ? take(s, 1) % 16u : 0u); n > 0u; n--) {
        cr_servo_rx(rig->servo, &f);
    }
}

/* The encoders, and sometimes the state, of one drive. */
static void move_drive(crt_servo_rig *rig, script *s) {
    const uint32_t how = take(s, 1);
    crt_drive *d = &rig->drives[how % CR_AXES];
    if ((how & 0x80u) == 0u) {
        d->counts = (int32_t)((uint32_t)d->counts + (uint32_t)(int8_t)take(s, 1));
    } else if ((how & 0x40u) == 0u) {
        d->counts = (int32_t)take(s, 4);
    } else {
        d->status = (uint16_t)take(s, 2);
    }
}

/* One number of the configuration, if the whole stays valid. */
static void set_number(crt_servo_rig *rig, script *s) {
    cr_servo_config config = rig->servo->config;
    const uint32_t words = (uint32_t)(offsetof(cr_servo_config, world) / 4u), at = take(s, 2) % words;
    const uint32_t how = take(s, 1);
    float value;
    memcpy(&value, (uint8_t *)&config + 4u * at, 4u);
    value = (how & 1u) != 0u ? take_float(s) : value * (float)take(s, 1) / 64.0f;
    memcpy((uint8_t *)&config + 4u * at, &value, 4u);
    if (cr_servo_config_error(&config) == NULL) {
        rig->servo->config = config;
    }
}

static void one_word(crt_servo_rig *rig, script *s, uint32_t word) {
    cr_tx tx;
    cr_frame turned = {0x194, 6u, 0u, {0}};
    int32_t wrist[3];
    switch (word & 15u) {
    case 0:
    case 1:
    case 2:
    case 3: /* periods as they should be */
        for (uint32_t n = word >> 4; n < 16u && rig->tick < TICKS_MAX + saved[1].tick; n += 4u) {
            crt_servo_period(rig, 1000000u);
        }
        break;
    case 4:
    case 5:
        move_drive(rig, s);
        break;
    case 6:
    case 7:
        any_frame(rig, s);
        break;
    case 8:
        crt_drives_speak(rig);
        break;
    case 9:
        rig->now_ns += (uint64_t)take(s, 2) << (word >> 4);
        cr_servo_sync(rig->servo, rig->now_ns, &tx);
        break;
    case 10: /* a tick at any time: before the SYNC, or much later */
        crt_servo_tick(rig, rig->now_ns + ((uint64_t)take(s, 2) << (word >> 4)) - 1000u, take_float(s));
        break;
    case 11:
        crt_servo_tick(rig, rig->now_ns + 300000u, 1e-3f);
        break;
    case 12:
        crt_servo_input(rig, take(s, 1));
        break;
    case 13:
        for (int k = 0; k < 3; k++) {
            wrist[k] = (int32_t)((word & 0x80u) != 0u ? take(s, 4) : (uint32_t)(int32_t)(int8_t)take(s, 1));
        }
        for (int k = 0; k < 3; k++) {
            turned.data[2 * k] = (uint8_t)((uint32_t)wrist[k] & 0xffu);
            turned.data[2 * k + 1] = (uint8_t)((uint32_t)wrist[k] >> 8 & 0xffu);
        }
        cr_servo_rx(rig->servo, &turned);
        break;
    case 14:
        set_number(rig, s);
        break;
    default:
        if ((word & 0x80u) != 0u) {
            rig->search_work = (word & 0x40u) != 0u ? CRT_SEARCH_WHOLE : take(s, 1);
        } else {
            cr_servo_rx_drops(rig->servo, take(s, 4));
        }
        break;
    }
}

/* The settings change between ticks in a script, and a recording has one of them: only scripts without are run again. */
static void run_again(int which) {
    const crt_servo_rig *rig = &rigs[which];
    static cr_record records[CRT_RECORDS_MAX];
    const uint32_t count = rig->record_count;
    cr_rerun result = {0};
    memcpy(records, rig->records, count * sizeof *records);
    crt_servo_rig *again = begin(which);
    HOLDS(cr_servo_rerun(again->servo, records, count, &result, NULL) == CR_OK);
    HOLDS(result.records == count && result.different == 0u && result.gap == 0u);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size == 0u) {
        return 0;
    }
    const int which = data[0] & (RIGS - 1);
    script s = {data + 1, data + size};
    crt_servo_rig *rig = begin(which);
    int changed = 0;
    while (s.at < s.end && rig->tick < TICKS_MAX + saved[1].tick) {
        const uint32_t word = take(&s, 1);
        changed |= (word & 15u) == 14u;
        one_word(rig, &s, word);
    }
    if (!changed) {
        run_again(which);
    }
    return 0;
}
