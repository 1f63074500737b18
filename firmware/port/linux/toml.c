#include "toml.h"

#include <errno.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

static int is_space(char c) { return c == ' ' || c == '\t'; }
static int is_digit(char c) { return c >= '0' && c <= '9'; }

static char *skip_space(char *at) {
    while (is_space(*at)) {
        at++;
    }
    return at;
}

static char *skip_digits(char *at) {
    while (is_digit(*at)) {
        at++;
    }
    return at;
}

/* Bytes of the letter at s, 0: none of UTF-8, or a control character other than the tab. */
static size_t letter_size(const char *s) {
    const unsigned char *u = (const unsigned char *)s;
    if (u[0] < 0x80u) {
        return (u[0] >= 0x20u && u[0] != 0x7fu) || u[0] == '\t';
    }
    const size_t size = u[0] >= 0xc2u && u[0] <= 0xdfu   ? 2u
                        : (u[0] & 0xf0u) == 0xe0u        ? 3u
                        : u[0] >= 0xf0u && u[0] <= 0xf4u ? 4u
                                                         : 0u;
    for (size_t i = 1; i < size; i++) {
        if ((u[i] & 0xc0u) != 0x80u) {
            return 0u;
        }
    }
    const int is_long = (u[0] == 0xe0u && u[1] < 0xa0u) || (u[0] == 0xf0u && u[1] < 0x90u);
    const int is_no_letter = (u[0] == 0xedu && u[1] > 0x9fu) || (u[0] == 0xf4u && u[1] > 0x8fu);
    return is_long || is_no_letter ? 0u : size;
}

static int is_text(const char *line) {
    while (*line != '\0') {
        const size_t size = letter_size(line);
        if (size == 0u) {
            return 0;
        }
        line += size;
    }
    return 1;
}

/* Cuts trailing space and a comment outside of quotes. */
static void trim(char *line) {
    char *end = line;
    int quoted = 0;
    for (char *c = line; *c != '\0'; c++) {
        if (*c == '"') {
            quoted = !quoted;
        } else if (*c == '#' && !quoted) {
            break;
        }
        if (!is_space(*c)) {
            end = c + 1;
        }
    }
    *end = '\0';
}

/* A line into reader->text, without its end: LF, or CR LF.   Output  what is wrong with it, null: nothing. */
static const char *take_line(toml_reader *r) {
    const char *end = strchr(r->at, '\n');
    size_t length = end != NULL ? (size_t)(end - r->at) : strlen(r->at);
    const size_t whole = length + (end != NULL);
    if (end != NULL && length > 0u && end[-1] == '\r') {
        length--;
    }
    const int fits = length < sizeof r->text;
    memcpy(r->text, r->at, fits ? length : 0u);
    r->text[fits ? length : 0u] = '\0';
    r->at += whole;
    r->line++;
    return !fits ? "longer than 399 characters" : is_text(r->text) ? NULL : "not a text in UTF-8";
}

static char *bare_key_end(char *at) {
    while (is_digit(*at) || (*at >= 'a' && *at <= 'z') || (*at >= 'A' && *at <= 'Z') || *at == '_' || *at == '-') {
        at++;
    }
    return at;
}

toml_kind toml_next(toml_reader *r, char **name, char **value) {
    while (*r->at != '\0') {
        r->wrong = take_line(r);
        *name = skip_space(r->text);
        if (r->wrong != NULL) {
            return TOML_WRONG;
        }
        trim(*name);
        if (**name == '\0') {
            continue;
        }
        char *end = strchr(*name, **name == '[' ? ']' : '=');
        const int is_table = **name == '[';
        char *const key_end = bare_key_end(*name + is_table);
        if (end == NULL || key_end == *name + is_table || (is_table ? key_end : skip_space(key_end)) != end ||
            (is_table && end[1] != '\0')) {
            return TOML_WRONG;
        }
        *key_end = '\0';
        *value = skip_space(end + 1);
        *name += is_table;
        return is_table ? TOML_TABLE : TOML_PAIR;
    }
    return TOML_END;
}

/* Behind a number of TOML at s, but for underscores, binary, octal, nan and inf; s: there is none. */
static char *number_end(char *s) {
    char *at = s + (*s == '+' || *s == '-');
    if (s[0] == '0' && s[1] == 'x') {
        const size_t digits = strspn(s + 2, "0123456789abcdefABCDEF");
        return digits > 0u ? s + 2 + digits : s;
    }
    if (!is_digit(*at) || (*at == '0' && is_digit(at[1]))) {
        return s;
    }
    at = skip_digits(at);
    if (*at == '.') {
        if (!is_digit(at[1])) {
            return s;
        }
        at = skip_digits(at + 1);
    }
    if (*at == 'e' || *at == 'E') {
        at += at[1] == '+' || at[1] == '-' ? 2 : 1;
        return is_digit(*at) ? skip_digits(at) : s;
    }
    return at;
}

int toml_number(char **at, double *number) {
    char *const from = skip_space(*at), *const end = number_end(from);
    char *read;
    errno = 0;
    *number = strtod(from, &read);
    if (end == from || read != end || errno != 0) {
        return -1;
    }
    *at = skip_space(end);
    return 0;
}

char *toml_text(char *value) {
    const size_t length = strlen(value);
    if (length < 2u || value[0] != '"' || value[length - 1u] != '"' || strcspn(value + 1, "\"\\") != length - 2u) {
        return NULL;
    }
    value[length - 1u] = '\0';
    return value + 1;
}
