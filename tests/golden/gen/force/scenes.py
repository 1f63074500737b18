"""Small scenes: static, tool, path. Units mm; a path is [(turn (3, 3), position (3,))]."""

from __future__ import annotations

import manifold3d as mf
import numpy as np
from scipy.spatial.transform import Rotation


def slab(lo, hi):
    return mf.Manifold.cube([b - a for a, b in zip(lo, hi)]).translate(lo)


def move(*stops, step=0.1, turn=(0, 0, 0)):
    """Straight legs between stops (x, y, z[, rx, ry, rz] degrees), `step` mm of motion (a degree counts as 0.2 mm)."""
    full = [np.concatenate([np.asarray(s, float), np.asarray(turn, float)]) if len(s) == 3 else np.asarray(s, float) for s in stops]
    out = []
    for a, b in zip(full, full[1:]):
        n = max(1, int(np.ceil((np.linalg.norm((b - a)[:3]) + 0.2 * np.linalg.norm((b - a)[3:])) / step)))
        out += [a + (b - a) * u for u in np.linspace(0, 1, n, endpoint=False)]
    out.append(full[-1])
    return [(Rotation.from_rotvec(np.radians(p[3:])).as_matrix(), p[:3]) for p in out]


BLOCK = slab((-40, -30, -30), (0, 30, 0))
CUBE = mf.Manifold.cube([10, 10, 10], True)


def union(parts):
    return mf.Manifold.batch_boolean(parts, mf.OpType.Add)


def wedge(deg):
    """A convex edge along y: top plane z = 0 for x < 0, second plane at the inner angle deg."""
    far, a = 40.0, np.radians(deg)
    flat = [(0, 0), (-far, 0), (-far * np.cos(a), -far * np.sin(a))] + ([(-far, -far)] if deg >= 90 else [])
    return mf.Manifold.hull_points([(x, y, z) for x, z in flat for y in (-30, 30)])


SCENES = {}


def scene(name, static, tool, path, h=0.5, **more):
    SCENES[name] = dict(static=static, tool=tool, path=path, h=h, **more)


for deg in (0, 0.1, 1, 5):
    scene(f"edge1_{deg}", BLOCK, mf.Manifold.cube([12, 6, 6], True), move((-8, 0, 2), (7, 0, 2), step=.1, turn=(0, deg, 0)))
scene("edge10_0", BLOCK, mf.Manifold.cube([30, 10, 24], True), move((-20, 0, 2), (17, 0, 2), step=.2), h=.6)
scene("edge10_5", BLOCK, mf.Manifold.cube([30, 10, 24], True), move((-20, 0, 2), (17, 0, 2), step=.2, turn=(0, 5, 0)), h=.6)
pads = [slab((-10, -10, 4), (10, 10, 8))]
for i in (-1, 1):
    for j in (-1, 1):
        pads.append(slab((i * 8 - 2, j * 8 - 2, 0), (i * 8 + 2, j * 8 + 2, 8)))
scene("pads", BLOCK, union(pads), move((-15, 0, .5), (-15, 0, -1), (-15, 0, -1, 2, 1, 0), (11, 0, -1, 2, 1, 0)), h=.5, tparts=pads)
scene("jaw", slab((-5, -20, -10), (5, 20, 10)), slab((-12, -6, -8), (12, 6, 16)) - slab((-3.9, -7, -9), (3.9, 7, 12)),
      move((-.6, 0, 0), (.6, 0, 0), step=.05),
      tparts=[slab((-12, -6, -8), (-3.9, 6, 16)), slab((3.9, -6, -8), (12, 6, 16)), slab((-12, -6, 12), (12, 6, 16))])
legs = slab((-10, -4, 0), (10, 4, 5)) + slab((-10, -4, -10), (-6, 4, 5)) + slab((6, -4, -10), (10, 4, 5))
LEGP = [slab((-10, -4, 0), (10, 4, 5)), slab((-10, -4, -10), (-6, 4, 5)), slab((6, -4, -10), (10, 4, 5))]
scene("legs_ridge", wedge(90).rotate([0, -45, 0]), legs, move((0, 0, 10), (0, 0, -1), (3, 0, -1), (-3, 0, 1)), tparts=LEGP)
scene("legs_floor", BLOCK, legs, move((-15, 0, 10.2), (-15, 0, -.6)), h=.4, tparts=LEGP)
STEPP = [slab((-30, -15, -20), (30, 15, 0)), slab((-30, -15, -20), (0, 15, 6))]
STEP = union(STEPP)
scene("legs_step", STEP, legs, move((5, 0, 10.2), (5, 0, 5.2), (3, 0, 5.0)), h=.4, tparts=LEGP, sparts=STEPP)
scene("inside", STEP, CUBE, move((14, 0, 6), (14, 0, 4.3), (4.2, 0, 4.3), (4.2, 0, 11), (2.7, 0, 10.2), (-10, 0, 10.2), step=.1), sparts=STEPP)
scene("pocket", slab((-20, -20, -10), (20, 20, 0)) - slab((-5.15, -5.15, -6), (5.15, 5.15, 1)), CUBE,
      move((1.15, 0, 6), (1.15, 0, -.5), (1.15, 1.15, -.5), (1.15, 1.15, -2), (-1, 1, -2), (-.3, .2, -2, 0, 3, 2)),
      sparts=[slab((-20, -20, -10), (20, 20, -6)), slab((-20, -20, -10), (-5.15, 20, 0)), slab((5.15, -20, -10), (20, 20, 0)),
              slab((-20, -20, -10), (20, -5.15, 0)), slab((-20, 5.15, -10), (20, 20, 0))])
corner3 = slab((-15, -15, -15), (15, 15, 15)) - slab((0, 0, 0), (20, 20, 20))
scene("corner_in", corner3, CUBE, move((6, 6, 6), (4, 4.4, 4.2), (4.4, 4.1, 4.6, 5, 3, 2), (3.6, 4, 5, -4, 8, 3)),
      sparts=[slab((-15, -15, -15), (0, 15, 15)), slab((-15, -15, -15), (15, 0, 15)), slab((-15, -15, -15), (15, 15, 0))])
scene("corner_out", slab((-30, -30, -30), (0, 0, 0)), mf.Manifold.sphere(10, 64),
      [(np.eye(3), 8.5 * v / np.linalg.norm(v)) for v in (np.array([np.sin(a * 1.4) * .8, a * .7 + .05, np.cos(a * 1.4)]) for a in np.linspace(0, 1, 150))])
hole = slab((-15, -15, -20), (15, 15, 0)) - mf.Manifold.cylinder(30, 5.2, 5.2, 96).translate([0, 0, -25]) - mf.Manifold.cylinder(1, 5.2, 6.2, 96).translate([0, 0, -.999])
peg = mf.Manifold.cylinder(20, 5.0, 5.0, 96).translate([0, 0, -10])
scene("peg", hole, peg, move((1.2, 0, 12), (.7, .1, 8, 0, .5, 0), (.5, .3, 2, 0, 1.5, 0), (.2, -.3, -2, .5, 2.5, 0), (-.4, 0, -2, 0, .5, 0)), h=.5)
hexa = mf.Manifold.cylinder(10, 8, 8, 6).translate([0, 0, -5])
jaws = mf.Manifold.cylinder(6, 16, 16, 48).translate([0, 0, -3]) - mf.Manifold.cylinder(8, 8.3, 8.3, 6).translate([0, 0, -4])
scene("spanner", hexa, jaws, move((0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 9), (.6, .2, 0, 0, 0, 9), (.6, .2, 0, 0, 0, -5), (-.5, .6, 0, 1, 1, -5), step=.05), h=.6)
plate = slab((-30, -30, -3), (0, 30, 0))
scene("rim", plate, CUBE, move((-10, 0, 5.5), (-10, 0, 4), (6, 0, 4), (4, 0, 3), (-10, 0, 4.5, 0, 5, 0), step=.1))
for deg in (90, 60):
    a = np.radians(deg)
    R, d = 12.0, 3.0
    pts = [(x, R - d) for x in np.linspace(-10, 0, 30)] + [((R - d) * np.sin(u), (R - d) * np.cos(u)) for u in np.linspace(0, np.pi - a, 60)][1:]
    scene(f"ball{deg}", wedge(deg), mf.Manifold.sphere(R, 64), [(np.eye(3), np.array([x, 0, z])) for x, z in pts], h=.6)
torus = mf.Manifold.revolve(mf.CrossSection.circle(6, 64).translate([14, 0]), 96)
scene("torus", torus, mf.Manifold.sphere(5, 48), [(np.eye(3), np.array([14 + 10 * np.sin(u), 0, 10 * np.cos(u)])) for u in np.linspace(-1.5, 2.5, 120)], h=.5)
scene("torus_ring", torus, mf.Manifold.sphere(20, 96), move((0, 0, 27), (0, 0, 20), (2, 1, 20), (-1, 2, 21), step=.1), h=.8)
bowl = slab((-25, -25, -15), (25, 25, 0)) - mf.Manifold.sphere(22, 96).translate([0, 0, 12])
scene("bowl", bowl, mf.Manifold.sphere(10, 48), move((0, 0, .5), (0, 0, -1), (6, 0, 0), (10, 3, 3), step=.1), h=.5)
sink = slab((-20, -20, -15), (20, 20, 0)) - mf.Manifold.cylinder(8.01, 2, 10, 96).translate([0, 0, -8])
scene("countersink", sink, mf.Manifold.sphere(9, 64), move((0, 0, 6), (0, 0, 1.6), (1, .5, 1.6), (2, 2, 3), step=.1), h=.5)
ELLP = [slab((-15, -5, -5), (15, 5, 5)), slab((5, -5, -15), (15, 5, 5))]
ell = union(ELLP)
scene("ell", BLOCK, ell, move((0, 0, 6), (0, 0, 4.8), (-5.4, 0, 4.8), (-5.2, 0, 6), (-5.6, 0, 4.6), step=.05), tparts=ELLP)
fork = slab((-12, -6, 5), (12, 6, 10)) + slab((-12, -6, -8), (-5.8, 6, 6)) + slab((5.8, -6, -8), (12, 6, 6))
scene("fork", slab((-5, -20, -30), (5, 20, 0)), fork, move((1.2, 0, 2), (1.2, 0, -5.4), (-1.2, 0, -5.4, 0, 3, 0), (0, 0, -5.3, 0, -6, 0)),
      tparts=[slab((-12, -6, 5), (12, 6, 10)), slab((-12, -6, -8), (-5.8, 6, 10)), slab((5.8, -6, -8), (12, 6, 10))])
ring = mf.Manifold.cylinder(5, 10, 10, 96) - mf.Manifold.cylinder(7, 5.2, 5.2, 96).translate([0, 0, -1])
boss = slab((-15, -15, -10), (15, 15, 0)) + mf.Manifold.cylinder(9, 5, 5, 96).translate([0, 0, -1])
scene("ring", boss, ring, move((0, 0, 10), (.6, 0, 6), (.5, .3, -.4), (-.6, 0, 1, 2, 3, 0), (0, 0, .5, 0, 0, 0)), h=.4)
_HALF = 20 * np.tan(np.radians(30))
VPARTS = [mf.Manifold.hull_points([(k * x, y, z) for x, z in ((0, -20), (_HALF, 0), (25, 0), (25, -25), (0, -25)) for y in (-15, 15)]) for k in (-1, 1)]
vgroove = union(VPARTS)
blade = mf.Manifold.cube([2, 10, 30], True)
scene("blade", vgroove, blade, move((0, 0, -2), (0, 0, -4), (1, 0, -4), (-.5, 0, -4.5), (-.5, 0, -4, 0, 10, 0), (1, 0, -3.5, 0, -15, 0), step=.05), sparts=VPARTS)
scene("vball", vgroove, mf.Manifold.sphere(5, 48), move((0, 0, -9), (0, 0, -12), (1, 0, -11.5), (-.6, 0, -11), (2.5, 0, -7), step=.05), sparts=VPARTS)
scene("pin", mf.Manifold.cylinder(20, 2, 2, 48).translate([0, 0, -20]), mf.Manifold.sphere(15, 64), move((.3, 0, 15.5), (.3, 0, 9)), h=.5)
scene("rock", BLOCK, CUBE, move((-15, 0, 4.2), (-15, 0, 4.2, 0, 20, 3), (-15, 0, 4.2, 5, -20, 3), step=.05))
