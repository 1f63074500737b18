/* The configuration of creased: what is read, and the one line for each thing that is wrong. And the bit rate as the kernel tells it. */
#include "can.h"
#include "device.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#define EXAMPLE "firmware/port/linux/device.toml"

static char error[DEVICE_TEXT_MAX];

static void example_is_the_default(void **state) {
    (void)state;
    device_config read;
    const device_config wanted = device_default();
    error[0] = '\0';
    const int result = device_load(EXAMPLE, &read, error);
    assert_string_equal(error, "");
    assert_int_equal(result, 0);
    const uint32_t *a = (const uint32_t *)(const void *)&read.servo, *b = (const uint32_t *)(const void *)&wanted.servo;
    for (size_t i = 0; i < sizeof read.servo / 4u; i++) {
        float x, y;
        memcpy(&x, &a[i], 4);
        memcpy(&y, &b[i], 4);
        /* The arm's stay rounded to what a person writes. */
        assert_true(a[i] == b[i] || fabsf(x - y) <= 2e-6f * fabsf(y));
    }
    assert_string_equal(read.interface, wanted.interface);
    assert_true(read.bitrate == wanted.bitrate && read.deadline_us == wanted.deadline_us &&
                read.priority == wanted.priority);
}

static void values_arrive_in_their_units(void **state) {
    (void)state;
    device_config d;
    const char *text =
        "\xef\xbb\xbf# first\n[bus]\ninterface = \"vcan7\" # a comment\n\n[fore]\r\nmin_deg = -90 \n rated_Nm=2.5\n"
        "[arm]\nbase_position_m = [1, -2.5, 3e-1]\n[control]\nramp_ms = 50\nwindow = 8\n";
    assert_int_equal(device_parse("d", text, &d, error), 0);
    assert_string_equal(d.interface, "vcan7");
    assert_true(fabsf(d.servo.arm.joint_min[2] + 1.5707963f) < 1e-6f && d.servo.axis[2].rated == 2.5f);
    assert_true(d.servo.arm.world_from_base.pos_m.y == -2.5f && d.servo.control.ramp_s == 0.05f);
    assert_int_equal(d.servo.control.window, 8);
}

static void every_mistake_has_its_line(void **state) {
    (void)state;
    static const struct {
        const char *text, *says;
    } table[] = {
        {"[bus]\nspeed = 1\n", "d:2: unknown key 'speed' in [bus]"},
        {"[wrist]\nfixed_deg = [0, 0, 0]\n", "d:2: unknown key 'fixed_deg' in [wrist]"},
        {"[bus]\ntorque_timeout_ms = 2000\n", "torque_timeout_ms = 2000 is out of range"},
        {"[guide]\nstuck_N = 1.5\n", "stuck: 0, or from twice coulomb"},
        {"[loop]\nstuck_ticks = 0\n", "stuck_ticks = 0 is out of range"},
        {"[buss]\n", "d:1: unknown table [buss]"},
        {"[bus\n", "d:1: '[bus' is no table"},
        {"window = 3\n", "d:1: key 'window' stands before the first [table]"},
        {"[control]\nwindow = 3\nwindow = 4\n", "d:3: window is given twice"},
        {"[control]\nwindow = 3.5\n", "d:2: window = 3.5 is not a whole number"},
        {"[control]\nwindow = 99\n", "d:2: window = 99 is out of range; 2 to 32 is allowed"},
        {"[arm]\nupper_mm = 450\n", "its unit is another: write upper_m"},
        {"[upper]\nrated_N = 3\n", "its unit is another: write rated_Nm"},
        {"[guide]\nrated_Nm = 3\n", "its unit is another: write rated_N"},
        {"[bus]\nwindow = 3\n", "it belongs to [control]"},
        {"[arm]\nupper_m = 45\n", "d:2: upper_m = 45 is out of range"},
        {"[arm]\nupper_m = nan\n", "is not a number"},
        {"[arm]\nupper_m = inf\n", "is not a number"},
        {"[arm]\nupper_m = 1e999\n", "is not a number"},
        {"[arm]\nupper_m =\n", "is not a number"},
        {"[arm]\nupper_m = 0.4 m\n", "'m' stands after the value"},
        {"[arm]\nupper_m = 450 mm\n", "'mm' stands after the value"},
        {"[loop]\nperiod_us = 1_000\n", "'_000' stands after the value"},
        {"[arm]\nbase_position_m = 1\n", "needs 3 numbers"},
        {"[arm]\nbase_position_m = [1, 2]\n", "needs 3 numbers"},
        {"[arm]\nbase_position_m = [1, 2, 3, 4]\n", "needs 3 numbers"},
        {"[arm]\nbase_quaternion = [1, 1, 0, 0]\n", "a unit quaternion"},
        {"[bus]\ninterface = can0\n", "must be a text in quotes"},
        {"[bus]\ninterface = \"\"\n", "must be a text in quotes"},
        {"[bus]\ninterface = \"a-name-longer-than-any\"\n", "at most 15 letters"},
        {"[bus]\nbitrate_bit_s = 500000\n", "bitrate_bit_s = 500000: only 1000000 is possible"},
        {"[bus]\nheartbeat_ms = 200\n", "above heartbeat_ms"},
        {"[loop]\ndeadline_us = 1000\n", "deadline_us: below period_us"},
        {"[loop]\noverrun_us = 5000\n", "overrun_s: one to two periods"},
        {"[guide]\nmin_m = 1\n", "joint_min, joint_max"},
        {"nonsense\n", "d:1: 'nonsense' is neither [table] nor key = value"},
        {"= 3\n", "is neither"},
    };
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        device_config d;
        memset(&d, 0x5a, sizeof d);
        const device_config before = d;
        error[0] = '\0';
        const int result = device_parse("d", table[i].text, &d, error);
        if (result == 0 || strstr(error, table[i].says) == NULL) {
            print_error("'%s' gave '%s', not '%s'\n", table[i].text, error, table[i].says);
        }
        assert_true(result != 0 && strstr(error, table[i].says) != NULL && strchr(error, '\n') == NULL);
        assert_memory_equal(&d, &before, sizeof d);
    }
}

/* The example with single bytes changed: refused with a line or read as a valid configuration, never anything else. */
static void damaged_text_is_refused_or_valid(void **state) {
    (void)state;
    static char good[16384], text[16384];
    FILE *file = fopen(EXAMPLE, "rb");
    assert_non_null(file);
    const size_t size = fread(good, 1, sizeof good - 1u, file);
    fclose(file);
    uint32_t seed = 3u;
    for (int n = 0; n < 20000; n++) {
        memcpy(text, good, size + 1u);
        for (int k = 0; k < 1 + n % 3; k++) {
            seed = seed * 1664525u + 1013904223u;
            text[(seed >> 8) % size] = (char)(1u + seed % 255u);
        }
        device_config d;
        error[0] = '\0';
        if (device_parse("d", text, &d, error) == 0) {
            assert_null(cr_servo_config_error(&d.servo));
        } else {
            assert_true(strlen(error) > 5u);
        }
    }
}

static void missing_file_is_told(void **state) {
    (void)state;
    device_config d;
    assert_int_equal(device_load("/no/such/device.toml", &d, error), -1);
    assert_non_null(strstr(error, "/no/such/device.toml: cannot be read"));
}

static void missing_interface_is_told(void **state) {
    (void)state;
    can_port port;
    char text[CAN_TEXT_MAX];
    assert_int_equal(can_open(&port, "nocan9", 1000000u, text), -1);
    assert_true(strncmp(text, "nocan9: ", 8) == 0 && strchr(text, '\n') == NULL && port.fd == -1);
    assert_int_equal(can_open(&port, "nocan-sixteen-ab", 1000000u, text), -1);
    assert_string_equal(text, "nocan-sixteen-ab: no such interface: a name has at most 15 letters");
    assert_int_equal(port.fd, -1);
}

/* RTM_NEWLINK of a can interface, by hand: header 16, ifinfomsg 16, then nested attributes. */
static size_t make_link_message(uint8_t *m, uint32_t bitrate) {
    static const uint8_t head[] = {36, 0, 18, 0};                 /* IFLA_LINKINFO */
    static const uint8_t kind[] = {8, 0, 1, 0, 'c', 'a', 'n', 0}; /* IFLA_INFO_KIND */
    size_t at = 32;
    memset(m, 0, 256);
    const uint8_t name[] = {9, 0, 3, 0, 'c', 'a', 'n', '0', 0, 0, 0, 0}; /* IFLA_IFNAME, padded */
    memcpy(m + at, name, sizeof name);
    at += sizeof name;
    memcpy(m + at, head, sizeof head);
    m[at] = (uint8_t)(4 + 8 + 4 + 4 + 32);
    at += 4;
    memcpy(m + at, kind, sizeof kind);
    at += sizeof kind;
    m[at] = 4 + 4 + 32; /* IFLA_INFO_DATA */
    m[at + 2] = 2;
    m[at + 4] = 4 + 32; /* IFLA_CAN_BITTIMING: 8 words, the first is the rate */
    m[at + 6] = 1;
    for (int i = 0; i < 4; i++) {
        m[at + 8 + (size_t)i] = (uint8_t)(bitrate >> 8 * i);
    }
    return at + 8 + 32;
}

static void bitrate_is_found_in_the_kernels_answer(void **state) {
    (void)state;
    uint8_t message[256];
    const size_t size = make_link_message(message, 500000u);
    assert_int_equal(can_bitrate_of(message, size), 500000);
    for (size_t shorter = 0; shorter < size; shorter++) {
        assert_int_equal(can_bitrate_of(message, shorter), 0);
    }
    message[32] = 0; /* an attribute of no length */
    assert_int_equal(can_bitrate_of(message, size), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(example_is_the_default),
        cmocka_unit_test(values_arrive_in_their_units),
        cmocka_unit_test(every_mistake_has_its_line),
        cmocka_unit_test(damaged_text_is_refused_or_valid),
        cmocka_unit_test(missing_file_is_told),
        cmocka_unit_test(missing_interface_is_told),
        cmocka_unit_test(bitrate_is_found_in_the_kernels_answer),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
