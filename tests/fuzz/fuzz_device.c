/* device.toml: either a configuration that the servo takes, or one line that says what is wrong, and nothing changed. */
#include "device.h"
#include "fuzz.h"

#include <math.h>

/* Every float of the servo's configuration is finite: they lie between whole numbers, so each is looked at by name. */
static void check_numbers(const device_config *d) {
    const cr_servo_config *s = &d->servo;
    HOLDS(isfinite(s->period_s) && isfinite(s->overrun_s) && isfinite(s->wrist_step_rad));
    for (int a = 0; a < CR_AXES; a++) {
        const cr_axis_config *x = &s->axis[a];
        HOLDS(isfinite(x->step) && isfinite(x->offset) && isfinite(x->rated) && isfinite(x->torque_max));
        HOLDS(isfinite(x->jump_max) && isfinite(x->gravity) && isfinite(x->coulomb) && isfinite(x->friction_speed));
        HOLDS(isfinite(s->arm.joint_min[a]) && isfinite(s->arm.joint_max[a]));
        HOLDS(x->rated > 0.0f && x->torque_max > 0.0f && s->arm.joint_min[a] < s->arm.joint_max[a]);
    }
    HOLDS(memchr(d->interface, '\0', sizeof d->interface) != NULL && d->interface[0] != '\0');
    HOLDS((float)d->deadline_us * 1e-6f < s->period_s && d->priority >= 1u && d->priority <= 99u);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const device_config blank;
    char error[DEVICE_TEXT_MAX];
    device_config device = blank;
    char *text = malloc(size + 1u);
    HOLDS(text != NULL);
    memcpy(text, data, size);
    text[size] = '\0';
    memset(error, 0x55, sizeof error);
    if (device_parse("device.toml", text, &device, error) == 0) {
        HOLDS(cr_servo_config_error(&device.servo) == NULL);
        check_numbers(&device);
    } else {
        HOLDS(memcmp(&device, &blank, sizeof device) == 0);
        HOLDS(memchr(error, '\0', sizeof error) != NULL && strchr(error, '\n') == NULL);
        HOLDS(strncmp(error, "device.toml:", 12) == 0 && strlen(error) > 14u);
    }
    free(text);
    return 0;
}
