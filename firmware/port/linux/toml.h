/* The subset of TOML that a configuration needs: tables, numbers, arrays of numbers, texts without escapes, comments. What is taken is
 * taken as TOML 1.0 means it; what is not is refused, also where TOML would take it (tests/host/test_toml.py, against tomllib).
 * Written here: Debian 12 has no TOML library in C, only toml++ and toml11, which would bring a C++ runtime into the servo. */
#ifndef CREASED_TOML_H
#define CREASED_TOML_H

#include <stdint.h>

#define TOML_LINE_MAX 400

typedef enum { TOML_END, TOML_TABLE, TOML_PAIR, TOML_WRONG } toml_kind;

/* Begin with at = the text, line = 0. */
typedef struct {
    const char *at;
    int line;          /* of what toml_next gave */
    const char *wrong; /* with that line; null: it is neither table nor pair */
    char text[TOML_LINE_MAX];
} toml_reader;

/* Purpose  the next line with something on it.
 * Output   *name of a table; *name and *value of a pair, which toml_number and toml_text read; for TOML_WRONG *name is the line. They
 *          last until the next call. A table or key that comes twice is for the caller to refuse. */
toml_kind toml_next(toml_reader *reader, char **name, char **value);

/* Purpose  a number at *at, which moves behind it and the space that follows.   Output  0, or -1: none of TOML, or none of double. */
int toml_number(char **at, double *number);

/* Purpose  a text in double quotes, and nothing else.   Output  its first letter, its end cut off; or null: none. */
char *toml_text(char *value);

#endif
