#include "csv.h"

#include <stdio.h>
#include <stdlib.h>

/* Fewest digits first: most numbers of a table are short (zeros, steps of the clock), so the retry is rare. */
static size_t format_double(char *text, double value) {
    int n = snprintf(text, CR_CSV_CELL_MAX, "%.15g", value);
    if (strtod(text, NULL) != value) {
        n = snprintf(text, CR_CSV_CELL_MAX, "%.17g", value);
    }
    return (size_t)n;
}

static size_t format_float(char *text, double value) {
    int n = snprintf(text, CR_CSV_CELL_MAX, "%.7g", value);
    if (strtof(text, NULL) != (float)value) {
        n = snprintf(text, CR_CSV_CELL_MAX, "%.9g", value);
    }
    return (size_t)n;
}

static size_t format_cell(char *text, double value, uint8_t kind) {
    if (value == 0.0) {
        text[0] = '0';
        return 1;
    }
    if (kind == CR_CSV_INT) {
        return (size_t)snprintf(text, CR_CSV_CELL_MAX, "%.0f", value); /* a cast could overflow: uint64 columns */
    }
    return kind == CR_CSV_FLOAT32 ? format_float(text, value) : format_double(text, value);
}

size_t cr_csv_format(const double *table, size_t row_count, size_t column_count, const uint8_t *kinds, char *text,
                     size_t text_bytes) {
    if (text_bytes < row_count * column_count * CR_CSV_CELL_MAX) {
        return 0;
    }
    size_t used = 0;
    for (size_t i = 0; i < row_count; i++) {
        for (size_t j = 0; j < column_count; j++) {
            used += format_cell(text + used, table[i * column_count + j], kinds[j]);
            text[used++] = j + 1 < column_count ? ',' : '\n';
        }
    }
    return used;
}
