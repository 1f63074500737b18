/* device: a table of keys. */
#include "device.h"

#include "toml.h"

#include <errno.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FILE_MAX 65536
#define NUMBERS_MAX 4
#define DEG 0.017453292519943295

typedef enum { FLOATS, WHOLE, NAME } kind;

/* Key of a table. The unit is the end of the key; `scale` turns it into that of the field. */
typedef struct {
    const char *table, *key;
    kind kind;
    uint32_t count;          /* numbers; more than one: an array. Of a name: bytes, with its end */
    size_t offset;           /* into device_config */
    double scale, low, high; /* range of what is written; of a name, `low` letters at least */
} entry;

#define AT(field) offsetof(device_config, field)
#define AXIS(name, unit, torque, i, low, high, turn)                                                                   \
    {name, "min_" unit, FLOATS, 1, AT(servo.arm.joint_min[i]), turn, low, high},                                       \
        {name, "max_" unit, FLOATS, 1, AT(servo.arm.joint_max[i]), turn, low, high},                                   \
        {name, "rated_" torque, FLOATS, 1, AT(servo.axis[i].rated), 1.0, 1e-3, 1e4},                                   \
        {name, "peak_" torque, FLOATS, 1, AT(servo.axis[i].torque_max), 1.0, 1e-3, 1e4},                               \
        {name, "gravity_" torque, FLOATS, 1, AT(servo.axis[i].gravity), 1.0, -1e4, 1e4},                               \
        {name, "stuck_" torque, FLOATS, 1, AT(servo.axis[i].stuck), 1.0, 0.0, 1e4}, {                                  \
        name, "coulomb_" torque, FLOATS, 1, AT(servo.axis[i].coulomb), 1.0, 0.0, 1e4                                   \
    }
#define JOINT(name, unit, i)                                                                                           \
    {name, "step_" unit, FLOATS, 1, AT(servo.axis[i].step), 1.0, -0.01, 0.01},                                         \
        {name, "offset_" unit, FLOATS, 1, AT(servo.axis[i].offset), 1.0, -50.0, 50.0},                                 \
        {name, "jump_" unit, FLOATS, 1, AT(servo.axis[i].jump_max), 1.0, 1e-9, 10.0}, {                                \
        name, "friction_speed_" unit "_s", FLOATS, 1, AT(servo.axis[i].friction_speed), 1.0, 1e-6, 100.0               \
    }

static const entry entries[] = {
    {"bus", "interface", NAME, DEVICE_NAME_MAX, AT(interface), 1.0, 1.0, 0.0},
    {"bus", "bitrate_bit_s", WHOLE, 1, AT(bitrate), 1.0, 1000000.0, 1000000.0},
    {"bus", "heartbeat_ms", WHOLE, 1, AT(servo.bus.heartbeat_ms), 1.0, 10.0, 1000.0},
    {"bus", "host_timeout_ms", WHOLE, 1, AT(servo.bus.host_timeout_ms), 1.0, 11.0, 10000.0},
    {"bus", "drive_timeout_ms", WHOLE, 1, AT(servo.bus.drive_timeout_ms), 1.0, 11.0, 10000.0},
    {"bus", "missing_max", WHOLE, 1, AT(servo.bus.missing_max), 1.0, 0.0, 10.0},
    {"bus", "sdo_timeout_ms", WHOLE, 1, AT(servo.bus.sdo_timeout_ms), 1.0, 10.0, 10000.0},
    {"bus", "enable_timeout_ms", WHOLE, 1, AT(servo.bus.enable_timeout_ms), 1.0, 50.0, 60000.0},
    {"bus", "listen_ms", WHOLE, 1, AT(servo.bus.listen_ms), 1.0, 0.0, 10000.0},
    {"bus", "vendor_id", WHOLE, 1, AT(servo.bus.vendor_id), 1.0, 0.0, 4294967295.0},
    {"bus", "product_code", WHOLE, 1, AT(servo.bus.product_code), 1.0, 0.0, 4294967295.0},
    {"bus", "revision", WHOLE, 1, AT(servo.bus.revision), 1.0, 0.0, 4294967295.0},
    {"loop", "period_us", FLOATS, 1, AT(servo.period_s), 1e-6, 816.0, 100000.0},
    {"loop", "overrun_us", FLOATS, 1, AT(servo.overrun_s), 1e-6, 816.0, 200000.0},
    {"loop", "deadline_us", WHOLE, 1, AT(deadline_us), 1.0, 100.0, 100000.0},
    {"loop", "watchdog", NAME, DEVICE_PATH_MAX, AT(watchdog), 1.0, 0.0, 0.0},
    {"loop", "priority", WHOLE, 1, AT(priority), 1.0, 1.0, 99.0},
    {"bus", "torque_timeout_ms", WHOLE, 1, AT(servo.bus.torque_timeout_ms), 1.0, 0.0, 1000.0},
    {"loop", "stuck_travel_m", FLOATS, 1, AT(servo.stuck_travel_m), 1.0, 0.0, 1.0},
    {"loop", "stuck_ticks", WHOLE, 1, AT(servo.bus.stuck_ticks), 1.0, 1.0, 10000.0},
    {"loop", "rest_ticks", WHOLE, 1, AT(servo.bus.rest_ticks), 1.0, 0.0, 100000.0},
    AXIS("guide", "m", "N", 0, -50.0, 50.0, 1.0),
    JOINT("guide", "m", 0),
    AXIS("upper", "deg", "Nm", 1, -720.0, 720.0, DEG),
    JOINT("upper", "rad", 1),
    AXIS("fore", "deg", "Nm", 2, -720.0, 720.0, DEG),
    JOINT("fore", "rad", 2),
    {"arm", "upper_m", FLOATS, 1, AT(servo.arm.upper_m), 1.0, 0.05, 5.0},
    {"arm", "fore_m", FLOATS, 1, AT(servo.arm.fore_m), 1.0, 0.05, 5.0},
    {"arm", "elbow_min_deg", FLOATS, 1, AT(servo.arm.elbow_min_rad), DEG, 0.0, 180.0},
    {"arm", "elbow_max_deg", FLOATS, 1, AT(servo.arm.elbow_max_rad), DEG, 0.0, 180.0},
    {"arm", "margin_min", FLOATS, 1, AT(servo.arm.margin_min), 1.0, 0.0, 0.99},
    {"arm", "base_position_m", FLOATS, 3, AT(servo.arm.world_from_base.pos_m), 1.0, -100.0, 100.0},
    {"arm", "base_quaternion", FLOATS, 4, AT(servo.arm.world_from_base.rot), 1.0, -1.0, 1.0},
    {"arm", "tool_position_m", FLOATS, 3, AT(servo.arm.tip_from_tool.pos_m), 1.0, -100.0, 100.0},
    {"arm", "tool_quaternion", FLOATS, 4, AT(servo.arm.tip_from_tool.rot), 1.0, -1.0, 1.0},
    {"wrist", "step_deg", FLOATS, 1, AT(servo.wrist_step_rad), DEG, 1e-4, 5.0},
    {"wrist", "min_deg", FLOATS, 3, AT(servo.arm.wrist_min_rad), DEG, -360.0, 360.0},
    {"wrist", "max_deg", FLOATS, 3, AT(servo.arm.wrist_max_rad), DEG, -360.0, 360.0},
    {"contact", "stiffness_N_m", FLOATS, 1, AT(servo.world.stiffness_N_m), 1.0, 0.0, 1e6},
    {"contact", "damping_Ns_m", FLOATS, 1, AT(servo.control.contact_damping_Ns_m), 1.0, 0.0, 1000.0},
    {"contact", "late_max_ticks", WHOLE, 1, AT(servo.late_max_ticks), 1.0, 0.0, CR_LATE_MAX},
    {"contact", "lookups_max", WHOLE, 1, AT(servo.world.lookups_max), 1.0, 32.0, 1048576.0},
    {"control", "free_damping_Ns_m", FLOATS, 1, AT(servo.control.free_damping_Ns_m), 1.0, 0.0, 1000.0},
    {"control", "friction_share", FLOATS, 1, AT(servo.control.friction_share), 1.0, 0.0, 0.95},
    {"control", "force_max_N", FLOATS, 1, AT(servo.control.force_max_N), 1.0, 0.01, 1000.0},
    {"control", "force_rate_max_N_s", FLOATS, 1, AT(servo.control.force_rate_max_N_s), 1.0, 1.0, 1e6},
    {"control", "power_max_W", FLOATS, 1, AT(servo.control.power_max_W), 1.0, 0.01, 1e4},
    {"control", "speed_max_m_s", FLOATS, 1, AT(servo.control.speed_max_m_s), 1.0, 0.01, 100.0},
    {"control", "passivity_damping_max_Ns_m", FLOATS, 1, AT(servo.control.passivity_damping_max_Ns_m), 1.0, 0.0,
     1000.0},
    {"control", "own_damping_Ns_m", FLOATS, 1, AT(servo.control.own_damping_Ns_m), 1.0, 0.0, 1000.0},
    {"control", "ramp_ms", FLOATS, 1, AT(servo.control.ramp_s), 1e-3, 0.0, 10000.0},
    {"control", "window", WHOLE, 1, AT(servo.control.window), 1.0, 2.0, CR_WINDOW_MAX},
};
#define ENTRY_COUNT (sizeof entries / sizeof *entries)

device_config device_default(void) {
    device_config d;
    memset(&d, 0, sizeof d);
    d.servo = cr_servo_config_default();
    d.servo.late_max_ticks = 50u;
    memcpy(d.interface, "can0", sizeof "can0");
    d.bitrate = 1000000u;
    d.deadline_us = 700u;
    d.priority = 80u;
    return d;
}

/* ------------------------------------------------------------------------------------------------------- reading */

typedef struct {
    const char *name;
    int line;
    const char *table;                            /* of entries; null before the first one */
    uint8_t seen[ENTRY_COUNT], open[ENTRY_COUNT]; /* 1: given; its table was */
    device_config *device;
    char *error;
} reader;

__attribute__((format(printf, 2, 3))) static int fail(reader *r, const char *format, ...) {
    int used = snprintf(r->error, DEVICE_TEXT_MAX, "%s:%d: ", r->name, r->line);
    size_t at = used < 0 ? 0u : (size_t)used < DEVICE_TEXT_MAX ? (size_t)used : DEVICE_TEXT_MAX - 1u;
    va_list list;
    va_start(list, format);
    /* NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): it is, a line above */
    vsnprintf(r->error + at, DEVICE_TEXT_MAX - at, format, list);
    va_end(list);
    return -1;
}

/* What the key may have meant: the same word with another unit, or in another table. */
static const char *near_key(const char *table, const char *key, char *text, size_t size) {
    const char *unit = strrchr(key, '_');
    size_t stem = unit != NULL ? (size_t)(unit - key) : strlen(key);
    for (size_t i = 0; i < ENTRY_COUNT; i++) {
        const char *other = entries[i].key, *its = strrchr(other, '_');
        if (strcmp(entries[i].table, table) == 0 && strncmp(other, key, stem) == 0 &&
            (other[stem] == '\0' || its == other + stem)) {
            snprintf(text, size, "its unit is another: write %s", other);
            return text;
        }
    }
    for (size_t i = 0; i < ENTRY_COUNT; i++) {
        if (strcmp(entries[i].key, key) == 0) {
            snprintf(text, size, "it belongs to [%s]", entries[i].table);
            return text;
        }
    }
    return "see device.toml of the port for all keys";
}

static int read_table(reader *r, const char *name) {
    r->table = NULL;
    for (size_t i = 0; i < ENTRY_COUNT; i++) {
        if (strcmp(entries[i].table, name) == 0) {
            if (r->open[i]) {
                return fail(r, "table [%s] is given twice", name);
            }
            r->open[i] = 1u;
            r->table = entries[i].table;
        }
    }
    if (r->table != NULL) {
        return 0;
    }
    return fail(r, "unknown table [%s]; known are bus, loop, guide, upper, fore, arm, wrist, contact, control", name);
}

static int read_name(reader *r, const entry *e, char *value) {
    const char *text = toml_text(value);
    if (text == NULL || strlen(text) < (size_t)e->low) {
        return fail(r, "%s must be a text in quotes", e->key);
    }
    if (strlen(text) >= e->count) {
        return fail(r, "%s has at most %u letters", e->key, (unsigned)e->count - 1u);
    }
    memcpy((char *)r->device + e->offset, text, strlen(text) + 1u);
    return 0;
}

static int read_number(reader *r, const entry *e, char **at, double *out) {
    if (toml_number(at, out) != 0) {
        return fail(r, "%s: '%s' is not a number", e->key, *at);
    }
    if (e->count == 1u && **at != '\0') {
        return fail(r, "%s: '%s' stands after the value", e->key, *at);
    }
    if (e->low == e->high && *out != e->low) {
        return fail(r, "%s = %.9g: only %.9g is possible", e->key, *out, e->low);
    }
    if (!(*out >= e->low && *out <= e->high)) {
        return fail(r, "%s = %g is out of range; %g to %g is allowed", e->key, *out, e->low, e->high);
    }
    if (e->kind == WHOLE && *out != (double)(uint32_t)*out) {
        return fail(r, "%s = %g is not a whole number", e->key, *out);
    }
    return 0;
}

static void store(reader *r, const entry *e, uint32_t index, double value) {
    char *to = (char *)r->device + e->offset + (size_t)4u * index;
    float number = (float)(value * e->scale);
    uint32_t whole = e->kind == WHOLE ? (uint32_t)value : 0u;
    memcpy(to, e->kind == WHOLE ? (const void *)&whole : (const void *)&number, 4u);
}

static int read_numbers(reader *r, const entry *e, char *value) {
    char *at = value;
    double numbers[NUMBERS_MAX];
    if (e->count > 1u && *at++ != '[') {
        return fail(r, "%s needs %u numbers: [a, b, ...]", e->key, (unsigned)e->count);
    }
    for (uint32_t i = 0; i < e->count; i++) {
        if (read_number(r, e, &at, &numbers[i]) != 0) {
            return -1;
        }
        char want = i + 1u < e->count ? ',' : ']';
        if (e->count > 1u && *at++ != want) {
            return fail(r, "%s needs %u numbers: [a, b, ...]", e->key, (unsigned)e->count);
        }
    }
    if (*at != '\0') {
        return fail(r, "%s: '%s' stands after the value", e->key, at);
    }
    for (uint32_t i = 0; i < e->count; i++) {
        store(r, e, i, numbers[i]);
    }
    return 0;
}

static int read_pair(reader *r, const char *key, char *value) {
    char text[128];
    if (r->table == NULL) {
        return fail(r, "key '%s' stands before the first [table]", key);
    }
    for (size_t i = 0; i < ENTRY_COUNT; i++) {
        const entry *e = &entries[i];
        if (strcmp(e->table, r->table) != 0 || strcmp(e->key, key) != 0) {
            continue;
        }
        if (r->seen[i]) {
            return fail(r, "%s is given twice", key);
        }
        r->seen[i] = 1u;
        return e->kind == NAME ? read_name(r, e, value) : read_numbers(r, e, value);
    }
    return fail(r, "unknown key '%s' in [%s]; %s", key, r->table, near_key(r->table, key, text, sizeof text));
}

static int read_line(reader *r, toml_kind what, const char *name, char *value) {
    if (what == TOML_TABLE) {
        return read_table(r, name);
    }
    if (what == TOML_PAIR) {
        return read_pair(r, name, value);
    }
    return name[0] == '[' ? fail(r, "'%s' is no table; write [name]", name)
                          : fail(r, "'%s' is neither [table] nor key = value", name);
}

int device_parse(const char *name, const char *text, device_config *device, char error[DEVICE_TEXT_MAX]) {
    device_config read = device_default();
    reader r = {name, 0, NULL, {0}, {0}, &read, error};
    static const char mark[] = "\xef\xbb\xbf"; /* that some editors put before UTF-8 */
    toml_reader lines = {.at = strncmp(text, mark, sizeof mark - 1u) == 0 ? text + sizeof mark - 1u : text};
    char *key, *value;
    for (toml_kind what; (what = toml_next(&lines, &key, &value)) != TOML_END;) {
        r.line = lines.line;
        if (lines.wrong != NULL) {
            return fail(&r, "the line is %s", lines.wrong);
        }
        if (read_line(&r, what, key, value) != 0) {
            return -1;
        }
    }
    const char *wrong = cr_servo_config_error(&read.servo);
    if (wrong == NULL && (float)read.deadline_us * 1e-6f >= read.servo.period_s) {
        wrong = "deadline_us: below period_us";
    }
    if (wrong != NULL) {
        snprintf(error, DEVICE_TEXT_MAX, "%s: %s", name, wrong);
        return -1;
    }
    *device = read;
    return 0;
}

int device_load(const char *path, device_config *device, char error[DEVICE_TEXT_MAX]) {
    static char text[FILE_MAX];
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        snprintf(error, DEVICE_TEXT_MAX, "%s: cannot be read: %s", path, strerror(errno));
        return -1;
    }
    size_t got = fread(text, 1, sizeof text - 1u, file);
    int whole = feof(file) && !ferror(file);
    (void)fclose(file); /* read only: nothing is lost */
    text[got] = '\0';
    if (!whole || strlen(text) != got) {
        snprintf(error, DEVICE_TEXT_MAX, "%s: is not a text of at most %d bytes", path, FILE_MAX - 1);
        return -1;
    }
    return device_parse(path, text, device, error);
}
