/* Numbers to text: any table fits its buffer, has as many cells as numbers, and reads back the same. */
#include "csv.h"
#include "fuzz.h"

#include <math.h>

#define COLUMNS_MAX 4
#define ROWS_MAX 16

static int same(double value, double back, uint8_t kind) {
    if (kind == CR_CSV_FLOAT32) {
        return (float)value == (float)back || (isnan(value) && isnan(back));
    }
    return value == back || (isnan(value) && isnan(back));
}

static void check_text(const double *table, size_t rows, size_t columns, const uint8_t *kinds, const char *text) {
    for (size_t i = 0; i < rows * columns; i++) {
        char *end;
        HOLDS(same(table[i], strtod(text, &end), kinds[i % columns]));
        HOLDS(end > text && end - text < CR_CSV_CELL_MAX && *end == (i % columns + 1u < columns ? ',' : '\n'));
        text = end + 1;
    }
    HOLDS(*text == '\0');
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    double table[ROWS_MAX * COLUMNS_MAX];
    uint8_t kinds[COLUMNS_MAX];
    if (size < 1u + COLUMNS_MAX + sizeof *table) {
        return 0;
    }
    const size_t columns = 1u + data[0] % COLUMNS_MAX;
    size_t rows = (size - 1u - COLUMNS_MAX) / (columns * sizeof *table);
    rows = rows < ROWS_MAX ? rows : ROWS_MAX;
    memcpy(table, data + 1u + COLUMNS_MAX, rows * columns * sizeof *table);
    for (size_t i = 0; i < columns; i++) {
        kinds[i] = data[1u + i] % 3u;
    }
    for (size_t i = 0; i < rows * columns; i++) {
        /* A column holds what its kind says; whole numbers as the tables have them. */
        if (kinds[i % columns] == CR_CSV_FLOAT32) {
            float single;
            memcpy(&single, &table[i], sizeof single);
            table[i] = (double)single;
        } else if (kinds[i % columns] == CR_CSV_INT) {
            uint64_t whole;
            memcpy(&whole, &table[i], sizeof whole);
            table[i] = (whole & 1u) != 0u ? (double)whole : (double)(int64_t)whole;
        }
    }
    const size_t bytes = rows * columns * CR_CSV_CELL_MAX;
    char *text = malloc(bytes + 1u);
    HOLDS(text != NULL);
    HOLDS(bytes == 0u || cr_csv_format(table, rows, columns, kinds, text, bytes - 1u) == 0u);
    const size_t used = cr_csv_format(table, rows, columns, kinds, text, bytes);
    HOLDS(used <= bytes && (rows == 0u || used > 0u));
    text[used] = '\0';
    check_text(table, rows, columns, kinds, text);
    free(text);
    return 0;
}
