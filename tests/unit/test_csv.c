/* Numbers to text: short where that reads back the same, whole where not. */
#include "csv.h"

#include <float.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static char text[64 * CR_CSV_CELL_MAX];

static const char *one(double value, uint8_t kind) {
    const size_t used = cr_csv_format(&value, 1, 1, &kind, text, sizeof text);
    assert_true(used > 1);
    assert_int_equal(text[used - 1], '\n');
    text[used - 1] = '\0';
    return text;
}

static void csv_writes_no_needless_digits(void **state) {
    (void)state;
    assert_string_equal(one(0.1, CR_CSV_FLOAT64), "0.1");
    assert_string_equal(one((double)0.1f, CR_CSV_FLOAT32), "0.1");
    assert_string_equal(one(-0.0, CR_CSV_FLOAT32), "0");
    assert_string_equal(one(4294967295.0, CR_CSV_INT), "4294967295");
    assert_string_equal(one(-7.0, CR_CSV_INT), "-7");
    assert_string_equal(one(0x1p64, CR_CSV_INT), "18446744073709551616"); /* what the largest uint64 becomes */
}

static void csv_reads_back_to_the_bit(void **state) {
    (void)state;
    const double values[] = {1.0 / 3.0, DBL_MAX, -DBL_MIN, 5e-324, 123456789.123456789};
    for (size_t i = 0; i < sizeof values / sizeof *values; i++) {
        assert_true(strtod(one(values[i], CR_CSV_FLOAT64), NULL) == values[i]);
    }
    const float floats[] = {1.0f / 3.0f, -FLT_MAX, FLT_MIN, 1e-45f, 16777217.0f};
    for (size_t i = 0; i < sizeof floats / sizeof *floats; i++) {
        assert_true(strtof(one((double)floats[i], CR_CSV_FLOAT32), NULL) == floats[i]);
    }
}

static void csv_longest_number_fits_its_cell(void **state) {
    (void)state;
    assert_true(strlen(one(-1.2345678901234567e-300, CR_CSV_FLOAT64)) < CR_CSV_CELL_MAX);
    assert_true(strlen(one(-9007199254740992.0, CR_CSV_INT)) < CR_CSV_CELL_MAX);
}

static void csv_puts_commas_between_and_line_feeds_after(void **state) {
    (void)state;
    const double table[] = {1.0, 2.5, 3.0, 4.5};
    const uint8_t kinds[] = {CR_CSV_INT, CR_CSV_FLOAT64};
    const size_t used = cr_csv_format(table, 2, 2, kinds, text, sizeof text);
    text[used] = '\0';
    assert_string_equal(text, "1,2.5\n3,4.5\n");
}

static void csv_refuses_a_short_buffer(void **state) {
    (void)state;
    const double value = 1.0;
    const uint8_t kind = CR_CSV_FLOAT64;
    assert_int_equal(cr_csv_format(&value, 1, 1, &kind, text, CR_CSV_CELL_MAX - 1), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(csv_writes_no_needless_digits),
        cmocka_unit_test(csv_reads_back_to_the_bit),
        cmocka_unit_test(csv_longest_number_fits_its_cell),
        cmocka_unit_test(csv_puts_commas_between_and_line_feeds_after),
        cmocka_unit_test(csv_refuses_a_short_buffer),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
