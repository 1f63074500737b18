/* QEMU plugin (plugin API 1): how often each stretch of code ran, from its first instruction to its last.
 *
 *     qemu-system-arm ... -plugin blocks.so,out=FILE
 *
 * FILE gets a line `COUNT ADDRESS...` for each: how often, and the addresses of its instructions. Stretches may overlap. Debian's QEMU has plugins
 * compiled in but ships no header: what is used is declared here. */
#include <inttypes.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef uint64_t plugin_id;
struct block;
struct instruction;
enum { INLINE_ADD = 0 };
void qemu_plugin_register_vcpu_tb_trans_cb(plugin_id id, void (*translated)(plugin_id, struct block *));
size_t qemu_plugin_tb_n_insns(const struct block *block);
struct instruction *qemu_plugin_tb_get_insn(const struct block *block, size_t i);
uint64_t qemu_plugin_insn_vaddr(const struct instruction *instruction);
void qemu_plugin_register_vcpu_tb_exec_inline(struct block *block, int op, void *counter, uint64_t add);
void qemu_plugin_register_atexit_cb(plugin_id id, void (*end)(plugin_id, void *), void *user);

#define EXPORT __attribute__((visibility("default")))
EXPORT extern int qemu_plugin_version;
int qemu_plugin_version = 1;
EXPORT int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv);

typedef struct stretch {
    struct stretch *before;
    uint64_t count, size;
    uint64_t address[];
} stretch;

static stretch *last;
static FILE *out;

static void translated(plugin_id id, struct block *block) {
    (void)id;
    const size_t size = qemu_plugin_tb_n_insns(block);
    stretch *s = calloc(1, sizeof *s + size * sizeof(uint64_t));
    if (s == NULL) {
        exit(1);
    }
    s->before = last;
    last = s;
    s->size = size;
    for (size_t i = 0; i < size; i++) {
        s->address[i] = qemu_plugin_insn_vaddr(qemu_plugin_tb_get_insn(block, i));
    }
    qemu_plugin_register_vcpu_tb_exec_inline(block, INLINE_ADD, &s->count, 1u);
}

static void finish(plugin_id id, void *user) {
    (void)id;
    (void)user;
    for (const stretch *s = last; s != NULL; s = s->before) {
        fprintf(out, "%" PRIu64, s->count);
        for (size_t i = 0; i < s->size; i++) {
            fprintf(out, " %" PRIx64, s->address[i]);
        }
        fprintf(out, "\n");
    }
    fclose(out);
}

EXPORT int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv) {
    (void)info;
    if (argc != 1 || strncmp(argv[0], "out=", 4) != 0 || (out = fopen(argv[0] + 4, "w")) == NULL) {
        fprintf(stderr, "blocks: -plugin blocks.so,out=FILE, a file that can be written\n");
        return -1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, finish, NULL);
    return 0;
}
