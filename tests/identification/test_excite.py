"""Motions to record: their limits, their torques by another computation, and what their recordings show."""

from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import InvalidInput, NoAnswer, ParallelRobot, dynamics_at
from framework.cli import main
from framework.identification import Sensors, excite, identify, parametrise_geometry
from framework.identification.base_parameters import (
    collect_link_parameters,
    torque_parameters,
    with_masses_and_motors,
)
from framework.identification.excite import PeriodicMotion, _complete, _Design
from framework.kinematics.linearised_loops import clearance, linearised_at, linearised_at_reference

SENSORS = Sensors(rate=250.0)
ROBOT = robots.load("five_bar_heavy")
LIMITS = {"torque_limit": 0.05, "speed_limit": 40.0, "acceleration": 6.0}


@pytest.fixture(scope="module")
def excitation():
    """The motion that shows the payload of the 5R with heavy legs."""
    return excite(ROBOT, duration=4.0, only=["payload"], sensors=SENSORS, trials=60, **LIMITS)


def test_the_motion_keeps_its_limits_and_rests_at_its_ends(excitation):
    motion = excitation.motion
    t = motion.times
    assert t[-1] == 4.0
    acceleration = np.gradient(np.gradient(motion.x, t, axis=0), t, axis=0)[2:-2]
    size = np.linalg.norm(acceleration, axis=1).max()
    used = [np.abs(motion.torque).max() / 0.05, np.abs(motion.speed).max() / 40.0, size / 6.0]
    assert max(used) <= 1.0 + 1e-3  # differences of 4 ms are off by less
    nearest = clearance(ROBOT, linearised_at(ROBOT, motion.q)).min()
    assert nearest >= 0.3 * clearance(ROBOT, linearised_at_reference(ROBOT))[0]
    assert np.abs(motion.speed[[0, -1]]).max() < 1e-9


def test_its_torques_are_those_of_its_motion(excitation):
    """Rates by differences of the poses of the platform, torques by `dynamics_at`."""
    motion = excitation.motion
    k = np.arange(40, 900, 97)
    h = motion.times[1]
    ahead, here, back = (motion.x[k + i] for i in (1, 0, -1))
    instant = dynamics_at(
        ROBOT, motion.q[k], dx=(ahead - back) / (2 * h), ddx=(ahead - 2 * here + back) / h**2
    )
    np.testing.assert_allclose(instant.torque, motion.torque[k], atol=2e-3 * np.abs(motion.torque).max())
    assert excitation.tracking_error < 1e-6


def test_a_heavier_payload_is_found_to_a_percent(excitation):
    links = collect_link_parameters(ROBOT, torque_parameters(ROBOT))
    values = links.values.copy()
    part = links.link_slices[links.links.index("left_tip")]
    values[part] *= 1.1
    real = ParallelRobot.from_description(with_masses_and_motors(ROBOT, links, values))
    found = identify(ROBOT, excitation.record(real, SENSORS), only=["payload"])
    (mass,) = (quantity for quantity in found.quantities if quantity.determined)
    assert mass.value == pytest.approx(values[part][0], rel=0.01)
    assert mass.value == pytest.approx(values[part][0], abs=4.0 * mass.deviation)
    # the motion was said to show it as well as it does
    (promised,) = excitation.shown
    assert mass.deviation == pytest.approx(promised.deviation, rel=0.3)


@pytest.mark.slow
def test_a_robot_with_other_rods_starts_at_the_motors_of_the_motion(excitation):
    """At the place of the platform instead, feedback would jerk the motors."""
    geometry = parametrise_geometry(ROBOT)
    values = np.zeros(len(geometry.names))
    values[geometry.names.index("right_rod_tip.x")] = 2e-3
    real = ParallelRobot.from_description(geometry.description(values))
    data = excitation.record(real, Sensors(rate=250.0, torque_noise=0.0))
    angles, torques = (data.columns(kind, ROBOT.actuator_names) for kind in ("motor_angle", "torque"))
    np.testing.assert_allclose(angles[0], excitation.motion.angle[0], atol=1e-4)
    assert (np.abs(torques).max(axis=0) < 1.2 * np.abs(excitation.motion.torque).max(axis=0)).all()


def test_a_search_finds_better_motions_than_its_first():
    found = excite(robots.load("three_rrr"), duration=2.0, sensors=Sensors(rate=100.0), trials=40)
    assert found.improvement > 1.5


def test_what_no_motion_can_keep_is_said():
    with pytest.raises(NoAnswer, match="however small, a motor exceeds its torque limit"):
        excite(ROBOT, duration=2.0, torque_limit=1e-9, sensors=SENSORS)
    with pytest.raises(InvalidInput, match="trials: needs a whole number"):
        excite(ROBOT, trials=-1)
    with pytest.raises(InvalidInput, match="--only: 'lift' is none of payload, friction, rotor, "):
        excite(ROBOT, only=["lift"])
    with pytest.raises(InvalidInput, match=r"are 5e\+07 samples, of at least 64 and at most"):
        excite(ROBOT, duration=1e5, seed=20261130)  # a date is a seed


@pytest.mark.slow
@pytest.mark.parametrize("name", ["slider_crank", "gough_stewart", "delta"])
def test_robots_of_all_kinds_have_motions(name):
    found = excite(robots.load(name), duration=3.0, only=["payload"], sensors=Sensors(rate=200.0), trials=30)
    assert found.tracking_error < 1e-6
    assert found.shown


@pytest.mark.slow
def test_the_command_writes_the_motion(tmp_path, capsys):
    file = tmp_path / "motion.csv"
    words = ["excite", "five_bar_heavy", "--duration", "2", "--only", "payload", "--torque-limit", "0.05"]
    assert main([*words, "--sensors", "rate=100", "--out", str(file)]) == 0
    report = capsys.readouterr().out
    assert "left_tip.mass" in report
    assert "forward simulation" in report
    assert file.read_text().startswith("time,motor_angle_left_motor")


def test_what_a_motion_leaves_unknown_is_what_its_motors_that_work_leave():
    """The covariance of unit normals z after noisy torques, by its inverse; an idle motor tells nothing."""
    rng = np.random.default_rng(4)
    T, motors, r, k = 5, 3, 4, 3
    columns, rows = rng.normal(size=(r, k)), rng.normal(size=(T, motors, r))
    torque = rng.normal(size=(T, motors))
    columns[2] = 0.0  # a base parameter that is known
    rows[:, 1], torque[:, 1] = 0.0, 0.0  # a motor that moves nothing
    design = _Design(ROBOT, None, columns, 0.3, *[None] * 6)
    angles = np.zeros((T, motors))
    motion = PeriodicMotion(np.arange(T), None, None, angles, angles, torque, angles, rows)
    information = np.eye(k)
    for motor in (0, 2):
        by_z = rows[:, motor] @ columns / (0.3 * np.abs(torque[:, motor]).max())
        information += by_z.T @ by_z
    known = [0, 1, 3]
    left = np.diag(columns @ np.linalg.inv(information) @ columns.T) / np.diag(columns @ columns.T + 1e-300)
    np.testing.assert_allclose(design.deviation_shares(motion), np.sqrt(left[known]), rtol=1e-10)


def test_digits_are_those_of_a_value_over_its_deviation(excitation):
    quantities = excitation.to_dict()["quantities"]
    shares = [np.abs(quantity["file"]) / quantity["deviation"] for quantity in quantities]
    assert max(shares) > 10.0
    assert [10.0 ** quantity["digits"] for quantity in quantities] == pytest.approx(np.maximum(shares, 1.0))


def test_a_motion_beyond_its_limits_is_made_smaller_and_keeps_its_shape():
    tried = []

    def evaluate(z, times, q):
        tried.append(z)
        return "too much torque"

    design = SimpleNamespace(duration=1.0, period=1.0, evaluate=evaluate, robot=ROBOT)
    z = np.random.default_rng(0).standard_normal((5, 2))
    with pytest.raises(NoAnswer, match="does not keep the limits: too much torque"):
        _complete(design, z, None, 100.0)
    shares = np.array([np.vdot(z, smaller) / np.vdot(z, z) for smaller in tried])
    np.testing.assert_allclose(tried, shares[:, None, None] * z, atol=1e-15)
    assert shares[0] == 1.0
    assert np.all(np.diff(shares) < 0.0)
    assert 0.0 < shares[-1] < 0.5
