# make install: the library for other people's programs. Included by the Makefile at the root; needs a C compiler and nothing else.

PREFIX ?= /usr/local
LIBDIR ?= $(PREFIX)/lib
INCLUDEDIR ?= $(PREFIX)/include
BINDIR ?= $(PREFIX)/bin
MANDIR ?= $(PREFIX)/share/man
DATADIR ?= $(PREFIX)/share/crease
DESTDIR ?= $(if $(QUICK),$(OUT)/install)

PACKAGE := firmware/package
INSTALLED := build/install
PUBLIC_H := firmware/crease.h firmware/servo.h firmware/couple.h firmware/config.h
MANUALS := $(patsubst $(PACKAGE)/man/%.in,%,$(wildcard $(PACKAGE)/man/*.in))

# As the header has it. Before 1.0 a minor version may break the ABI, so it is part of the soname.
VERSION := $(shell awk '/^\#define CR_VERSION_(MAJOR|MINOR|PATCH) / {printf "%s%s", dot, $$3; dot = "."}' firmware/crease.h)
SOVERSION := $(if $(filter 0,$(word 1,$(subst ., ,$(VERSION)))),$(basename $(VERSION)),$(word 1,$(subst ., ,$(VERSION))))
SHARED := libcrease.so.$(VERSION)

# The results are the same to the bit with any CFLAGS that keep IEEE arithmetic: not -ffast-math.
CC_install := $(CC)
CFLAGS_install := -O3 -fPIC -ffunction-sections -fdata-sections $(CFLAGS)
$(eval $(call VARIANT,install))

# What the public headers declare is what the library exports.
$(INSTALLED)/exports: $(PUBLIC_H)
	@mkdir -p $(@D)
	@printf '#include "crease.h"\n#include "servo.h"\n#include "couple.h"\n' | $(CC) -E -P -std=c11 -Ifirmware - | grep -o '\bcr_[a-z0-9_]*(' | tr -d '(' | sort -u >$@

$(INSTALLED)/crease.map: $(INSTALLED)/exports
	@{ echo 'CREASE_$(SOVERSION) {'; echo 'global:'; sed 's/$$/;/' $<; echo 'local: *;'; echo '};'; } >$@

$(INSTALLED)/lib/libcrease.a: $(FIRMWARE_C:%.c=$(INSTALLED)/%.o)
	@mkdir -p $(@D); rm -f $@
	@ar rcs $@ $^

$(INSTALLED)/lib/$(SHARED): $(INSTALLED)/crease.map $(FIRMWARE_C:%.c=$(INSTALLED)/%.o)
	@mkdir -p $(@D)
	@$(CC) $(CFLAGS_install) $(LDFLAGS) -shared -Wl,-soname,libcrease.so.$(SOVERSION) -Wl,--version-script=$< -Wl,-z,defs \
	    $(filter %.o,$^) -lm -o $@

$(INSTALLED)/bin/creased: $(PORT_C:%.c=$(INSTALLED)/%.o) $(PORT_LIB_C:%.c=$(INSTALLED)/%.o) $(INSTALLED)/lib/libcrease.a
	@mkdir -p $(@D)
	@$(CC) $(CFLAGS_install) $(LDFLAGS) $(sort $(filter %.o,$^)) $(filter %.a,$^) -lm -lpthread -o $@

# Where the manual $(1) goes.
MANUAL = '$(DESTDIR)$(MANDIR)/man$(subst .,,$(suffix $(1)))/$(1)'

# The template $(1) of this folder, filled in, as the file $(2).
FILL = sed -e 's|@PREFIX@|$(PREFIX)|' -e 's|@LIBDIR@|$(LIBDIR)|g' -e 's|@INCLUDEDIR@|$(INCLUDEDIR)|' -e 's|@VERSION@|$(VERSION)|' \
    -e 's|@SOVERSION@|$(SOVERSION)|' -e "s|@INCLUDE_FROM_LIB@|$$(realpath -m --relative-to='$(LIBDIR)' '$(INCLUDEDIR)')|" \
    -e 's|@DATADIR@|$(DATADIR)|g' $(PACKAGE)/$(1).in >$(2)

install: $(INSTALLED)/lib/libcrease.a $(INSTALLED)/lib/$(SHARED) $(INSTALLED)/bin/creased ## library, headers, pkg-config, CMake, creased, manuals: PREFIX=/usr/local DESTDIR=
	@case '$(PREFIX)' in /*) ;; *) echo "error: PREFIX=$(PREFIX): is not an absolute path; use DESTDIR for a folder to pack from" >&2; exit 1;; esac
	install -d '$(DESTDIR)$(LIBDIR)/pkgconfig' '$(DESTDIR)$(LIBDIR)/cmake/crease' '$(DESTDIR)$(INCLUDEDIR)/crease' '$(DESTDIR)$(BINDIR)' \
	    '$(DESTDIR)$(DATADIR)' $(foreach s,1 3 8,'$(DESTDIR)$(MANDIR)/man$(s)')
	install -m 644 $(PUBLIC_H) '$(DESTDIR)$(INCLUDEDIR)/crease'
	install -m 644 $(INSTALLED)/lib/libcrease.a '$(DESTDIR)$(LIBDIR)'
	install -m 755 $(INSTALLED)/lib/$(SHARED) '$(DESTDIR)$(LIBDIR)'
	ln -sf $(SHARED) '$(DESTDIR)$(LIBDIR)/libcrease.so.$(SOVERSION)'
	ln -sf libcrease.so.$(SOVERSION) '$(DESTDIR)$(LIBDIR)/libcrease.so'
	@$(call FILL,crease.pc,'$(DESTDIR)$(LIBDIR)/pkgconfig/crease.pc')
	@$(foreach c,crease-config.cmake crease-config-version.cmake,$(call FILL,$(c),'$(DESTDIR)$(LIBDIR)/cmake/crease/$(c)');)
	install -m 755 $(INSTALLED)/bin/creased '$(DESTDIR)$(BINDIR)'
	install -m 644 firmware/port/linux/device.toml $(PACKAGE)/example.c LICENSE '$(DESTDIR)$(DATADIR)'
	@$(foreach m,$(MANUALS),$(call FILL,man/$(m),$(call MANUAL,$(m)));)
	@echo "installed: man 3 crease; $(DATADIR)/example.c. A program that does not find libcrease.so.$(SOVERSION): ldconfig, or LD_LIBRARY_PATH=$(LIBDIR)"

# What install may have made, the inner ones first; below /usr they are the system's, empty or not.
LEFT_EMPTY = $(if $(filter /usr /usr/local,$(PREFIX)),,$(LIBDIR)/pkgconfig $(LIBDIR)/cmake $(LIBDIR) $(INCLUDEDIR) $(BINDIR) \
    $(foreach s,1 3 8,$(MANDIR)/man$(s)) $(MANDIR) $(dir $(MANDIR)) $(dir $(DATADIR)) $(PREFIX))

uninstall: ## what install put there, with the same PREFIX and DESTDIR
	rm -rf '$(DESTDIR)$(INCLUDEDIR)/crease' '$(DESTDIR)$(LIBDIR)/cmake/crease' '$(DESTDIR)$(DATADIR)'
	rm -f '$(DESTDIR)$(LIBDIR)'/libcrease.a '$(DESTDIR)$(LIBDIR)'/libcrease.so* '$(DESTDIR)$(LIBDIR)/pkgconfig/crease.pc' '$(DESTDIR)$(BINDIR)/creased'
	rm -f $(foreach m,$(MANUALS),$(call MANUAL,$(m)))
	@for folder in $(foreach f,$(LEFT_EMPTY),'$(DESTDIR)$(f)'); do rmdir "$$folder" 2>/dev/null || true; done

manuals: build/.host build/gcc/creased ## write the manual pages of crease and creased anew, from what they say of themselves
	$(PY) host/backend/manuals.py build/gcc/creased $(PACKAGE)/man

# Needs Python and nothing else.
PACK = $(OUT)/pack/crease.crease.$(VERSION).pack

pack: ## the library as a CMSIS-Pack, in build/pack
	$(PYTHON) host/backend/cmsis_pack.py $(OUT)/pack

check-pack: build/.develop build/.device build/scenes/.stamp pack ## the pack in a project outside, on an emulated Cortex-M7: the bits that Python feels
	cd tests/device && $(abspath $(PY)) pack.py $(abspath $(PACK))

.PHONY: install uninstall manuals pack check-pack
