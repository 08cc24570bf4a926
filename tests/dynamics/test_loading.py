"""Loads put on little by little: against the energy of the 5R written anew, where it snaps and where not."""

from functools import cache

import mpmath
import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, NoLaw, assemble, plan_crossing
from framework.dynamics import loading
from framework.dynamics.loaded_balance import DeflectedMotion
from framework.dynamics.loaded_measure import measure_softening
from framework.dynamics.loading import LoadReason, loaded_stack
from framework.dynamics.static_fold import find_static_fold
from framework.dynamics.stiffness import least_stiffness
from framework.dynamics.tangent_stiffness import Load, check_wrench, evaluate_equilibrium
from framework.kinematics.frames import difference, frames_at, integrate_columns
from framework.planning.refusals import LeastSoftening, StaticFold
from framework.singularity.points_on_path import search_path
from framework.tolerances import NEWTON_STEP
from tests.dynamics.upright_robots import drawn
from tests.oracles import five_bar_pose
from tests.oracles.five_bar_pose import BASES, DRIVE, LENGTH, ROD
from tests.oracles.static_fold import fold

ROBOT = "five_bar"
FLEXIBILITY = "flexible_links"
STEPS = 20  # of the load, of the oracle
H = 1e-5  # [m] of its differences


def derivatives(x, start, w):
    """Slope (2,) and Hessian (2, 2) of V - w . x at the payload's place x (2,)."""
    steps = H * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]])
    V = five_bar_pose.energy(x + steps, start) - steps @ w
    mixed = (V[5] + V[6] - V[7] - V[8]) / (4 * H * H)
    hessian = np.array([[V[1] + V[2] - 2 * V[0], 0.0], [0.0, V[3] + V[4] - 2 * V[0]]]) / H**2
    return np.array([V[1] - V[2], V[3] - V[4]]) / (2 * H), hessian + mixed * np.array([[0, 1], [1, 0]])


def followed(x, w):
    """The share of the load at which the payload, followed from x (2,), loses its stiffness; else that."""
    start, x = five_bar_pose.pose(np.array([x])), np.array(x)
    for k in range(STEPS + 1):
        for _ in range(20):
            slope, hessian = derivatives(x, start, w * k / STEPS)
            if np.linalg.eigvalsh(hessian)[0] <= 0:
                return k / STEPS, None
            move = -np.linalg.solve(hessian, slope)
            x = x + move * min(1.0, 2e-3 / np.abs(move).max())
            if np.abs(move).max() < 1e-9:
                break
        else:
            return k / STEPS, None
    return 1.0, np.linalg.eigvalsh(derivatives(x, start, w)[1])[0]


@pytest.mark.parametrize(
    ("y", "force", "snaps"),
    [
        (0.27, -300.0, True),  # above the locus and pushed onto it: a truss that snaps through
        (0.27, 300.0, False),
        (0.22, -300.0, False),  # below it the same force pulls away
        (0.22, 1500.0, True),
    ],
)
def test_the_5r_gives_way_where_its_energy_does(robot, y, force, snaps):
    w = np.array([0.0, force])
    found = loaded_stack(robot, assemble(robot, [0.01, y]).q[None], wrench=w)
    share, softest = followed((0.01, y), w)
    assert (softest is None) == snaps
    assert found.reason[0] == (LoadReason.GIVES_WAY if snaps else LoadReason.CARRIED)
    assert share - 1.0 / STEPS - 1e-6 <= found.share[0] <= share
    if not snaps:
        assert least_stiffness(robot, found.free)[0] == pytest.approx(softest, rel=1e-4)


def test_loads_that_cannot_be_are_refused_and_absurd_ones_are_not_carried(robot):
    with pytest.raises(InvalidInput, match="wrench"):
        loaded_stack(robot, robot.reference.q[None], wrench=[1.0])
    with pytest.raises(InvalidInput, match="no springs"):
        loaded_stack(robots.load("five_bar"), robots.load("five_bar").reference.q[None])
    found = loaded_stack(robot, robot.reference.q[None], wrench=[0.0, 1e9])  # a kilometre away
    assert found.reason[0] in (LoadReason.GIVES_WAY, LoadReason.TOO_SOFT)


def test_a_load_is_carried_in_another_mode_where_the_end_has_its_sign(robot, monkeypatch):
    """What gives way gives way in any mode."""
    start = [assemble(robot, [0.01, y]).q for y in (0.36, 0.27)]
    modes, calls = loading.mode_signs, []

    def flipped(robot, linearised):
        calls.append(linearised)
        kept, sign = modes(robot, linearised)
        return kept, sign if len(calls) % 2 else -sign  # of the start, then of the end

    for flip, carried in ((False, LoadReason.CARRIED), (True, LoadReason.OTHER_MODE)):
        if flip:
            monkeypatch.setattr(loading, "mode_signs", flipped)
        found = loaded_stack(robot, np.array(start), wrench=[0.0, -300.0])
        assert found.reason.tolist() == [carried, LoadReason.GIVES_WAY]


def truss(y, locked, load, *, lib=np):
    """Slope (4,) and Hessian (4, 4) of V - load . x of the 5R in y = (angles of cranks, payload's place)."""
    slope, hessian = [0 * y[0]] * 4, [[0 * y[0]] * 4 for _ in range(4)]
    slope[2], slope[3] = slope[2] - load[0], slope[3] - load[1]
    for i, base in enumerate(BASES):
        c, s = LENGTH * lib.cos(y[i]), LENGTH * lib.sin(y[i])
        rod = (y[2] - base[0] - c, y[3] - base[1] - s)
        size = lib.sqrt(rod[0] ** 2 + rod[1] ** 2)
        bent = rod[0] * c + rod[1] * s  # the rod's product with minus the crank's second derivative
        along = {i: (rod[0] * s - rod[1] * c) / size, 2: rod[0] / size, 3: rod[1] / size}  # slope of size
        square = {  # half the second derivatives of size^2
            (i, i): LENGTH**2 + bent, (2, 2): 1, (3, 3): 1, (i, 2): s, (i, 3): -c, (2, 3): 0,
        }  # fmt: skip
        slope[i] = slope[i] + DRIVE * (y[i] - locked[i])
        hessian[i][i] = hessian[i][i] + DRIVE
        for j, first in along.items():
            slope[j] = slope[j] + ROD * (size - LENGTH) * first
            for k, second in along.items():
                curved = (square[min(j, k), max(j, k)] - first * second) / size
                hessian[j][k] = hessian[j][k] + ROD * (first * second + (size - LENGTH) * curved)
    return slope, hessian


def crank_angles(x):
    """Angles (2,) of the cranks with the payload at x (2,), springs at rest."""
    crank = five_bar_pose.pose(np.array([x])).crank[0]
    return np.arctan2(crank[:, 1], crank[:, 0])


def snap(x, w, share, near):
    """Share of the load and payload's place (2,) of the fold near to a guess, to 30 digits."""
    locked = crank_angles(x)

    def fold(*unknowns):
        slope, hessian = truss(unknowns[:4], locked, [unknowns[4] * force for force in w], lib=mpmath)
        return [*slope, mpmath.det(mpmath.matrix(hessian)) / (DRIVE * ROD) ** 2]

    with mpmath.workdps(30):
        root = mpmath.findroot(fold, [*crank_angles(near), *near, share], tol=1e-40, maxsteps=50)
        return float(root[4]), np.array([float(root[2]), float(root[3])])


def stepped(x, w):
    """Share of the load (1 if it carries all of it) and place to which steps in the share follow the truss.

    A step counts if the softest stiffness changes by less than a third in it.
    """
    locked = crank_angles(x)
    y, share, step = np.array([*locked, *x]), 0.0, 1e-3
    first = softest = np.linalg.eigvalsh(truss(y, locked, np.zeros(2))[1])[0]
    while share < 1.0 and softest > 1e-4 * first and step > 1e-14:
        ahead, target, size = y.copy(), min(1.0, share + step), np.inf
        for _ in range(8):
            slope, hessian = truss(ahead, locked, target * np.array(w))
            move = -np.linalg.solve(hessian, slope)
            ahead, size = ahead + move, np.abs(move).max()
            if not 1e-11 < size < 0.1:
                break
        new = np.linalg.eigvalsh(truss(ahead, locked, target * np.array(w))[1])[0]
        if size <= 1e-11 and abs(new - softest) < softest / 3:
            y, share, softest, step = ahead, target, new, 2 * step
        else:
            step /= 2
    return share, y[2:]


def near_type2(count, rng):
    """Places (count, 2) with rods that are nearly on a line, at angles down to 1e-3, on both sides of it."""
    places = []
    while len(places) < count:
        x, angle = rng.uniform([-0.2, 0.02], [0.2, 0.4]), 10 ** rng.uniform(-3, -1) * rng.choice([-1, 1])
        y = x[1] + np.linspace(0.0, 0.05, 201)
        column = np.stack([np.full(len(y), x[0]), y], axis=1)
        column = column[five_bar_pose.reachable(column) > 0.02]
        sines = five_bar_pose.pose(column).sine if len(column) else np.zeros(1)
        crossed = np.flatnonzero(np.diff(np.sign(sines - angle)) * (np.abs(sines[:-1]) > 1e-3))
        places += [column[k] for k in crossed[:1]]
    return np.array(places)


SOFT_PLACE, FORCE = (0.20945440887785466, 0.10879996512734091), (119.8132489174077, 382.560076786355)


def test_a_soft_pose_that_stiffens_carries_the_load(robot):
    found = loaded_stack(robot, assemble(robot, SOFT_PLACE).q[None], wrench=FORCE)
    share, place = stepped(SOFT_PLACE, FORCE)
    assert share == 1.0
    assert found.reason[0] == LoadReason.CARRIED
    np.testing.assert_allclose(place, [0.22370, 0.15291], rtol=0, atol=1e-5)
    reached = robot.platform.coordinates(frames_at(robot, found.q))[0]
    np.testing.assert_allclose(reached, place, rtol=0, atol=1e-9)
    assert np.linalg.eigvalsh(found.free.K[0])[0] > 0


@pytest.mark.parametrize(
    ("x", "w"),
    [((0.01, 0.27), (0.0, -300.0)), ((0.01, 0.22), (0.0, 1500.0)), ((-0.1, 0.25), (100.0, -900.0))],
)
def test_the_snap_is_the_fold_of_the_truss_to_rounding(robot, x, w):
    found = loaded_stack(robot, assemble(robot, x).q[None], wrench=w)
    assert found.reason[0] == LoadReason.GIVES_WAY
    reached = robot.platform.coordinates(frames_at(robot, found.q))[0]
    share, place = snap(x, w, found.share[0], reached)
    assert found.share[0] == pytest.approx(share, rel=1e-11)
    np.testing.assert_allclose(reached, place, rtol=0, atol=NEWTON_STEP)  # whose square is in the share
    stiffness = np.linalg.eigvalsh(found.free.K[0])
    assert abs(stiffness[0]) < 10 * NEWTON_STEP * stiffness[-1]


@pytest.mark.slow
def test_soft_poses_carry_and_snap_as_small_steps_of_the_load_do():
    robot, rng = robots.load("five_bar", flexibility="flexible_links"), np.random.default_rng(3)
    x = near_type2(100, rng)
    w = 10 ** rng.uniform(0.0, 3.0) * np.array([np.cos(2.0), np.sin(2.0)])
    found = loaded_stack(robot, np.array([assemble(robot, place).q for place in x]), wrench=w)
    reached = robot.platform.coordinates(frames_at(robot, found.q))
    carried = np.isin(found.reason, [LoadReason.CARRIED, LoadReason.OTHER_MODE])
    assert 10 < carried.sum() < 90
    assert np.all(carried | (found.reason == LoadReason.GIVES_WAY))
    for k in range(len(x)):
        share, place = stepped(x[k], w)
        assert found.share[k] == pytest.approx(share, rel=1e-3), x[k]
        assert (share == 1.0) == carried[k]
        if carried[k]:
            np.testing.assert_allclose(reached[k], place, rtol=0, atol=1e-8)


# folds of deflections at rest, against arclength in all coordinates, and by the laws of soft springs


@cache
def branch_of(softness):
    """The poses of an upright five-bar; 100 times as soft, its springs give way at both ends of the path."""
    return search_path(drawn(7).robot(softness), drawn(7).path).branch


@pytest.mark.slow
@pytest.mark.parametrize("s", [0.0, 1.0])
def test_a_fold_is_that_of_all_coordinates(s):
    branch, at = branch_of(100.0), np.array([s])
    expected = fold(branch.robot, branch.path(at)[0], branch.guess(at)[0])
    assert find_static_fold(branch, s) == pytest.approx(expected, rel=2e-3)


def test_springs_a_little_stiffer_than_at_the_fold_hold_and_softer_ones_do_not():
    softness = 100.0 * find_static_fold(branch_of(100.0), 1.0)  # of springs at the fold
    assert find_static_fold(branch_of((1.0 - 1e-6) * softness), 1.0) is None
    assert find_static_fold(branch_of(1.02 * softness), 1.0) == pytest.approx(1.0 / 1.02, rel=1e-9)


@pytest.mark.slow
def test_a_plan_is_refused_with_the_fold_and_the_springs_that_hold():
    asked = drawn(7)
    with pytest.raises(NoLaw, match="at rest at s = 0 the springs give way") as refusal:
        plan_crossing(asked.robot(100.0), asked.path, duration=asked.duration, law="optimal")
    fold_at_start = find_static_fold(branch_of(100.0), 0.0)
    assert refusal.value.evidence == StaticFold(0.0, fold_at_start)
    stiffness = float(str(refusal.value).split("springs ")[-1].split(" times")[0])
    assert find_static_fold(branch_of(100.0 / stiffness), 0.0) is None


def softening_at_rest(branch, s):
    """The share of the measure that the robot at rest loses, to first order."""
    at, still = np.array([s]), np.zeros((1, branch.robot.n))
    rest = np.zeros((1, branch.robot.n_e))
    found = measure_softening(branch, DeflectedMotion(at, branch.path(at), still, still, rest, rest, rest))
    return float(-found.h[0] / found.g[0])


@pytest.mark.parametrize("s", [0.0, 1.0])
def test_the_robot_has_lost_half_of_its_measure_at_a_fold(s):
    # near the locus the balance is a quadratic equation, whose roots meet where the measure has halved
    share = softening_at_rest(branch_of(100.0), s)
    assert 0.5 / share == pytest.approx(find_static_fold(branch_of(100.0), s), rel=0.15)  # to first order
    assert softening_at_rest(branch_of(50.0), s) == pytest.approx(0.5 * share, rel=1e-4)


@pytest.mark.slow
def test_a_plan_is_refused_with_the_least_softening_along_the_path():
    asked = drawn(50)
    with pytest.raises(NoLaw, match=r"the springs give way at s = 0\.058") as refusal:
        plan_crossing(asked.robot(3.0), asked.path, duration=asked.duration, law="optimal")
    least = refusal.value.evidence
    assert isinstance(least, LeastSoftening)
    assert 0.5 < least.rho < 0.6
    plan_crossing(asked.robot(1.0), asked.path, duration=asked.duration, law="optimal")


def test_the_stiffness_under_a_force_and_a_moment_is_that_of_an_energy_on_closed_loops():
    """Second differences of V - w . x of a 3-RPR, along motions that are closed again by shortest steps."""
    robot = robots.load("three_rpr", flexibility="flexible_joints")
    w = np.array([40.0, -30.0, 25.0])
    q = robot.reference.q[None]
    load = Load(check_wrench(robot, w), np.ones(1), np.zeros((1, robot.nv)))
    at = evaluate_equilibrium(robot, q, load)
    lengths = robot.column_scale[robot.unlocked]
    data = robot.model.createData()

    def energy(step):
        """V - w . x after a step (f,) from q, closed."""
        there = integrate_columns(robot, q, robot.unlocked, (step * lengths)[None])
        for _ in range(4):
            closing = evaluate_equilibrium(robot, there, load).closing_step
            there = integrate_columns(robot, there, robot.unlocked, closing * lengths)
        offset = difference(robot, robot.reference.q, there[0])
        springs = 0.5 * robot.all_stiffness @ offset**2
        weight = pin.computePotentialEnergy(robot.model, data, there[0])
        return springs + weight - w @ robot.platform.coordinates(frames_at(robot, there))[0]

    h, Z = 1e-4, at.null_space[0]
    for column in Z.T:
        second = (energy(h * column) - 2 * energy(0 * column) + energy(-h * column)) / h**2
        expected = column @ Z @ at.H[0] @ Z.T @ column
        assert second == pytest.approx(expected, abs=1e-5 * np.abs(at.H).max())
