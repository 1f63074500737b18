/* One triangle and its pieces: points go in, edges are split. */
#include "cuts.h"

int32_t crx_local_of(const sheet *s, int32_t id) {
    for (int32_t i = 0; i < s->count; i++) {
        if (s->id[i] == id) {
            return i;
        }
    }
    return -1;
}

int32_t crx_add_local(sheet *s, int32_t id) {
    if (!GROW(s->id, s->count, s->id_room) || !GROW(s->at, s->count, s->at_room)) {
        return -1;
    }
    s->id[s->count] = id;
    s->at[s->count][0] = position(s->cuts, id)[s->axis[0]];
    s->at[s->count][1] = position(s->cuts, id)[s->axis[1]];
    return (int32_t)s->count++;
}

int crx_add_triangle(sheet *s, int32_t a, int32_t b, int32_t c) {
    if (!GROW(s->tri, s->tri_count, s->tri_room)) {
        return 0;
    }
    s->tri[s->tri_count][0] = a;
    s->tri[s->tri_count][1] = b;
    s->tri[s->tri_count][2] = c;
    s->tri_count++;
    return 1;
}

int crx_add_line(sheet *s, int32_t a, int32_t b, int32_t other) {
    if (!GROW(s->lines, s->line_count, s->line_room)) {
        return 0;
    }
    s->lines[s->line_count++] = (line){{a, b}, other};
    return 1;
}

int64_t crx_line_at(const sheet *s, int32_t a, int32_t b) {
    for (int64_t i = 0; s->lines != NULL && i < s->line_count; i++) {
        const int32_t *e = s->lines[i].ends;
        if ((e[0] == a && e[1] == b) || (e[0] == b && e[1] == a)) {
            return i;
        }
    }
    return -1;
}

int64_t crx_side_at(const sheet *s, int32_t a, int32_t b, int32_t *third) {
    for (int64_t t = 0; t < s->tri_count; t++) {
        for (int k = 0; k < 3; k++) {
            if (s->tri[t][k] == a && s->tri[t][(k + 1) % 3] == b) {
                *third = s->tri[t][(k + 2) % 3];
                return t;
            }
        }
    }
    return -1;
}

static void set_triangle(sheet *s, int64_t t, int32_t a, int32_t b, int32_t c) {
    s->tri[t][0] = a;
    s->tri[t][1] = b;
    s->tri[t][2] = c;
}

int crx_split_edge(sheet *s, int32_t a, int32_t b, int32_t m) {
    const int64_t on = crx_line_at(s, a, b);
    if (on >= 0 && s->lines != NULL) {
        const line whole = s->lines[on];
        s->lines[on] = (line){{whole.ends[0], m}, whole.other};
        if (!crx_add_line(s, m, whole.ends[1], whole.other)) {
            return 0;
        }
    }
    for (int back = 0; back < 2; back++) {
        const int32_t from = back ? b : a, to = back ? a : b;
        int32_t third;
        const int64_t t = crx_side_at(s, from, to, &third);
        if (t >= 0) {
            set_triangle(s, t, from, m, third);
            if (!crx_add_triangle(s, m, to, third)) {
                return 0;
            }
        }
    }
    return 1;
}

int crx_insert_inside(sheet *s, int32_t m) {
    for (int64_t t = 0; t < s->tri_count; t++) {
        const int32_t v[3] = {s->tri[t][0], s->tri[t][1], s->tri[t][2]};
        const int turn[3] = {turn_of(s, v[0], v[1], m), turn_of(s, v[1], v[2], m), turn_of(s, v[2], v[0], m)};
        if (turn[0] < 0 || turn[1] < 0 || turn[2] < 0) {
            continue;
        }
        if ((turn[0] == 0) + (turn[1] == 0) + (turn[2] == 0) > 1) {
            return 0;
        }
        for (int k = 0; k < 3; k++) {
            if (turn[k] == 0) {
                return crx_split_edge(s, v[k], v[(k + 1) % 3], m);
            }
        }
        set_triangle(s, t, v[0], v[1], m);
        return crx_add_triangle(s, v[1], v[2], m) && crx_add_triangle(s, v[2], v[0], m);
    }
    return 0;
}
