/* Numbers to text: a table as CSV rows, each number with the fewest digits that read back the same. */
#ifndef CR_CSV_H
#define CR_CSV_H

#include <stddef.h>
#include <stdint.h>

/* What a column of doubles held before it became double: decides the digits. INT: whole numbers of at most 64 bits. */
enum { CR_CSV_INT = 0, CR_CSV_FLOAT32 = 1, CR_CSV_FLOAT64 = 2 };

/* Longest text of one number with its separator. */
#define CR_CSV_CELL_MAX 26

/* Purpose  write rows of a table as comma-separated lines ending in a line feed.
 * Shapes   table[row_count * column_count], row after row; kinds[column_count] of CR_CSV_*; text[text_bytes].
 * Output   bytes written; 0 when text_bytes < row_count * column_count * CR_CSV_CELL_MAX.
 * Cost     about 0.2 us a number. */
size_t cr_csv_format(const double *table, size_t row_count, size_t column_count, const uint8_t *kinds, char *text,
                     size_t text_bytes);

#endif
