/* On which side of a plane or line a point lies: never wrong, however near. */
#ifndef CR_EXACT_H
#define CR_EXACT_H

/* Purpose  sign of the volume of the tetrahedron a, b, c, d: of det(b - a, c - a, d - a).
 * Shapes   three coordinates each; finite, and differences either zero or between 1e-80 and 1e80.
 * Output   1: d lies on the side to which (b - a) x (c - a) points; -1: on the other; 0: exactly in the plane.
 * Cost     15 ns; about 1 us where rounding could decide.
 * Source   Shewchuk 1997, Adaptive Precision Floating-Point Arithmetic (filter A, and expansions without the stages between). */
int cr_exact_side(const double *a, const double *b, const double *c, const double *d);

/* Purpose  the same in a plane: sign of the area of a, b, c, of det(b - a, c - a).   Shapes  two coordinates each.
 * Output   1: counter-clockwise; -1: clockwise; 0: on one line. */
int cr_exact_turn(const double *a, const double *b, const double *c);

#endif
