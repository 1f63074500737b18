/* device.toml: the configuration of creased. */
#ifndef CREASED_DEVICE_H
#define CREASED_DEVICE_H

#include "servo.h"

#define DEVICE_NAME_MAX 16 /* IFNAMSIZ */
#define DEVICE_PATH_MAX 128
#define DEVICE_TEXT_MAX 300

typedef struct {
    cr_servo_config servo;
    char interface[DEVICE_NAME_MAX];
    uint32_t bitrate;               /* bit/s; asked of interfaces that have one */
    uint32_t deadline_us;           /* after SYNC: the tick starts then at the latest */
    uint32_t priority;              /* of SCHED_FIFO */
    char watchdog[DEVICE_PATH_MAX]; /* empty: none */
} device_config;

device_config device_default(void);

/* Purpose  read a configuration from text, in the subset of TOML of toml.h.
 *          Keys that are not given keep their default.
 * Output   0 and *device, or -1 and one line in error, `name:line: what; mend`; *device untouched then. */
int device_parse(const char *name, const char *text, device_config *device, char error[DEVICE_TEXT_MAX]);

/* Purpose  the same from a file. */
int device_load(const char *path, device_config *device, char error[DEVICE_TEXT_MAX]);

#endif
