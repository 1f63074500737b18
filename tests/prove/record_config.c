/* Proof    a configuration that is taken has counts that are within their arrays, and times whose nanoseconds do not overflow
 * Entry    control_error, bus_error of cr_servo_config_error, cr_config_error
 * Bounds   none: every content
 * Unwind   5 */
#include "prove.h"

#include "contact/math3.c"
#include "contact/settings.c"
#include "servo/config.c"

int main(void) {
    cr_servo_config config; /* not set: anything */
    const char *error = control_error(&config.control);
    PROVE(error != NULL || (config.control.window >= 2u && config.control.window <= CR_WINDOW_MAX));
    PROVE(error != NULL || (config.control.force_max_N >= 0.01f && config.control.force_max_N <= 1e3f));
    error = bus_error(&config.bus);
    PROVE(error != NULL || (config.bus.missing_max <= 10u && config.bus.sdo_timeout_ms <= 10000u));
    PROVE(error != NULL || (config.bus.drive_timeout_ms <= 10000u && config.bus.heartbeat_ms <= 1000u));
    error = cr_config_error(&config.world);
    PROVE(error != NULL || (config.world.response < CR_RESPONSE_COUNT && config.world.lookups_max <= 1048576u));
    return 0;
}
