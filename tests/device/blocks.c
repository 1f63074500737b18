/* QEMU plugin (plugin API 1): how often each stretch of code ran, from its first instruction to its last.
 *
 *     qemu-system-arm ... -plugin blocks.so,out=FILE
 *
 * FILE gets a line `COUNT ADDRESS...` for each: how often, and the addresses of its instructions. Stretches may overlap. */
#include "plugin.h"

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
    out = plugin_open(argc, argv);
    if (out == NULL) {
        return -1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, finish, NULL);
    return 0;
}
