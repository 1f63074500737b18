/* Capacities and numeric limits of the firmware. Every value has a unit, a range check and a reason.
 * Override with -DNAME=value; the state size and the worst-case tick grow with the capacities (DESIGN.md, "Budgets"). */
#ifndef CR_CONFIG_H
#define CR_CONFIG_H

/* Points per cluster and spheres per group: the width of every vector loop. The image is built for it, so it is a
 * property of the format, not a knob. */
#define CR_LANES 16

/* 1: lookups go lane by lane, and only where they are asked for; 0: sixteen lanes abreast, which compilers turn into vector code. The
 * answers are the same to the bit. A Cortex-M7 has no vectors of float, and takes a third of the instructions with 1. */
#ifndef CR_SCALAR
#if defined(__SSE2__) || defined(__ARM_NEON)
#define CR_SCALAR 0
#else
#define CR_SCALAR 1
#endif
#endif
#if CR_SCALAR != 0 && CR_SCALAR != 1
#error "CR_SCALAR: 0 or 1"
#endif

/* 1: what must hold inside is checked as it runs, for 3 % more instructions, and the port defines cr_assert_failed (asserts.h). 0: no code of it. */
#ifndef CR_ASSERTS
#define CR_ASSERTS 0
#endif
#if CR_ASSERTS != 0 && CR_ASSERTS != 1
#error "CR_ASSERTS: 0 or 1"
#endif

/* Depth of the sphere tree in groups. 16^6 clusters hold 268 million points; the traversal stack has this length. */
#ifndef CR_TREE_DEPTH_MAX
#define CR_TREE_DEPTH_MAX 6
#endif
#if CR_TREE_DEPTH_MAX < 2 || CR_TREE_DEPTH_MAX > 8
#error "CR_TREE_DEPTH_MAX: 2..8 levels"
#endif

/* Clusters in contact that one tick may keep. 528 clusters are 8,448 points: at 2 mm spacing a patch of 183 x 183 mm. With
 * more, servo and world would exceed 64 KiB. What does not fit is left out and counted in stats.clusters_dropped. */
#ifndef CR_CLUSTERS_MAX
#define CR_CLUSTERS_MAX 528
#endif
#if CR_CLUSTERS_MAX < 16 || CR_CLUSTERS_MAX > 65535
#error "CR_CLUSTERS_MAX: 16..65535 clusters"
#endif

/* Work of a tick in lookups of 16 points, unless cr_config says otherwise: what is looked up, and what is made of it, weighed by what it costs.
 * So much takes some tenths of a millisecond on a desktop core. An answer that needs more goes on in the next tick (stats.late_ticks). */
#ifndef CR_LOOKUPS_MAX
#define CR_LOOKUPS_MAX 8192
#endif
#if CR_LOOKUPS_MAX < 32 || CR_LOOKUPS_MAX > 1048576
#error "CR_LOOKUPS_MAX: 32..1048576 lookups"
#endif

/* Ticks that a search may take. A hand moves some millimetres in that time: an older pose says little about this one. What was not seen
 * by then is left out and counted in stats.clusters_dropped. */
#ifndef CR_SEARCH_TICKS_MAX
#define CR_SEARCH_TICKS_MAX 32
#endif
#if CR_SEARCH_TICKS_MAX < 1 || CR_SEARCH_TICKS_MAX > 1000
#error "CR_SEARCH_TICKS_MAX: 1..1000 ticks"
#endif

/* Contact areas reported and answered. Further areas join the last one that was kept, and are counted. */
#ifndef CR_AREAS_MAX
#define CR_AREAS_MAX 16
#endif
#if CR_AREAS_MAX < 1 || CR_AREAS_MAX > 64
#error "CR_AREAS_MAX: 1..64 areas"
#endif

/* Contact zones of one area. Projection on the cone of the zone normals needs at most three at a time; eight leave room for
 * pyramids and stars. Further zones of an area are left out by least touched area, and counted. */
#ifndef CR_ZONES_MAX
#define CR_ZONES_MAX 8
#endif
#if CR_ZONES_MAX < 3 || CR_ZONES_MAX > 16
#error "CR_ZONES_MAX: 3..16 zones"
#endif

/* Sweeps of the projected Gauss-Seidel solve for the zone weights, at most: it ends when no weight moves by 1e-6 of the area. */
#ifndef CR_SWEEPS_MAX
#define CR_SWEEPS_MAX 64
#endif
#if CR_SWEEPS_MAX < 1 || CR_SWEEPS_MAX > 1024
#error "CR_SWEEPS_MAX: 1..1024 sweeps"
#endif

#endif
