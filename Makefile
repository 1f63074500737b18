# crease: every verb. `make` alone lists them.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
MAKEFLAGS += --no-builtin-rules
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.SECONDARY:

# make again, for work whose order does not matter and that no clock is held to.
TWO_AT_A_TIME = $(MAKE) --no-print-directory --jobs=2 --keep-going --output-sync=target

# A Python of 3.11 or newer that can make a virtual environment.
PYTHON ?= $(firstword $(shell for p in python3 /usr/bin/python3; do \
    "$$p" -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo "$$p"; done) python3)
VENV := .venv
PY := $(VENV)/bin/python
CREASE := $(VENV)/bin/crease

# QUICK=1: the least of a target that shows that it runs; not what its figures are taken from, and kept apart from them.
QUICK ?=
OUT := build$(if $(QUICK),/quick)

# What a user needs to build, bake, replay, see and run the demo; and what tests, lints, fuzzers and benchmarks need besides.
APT := build-essential cmake ninja-build python3-dev python3-venv libode-dev pkg-config
APT_DEVELOP := libcmocka-dev clang clang-format clang-tidy cppcheck gcovr libclang-rt-14-dev valgrind groff-base doxygen
PIP_USER := meshes live mcap
PIP_DEVELOP := test fuzz dask lint step parquet wheel docs ports prove

# For the tests of `crease view` only; any of BROWSERS that is there already will do.
APT_BROWSER := chromium-headless-shell
BROWSERS := chromium-headless-shell chromium chromium-browser google-chrome

FIRMWARE_C := $(wildcard firmware/contact/*.c firmware/servo/*.c firmware/couple/*.c)
# On a device a library of its own: who has no use for six degrees of freedom links none of it.
COUPLE_C := $(wildcard firmware/couple/*.c)
# Other methods, for comparison: on the host only, in an extension and tests of their own, never in a device library.
RIVALS_C := $(wildcard firmware/rivals/*.c)
CONTACT_C := $(wildcard firmware/contact/*.c)
PORT_C := $(wildcard firmware/port/linux/*.c)
PORT_LIB_C := $(filter-out %/creased.c,$(PORT_C)) $(addprefix firmware/port/cortex-m7/,fdcan.c slcan.c)
NATIVE_C := $(wildcard host/native/*.c host/native/*/*.c)
NATIVE_H := $(wildcard host/native/*.h host/native/*/*.h)
SIM_C := $(wildcard sim/*.c sim/port/linux/*.c)
C_HEADERS := $(wildcard firmware/*.h firmware/contact/*.h firmware/servo/*.h firmware/couple/*.h firmware/rivals/*.h firmware/port/linux/*.h tests/unit/*.h tests/property/*.h tests/fuzz/*.h) $(NATIVE_H)
TEST_C := $(wildcard tests/unit/test_*.c tests/property/test_*.c)
TEST_NAMES := $(notdir $(TEST_C:.c=))
# Of what is there for comparison only: built with rivals.
RIVAL_TESTS := test_rivals test_extent test_extent_zones
TEST_HELPERS := $(filter-out $(TEST_C),$(wildcard tests/unit/*.c tests/property/*.c))
IMAGE_HELPERS := $(filter-out $(addprefix %/,servo_rig.c servo_loop.c bus_rig.c control_bench.c),$(TEST_HELPERS))
FUZZ_C := $(wildcard tests/fuzz/fuzz_*.c)
PAGE := $(filter-out %.py %.md,$(wildcard host/crease/draw/view/*.*))
CORTEX_C := $(wildcard firmware/port/cortex-m7/*.[ch] tests/device/*.[ch] tests/check/*.h)
C_ALL := firmware/package/example.c $(CORTEX_C) $(FIRMWARE_C) $(RIVALS_C) $(PORT_C) $(NATIVE_C) $(SIM_C) $(wildcard sim/*.h sim/port/linux/*.h) $(TEST_C) $(TEST_HELPERS) $(FUZZ_C) $(wildcard tests/check/*.c tests/prove/*.[ch] tests/bench/*.[ch] tests/bench/peers/*.c tests/bench/peers/*.h tests/bench/peers/*.cpp) $(C_HEADERS)
PY_ALL := $(shell find host/crease host/native -name '*.py' 2>/dev/null)
PY_LINT := $(wildcard host/crease host/native host/backend meshes tests)

help: ## this list
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / {printf "make %-13s %s\n", $$1, $$2}' Makefile firmware/port/cortex-m7/device.mk firmware/package/install.mk

# ---------------------------------------------------------------------------------------------------- installing

setup: $(VENV)/.stamp build/.npm ## what users need: system packages (apt, when allowed), the environment .venv, libraries of the page

setup-develop: setup $(VENV)/.develop build/.browser ## the same, and what tests, lints, fuzzers and benchmarks need

# Recipe lines that install packages $(1) with options $(2), or say which are missing; one such recipe at a time, as apt-get has it.
define APT_INSTALL
	@mkdir -p build
	@command -v dpkg-query >/dev/null || { echo "not a Debian system: this needs $(1)"; touch $@; exit 0; }
	@exec 9>build/.apt-lock; flock 9; \
	missing=$$(for p in $(1); do dpkg-query -W -f '$${Status}' $$p 2>/dev/null | grep -q 'ok installed' || echo $$p; done); \
	missing=$$(echo $$missing); \
	if [ -z "$$missing" ]; then :; \
	elif [ $$(id -u) = 0 ]; then apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $(2) $$missing >build/apt.log; \
	elif sudo -n true 2>/dev/null; then sudo apt-get update -qq && sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $(2) $$missing >build/apt.log; \
	else echo "error: system packages are missing, install them with: sudo apt-get install $$missing"; exit 1; fi
	@test -e $@ || touch $@
endef

# Checked every time (0.1 s): a package may have been removed since.
build/.apt: FORCE
	$(call APT_INSTALL,$(APT))

build/.apt-develop: FORCE | build/.apt
	$(call APT_INSTALL,$(APT_DEVELOP))

build/.browser: FORCE | build/.apt
	$(call APT_INSTALL,$(if $(strip $(foreach b,$(BROWSERS),$(shell command -v $b))),,$(APT_BROWSER)),--no-install-recommends)

$(VENV)/.stamp: host/pyproject.toml | build/.apt
	@echo "python environment: $(VENV)"
	@mkdir -p build
	@exec 9>build/.lock; flock 9; \
	test -x $(PY) || "$(PYTHON)" -m venv $(VENV); \
	$(call PIP_INSTALL,["build-system"]["requires"] + p["project"]["dependencies"],$(PIP_USER)); touch $@

$(VENV)/.develop: $(VENV)/.stamp host/pyproject.toml | build/.apt-develop
	@echo "python environment: $(VENV), with what tests need"
	@exec 9>build/.lock; flock 9; $(call PIP_INSTALL,["build-system"]["requires"],$(PIP_DEVELOP)); touch $@

# Shell words that install lists of host/pyproject.toml: $(1) and the optional groups $(2).
PIP_INSTALL = "$(PYTHON)" -c 'import tomllib; p = tomllib.load(open("host/pyproject.toml", "rb")); r = list(p$(1)); \
	[r.extend(p["project"]["optional-dependencies"][g]) for g in "$(2)".split()]; print("\n".join(r))' >build/requirements.txt; \
	$(PY) -m pip install --quiet --disable-pip-version-check -r build/requirements.txt

# three.js and uPlot for the page of `crease view`, as host/package-lock.json has them.
PAGE_LOCK := host/package.json host/package-lock.json host/.npmrc

build/.apt-npm: FORCE
	$(call APT_INSTALL,$(if $(shell command -v npm),,nodejs npm),--no-install-recommends)

build/.npm: $(PAGE_LOCK) | build/.apt-npm
	@echo "libraries of the page: build/npm"
	@mkdir -p build/npm; cp $^ build/npm; cd build/npm; npm ci --silent --ignore-scripts >../npm.log 2>&1 || { cat ../npm.log; exit 1; }
	@touch $@

# ------------------------------------------------------------------------------------------------------ building

build: build/.host ## the C extensions and the `crease` command, in .venv

# The list of modules: the editable install has to know a new one.
build/modules.txt: FORCE
	@mkdir -p build; echo '$(sort $(PY_ALL))' | cmp -s - $@ || echo '$(sort $(PY_ALL))' >$@

build/.host: $(VENV)/.stamp build/.npm build/modules.txt $(FIRMWARE_C) $(RIVALS_C) $(NATIVE_C) $(wildcard firmware/*.h firmware/contact/*.h firmware/servo/*.h firmware/couple/*.h firmware/rivals/*.h) $(NATIVE_H) \
             $(SIM_C) $(wildcard sim/*.h sim/port/linux/*.h) \
             host/CMakeLists.txt host/native/gen_binding.py host/pyproject.toml
	@echo "extensions: crease._native, as it ships; crease._rivals; crease._sim"
	@exec 9>build/.lock; flock 9; \
	$(PY) -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable host >build/host.log 2>&1 \
	    || { cat build/host.log; exit 1; }
	@touch $@

# From a source archive, so that it is seen to hold all it needs. auditwheel puts ODE into the wheel.
WHEELS := $(OUT)/wheels

wheel: $(VENV)/.develop build/.npm ## source archive and wheel for any x86-64 Linux as new as this one, in build/wheels
	@rm -rf $(WHEELS); mkdir -p $(WHEELS)
	@cd host && ../$(PY) -c 'import sys; sys.path[:0] = ["backend"]; import crease_backend as b; b.build_sdist("../$(WHEELS)")' >../build/wheel.log
	@$(PY) -m pip wheel --quiet --disable-pip-version-check --no-build-isolation --no-deps -w $(WHEELS)/plain $(WHEELS)/crease-*.tar.gz
	@PATH="$(abspath $(VENV)/bin):$$PATH" $(PY) -m auditwheel repair -w $(WHEELS) $(WHEELS)/plain/*.whl >>build/wheel.log 2>&1 || { cat build/wheel.log; exit 1; }
	@rm -r $(WHEELS)/plain; ls $(WHEELS)/*

# The host with everything that its tests, lints and fuzzers use.
build/.develop: build/.host $(VENV)/.develop
	@touch $@

meshes: build/meshes/.stamp build/meshes/six/.stamp ## the paper's objects and their trajectories, in build/meshes; those of meshes/six

build/meshes/six/.stamp: $(wildcard meshes/six/*.*) | $(VENV)/.stamp
	$(PY) meshes/six/make_six.py >/dev/null
	@touch $@

build/meshes/.stamp: $(wildcard meshes/*.*) | $(VENV)/.stamp
	@mkdir -p build/meshes
	$(PY) meshes/make.py
	@touch $@

scenes: build/scenes/.stamp ## scene images of meshes/scenes.toml, in build/scenes

BAKE_PY := $(wildcard host/crease/mesh/*.py host/crease/bake/*.py)

build/scenes/.stamp: build/.host build/meshes/.stamp meshes/scenes.toml $(BAKE_PY)
	@mkdir -p $(@D)
	$(PY) -m crease.bake.scene_list meshes/scenes.toml build/meshes build/scenes
	@touch $@

# ---------------------------------------------------------------------------------------------------------- demo

demo: build/demo/.stamp ## bake, replay the corner trajectory, write the plots and a page that moves, and name them
	@printf '%s\n' build/demo/*.png build/demo/*.html

DEMO_SCENES := edge90_sphere edge90_cube

build/demo/.stamp: build/.host build/meshes/.stamp meshes/scenes.toml $(PY_ALL) $(PAGE)
	@mkdir -p build/demo
	$(PY) -m crease.bake.scene_list meshes/scenes.toml build/meshes build/scenes $(DEMO_SCENES)
	$(PY) -m crease.draw.demo meshes/scenes.toml build/meshes build/scenes build/demo
	@touch $@

play: build/.host build/meshes/.stamp ## a block and a ball in the browser: drag the ball with the mouse and see the force
	$(PY) -m crease.bake.scene_list meshes/scenes.toml build/meshes build/scenes $(PLAY)
	$(CREASE) view --live build/scenes/$(PLAY).crs --title "$(PLAY): drag the ball" $(if $(QUICK),--seconds 2 --no-open)

# A scene of meshes/scenes.toml.
PLAY ?= edge90_sphere

# --------------------------------------------------------------------------------------------------------- tests
# One library and one set of test programs for each variant: build/<variant>/... All but cov, which counts what ships, check what must hold inside
# (firmware/asserts.h).
ASSERTS := -DCR_ASSERTS=1

CC_gcc := gcc
CFLAGS_gcc := -O2 -g $(ASSERTS)
CC_clang := clang
CFLAGS_clang := -O2 -g $(ASSERTS)
CC_san := gcc
CFLAGS_san := $(ASSERTS) -O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer
CC_cov := gcc
CFLAGS_cov := -O0 -g --coverage -DNDEBUG
CC_fuzz := clang
CFLAGS_fuzz := $(ASSERTS) -O1 -g -fsanitize=fuzzer-no-link,address,undefined,float-cast-overflow -fno-sanitize-recover=all -fno-omit-frame-pointer
# As a Cortex-M runs it: lane by lane.
CC_scalar := $(CC_fuzz)
CFLAGS_scalar := $(CFLAGS_fuzz) -DCR_SCALAR=1
WARNINGS := -Wall -Wextra -Wconversion -Wshadow
# As on the device. What compares with rivals is built again, in rivals/ of a variant's folder.
C_STD := -std=c11 -D_POSIX_C_SOURCE=200809L -ffp-contract=off -fno-math-errno
WITH_RIVALS := -DCR_RIVALS
INCLUDES := -Ifirmware -Ifirmware/port/linux -Ifirmware/port/cortex-m7 -Ihost/native -Isim -Isim/port/linux -Itests/unit -Itests/property

define VARIANT
# Options that change make every object anew.
build/$(1)/.flags: FORCE
	@mkdir -p $$(@D); echo '$(CC_$(1)) $(C_STD) $(CFLAGS_$(1)) $(WARNINGS) $(INCLUDES)' | cmp -s - $$@ \
	    || echo '$(CC_$(1)) $(C_STD) $(CFLAGS_$(1)) $(WARNINGS) $(INCLUDES)' >$$@

build/$(1)/%.o: %.c build/$(1)/.flags
	@mkdir -p $$(@D)
	@echo "$(1): $$<"
	@$(CC_$(1)) $(C_STD) $(CFLAGS_$(1)) $(WARNINGS) $(INCLUDES) -MMD -MP -c $$< -o $$@

build/$(1)/rivals/%.o: %.c build/$(1)/.flags
	@mkdir -p $$(@D)
	@echo "$(1), rivals: $$<"
	@$(CC_$(1)) $(C_STD) $(WITH_RIVALS) $(CFLAGS_$(1)) $(WARNINGS) $(INCLUDES) -MMD -MP -c $$< -o $$@

build/$(1)/libcrease.a: $(FIRMWARE_C:%.c=build/$(1)/%.o) $(PORT_LIB_C:%.c=build/$(1)/%.o) $(NATIVE_C:%.c=build/$(1)/%.o)
	@rm -f $$@
	@ar rcs $$@ $$^

build/$(1)/libhelpers.a: $(TEST_HELPERS:%.c=build/$(1)/%.o)
	@rm -f $$@
	@ar rcs $$@ $$^

build/$(1)/librivals.a: $(patsubst %.c,build/$(1)/rivals/%.o,$(CONTACT_C) $(RIVALS_C) $(IMAGE_HELPERS) firmware/port/linux/assert_failed.c)
	@rm -f $$@
	@ar rcs $$@ $$^

$(RIVAL_TESTS:%=build/$(1)/tests/%): build/$(1)/tests/%: build/$(1)/rivals/tests/unit/%.o build/$(1)/librivals.a
	@$(CC_$(1)) $(CFLAGS_$(1)) $$^ -lcmocka -lm -o $$@

build/$(1)/libsim.a: $(SIM_C:%.c=build/$(1)/%.o)
	@rm -f $$@
	@ar rcs $$@ $$^

build/$(1)/tests/%: build/$(1)/tests/unit/%.o build/$(1)/libhelpers.a build/$(1)/libcrease.a build/$(1)/libsim.a
	@$(CC_$(1)) $(CFLAGS_$(1)) $$^ -lcmocka -Wl,--as-needed -lode -lm -o $$@

build/$(1)/tests/%: build/$(1)/tests/property/%.o build/$(1)/libhelpers.a build/$(1)/libcrease.a build/$(1)/libsim.a
	@$(CC_$(1)) $(CFLAGS_$(1)) $$^ -lcmocka -Wl,--as-needed -lode -lm -o $$@

build/$(1)/creased: build/$(1)/firmware/port/linux/creased.o build/$(1)/libcrease.a
	@$(CC_$(1)) $(CFLAGS_$(1)) $$^ -lm -lpthread -o $$@

c-tests-$(1): $(addprefix build/$(1)/tests/,$(TEST_NAMES))
$(patsubst %.c,build/$(1)/%.o,$(TEST_C) $(TEST_HELPERS) $(FUZZ_C)) $(RIVAL_TESTS:%=build/$(1)/rivals/tests/unit/%.o): | build/.apt-develop
endef
$(foreach variant,gcc clang san cov fuzz scalar,$(eval $(call VARIANT,$(variant))))
build/clang/.flags build/fuzz/.flags build/scalar/.flags: | build/.apt-develop
include firmware/port/cortex-m7/device.mk
include firmware/package/install.mk
-include $(wildcard build/*/*/*.d build/*/*/*/*.d build/*/*/*/*/*.d)

creased: build/gcc/creased ## the servo for Linux with SocketCAN, build/gcc/creased

# What the tests run, with the programs of the variants $(1).
TESTED = build/gcc/creased build/gcc/creased-unix build/gcc/latency_drives $(1:%=c-tests-%)

check: build/.develop build/scenes/.stamp build/meshes/six/.stamp $(if $(QUICK),build/gcc/tests/test_late) ## quick tests, under two minutes
	$(if $(QUICK),,@$(TWO_AT_A_TIME) $(call TESTED,gcc))
	$(PY) tests/run.py --quick --c-tests build/gcc/tests $(if $(QUICK),--programs test_late -- tests/check/test_asserts.py)

test: build/.develop build/.browser build/scenes/.stamp build/meshes/six/.stamp hil-kernel ## everything that must pass, in a quarter of an hour on two idle cores; ends with one count
	@$(TWO_AT_A_TIME) $(call TESTED,gcc san)
	$(PY) tests/run.py --c-tests build/gcc/tests --sanitized build/san/tests

# `make test` runs all of it: one program shows that the target works.
sanitize: $(if $(QUICK),build/san/tests/test_late,c-tests-san) ## C tests under address and undefined-behaviour sanitizers
	$(PY) tests/run.py --c-tests build/san/tests --only-c $(if $(QUICK),--programs test_late)

# Seconds of the clock, shared by all targets of tests/fuzz/run.py.
FUZZ_SECONDS ?= $(if $(QUICK),20,60)

FUZZERS := $(patsubst tests/fuzz/%.c,build/fuzz/%,$(FUZZ_C)) build/fuzz/fuzz_scene_scalar

fuzz: build/.develop ## fuzz every input under sanitizers, 60 s or FUZZ_SECONDS=
	@$(TWO_AT_A_TIME) $(FUZZERS)
	$(PY) tests/fuzz/run.py --build build/fuzz --seconds $(FUZZ_SECONDS) $(if $(FUZZ_KEEP),--keep tests/fuzz/hours.csv)

build/fuzz/fuzz_%: build/fuzz/tests/fuzz/fuzz_%.o build/fuzz/libhelpers.a build/fuzz/libcrease.a build/fuzz/libsim.a
	@$(CC_fuzz) $(subst fuzzer-no-link,fuzzer,$(CFLAGS_fuzz)) $^ -lcmocka -Wl,--as-needed -lode -lm -o $@

build/fuzz/fuzz_scene_scalar: build/scalar/tests/fuzz/fuzz_scene.o build/scalar/libhelpers.a build/scalar/libcrease.a build/scalar/libsim.a
	@mkdir -p $(@D)
	@$(CC_scalar) $(subst fuzzer-no-link,fuzzer,$(CFLAGS_scalar)) $^ -lcmocka -Wl,--as-needed -lode -lm -o $@

prove: build/.develop ## proofs of what takes bytes from outside, by a bounded model checker: firmware/PROOFS.md
	$(PY) tests/prove/proofs.py $(if $(QUICK),--quick)

promises: build/.develop ## promise by promise of the pages the tests that show it; fails on a gap
	$(PY) tests/check/promises.py $(if $(QUICK),--count)

evidence: build/.develop $(if $(QUICK),,build/.device build/scenes/.stamp coverage-firmware prove) ## figures of firmware/EVIDENCE.md, MISRA.md, MEMORY.md anew
	PYTHONPATH=tests/device:tests/prove $(PY) tests/check/evidence.py $(if $(QUICK),--quick)

# 2.8 hours of rendering, in 4 minutes.
SOAK_TICKS ?= $(if $(QUICK),200000,10000000)

soak: build/gcc/tests/test_soak ## the closed loop for 10^7 ticks of virtual time, or SOAK_TICKS=
	CREASE_SOAK_TICKS=$(SOAK_TICKS) build/gcc/tests/test_soak

coverage: build/.develop build/.browser c-tests-cov build/scenes/.stamp build/meshes/six/.stamp $(if $(QUICK),,coverage-firmware) ## lines and branches that the tests reach, C and Python
	$(if $(QUICK),,gcovr --root . --filter 'host/native/' --filter 'sim/' --branches build/cov | tail -20)
	$(PY) -m pytest -c host/pyproject.toml --rootdir . -q --cov --cov-config=host/pyproject.toml $(if $(QUICK),tests/host/test_units.py,tests)

# The long one, and the one of two threads, reach nothing that the others do not; what is covered is what ships, not what was built with rivals beside it.
# The longest begin first.
LONG_TESTS := test_way_out test_bitflips
COVERING := $(LONG_TESTS) $(filter-out $(LONG_TESTS) test_soak test_two_threads $(RIVAL_TESTS),$(TEST_NAMES))

coverage-firmware: $(addprefix build/cov/tests/,$(COVERING)) ## fails below every line and 95 % of the branches of contact/, servo/ and couple/
	@find build/cov -name '*.gcda' -delete; mkdir -p build/coverage
	@printf '%s\n' $(COVERING) | xargs -P 2 -I{} sh -c 'build/cov/tests/{} >build/coverage/{}.log 2>&1 || { cat build/coverage/{}.log; exit 255; }'
	gcovr --root . --filter 'firmware/([^/]*|contact/.*|servo/.*|couple/.*)\.[ch]$$' --branches --print-summary \
	    --fail-under-line 100 --fail-under-branch 95 build/cov/firmware | tee build/coverage/summary.txt

.PHONY: pictures
pictures: build/.develop build/.browser build/scenes/.stamp ## pictures of the texts, anew: of the contact, the page, the live page, run.mcap
	$(PY) tests/bench/pictures.py $(if $(QUICK),-o $(OUT)/pictures --only problem.png)
	PYTHONPATH=tests/host $(PY) tests/bench/page_pictures.py $(if $(QUICK),-o $(OUT)/pictures --only mcap.png)

bench: build/.host build/scenes/.stamp ## measured figures, with the machine's name
	$(PY) tests/bench/bench.py --figures $(OUT)/bench $(if $(QUICK),--scene edge90_cube --repeat 2)
	$(PY) tests/bench/bake.py $(if $(QUICK),--quick)

first-plot: $(if $(QUICK),build/.host) ## from a fresh clone to a plot of two STL files in ten lines: how long it takes
	$(if $(QUICK),$(PY),"$(PYTHON)") tests/bench/first_plot.py $(if $(QUICK),--here)

bench-worlds: build/.host build/scenes/.stamp ## throughput of crease.Worlds over batch sizes and threads
	$(PY) tests/bench/worlds.py build/scenes/edge90_cube.crs build/meshes/edge90_cube.csv $(if $(QUICK),--steps 10)

# An environment of its own: nothing here is needed by users. What has no wheel for this machine is said and left out.
PEERS := build/peers
PEERS_PIP := python-fcl coal mujoco pybullet
PEERS_APT := libode-dev libccd-dev libbullet-dev
PEERS_SCENES := edge90_cube edge90_sphere corner3_sphere groove_block part_spanner groove_stylus

build/.peers: FORCE
	$(call APT_INSTALL,$(PEERS_APT))

# Two libraries of one C file each, linked into one; warnings of Bullet's headers are not ours.
$(PEERS)/libpeers.so: $(wildcard tests/bench/peers/*.c tests/bench/peers/*.h tests/bench/peers/*.cpp) | build/.peers
	@mkdir -p $(@D)
	cc -O2 -fPIC $(WARNINGS) $$(pkg-config --cflags ode) -c tests/bench/peers/peers.c -o $(PEERS)/peers.o
	c++ -O2 -fPIC -Wall -Wextra $$(pkg-config --cflags bullet-float64 | sed 's/-I/-isystem /g') -c tests/bench/peers/gimpact.cpp -o $(PEERS)/gimpact.o
	c++ -shared $(PEERS)/peers.o $(PEERS)/gimpact.o -lode -lccd $$(pkg-config --libs bullet-float64) -lm -o $@

$(PEERS)/.libraries: $(PEERS)/libpeers.so
	@test -x $(PEERS)/bin/python || "$(PYTHON)" -m venv $(PEERS)
	@$(PEERS)/bin/pip install --quiet --disable-pip-version-check numpy scipy trimesh
	@for p in $(PEERS_PIP); do $(PEERS)/bin/pip install --quiet --disable-pip-version-check --only-binary :all: $$p \
	    || echo "bench: $$p has no wheel for this machine: left out"; done
	@touch $@

bench-peers: build/.host build/scenes/.stamp $(PEERS)/.libraries ## rival libraries, every sweep and float32 against double: build/bench/pareto.png, precision.png
	rm -rf $(OUT)/peers/raw
	$(PEERS)/bin/python tests/bench/peers/query.py meshes/scenes.toml build/meshes $(OUT)/peers/raw \
	    $(if $(QUICK),edge90_cube part_spanner --every 400 --repeat 1,$(PEERS_SCENES)) --library $(PEERS)/libpeers.so
	@mkdir -p $(OUT)/bench
	$(PY) tests/bench/peers/collect.py $(OUT)/peers/raw $(OUT)/bench/peers.csv
	$(CREASE) bench pareto -o $(OUT)/bench --peers $(OUT)/bench/peers.csv --force $(if $(QUICK),--quick)
	$(CREASE) bench precision -o $(OUT)/bench --force $(if $(QUICK),--quick)

bench-report: bench-peers ## the same, then pictures, CSV and tables of tests/bench/REPORT.md
	$(PY) tests/bench/report.py $(OUT)/bench $(if $(QUICK),-o $(OUT)/report)

bench-properties: build/.develop build/meshes/.stamp $(PEERS)/.libraries ## what a contact force must have, all responses and libraries: build/properties, 10 minutes
	rm -rf $(OUT)/peers/properties
	$(PEERS)/bin/python tests/bench/peers/query.py meshes/property_scenes.toml build/meshes $(OUT)/peers/properties \
	    $(if $(QUICK),corner --every 40,--every 4) --repeat 1 --library $(PEERS)/libpeers.so
	$(CREASE) bench properties -o $(OUT)/properties --peers $(OUT)/peers/properties --force $(if $(QUICK),--quick --scenes corner)

bench-meshes: build/.develop build/meshes/.stamp ## machine parts, clean and spoiled in nine ways: accepted, inside right, time, memory, size, force: tests/bench/MESHES.md; the time foreseen
	PYTHONPATH=meshes $(PY) tests/bench/meshes.py -o $(OUT)/bench $(if $(QUICK),--parts spanner --damages clean holes,--write)
	PYTHONPATH=meshes $(PY) tests/bench/bake_estimate.py $(if $(QUICK),--only nut)

bench-meshes-force: build/.develop build/meshes/.stamp ## clearing and amplification over every ridge and pocket of these parts, three tools: tests/bench/MESHES.md
	PYTHONPATH=meshes:tests/bench $(PY) tests/bench/meshes.py --damages clean --judge mesh_judge:judge -o $(OUT)/bench/force $(if $(QUICK),--parts spanner,--write)

bench-curved: build/.develop ## balls on torus, saddle, bowl and involute at three tessellations: force and amplification beside the smooth bodies', 6 minutes
	PYTHONPATH=meshes:tests/bench $(PY) tests/bench/curved.py $(if $(QUICK),--quick --scenes saddle)

bench-six: build/.develop build/meshes/six/.stamp ## held tools of meshes/six by exact judges, beside rivals: tests/bench/SIX.md, 25 minutes
	PYTHONPATH=tests/bench $(PY) tests/bench/six_bench.py $(if $(QUICK),--quick -o $(OUT)/six)

# In its quick form a known jump is no failure of the target: tests/host/test_stress.py tells known violations from new ones.
stress: build/.host ## 100,000 random cases against the tick, resumable: build/stress
	$(if $(QUICK),rm -rf $(OUT)/stress; )$(CREASE) stress -o $(OUT)/stress $(if $(QUICK),--cases 6 --per-chunk 6 --scenes 1 \
	    || grep -q '"cases": 6' $(OUT)/stress/summary.json)

bench-loop: build/.develop build/scenes/.stamp ## stability of the closed loop: theory, round an edge and a corner, largest stiffness; 9 minutes
	$(PY) tests/bench/loop_held.py $(if $(QUICK),--quick)
	$(PY) tests/bench/loop.py --figure $(OUT)/loop/edge.png $(if $(QUICK),--quick)

bench-faults: build/.develop build/scenes/.stamp ## every bus fault at every 50th tick of a contact: fault x outcome, 4 minutes
	$(PY) tests/bench/faults.py build/scenes/wall_cube.crs $(if $(QUICK),--every 1000 --seconds 1)

# creased with a UNIX socket for its bus: everything but can.c.
build/gcc/creased-unix: build/gcc/firmware/port/linux/creased.o build/gcc/tests/bench/latency_can.o build/gcc/libcrease.a
	@$(CC_gcc) $(CFLAGS_gcc) $^ -lm -lpthread -o $@

build/gcc/latency_drives: build/gcc/tests/bench/latency_drives.o build/gcc/libsim.a
	@$(CC_gcc) $(CFLAGS_gcc) $^ -lode -lm -o $@

LATENCY = $(PY) tests/bench/latency.py build/scenes/wall_cube.crs $(if $(QUICK),--seconds 2)

bench-latency: build/.develop build/gcc/creased build/gcc/creased-unix build/gcc/latency_drives build/scenes/.stamp hil-kernel ## wake-up and SYNC to torque frame in real time: histograms, p99.9
	$(LATENCY) --where 'native kernel without CAN' --figure $(OUT)/bench/latency-unix.png
	if [ -e /sys/class/net/vcan0 ]; then $(LATENCY) --transport vcan --where native --figure $(OUT)/bench/latency-vcan.png; \
	else tests/hil/lab/vcan-run $(LATENCY) --transport vcan --where 'User-Mode Linux' --figure $(OUT)/bench/latency-vcan.png; fi

# ----------------------------------------------------------------------------------------------- hardware in the loop
# Protocol tests on a real vcan0: the kernel's own where there is one, else in User-Mode Linux with virtual time.

# Length of the two runs whose logs must be identical.
HIL_SECONDS ?= $(if $(QUICK),2,5)
HIL_TESTS := $(if $(QUICK),tests/bus/test_drive.py -k heartbeat,tests/bus/test_drive.py tests/bus/test_bus_cli.py $(wildcard tests/hil/test_*.py))
HIL_PYTEST = CREASE_TRANSPORT=socketcan $(1) $(PY) -m pytest -c host/pyproject.toml --rootdir . -q $(HIL_TESTS)

hil-minute: build/.develop build/gcc/creased hil-kernel ## 60 s of the loop on vcan in virtual time, twice: no tick missed, logs identical
	$(PY) tests/hil/repeat.py --seconds $(if $(QUICK),5,60)

hil-kernel: ## the kernel for `make hil` (once, under 5 minutes, kept outside the checkout)
	@if [ -e /sys/class/net/vcan0 ]; then echo "hil: this kernel has vcan0"; else tests/hil/lab/build-kernel; fi

hil: build/.develop build/gcc/creased hil-kernel ## tests on a real vcan: native, or in User-Mode Linux with virtual time
	@if [ -e /sys/class/net/vcan0 ]; then echo "hil: vcan0 of this kernel"; $(call HIL_PYTEST,); \
	else echo "hil: vcan0 in User-Mode Linux, virtual time"; $(call HIL_PYTEST,CREASE_VIRTUAL_TIME=1 tests/hil/lab/vcan-run -V); \
	    $(PY) tests/hil/repeat.py --seconds $(HIL_SECONDS); fi

# Every target of `make help` that continuous integration does not run as it is, in its quick form, so that none rots.
HELPED = $(shell sed -n 's/^\([a-z0-9-]*\):.*\#\# .*/\1/p' Makefile firmware/port/cortex-m7/device.mk firmware/package/install.mk)
CI_TARGETS = $(shell sed -n 's/^make \([a-z0-9-]*\).*/\1/p' .ci/run)
QUICK_TARGETS = $(filter-out $(CI_TARGETS),$(HELPED))

# What git would commit must be the same after them as before.
TREE = $$({ git status --porcelain && git diff HEAD; } | sha256sum)

# Of these each needs, changes or takes away what another one looks at (bench-latency is a host on vcan0, as hil is): after all the rest, one at a time.
LAST_TARGETS := bench-latency install uninstall licences manuals format clean

all-targets: ## the targets that tests and linters leave out, in their quick forms: under 10 minutes
	@failed=; tree="$(TREE)"; \
	for t in "$(filter-out $(LAST_TARGETS),$(QUICK_TARGETS))" $(filter $(QUICK_TARGETS),$(LAST_TARGETS)); do echo "== make $$t QUICK=1"; \
	    $(TWO_AT_A_TIME) $$t QUICK=1 || failed=", not all passed"; done; \
	[ "$$tree" = "$(TREE)" ] || { git status --short; failed="$$failed, and the checkout is not as it was"; }; \
	echo "all-targets: $(words $(QUICK_TARGETS)) targets in $$SECONDS s$$failed"; test -z "$$failed"

# ---------------------------------------------------------------------------------------------------------- lint

lint: build/.develop ## format, static analysis and types: C and Python
	@$(TWO_AT_A_TIME) $(LINTS)

LINTS := lint-clang-format lint-warnings lint-clang-tidy lint-analyzer lint-cppcheck lint-misra lint-structure lint-rooms lint-statics lint-ruff lint-mypy

SHIPPED_C := $(FIRMWARE_C) $(PORT_C) $(NATIVE_C) $(SIM_C)
# What the extra variant has: other methods, and the few files of the tick that know of them.
EXTRA_C := $(RIVALS_C) $(shell grep -l CR_RIVALS $(CONTACT_C))
STRICT := $(WARNINGS) -Werror -Wsign-conversion -Wdouble-promotion -Wvla -Wundef -Wstrict-prototypes -Wmissing-prototypes

# With optimisation: some warnings need the data flow. Files $(1), options $(2).
define WARN
	@for f in $(1); do \
	    gcc $(C_STD) $(2) $(INCLUDES) -O2 $(STRICT) -Wlogical-op -Wduplicated-cond -c $$f -o /dev/null; \
	    clang $(C_STD) $(2) $(INCLUDES) -O2 $(STRICT) -Wcomma -Wunreachable-code -c $$f -o /dev/null; done
endef

lint-warnings:
	@echo "gcc, clang -Werror: $(SHIPPED_C)"
	$(call WARN,$(SHIPPED_C),)
	@echo "the same with rivals: $(EXTRA_C)"
	$(call WARN,$(EXTRA_C),$(WITH_RIVALS))

# Without optimisation, which gcc 12 needs to follow loops that fill an array.
lint-analyzer:
	@echo "gcc -fanalyzer: $(SHIPPED_C)"
	@for f in $(SHIPPED_C); do gcc $(C_STD) $(INCLUDES) -O0 -fanalyzer -Werror -c $$f -o /dev/null; done
	@for f in $(EXTRA_C); do gcc $(C_STD) $(WITH_RIVALS) $(INCLUDES) -O0 -fanalyzer -Werror -c $$f -o /dev/null; done

# Deviations and their reasons: tests/check/misra.csv.
lint-misra:
	$(PY) tests/check/misra.py --std=c11 -D__GNUC__ -Ifirmware --suppress=missingIncludeSystem -- $(FIRMWARE_C)

lint-structure:
	$(PY) tests/check/structure.py gcc $(C_STD) -Ifirmware -- $(FIRMWARE_C)

lint-rooms:
	$(PY) tests/check/rooms.py

lint-statics:
	$(PY) tests/check/statics.py gcc $(C_STD) $(INCLUDES) -- $(FIRMWARE_C) $(NATIVE_C) $(wildcard sim/*.c)
	$(PY) tests/check/statics.py gcc $(C_STD) $(WITH_RIVALS) $(INCLUDES) -- $(EXTRA_C)

lint-clang-format:
	clang-format --dry-run -Werror $(C_ALL)

lint-clang-tidy:
	@echo clang-tidy $(SHIPPED_C)
	@{ clang-tidy --quiet --warnings-as-errors='*' $(SHIPPED_C) -- $(C_STD) $(INCLUDES) && \
	    clang-tidy --quiet --warnings-as-errors='*' $(EXTRA_C) -- $(C_STD) $(WITH_RIVALS) $(INCLUDES); } 2>build/clang-tidy.log \
	    || { grep -v 'warnings generated' build/clang-tidy.log; exit 1; }

lint-cppcheck:
	cppcheck --quiet --std=c11 --error-exitcode=1 --enable=warning,performance,portability --inline-suppr \
	    --suppress=missingIncludeSystem -Ifirmware -Ihost/native -Isim firmware host/native sim tests/check

lint-ruff:
	$(PY) -m ruff check --config host/pyproject.toml $(PY_LINT)
	$(PY) -m ruff format --check --config host/pyproject.toml $(PY_LINT)

lint-mypy:
	$(PY) -m mypy --config-file host/pyproject.toml host/crease
	$(PY) -m mypy --config-file host/pyproject.toml $(wildcard host/backend meshes tests)

licences: $(VENV)/.develop build/.npm ## collect the licences of other authors: host/THIRD_PARTY.md
	$(PY) host/backend/third_party.py

docs: build/.develop ## pages of the C and Python interfaces and of all texts, to read offline, links checked: build/docs/index.html
	$(PY) host/backend/reference.py $(OUT)/docs

format: $(VENV)/.develop ## rewrite C and Python in the house format
	clang-format -i $(C_ALL)
	$(PY) -m ruff check --fix --quiet --config host/pyproject.toml $(PY_LINT) || true
	$(PY) -m ruff format --config host/pyproject.toml $(PY_LINT)

clean: ## remove build/ (.venv stays)
	rm -rf $(OUT)

FORCE:
.PHONY: FORCE $(LINTS) help setup setup-develop build wheel meshes scenes creased demo play check test sanitize fuzz prove promises evidence soak coverage coverage-firmware bench bench-peers bench-report bench-properties bench-meshes bench-meshes-force bench-curved bench-six stress bench-loop bench-faults bench-latency hil hil-kernel hil-m7 check-device firmware-m7 firmware-m4f firmware-m55 worst wcet hil-minute all-targets bench-worlds first-plot lint format licences docs clean \
        c-tests-gcc c-tests-clang c-tests-san c-tests-cov
