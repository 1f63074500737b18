/* What the QEMU plugins of this folder share. Debian's QEMU has plugins (API 1) compiled in but ships no header: what is used is declared here. Each
 * plugin is one C file that includes this once. */
#ifndef DEVICE_PLUGIN_H
#define DEVICE_PLUGIN_H

#include <inttypes.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef uint64_t plugin_id;
struct block;
struct instruction;
enum { NO_REGISTERS = 0, INLINE_ADD = 0 };
void qemu_plugin_register_vcpu_tb_trans_cb(plugin_id id, void (*translated)(plugin_id, struct block *));
size_t qemu_plugin_tb_n_insns(const struct block *block);
struct instruction *qemu_plugin_tb_get_insn(const struct block *block, size_t i);
const char *qemu_plugin_insn_symbol(const struct instruction *instruction);
uint64_t qemu_plugin_insn_vaddr(const struct instruction *instruction);
void qemu_plugin_register_vcpu_tb_exec_cb(struct block *block, void (*run)(unsigned, void *), int flags, void *user);
void qemu_plugin_register_vcpu_tb_exec_inline(struct block *block, int op, void *counter, uint64_t add);
void qemu_plugin_register_atexit_cb(plugin_id id, void (*end)(plugin_id, void *), void *user);

#define EXPORT __attribute__((visibility("default")))
EXPORT extern int qemu_plugin_version;
int qemu_plugin_version = 1;
EXPORT int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv);

/* The file of the only argument, out=FILE.   Output  null, and said why, when there is none. */
static FILE *plugin_open(int argc, char **argv) {
    FILE *out = argc == 1 && strncmp(argv[0], "out=", 4) == 0 ? fopen(argv[0] + 4, "w") : NULL;
    if (out == NULL) {
        fprintf(stderr, "error: -plugin PLUGIN.so,out=FILE: a file that can be written is asked for\n");
    }
    return out;
}

#endif
