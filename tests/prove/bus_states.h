/* States of the bus that can come about: what every function of the bus manager leaves as it found it. */
#ifndef BUS_STATES_H
#define BUS_STATES_H

#include "prove.h"

#include "servo/bus_parts.h"

/* `steps`: how many an axis has; it is known to sdo.c only. */
static inline int can_be(const cr_bus *bus, uint32_t steps) {
    return bus->phase <= CR_PHASE_RUN && bus->sdo_axis <= CR_AXES &&
           bus->sdo_step < (bus->sdo_axis < CR_AXES ? steps : 1u);
}

#endif
