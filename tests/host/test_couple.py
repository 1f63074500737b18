"""firmware/couple against scipy's least energy over the true, curved constraints; energy; what must not matter."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from crease.base.native import ffi, lib
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize, nnls
from scipy.spatial.transform import Rotation

F64 = npt.NDArray[np.float64]

K_T, K_R = 2000.0, 5.0
INSIDE_MAX_M = 2e-5
WITHIN_M = 2e-5
"""Of force over k_t, and of torque over k_t and the tool's radius."""
HALF_M = np.array([0.05, 0.03, 0.02])
RADIUS_M = float(np.linalg.norm(HALF_M))
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF_M


class Contact:
    """A half-space and the points of the tool that must stay in it."""

    def __init__(self, normal: Any, offset_m: float, points_m: F64, key: int = 0) -> None:
        self.normal = np.asarray(normal, np.float64) / np.linalg.norm(normal)
        self.offset_m, self.points_m, self.key = offset_m, points_m, key


class Coupling:
    """`cr_couple`, step by step."""

    def __init__(self, friction: float = 0.0, **settings_of: float) -> None:
        config = ffi.new("cr_couple_config *", lib.cr_couple_config_default())
        config.stiffness_N_m, config.stiffness_Nm_rad, config.friction = K_T, K_R, friction
        for name, value in settings_of.items():
            setattr(config, name, value)
        self.memory = ffi.new("cr_couple *")
        assert lib.cr_couple_init(self.memory, config) == lib.CR_OK
        self.out = ffi.new("cr_couple_output *")

    def step(
        self, at_m: F64, turn: Rotation, contacts: list[Contact], period_s: float = 1e-3
    ) -> F64:
        """One period.   Output  force and torque, (6,)."""
        x, y, z, w = turn.as_quat()
        pose = ffi.new("cr_pose *", {"pos_m": tuple(at_m), "rot": (w, x, y, z)})
        given_c = ffi.new("cr_couple_contact[]", max(1, len(contacts)))
        for c, to in zip(contacts, given_c, strict=False):
            to.key, to.offset_m, to.point_count = c.key, c.offset_m, len(c.points_m)
            to.normal_world = tuple(c.normal)
            for i, point in enumerate(c.points_m):
                to.point_tool_m[i] = tuple(point)
        lib.cr_couple_step(self.memory, pose, period_s, given_c, len(contacts), self.out)
        f, t = self.out.force_world_N, self.out.torque_world_Nm
        return np.array([f.x, f.y, f.z, t.x, t.y, t.z])

    @property
    def held_m(self) -> F64:
        """Position of the held tool."""
        p = self.out.held.pos_m
        return np.array([p.x, p.y, p.z])

    @property
    def held_turn(self) -> Rotation:
        """Attitude of the held tool."""
        q = self.out.held.rot
        return Rotation.from_quat([q.x, q.y, q.z, q.w])

    def stored_J(self, at_m: F64, turn: Rotation) -> float:
        """Energy of the springs."""
        apart, lean = at_m - self.held_m, (turn * self.held_turn.inv()).as_rotvec()
        return float(0.5 * K_T * apart @ apart + 0.5 * K_R * lean @ lean)


def left_jacobian(r: F64) -> F64:
    """How a turn by the rotation vector r turns further when r grows."""
    angle = float(np.linalg.norm(r))
    k = np.cross(np.eye(3), -r)
    if angle < 1e-6:
        return np.eye(3) + 0.5 * k
    found: F64 = (
        np.eye(3)
        + (1 - np.cos(angle)) / angle**2 * k
        + (angle - np.sin(angle)) / angle**3 * (k @ k)
    )
    return found


def quasi_static(at_m: F64, turn: Rotation, contacts: list[Contact]) -> F64:
    """Wrench of the least energy outside: SLSQP in double over position and rotation vector, nothing linearised."""
    points = np.concatenate([c.points_m for c in contacts])
    normals = np.concatenate([np.tile(c.normal, (len(c.points_m), 1)) for c in contacts])
    offsets = np.concatenate([np.full(len(c.points_m), c.offset_m) for c in contacts])
    reach = np.sqrt(K_R / K_T)

    def arms(x: F64) -> F64:
        found: F64 = (Rotation.from_rotvec(1e-3 * x[3:] / reach) * turn).apply(points)
        return found

    def gaps(x: F64) -> F64:
        found: F64 = 1e3 * (np.sum(normals * (arms(x) + at_m + 1e-3 * x[:3]), axis=1) - offsets)
        return found

    def slopes(x: F64) -> F64:
        turning = np.cross(arms(x), normals) @ left_jacobian(1e-3 * x[3:] / reach) / reach
        return np.hstack([normals, turning])

    def rest_of(x: F64) -> float:
        """What the forces of the points do not balance; infinite where one is inside."""
        pressed = slopes(x)[gaps(x) < 1e-5].T
        rest = nnls(pressed, x)[1] if pressed.size else float(np.linalg.norm(x))
        return float(rest) if gaps(x).min() > -1e-6 else np.inf

    # From one beginning in fifty it goes round in circles, from another it ends: the balance tells.
    rng = np.random.default_rng(0)
    begin = np.zeros(6)
    for _ in range(40):
        x = minimize(
            lambda x: 0.5 * x @ x,
            begin,
            jac=lambda x: x,
            constraints={"type": "ineq", "fun": gaps, "jac": slopes},
            method="SLSQP",
            options={"maxiter": 100, "ftol": 1e-13},
        ).x
        if rest_of(x) < 1e-4:
            return 1e-3 * np.concatenate([K_T * x[:3], K_R / reach * x[3:]])
        begin = np.concatenate([rng.uniform(2, 6, 3), rng.uniform(-1, 1, 3)])
    raise AssertionError("the reference finds no place where the forces of the points balance")


def corner(play_m: float = 0.0) -> list[Contact]:
    """A corner of three faces at the origin, and what of a box may touch each."""
    return [Contact(np.eye(3)[i], -play_m, CORNERS[CORNERS[:, i] < 0], key=i) for i in range(3)]


def assert_wrench_near(found: F64, right: F64) -> None:
    """Within the goal of the coupling: 0.02 mm of force, and of torque at the tool's radius."""
    assert np.abs(found[:3] - right[:3]).max() <= WITHIN_M * K_T
    assert np.abs(found[3:] - right[3:]).max() <= WITHIN_M * K_T * RADIUS_M


small = st.floats(-1.0, 1.0, allow_nan=False)
six = st.tuples(small, small, small, small, small, small)


@settings(max_examples=60, deadline=None)
@given(six)
@example((1.0, 0.0, 1.0, 0.75, 1.0, 1.0))
@example((1.0, 0.0, 0.0, 1.0, 1.0, 1.0))
@example((-1.0, -0.5, -0.7, 1.0, 0.75, -1.0))
def test_wrench_in_a_corner_is_the_quasi_static_one(where: tuple[float, ...]) -> None:
    at_m = HALF_M + 0.004 * np.array(where[:3]) - 0.002
    turn = Rotation.from_rotvec(0.1 * np.array(where[3:]))
    coupling = Coupling()
    for i in range(120):  # the hand comes from outside
        wrench = coupling.step(at_m + max(0.0, 1.0 - i / 100) * 0.02, turn, corner())
        assert coupling.out.inside_m <= INSIDE_MAX_M
    assert_wrench_near(wrench, quasi_static(at_m, turn, corner()))


@settings(max_examples=40, deadline=None)
@given(six, st.sampled_from([4e-4, 1e-4, 2e-5]))
def test_wrench_of_a_peg_in_a_square_hole_is_the_quasi_static_one(
    where: tuple[float, ...], play_m: float
) -> None:
    half = np.array([0.01, 0.01, 0.03])
    corners = CORNERS / HALF_M * half
    walls = [
        Contact(sign * np.eye(3)[i], -half[i] - play_m / 2, corners[corners[:, i] * sign < 0], key=2 * i + (sign > 0))
        for i in (0, 1)
        for sign in (-1, 1)
    ]  # fmt: skip
    coupling = Coupling()
    at_m, turn = 0.002 * np.array(where[:3]), 0.05 * np.array(where[3:])
    for i in range(130):
        t = min(1.0, i / 100)
        wrench = coupling.step(t * at_m, Rotation.from_rotvec(t * turn), walls)
        assert coupling.out.inside_m <= INSIDE_MAX_M
    right = quasi_static(at_m, Rotation.from_rotvec(turn), walls)
    assert np.abs(wrench[:3] - right[:3]).max() <= WITHIN_M * K_T
    assert np.abs(wrench[3:] - right[3:]).max() <= WITHIN_M * K_T * 0.033


def closed_way(seed: int, steps: int) -> list[tuple[F64, Rotation]]:
    """A closed way of the hand in and out of a corner, a few waves of each coordinate."""
    rng = np.random.default_rng(seed)
    phase, size = rng.uniform(0, 2 * np.pi, (6, 3)), rng.normal(size=(6, 3))
    angle = np.linspace(0, 2 * np.pi, steps, endpoint=False)
    parts = [size[:, m, None] * np.sin((m + 1) * angle + phase[:, m, None]) for m in range(3)]
    waves = np.sum(parts, axis=0)
    at, turn = HALF_M + 0.003 * waves[:3].T, Rotation.from_rotvec(0.05 * waves[3:].T)
    return [(at[i], turn[i]) for i in range(steps)]


def go_round(coupling: Coupling, way: list[tuple[F64, Rotation]]) -> tuple[float, float, float]:
    """Energy given to the hand over the second round, largest energy stored, largest change of force in a step."""
    given_J = stored_J = change_N = 0.0
    wrench = np.zeros(6)
    for i in range(2 * len(way) + 1):
        at_m, turn = way[i % len(way)]
        before, wrench = wrench, coupling.step(at_m, turn, corner())
        assert coupling.out.faults == 0
        assert coupling.out.inside_m <= INSIDE_MAX_M
        if i > len(way):
            last_m, last_turn = way[(i - 1) % len(way)]
            moved = np.concatenate([at_m - last_m, (turn * last_turn.inv()).as_rotvec()])
            given_J += 0.5 * float((wrench + before) @ moved)
            stored_J = max(stored_J, coupling.stored_J(at_m, turn))
            change_N = max(change_N, float(np.abs(wrench - before)[:3].max()))
    return given_J, stored_J, change_N


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_a_closed_way_of_the_hand_gives_it_no_energy(seed: int, friction: float) -> None:
    given_J, stored_J, _ = go_round(Coupling(friction), closed_way(seed, 2000))
    assert given_J <= 1e-3 * stored_J
    assert friction > 0 or given_J >= -5e-3 * stored_J


def test_half_the_step_is_half_the_largest_change_of_force() -> None:
    for seed in range(3):
        changes = [go_round(Coupling(), closed_way(seed, n))[2] for n in (1000, 2000)]
        assert changes[1] <= 0.55 * changes[0]


@settings(max_examples=40, deadline=None)
@given(six, st.sampled_from([0.0, 0.3]), st.integers(1, 5))
def test_contacts_told_again_change_nothing_and_none_is_stiffer_than_the_springs(
    where: tuple[float, ...], friction: float, times: int
) -> None:
    at_m = HALF_M + 0.003 * np.array(where[:3]) - 0.002
    turn = Rotation.from_rotvec(0.05 * np.array(where[3:]))
    many = [
        Contact(c.normal, c.offset_m, c.points_m, c.key + 10 * n)
        for n in range(times + 1)
        for c in corner()
    ]
    plain, repeated = Coupling(), Coupling()
    for i in range(120):
        at = at_m + max(0.0, 1.0 - i / 100) * 0.02
        one, two = plain.step(at, turn, corner()), repeated.step(at, turn, many)
    assert np.abs(one - two)[:3].max() <= 5e-6 * K_T
    assert np.abs(one - two)[3:].max() <= 5e-6 * K_T * RADIUS_M
    rough = Coupling(friction)
    for _ in range(50):
        before = rough.step(at_m, turn, many)
    moved = 1e-4 * np.array(where[:3])
    after = rough.step(at_m + moved, turn, many)
    assert np.linalg.norm(after - before) <= 1.02 * K_T * np.linalg.norm(moved) + 1e-3


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(six, st.floats(-0.2, 0.2)), min_size=0, max_size=24),
    st.lists(six, min_size=3, max_size=6),
    st.floats(0.0, 1.0),
    st.sampled_from([0.0, 5.0]),
)
def test_whatever_the_contacts_the_wrench_is_finite_and_that_of_the_springs(
    walls: list[tuple[tuple[float, ...], float]],
    hands: list[tuple[float, ...]],
    friction: float,
    damping: float,
) -> None:
    contacts = [
        Contact((w[0], w[1], w[2] + 1.1), offset, CORNERS[: 1 + i % 4] * w[3:], key=i)
        for i, (w, offset) in enumerate(walls)
    ]
    coupling = Coupling(friction, damping_Ns_m=damping)
    for hand in hands:
        at_m, turn = 0.1 * np.array(hand[:3]), Rotation.from_rotvec(2.0 * np.array(hand[3:]))
        wrench = coupling.step(at_m, turn, contacts)
        assert coupling.out.faults == 0
        assert np.isfinite(wrench).all()
        assert coupling.out.iterations <= lib.CR_COUPLE_ITERATIONS_MAX
        if coupling.out.pressing == 0:
            assert not wrench.any()
        elif damping == 0.0:
            assert np.allclose(wrench[:3], K_T * (coupling.held_m - at_m), atol=1e-6 * K_T)
