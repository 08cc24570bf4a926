"""Problems that others have published, with the solution that they give or that can be written down."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

import robots
from framework import NotConverged, ParallelRobot, simulate
from robots.generators import n_four_bar as generator
from tests.robots.test_bricard import energies

GRAVITY = 9.81
SQUEEZER = Path(__file__).parents[1] / "data" / "andrews_squeezer" / "andrews_squeezer.yaml"
TORQUE, DURATION = 0.033, 0.03  # of the squeezer [N m], [s]


def no_torque(t: float) -> list[float]:
    return [0.0]


def without_motor(robot: ParallelRobot) -> ParallelRobot:
    """The robot without the rotor of its drive, which the benchmarks do not have."""
    return replace(robot, rotor_inertia=np.zeros(robot.n_a))


def columns(robot: ParallelRobot, start: str) -> list[int]:
    return [c for c in range(robot.model.nv) if robot.coordinates.name_of(c).startswith(start)]


def leaning(loops: int, t: np.ndarray) -> np.ndarray:
    """Angle of the rods from the vertical after a start upright at 1 rad/s.

    x'^2 = 1 + 4 k sin^2(x / 2), k = g ((N + 1) / 2 + N) / ((N + 1) / 3 + N): a pendulum that turns over,
    x = pi + 2 am(t sqrt(1 + 4 k) / 2 - K(m), m), m = 4 k / (1 + 4 k).
    """
    k = GRAVITY * ((loops + 1) / 2 + loops) / ((loops + 1) / 3 + loops)
    m = 4 * k / (1 + 4 * k)
    return np.pi + 2 * ellipj(t * np.sqrt(1 + 4 * k) / 2 - ellipk(m), m)[3]


def four_bars(folder: Path, loops: int, duration: float, **options):
    robot = without_motor(ParallelRobot.from_file(generator.write(folder, loops)))
    rods = columns(robot, "pivot")
    rates = np.full(robot.model.nv, -1.0)
    rates[rods] = 1.0
    result = simulate(
        robot, no_torque, start=np.zeros(robot.model.nq), start_velocity=rates, duration=duration, **options
    )
    x = leaning(loops, result.times)[:, None]
    return result, np.hypot(*(f(result.q[:, rods]) - f(x) for f in (np.sin, np.cos)))


def test_closed_form_of_the_four_bars_is_a_solution():
    k = GRAVITY * 3.5 / 3

    def slope(t, y):
        return y[1], k * np.sin(y[0])

    other = solve_ivp(slope, (0, 10), [0.0, 1.0], "DOP853", rtol=1e-12, atol=1e-12, t_eval=[1, 5, 10])
    np.testing.assert_allclose(leaning(2, other.t), other.y[0], atol=1e-8)


def test_two_four_bars_for_ten_seconds(tmp_path):
    """IFToMM A02: each loop loses a rank whenever the rods are level, some ten times here.

    A step that falls badly on a passage loses some digits there, so several runs judge the drift.
    """
    growth, gaps = [], []
    for k in range(3):
        result, off = four_bars(tmp_path / str(k), 2, 10.0, tolerance=1e-12 * (1.0 + 1e-3 * k))
        assert off.max() < 1e-7  # [m]; the goal is 1e-6
        assert result.energy_error < 1e-9
        assert result.unresolved < 1e-8
        growth.append(off[250:].max() / off[:250].max())
        gaps.append(result.closure_error)
    level = np.abs(np.cos(leaning(2, result.times)))
    assert np.sum((level[1:-1] < level[:-2]) & (level[1:-1] < level[2:])) >= 10  # passages
    assert np.median(growth) < 100  # no drift
    assert np.median(gaps) < 1e-12
    assert max(gaps) < 1e-9


def squeezed(**options):
    """The squeezer from its reference under its torque."""
    robot = ParallelRobot.from_file(SQUEEZER)
    return simulate(robot, lambda t: [TORQUE], duration=DURATION, **options)


@pytest.mark.parametrize(("method", "allowed"), [("reference", 5e-11), ("stiff", 1e-6)])
def test_andrews_squeezer(method, allowed):
    """F. Mazzia and C. Magherini, Test Set for Initial Value Problem Solvers, release 2.4, Bari 2008.

    `angles.txt` has its angles at the end by two programs; those published are right to nine digits.
    """
    result = squeezed(method=method)
    end = {result.robot.coordinates.name_of(c): value for c, value in enumerate(result.q[-1])}
    lines = SQUEEZER.with_name("angles.txt").read_text(encoding="utf-8").splitlines()
    angles = dict(line.split() for line in lines if not line.startswith("#"))
    assert {joint: end[joint] for joint in angles} == pytest.approx(
        {joint: float(angle) for joint, angle in angles.items()}, abs=allowed
    )


def test_andrews_squeezer_in_fixed_steps():
    """Steps of a millisecond turn the squeezer three radians wrong: refused, with a step that would do."""
    exact = squeezed(method="stiff").configuration(DURATION)[0]
    with pytest.raises(NotConverged, match=r"leave about .* about 0.0001 s leave a tenth of"):
        squeezed(method="fast")
    for step in (2e-4, 5e-5):
        result = squeezed(method="fast", step=step)
        error = np.abs(result.q[-1] - exact).max()
        assert error / 5 < result.unresolved < 5 * error


def test_bricard_for_ten_seconds_keeps_its_energy():
    """IFToMM A04: released at rest, one degree of freedom, so that M(x) x'^2 / 2 + V(x) = V(x_0) says all."""
    robot = without_motor(robots.load("bricard"))
    start = robot.q_near * 0.0
    result = simulate(robot, no_torque, start=start, duration=10.0, samples=101)
    assert result.energy_error < 1e-10
    assert result.closure_error < 1e-12
    x, rate = result.platform(result.times)[:, 0], result.platform(result.times, order=1)[:, 0]
    inertia, height = np.array([energies(angle) for angle in x]).T
    np.testing.assert_allclose(0.5 * inertia * rate**2 + height, energies(x[0])[1], atol=1e-8)
    assert np.ptp(x) > 0.5


@pytest.mark.slow
def test_a_quadruped_falls_through_its_folded_legs():
    """All four legs fold at once, foot against hip: all loops lose rank, and the motion may branch there.

    To 1e-7 there is a way on that keeps the energy; to 1e-12 there is none, and this is said.
    """
    robot = robots.load("standing_quadruped")
    limp = [0.0] * robot.n_a
    result = simulate(robot, lambda t: limp, duration=0.3, method="stiff")
    assert result.energy_error < 1e-6
    assert np.abs(result.q[-1, robot.actuated]).max() > 3.5  # folded further than half a turn
    with pytest.raises(NotConverged, match="loops lock or branch"):
        simulate(robot, lambda t: limp, duration=0.3)
