# Cortex-M: the library and its images for M7, M4 with FPU and M55. Included by the Makefile at the root.

APT_DEVICE := gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user

CORTEX := firmware/port/cortex-m7
ARM := arm-none-eabi-
CPU_m7 := -mcpu=cortex-m7 -mfpu=fpv5-sp-d16
CPU_m4f := -mcpu=cortex-m4 -mfpu=fpv4-sp-d16
CPU_m55 := -mcpu=cortex-m55
BOARD_m7 := mps2-an500
BOARD_m4f := mps2-an386
BOARD_m55 := mps3-an547
# Optimisation of the device images. The replay check also builds others.
LEVEL ?= -O2
CORTEX_FLAGS := -std=c11 -mthumb -mfloat-abi=hard -ffp-contract=off -fno-math-errno -fno-common -fconserve-stack \
    -ffunction-sections -fdata-sections -fstack-usage -fcallgraph-info=su -g \
    -Wall -Wextra -Wconversion -Wshadow -Wdouble-promotion -Wfloat-conversion -Wvla -Werror
CORTEX_INCLUDES := -Ifirmware -I$(CORTEX) -Itests/check
CORTEX_LINK := -nostartfiles --specs=nano.specs -Wl,--gc-sections -Wl,--fatal-warnings -L$(CORTEX)
CONTROLLER_C := $(addprefix $(CORTEX)/,startup.c controller.c stm32h743.c fdcan.c)
EMULATED_C := $(CORTEX)/startup.c $(CORTEX)/semihost.c tests/check/job.c tests/device/emulated.c
SMALL_C := $(addprefix firmware/,$(addprefix contact/,detect.c motion.c exits.c facets.c rows.c layers.c gather.c depth_along.c measure.c math3.c scene.c settings.c world.c answer.c relate.c feel.c search.c tick.c resolve.c planes.c coverage.c field.c) $(addprefix servo/,config.c modes.c sdo.c bus.c rerun.c servo.c record.c control.c velocity.c pose.c) $(addprefix couple/,descend.c round.c couple.c passivity.c points.c follow.c nearest.c turn.c))
RARELY := -fno-move-loop-invariants -fno-thread-jumps -fno-tree-dominator-opts
RARE_C := $(addprefix firmware/,$(addprefix contact/,layers.c coverage.c field.c gather.c facets.c rows.c depth_along.c scene.c search.c answer.c) $(addprefix servo/,config.c modes.c bus.c servo.c control.c pose.c))

# And passes of -Os that make one source or another larger: SOURCE=FLAG.
without = $(addprefix firmware/$(1).c=-fno-,$(2))
WITHOUT := $(call without,contact/answer,tree-forwprop) \
    $(call without,contact/coverage,schedule-insns2 tree-sink) \
    $(call without,contact/depth_along,caller-saves reorder-blocks) \
    $(call without,contact/detect,if-conversion reorder-blocks schedule-insns2) \
    $(call without,contact/exits,expensive-optimizations move-loop-invariants tree-ter) \
    $(call without,contact/facets,caller-saves optimize-sibling-calls) \
    $(call without,contact/gather,schedule-insns2 tree-forwprop tree-vrp) \
    $(call without,contact/layers,conserve-stack expensive-optimizations optimize-sibling-calls tree-tail-merge) \
    $(call without,contact/measure,schedule-insns2 ssa-phiopt tree-tail-merge) \
    $(call without,contact/motion,inline-functions-called-once) \
    $(call without,contact/planes,move-loop-invariants rerun-cse-after-loop schedule-insns2) \
    $(call without,contact/relate,conserve-stack expensive-optimizations thread-jumps) \
    $(call without,contact/resolve,inline-functions-called-once move-loop-invariants) \
    $(call without,contact/rows,expensive-optimizations if-conversion tree-ter) \
    $(call without,contact/scene,if-conversion inline-small-functions ssa-phiopt) \
    $(call without,contact/search,ivopts tree-forwprop tree-fre) \
    $(call without,servo/bus,inline-functions-called-once) \
    $(call without,servo/config,optimize-sibling-calls tree-tail-merge) \
    $(call without,servo/control,if-conversion reorder-blocks ssa-phiopt) \
    $(call without,servo/modes,if-conversion inline-functions-called-once) \
    $(call without,servo/pose,if-conversion inline-functions-called-once ivopts ssa-phiopt) \
    $(call without,servo/record,schedule-insns2) \
    $(call without,servo/rerun,expensive-optimizations) \
    $(call without,servo/sdo,code-hoisting optimize-sibling-calls) \
    $(call without,servo/servo,if-conversion reorder-blocks ssa-phiopt tree-sra) \
    $(call without,servo/velocity,inline-functions-called-once)

define CORTEX_VARIANT
build/$(1)/.flags: FORCE
	@mkdir -p $$(@D); echo '$(CPU_$(1)) $(CORTEX_FLAGS) $(LEVEL) $(SMALL_C) $(RARELY) $(RARE_C) $(WITHOUT)' | cmp -s - $$@ || echo '$(CPU_$(1)) $(CORTEX_FLAGS) $(LEVEL) $(SMALL_C) $(RARELY) $(RARE_C) $(WITHOUT)' >$$@

build/$(1)/%.o: %.c build/$(1)/.flags
	@mkdir -p $$(@D)
	@echo "$(1): $$<"
	@$(ARM)gcc $(CPU_$(1)) $(CORTEX_FLAGS) $$(LEVEL) $$(if $$(filter -Os,$$(LEVEL)),$$(patsubst $$<=%,%,$$(filter $$<=%,$(WITHOUT)))) $(CORTEX_INCLUDES) -MMD -MP -c $$< -o $$@

# Small, not fast: all but detect and near, which are dearer so. What stands between lookups takes about as long either way.
$(SMALL_C:%.c=build/$(1)/%.o): LEVEL := $(if $(filter -O2,$(LEVEL)),-Os,$(LEVEL))
# Of these, what costs little, smaller still.
$(RARE_C:%.c=build/$(1)/%.o): LEVEL := $(if $(filter -O2,$(LEVEL)),-Os $(RARELY),$(LEVEL))

build/$(1)/libcrease.a: $(patsubst %.c,build/$(1)/%.o,$(filter-out $(COUPLE_C),$(FIRMWARE_C)))
	@rm -f $$@
	@$(ARM)ar rcs $$@ $$^

build/$(1)/libcouple.a: $(COUPLE_C:%.c=build/$(1)/%.o)
	@rm -f $$@
	@$(ARM)ar rcs $$@ $$^

build/$(1)/replay.elf: $(EMULATED_C:%.c=build/$(1)/%.o) build/$(1)/libcouple.a build/$(1)/libcrease.a $(CORTEX)/$(BOARD_$(1)).ld $(CORTEX)/sections.ld
	@$(ARM)gcc $(CPU_$(1)) $(CORTEX_FLAGS) $(CORTEX_LINK) -T $(BOARD_$(1)).ld $$(filter %.o %.a,$$^) -o $$@
endef
$(foreach variant,m7 m4f m55,$(eval $(call CORTEX_VARIANT,$(variant))))

# The device: an STM32H743. SCENE is the image beside its code.
SCENE ?= build/scenes/edge90_cube.crs

build/scenes/%.crs: | build/scenes/.stamp ;

build/m7/scene.o: $(CORTEX)/scene.S $(SCENE)
	@$(ARM)gcc $(CPU_m7) -mthumb '-DSCENE_FILE="$(SCENE)"' -c $< -o $@

build/m7/controller.elf: $(CONTROLLER_C:%.c=build/m7/%.o) build/m7/scene.o build/m7/libcrease.a $(CORTEX)/stm32h743.ld $(CORTEX)/sections.ld
	@$(ARM)gcc $(CPU_m7) $(CORTEX_FLAGS) $(CORTEX_LINK) -T stm32h743.ld $(filter %.o %.a,$^) -o $@

# The same loop on the emulator's board, for hil-m7. The scene is loaded from outside.
LOOP_C := $(addprefix $(CORTEX)/,startup.c controller.c an500.c slcan.c semihost.c)

build/m7/loop.elf: $(LOOP_C:%.c=build/m7/%.o) build/m7/libcrease.a $(CORTEX)/mps2-an500.ld $(CORTEX)/sections.ld
	@$(ARM)gcc $(CPU_m7) $(CORTEX_FLAGS) $(CORTEX_LINK) -T mps2-an500.ld $(filter %.o %.a,$^) -o $@

# Not in APT: 1 GB that only the device images and their checks need.
build/.device: FORCE
	$(call APT_INSTALL,$(APT_DEVICE))

firmware-m7: build/.device build/scenes/.stamp build/m7/replay.elf build/m7/controller.elf build/m7/libcouple.a ## library and images for the Cortex-M7, with their sizes
firmware-m4f: build/.device build/m4f/replay.elf build/m4f/libcouple.a ## the same for the Cortex-M4 with FPU
firmware-m55: build/.device build/m55/replay.elf build/m55/libcouple.a ## the same for the Cortex-M55
firmware-m7 firmware-m4f firmware-m55: firmware-%:
	@$(ARM)size -t build/$*/libcrease.a build/$*/libcouple.a
	@$(ARM)size build/$*/*.elf

check-device: build/.develop build/.device build/scenes/.stamp build/meshes/six/.stamp firmware-m7 firmware-m4f firmware-m55 ## replays on emulated Cortex-M: hash, instructions, sizes against budgets; LONG=1 does more
	@cd tests/device && $(abspath $(PY)) check.py $(if $(LONG),--long)

worst: build/.develop build/.device build/scenes/.stamp firmware-m7 ## the most expensive pose of each scene on the Cortex-M7, searched for: 10 minutes; KEEP=1 keeps them
	@cd tests/device && $(abspath $(PY)) worst.py $(if $(QUICK),--seconds 1 --scene edge90_cube) $(if $(KEEP),--write)

wcet: build/.develop build/.device build/scenes/.stamp firmware-m7 ## the most instructions of a tick on the Cortex-M7, derived from the object code: 3 minutes
	@$(PY) -m pytest -c host/pyproject.toml --rootdir . -q tests/device/wcet_of_code.py
	@cd tests/device && $(abspath $(PY)) wcet.py $(if $(QUICK),--quick)

# In User-Mode Linux also where this kernel has vcan0: only there the time is virtual.
hil-m7: build/.develop build/.device build/scenes/.stamp build/m7/loop.elf ## the whole loop on an emulated Cortex-M7, over CAN, with the simulated drives: two minutes; SHIFT=5: a core of 120 MHz
	@tests/hil/lab/build-kernel
	$(PY) tests/hil/m7.py $(if $(SHIFT),--shift $(SHIFT))
