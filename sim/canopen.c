/* CiA 301, section numbers of version 4.2.0. */
#include "canopen.h"

#include "dictionary.h"

#include <string.h>

/* SDO abort codes, 7.2.4.3.17. */
enum {
    ABORT_COMMAND = 0x05040001,
    ABORT_WRITE_ONLY = 0x06010001,
    ABORT_READ_ONLY = 0x06010002,
    ABORT_NO_OBJECT = 0x06020000,
    ABORT_NOT_MAPPABLE = 0x06040041,
    ABORT_PDO_LENGTH = 0x06040042,
    ABORT_LENGTH = 0x06070010,
    ABORT_NO_SUB = 0x06090011,
    ABORT_RANGE = 0x06090030,
    ABORT_STATE = 0x08000022
};

#define COB_ID_MASK 0x1FFFFFFFu
#define COB_EXTENDED 0x20000000u
#define COB_INVALID 0x80000000u
#define SYNC_TYPE_MAX 240u
#define EVENT_TYPE_MIN 254u

uint32_t cr_frame_bits(uint32_t len) { return 55u + 10u * len; }

static int find(uint16_t index, uint8_t sub) {
    int low = 0, high = CR_OD_ENTRIES - 1;
    const uint32_t key = (uint32_t)index << 8 | sub;
    while (low <= high) {
        const int mid = (low + high) / 2;
        const uint32_t at = (uint32_t)cr_od_entries[mid].index << 8 | cr_od_entries[mid].sub;
        if (at == key) {
            return mid;
        }
        if (at < key) {
            low = mid + 1;
        } else {
            high = mid - 1;
        }
    }
    return -1;
}

static int has_index(uint16_t index) {
    for (int i = 0; i < CR_OD_ENTRIES; i++) {
        if (cr_od_entries[i].index == index) {
            return 1;
        }
    }
    return 0;
}

static int64_t widen(const cr_od_entry *entry, uint32_t raw) {
    if ((entry->flags & CR_OD_SIGNED) == 0u) {
        return (int64_t)raw;
    }
    const uint32_t sign = 1u << (entry->bits - 1u);
    return (int64_t)(raw ^ sign) - (int64_t)sign;
}

static uint32_t trim(uint32_t value, uint32_t bits) { return bits >= 32u ? value : value & ((1u << bits) - 1u); }

uint32_t cr_node_get(const cr_node *node, uint16_t index, uint8_t sub) {
    const int at = find(index, sub);
    return at < 0 ? 0u : node->value[at];
}

int32_t cr_node_get_signed(const cr_node *node, uint16_t index, uint8_t sub) {
    const int at = find(index, sub);
    return at < 0 ? 0 : (int32_t)widen(&cr_od_entries[at], node->value[at]);
}

void cr_node_set(cr_node *node, uint16_t index, uint8_t sub, uint32_t value) {
    const int at = find(index, sub);
    if (at >= 0) {
        node->value[at] = trim(value, cr_od_entries[at].bits);
    }
}

static uint32_t load_le(const uint8_t *bytes, uint32_t count) {
    uint32_t value = 0u;
    for (uint32_t i = 0; i < count; i++) {
        value |= (uint32_t)bytes[i] << (8u * i);
    }
    return value;
}

static void store_le(uint8_t *bytes, uint32_t value, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        bytes[i] = (uint8_t)(value >> (8u * i));
    }
}

static void send(cr_node *node, const cr_sim_frame *frame) {
    if (node->out_count < CR_OUTBOX_MAX) {
        node->out[node->out_count++] = *frame;
    } else {
        node->out_dropped++;
    }
}

static void send_heartbeat(cr_node *node, uint64_t now_us) {
    const cr_sim_frame frame = {.id = 0x700u + node->node, .len = 1, .data = {node->nmt}};
    send(node, &frame);
    node->heartbeat_due_us = now_us + (uint64_t)1000u * cr_node_get(node, 0x1017, 0);
}

/* ------------------------------------------------------------------------------------------------------------------------ PDO */

static uint16_t comm_of(int receive, uint32_t number) { return (uint16_t)((receive ? 0x1400u : 0x1800u) + number); }
static uint16_t map_of(int receive, uint32_t number) { return (uint16_t)((receive ? 0x1600u : 0x1A00u) + number); }

static uint32_t pdo_cob(const cr_node *node, int receive, uint32_t number) {
    return cr_node_get(node, comm_of(receive, number), 1);
}

static int pdo_valid(const cr_node *node, int receive, uint32_t number) {
    return (pdo_cob(node, receive, number) & COB_INVALID) == 0u;
}

static uint32_t pdo_type(const cr_node *node, int receive, uint32_t number) {
    return cr_node_get(node, comm_of(receive, number), 2);
}

/* Bits of a dummy object, 7.4.9.2: 0 when index is not the code of a data type. */
static uint32_t dummy_bits(uint32_t index) {
    static const uint8_t bits[8] = {0, 0, 8, 16, 32, 8, 16, 32};
    return index < 8u ? bits[index] : 0u;
}

static uint32_t pdo_length_bits(const cr_node *node, int receive, uint32_t number) {
    const uint16_t map = map_of(receive, number);
    uint32_t bits = 0u, count = cr_node_get(node, map, 0);
    for (uint32_t i = 1; i <= count; i++) {
        bits += cr_node_get(node, map, (uint8_t)i) & 0xFFu;
    }
    return bits;
}

static void write_mapped(cr_node *node, uint32_t mapping, const uint8_t *bytes) {
    const int at = find((uint16_t)(mapping >> 16), (uint8_t)(mapping >> 8));
    if (at < 0) {
        return; /* dummy */
    }
    const cr_od_entry *entry = &cr_od_entries[at];
    const uint32_t raw = load_le(bytes, entry->bits / 8u);
    const int64_t value = widen(entry, raw);
    if (value >= entry->low && value <= entry->high) {
        node->value[at] = raw;
    }
}

static void rpdo_act(cr_node *node, uint32_t number, const cr_sim_frame *frame) {
    const uint16_t map = map_of(1, number);
    const uint32_t count = cr_node_get(node, map, 0);
    uint32_t at = 0u;
    if (8u * frame->len < pdo_length_bits(node, 1, number)) {
        cr_node_emcy(node, CR_EMCY_PDO_LENGTH, 0x10u);
        return;
    }
    for (uint32_t i = 1; i <= count; i++) {
        const uint32_t mapping = cr_node_get(node, map, (uint8_t)i);
        write_mapped(node, mapping, frame->data + at);
        at += (mapping & 0xFFu) / 8u;
    }
}

static void rpdo_receive(cr_node *node, uint32_t number, const cr_sim_frame *frame, uint64_t now_us) {
    cr_rpdo *rpdo = &node->rpdo[number];
    rpdo->heard_us = now_us;
    rpdo->deadline_missed = 0;
    if (pdo_type(node, 1, number) <= SYNC_TYPE_MAX) {
        rpdo->frame = *frame;
        rpdo->pending = 1;
    } else {
        rpdo_act(node, number, frame);
    }
}

static cr_sim_frame tpdo_frame(const cr_node *node, uint32_t number) {
    const uint16_t map = map_of(0, number);
    const uint32_t count = cr_node_get(node, map, 0);
    cr_sim_frame frame = {.id = pdo_cob(node, 0, number) & 0x7FFu};
    for (uint32_t i = 1; i <= count; i++) {
        const uint32_t mapping = cr_node_get(node, map, (uint8_t)i);
        const uint32_t bytes = (mapping & 0xFFu) / 8u;
        store_le(frame.data + frame.len, cr_node_get(node, (uint16_t)(mapping >> 16), (uint8_t)(mapping >> 8)), bytes);
        frame.len = (uint8_t)(frame.len + bytes);
    }
    return frame;
}

static int same_frame(const cr_sim_frame *a, const cr_sim_frame *b) {
    return a->id == b->id && a->len == b->len && memcmp(a->data, b->data, a->len) == 0;
}

static void tpdo_send(cr_node *node, uint32_t number, const cr_sim_frame *frame, uint64_t now_us) {
    cr_tpdo *tpdo = &node->tpdo[number];
    tpdo->last = *frame;
    tpdo->sent = 1;
    tpdo->sent_us = now_us;
    send(node, frame);
}

/* Event-driven TPDO: on a change, no sooner than the inhibit time, and at least every event time. */
static void tpdo_event(cr_node *node, uint32_t number, uint64_t now_us) {
    const cr_tpdo *tpdo = &node->tpdo[number];
    const cr_sim_frame frame = tpdo_frame(node, number);
    const uint64_t age_us = now_us - tpdo->sent_us;
    const uint64_t inhibit_us = 100u * (uint64_t)cr_node_get(node, comm_of(0, number), 3);
    const uint64_t event_us = 1000u * (uint64_t)cr_node_get(node, comm_of(0, number), 5);
    const int due = event_us > 0u && age_us >= event_us;
    const int news = tpdo->sent == 0 || same_frame(&frame, &tpdo->last) == 0;
    if (tpdo->sent == 0 || due || (news && age_us >= inhibit_us)) {
        tpdo_send(node, number, &frame, now_us);
    }
}

static void tpdo_sync(cr_node *node, uint32_t number, uint64_t now_us) {
    cr_tpdo *tpdo = &node->tpdo[number];
    const uint32_t type = pdo_type(node, 0, number);
    const cr_sim_frame frame = tpdo_frame(node, number);
    if (type == 0u) {
        if (tpdo->sent == 0 || same_frame(&frame, &tpdo->last) == 0) {
            tpdo_send(node, number, &frame, now_us);
        }
    } else if (++tpdo->sync_count >= type) {
        tpdo->sync_count = 0;
        tpdo_send(node, number, &frame, now_us);
    }
}

void cr_node_sync(cr_node *node, uint64_t now_us) {
    if (node->nmt != CR_NMT_OPERATIONAL) {
        return;
    }
    for (uint32_t i = 0; i < CR_PDOS; i++) {
        if (pdo_valid(node, 0, i) && pdo_type(node, 0, i) <= SYNC_TYPE_MAX) {
            tpdo_sync(node, i, now_us);
        }
    }
    for (uint32_t i = 0; i < CR_PDOS; i++) {
        if (node->rpdo[i].pending) {
            node->rpdo[i].pending = 0;
            rpdo_act(node, i, &node->rpdo[i].frame);
        }
    }
}

/* ------------------------------------------------------------------------------------------------------------------------ SDO */

static void sdo_reply(cr_node *node, uint8_t command, const uint8_t *multiplexor, uint32_t value) {
    cr_sim_frame frame = {.id = 0x580u + node->node, .len = 8, .data = {command}};
    memcpy(frame.data + 1, multiplexor, 3);
    store_le(frame.data + 4, value, 4);
    send(node, &frame);
}

/* Identifiers that no PDO, EMCY or SYNC may take, 7.3.5. */
static int restricted(uint32_t id) {
    return id < 0x080u || (id > 0x100u && id <= 0x180u) || (id > 0x580u && id < 0x600u) ||
           (id > 0x600u && id < 0x680u) || id >= 0x6E0u;
}

/* An identifier may only change while its object is switched off (bit 31), 7.5.2.15 and 7.5.2.35. */
static uint32_t check_cob(uint32_t old, uint32_t value) {
    if ((value & COB_EXTENDED) != 0u || (value & COB_ID_MASK) > 0x7FFu || restricted(value & 0x7FFu)) {
        return ABORT_RANGE;
    }
    const int both_valid = ((old | value) & COB_INVALID) == 0u;
    return both_valid && (old & COB_ID_MASK) != (value & COB_ID_MASK) ? ABORT_RANGE : 0u;
}

static uint32_t check_mapping_entry(int receive, uint32_t mapping) {
    const uint32_t index = mapping >> 16, bits = mapping & 0xFFu;
    if (receive && dummy_bits(index) != 0u) {
        return dummy_bits(index) == bits ? 0u : ABORT_NOT_MAPPABLE;
    }
    const int at = find((uint16_t)index, (uint8_t)(mapping >> 8));
    if (at < 0) {
        return ABORT_NO_OBJECT;
    }
    const uint32_t need = receive ? CR_OD_RPDO : CR_OD_TPDO;
    return (cr_od_entries[at].flags & need) != 0u && cr_od_entries[at].bits == bits ? 0u : ABORT_NOT_MAPPABLE;
}

static uint32_t check_mapping(const cr_node *node, uint16_t index, uint8_t sub, uint32_t value) {
    const int receive = index < 0x1800u;
    const uint32_t number = index & 0x1FFu;
    uint32_t bits = 0u;
    if (pdo_valid(node, receive, number)) {
        return ABORT_STATE;
    }
    if (sub != 0u) {
        return cr_node_get(node, index, 0) == 0u ? check_mapping_entry(receive, value) : ABORT_STATE;
    }
    for (uint32_t i = 1; i <= value; i++) {
        const uint32_t mapping = cr_node_get(node, index, (uint8_t)i);
        if (check_mapping_entry(receive, mapping) != 0u) {
            return ABORT_NOT_MAPPABLE;
        }
        bits += mapping & 0xFFu;
    }
    return bits > 64u ? ABORT_PDO_LENGTH : 0u;
}

static uint32_t check_comm(const cr_node *node, uint16_t index, uint8_t sub, uint32_t value) {
    if (sub == 1u) {
        return check_cob(cr_node_get(node, index, 1), value);
    }
    if (sub == 2u) {
        return value > SYNC_TYPE_MAX && value < EVENT_TYPE_MIN ? ABORT_RANGE : 0u;
    }
    return sub == 3u && pdo_valid(node, index < 0x1800u, index & 0x1FFu) ? ABORT_STATE : 0u;
}

static uint32_t check_write(const cr_node *node, const cr_od_entry *entry, uint32_t value) {
    const int64_t wide = widen(entry, value);
    const uint32_t group = entry->index & 0xFE00u;
    if (wide < entry->low || wide > entry->high) {
        return ABORT_RANGE;
    }
    if (entry->index == 0x1014u) {
        return check_cob(cr_node_get(node, 0x1014, 0), value);
    }
    if (entry->index == 0x6060u) {
        return wide == 0 || wide == 10 ? 0u : ABORT_RANGE;
    }
    if (group == 0x1400u || group == 0x1800u) {
        return check_comm(node, entry->index, entry->sub, value);
    }
    if (group == 0x1600u || group == 0x1A00u) {
        return check_mapping(node, entry->index, entry->sub, value);
    }
    return 0u;
}

static void after_write(cr_node *node, const cr_od_entry *entry, uint64_t now_us) {
    const uint32_t number = entry->index & 0x1FFu;
    if (entry->index == 0x1003u) {
        for (uint8_t i = 1; i <= 4u; i++) {
            cr_node_set(node, 0x1003, i, 0);
        }
    } else if (entry->index == 0x1016u) {
        node->host_watched = 0;
    } else if (entry->index == 0x1017u) {
        node->heartbeat_due_us = now_us;
    } else if ((entry->index & 0xFE00u) == 0x1400u) {
        node->rpdo[number] = (cr_rpdo){0};
    } else if ((entry->index & 0xFE00u) == 0x1800u) {
        node->tpdo[number] = (cr_tpdo){0};
    }
}

static uint32_t sdo_write(cr_node *node, int at, const cr_sim_frame *frame, uint64_t now_us) {
    const cr_od_entry *entry = &cr_od_entries[at];
    const uint8_t command = frame->data[0];
    const uint32_t bytes = entry->bits / 8u;
    if ((command & 0x02u) == 0u) {
        return ABORT_COMMAND; /* segmented: nothing here is longer than four bytes */
    }
    if ((entry->flags & CR_OD_WRITE) == 0u) {
        return ABORT_READ_ONLY;
    }
    if ((command & 0x01u) != 0u && 4u - (command >> 2 & 3u) != bytes) {
        return ABORT_LENGTH;
    }
    const uint32_t value = load_le(frame->data + 4, bytes);
    const uint32_t abort_code = check_write(node, entry, value);
    if (abort_code == 0u) {
        node->value[at] = value;
        after_write(node, entry, now_us);
    }
    return abort_code;
}

static void sdo_serve(cr_node *node, const cr_sim_frame *frame, uint64_t now_us) {
    const uint8_t *multiplexor = frame->data + 1;
    const uint16_t index = (uint16_t)load_le(multiplexor, 2);
    const uint8_t kind = frame->data[0] >> 5, sub = multiplexor[2];
    if (frame->len != 8u || kind == 4u) {
        return; /* too short to answer, or the client's own abort */
    }
    const int at = find(index, sub);
    uint32_t abort_code = 0u;
    if (kind != 1u && kind != 2u) {
        abort_code = ABORT_COMMAND;
    } else if (at < 0) {
        abort_code = has_index(index) ? ABORT_NO_SUB : ABORT_NO_OBJECT;
    } else if (kind == 1u) {
        abort_code = sdo_write(node, at, frame, now_us);
    } else if ((cr_od_entries[at].flags & CR_OD_READ) == 0u) {
        abort_code = ABORT_WRITE_ONLY;
    }
    if (abort_code != 0u) {
        sdo_reply(node, 0x80u, multiplexor, abort_code);
    } else if (kind == 1u) {
        sdo_reply(node, 0x60u, multiplexor, 0u);
    } else {
        const uint8_t unused = (uint8_t)(4u - cr_od_entries[at].bits / 8u);
        sdo_reply(node, (uint8_t)(0x43u | (unsigned)unused << 2), multiplexor, node->value[at]);
    }
}

/* ---------------------------------------------------------------------------------------------------------------- NMT and errors */

static void reset_values(cr_node *node, uint16_t from, uint16_t to) {
    for (int i = 0; i < CR_OD_ENTRIES; i++) {
        if (cr_od_entries[i].index >= from && cr_od_entries[i].index <= to) {
            node->value[i] = cr_od_entries[i].value[node->axis];
        }
    }
}

static void boot(cr_node *node, uint64_t now_us) {
    memset(node->rpdo, 0, sizeof node->rpdo);
    memset(node->tpdo, 0, sizeof node->tpdo);
    node->host_watched = 0;
    node->emcy_count = 0;
    node->emcy_free_us = 0;
    node->nmt = CR_NMT_INITIALISING;
    send_heartbeat(node, now_us);
    node->nmt = CR_NMT_PRE_OPERATIONAL;
}

void cr_node_init(cr_node *node, uint8_t axis, uint64_t now_us) {
    memset(node, 0, sizeof *node);
    node->axis = axis;
    node->node = cr_od_nodes[axis];
    reset_values(node, 0, 0xFFFF);
    boot(node, now_us);
}

static void nmt_command(cr_node *node, uint8_t command, uint64_t now_us) {
    switch (command) {
    case 0x01:
        node->nmt = CR_NMT_OPERATIONAL;
        break;
    case 0x02:
        node->nmt = CR_NMT_STOPPED;
        break;
    case 0x80:
        node->nmt = CR_NMT_PRE_OPERATIONAL;
        break;
    case 0x81:
        reset_values(node, 0, 0xFFFF);
        boot(node, now_us);
        break;
    case 0x82:
        reset_values(node, 0x1000, 0x1FFF);
        boot(node, now_us);
        break;
    default:
        break;
    }
    if (node->nmt != CR_NMT_OPERATIONAL) {
        memset(node->rpdo, 0, sizeof node->rpdo);
        memset(node->tpdo, 0, sizeof node->tpdo);
    }
}

static void emcy_flush(cr_node *node, uint64_t now_us) {
    const uint32_t cob = cr_node_get(node, 0x1014, 0);
    if (node->emcy_count == 0u || now_us < node->emcy_free_us || node->nmt == CR_NMT_STOPPED) {
        return;
    }
    if ((cob & COB_INVALID) == 0u) {
        node->emcy[0].id = cob & 0x7FFu;
        send(node, &node->emcy[0]);
    }
    node->emcy_count--;
    memmove(node->emcy, node->emcy + 1, node->emcy_count * sizeof *node->emcy);
    node->emcy_free_us = now_us + 100u * (uint64_t)cr_node_get(node, 0x1015, 0);
}

void cr_node_emcy(cr_node *node, uint16_t code, uint8_t error_register) {
    cr_sim_frame frame = {.len = 8};
    store_le(frame.data, code, 2);
    frame.data[2] = error_register;
    cr_node_set(node, 0x1001, 0, error_register);
    if (code != CR_EMCY_NONE) {
        const uint32_t count = cr_node_get(node, 0x1003, 0);
        for (uint8_t i = 4; i > 1u; i--) {
            cr_node_set(node, 0x1003, i, cr_node_get(node, 0x1003, (uint8_t)(i - 1u)));
        }
        cr_node_set(node, 0x1003, 1, code);
        cr_node_set(node, 0x1003, 0, count < 4u ? count + 1u : 4u);
    }
    if (node->emcy_count < CR_EMCY_MAX) {
        node->emcy[node->emcy_count++] = frame;
    }
}

/* -------------------------------------------------------------------------------------------------------------------- receiving */

static int receive_rpdo(cr_node *node, const cr_sim_frame *frame, uint64_t now_us) {
    int ours = 0;
    for (uint32_t i = 0; i < CR_PDOS; i++) {
        if (pdo_valid(node, 1, i) && (pdo_cob(node, 1, i) & 0x7FFu) == frame->id) {
            ours = 1;
            if (node->nmt == CR_NMT_OPERATIONAL) {
                rpdo_receive(node, i, frame, now_us);
            }
        }
    }
    return ours;
}

int cr_node_watches(const cr_node *node, uint32_t id) {
    const uint32_t watched = cr_node_get(node, 0x1016, 1) >> 16 & 0x7Fu;
    return watched != 0u && id == 0x700u + watched;
}

static int receive_heartbeat(cr_node *node, const cr_sim_frame *frame, uint64_t now_us) {
    if (!cr_node_watches(node, frame->id) || frame->len != 1u) {
        return 0;
    }
    node->host_watched = 1;
    node->host_seen_us = now_us;
    return 1;
}

int cr_node_receive(cr_node *node, const cr_sim_frame *frame, uint64_t now_us) {
    if (frame->id == 0u) {
        if (frame->len == 2u && (frame->data[1] == 0u || frame->data[1] == node->node)) {
            nmt_command(node, frame->data[0], now_us);
            return 1;
        }
        return 0;
    }
    if (frame->id == 0x600u + node->node) {
        if (node->nmt != CR_NMT_STOPPED) {
            sdo_serve(node, frame, now_us);
        }
        return 1;
    }
    return receive_heartbeat(node, frame, now_us) || receive_rpdo(node, frame, now_us);
}

static void watch_host(cr_node *node, uint64_t now_us) {
    const uint64_t limit_us = 1000u * (uint64_t)(cr_node_get(node, 0x1016, 1) & 0xFFFFu);
    if (node->host_watched && limit_us > 0u && now_us - node->host_seen_us > limit_us) {
        node->host_watched = 0;
        node->error = CR_EMCY_HEARTBEAT;
    }
}

/* The event timer of an RPDO is its deadline, 7.5.2.35: it starts with the first frame. */
static void watch_rpdo(cr_node *node, uint32_t number, uint64_t now_us) {
    cr_rpdo *rpdo = &node->rpdo[number];
    const uint64_t limit_us = 1000u * (uint64_t)cr_node_get(node, comm_of(1, number), 5);
    if (limit_us > 0u && rpdo->heard_us > 0u && !rpdo->deadline_missed && now_us - rpdo->heard_us > limit_us) {
        rpdo->deadline_missed = 1;
        node->error = CR_EMCY_RPDO_TIMEOUT;
    }
}

void cr_node_poll(cr_node *node, uint64_t now_us) {
    watch_host(node, now_us);
    for (uint32_t i = 0; i < CR_PDOS && node->nmt == CR_NMT_OPERATIONAL; i++) {
        watch_rpdo(node, i, now_us);
        if (pdo_valid(node, 0, i) && pdo_type(node, 0, i) >= EVENT_TYPE_MIN) {
            tpdo_event(node, i, now_us);
        }
    }
    if (cr_node_get(node, 0x1017, 0) > 0u && now_us >= node->heartbeat_due_us) {
        send_heartbeat(node, now_us);
    }
    emcy_flush(node, now_us);
}
