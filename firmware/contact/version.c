/* version: of the library, for callers that were built apart from it. */
#include "crease.h"

uint32_t cr_version(void) { return CR_VERSION; }
