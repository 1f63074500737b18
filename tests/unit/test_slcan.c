/* Frames as the text of serial adapters. Expected lines are written out by hand from the LAWICEL manual. */
#include "slcan.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

static slcan in;

/* Frames that a text brings; the last of them is in *frame. */
static int feed(const char *text, cr_frame *frame) {
    int frames = 0;
    for (size_t i = 0; i < strlen(text); i++) {
        frames += slcan_read(&in, text[i], frame);
    }
    return frames;
}

static int set_up(void **state) {
    (void)state;
    in = (slcan){0};
    return 0;
}

static void frame_becomes_its_line(void **state) {
    (void)state;
    char out[SLCAN_LINE_MAX];
    const cr_frame frame = {0x191u, 8u, 0u, {0x00u, 0x12u, 0xABu, 0xCDu, 0xEFu, 0x7Fu, 0x80u, 0xFFu}};
    assert_int_equal(slcan_write(&frame, out), 22u);
    assert_memory_equal(out, "t19180012ABCDEF7F80FF\r", 22u);
}

static void sync_has_no_data(void **state) {
    (void)state;
    char out[SLCAN_LINE_MAX];
    const cr_frame frame = {0x080u, 0u, 0u, {0u}};
    assert_int_equal(slcan_write(&frame, out), 6u);
    assert_memory_equal(out, "t0800\r", 6u);
}

static void frame_that_is_none_is_not_written(void **state) {
    (void)state;
    char out[SLCAN_LINE_MAX];
    const cr_frame long_id = {0x800u, 0u, 0u, {0u}}, long_data = {0x1u, 9u, 0u, {0u}};
    assert_int_equal(slcan_write(&long_id, out), 0u);
    assert_int_equal(slcan_write(&long_data, out), 0u);
}

static void line_becomes_its_frame_in_either_case(void **state) {
    (void)state;
    static const char *const lines[] = {"t7FF3A0bC09\r", "t7ff3a0Bc09\r"};
    for (size_t i = 0; i < 2u; i++) {
        cr_frame frame;
        memset(&frame, 0xff, sizeof frame);
        assert_int_equal(feed(lines[i], &frame), 1);
        const cr_frame expected = {0x7ffu, 3u, 0u, {0xA0u, 0xBCu, 0x09u}};
        assert_memory_equal(&frame, &expected, sizeof frame);
    }
    assert_int_equal(in.refused, 0u);
}

static void frames_follow_each_other_without_loss(void **state) {
    (void)state;
    cr_frame frame;
    assert_int_equal(feed("t0800\rt19181122334455667788\rt08", &frame), 2);
    assert_int_equal(frame.id, 0x191u);
    assert_int_equal(feed("10\r", &frame), 1);
    assert_int_equal(frame.id, 0x081u);
}

static void channel_opens_and_closes(void **state) {
    (void)state;
    cr_frame frame;
    assert_int_equal(feed("C\rS8\r", &frame), 0);
    assert_int_equal(in.open, 0u);
    assert_int_equal(feed("O\r", &frame), 0);
    assert_int_equal(in.open, 1u);
    assert_int_equal(feed("t0800\rz\r\r", &frame), 1);
    assert_int_equal(in.open, 1u);
    assert_int_equal(feed("C\r", &frame), 0);
    assert_int_equal(in.open, 0u);
}

static void broken_frames_are_counted_and_passed_over(void **state) {
    (void)state;
    static const char *const lines[] = {
        "t\r",     "t191\r",    "t8000\r", "t1919112233445566778899\r",          "t1912112\r", "t191211223\r",
        "t19g0\r", "t19121g\r", "t191x\r", "t19181122334455667788112233445566\r"};
    const size_t count = sizeof lines / sizeof lines[0];
    cr_frame frame;
    for (size_t i = 0; i < count; i++) {
        assert_int_equal(feed(lines[i], &frame), 0);
        assert_int_equal(in.refused, i + 1u);
    }
    assert_int_equal(feed("t0800\r", &frame), 1);
}

static void other_kinds_of_lines_bring_nothing(void **state) {
    (void)state;
    cr_frame frame;
    assert_int_equal(feed("T000000800\rr0800\rV\rF00\rN1234\ra very long line that is no command at all\r", &frame), 0);
    assert_int_equal(in.refused, 0u);
}

static void what_is_written_reads_back(void **state) {
    (void)state;
    uint32_t seed = 1u;
    for (uint32_t i = 0; i < 2000u; i++) {
        char out[SLCAN_LINE_MAX];
        cr_frame frame = {(uint16_t)(i & 0x7ffu), (uint8_t)(i % 9u), 0u, {0u}}, back;
        for (uint32_t d = 0; d < frame.size; d++) {
            seed = seed * 1664525u + 1013904223u;
            frame.data[d] = (uint8_t)(seed >> 24);
        }
        const uint32_t size = slcan_write(&frame, out);
        for (uint32_t c = 0; c < size; c++) {
            assert_int_equal(slcan_read(&in, out[c], &back), c + 1u == size);
        }
        assert_memory_equal(&back, &frame, sizeof frame);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(frame_becomes_its_line, set_up),
        cmocka_unit_test_setup(sync_has_no_data, set_up),
        cmocka_unit_test_setup(frame_that_is_none_is_not_written, set_up),
        cmocka_unit_test_setup(line_becomes_its_frame_in_either_case, set_up),
        cmocka_unit_test_setup(frames_follow_each_other_without_loss, set_up),
        cmocka_unit_test_setup(channel_opens_and_closes, set_up),
        cmocka_unit_test_setup(broken_frames_are_counted_and_passed_over, set_up),
        cmocka_unit_test_setup(other_kinds_of_lines_bring_nothing, set_up),
        cmocka_unit_test_setup(what_is_written_reads_back, set_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
