"""Identified parameters against those that the data were made with."""

import importlib
import json

import numpy as np
import pytest

import robots
from framework import InvalidInput, ParallelRobot, Type2Singularity, plan_scene
from framework.cli import main
from framework.dynamics.body_parameters import pseudo_inertia
from framework.identification import Recording, identify
from framework.identification.base_parameters import (
    collect_link_parameters,
    torque_parameters,
    with_masses_and_motors,
)
from framework.identification.measured_motion import measured_motion
from tests.identification.recorded_motions import measured, motor_columns, planned_motors, sines

NOMINAL = {name: robots.load(name) for name in ("five_bar", "five_bar_heavy", "three_rrr")}
RUNS = 40


def other_robot(nominal: ParallelRobot, change) -> tuple[ParallelRobot, np.ndarray]:
    """The robot with other parameters of its links and motors, and those of its bodies and motors."""
    described = torque_parameters(nominal)
    links = collect_link_parameters(nominal, described)
    values = links.values.copy()
    change(
        links.links,
        values[: 10 * len(links.links)].reshape(-1, 10),
        values[10 * len(links.links) :].reshape(-1, 3),
    )
    body = described.values + links.to_parameters @ (values - links.values)
    return ParallelRobot.from_description(with_masses_and_motors(nominal, links, values)), body


def off_by_a_fifth(links, bodies, motors) -> None:
    random = np.random.default_rng(5)
    bodies *= random.uniform(0.8, 1.2, (len(bodies), 1))
    motors[:, 0] *= random.uniform(0.8, 1.2, len(motors))
    motors[:, 1:] = [0.05, 0.2]


TRUE = {name: other_robot(robot, off_by_a_fifth) for name, robot in NOMINAL.items()}
SINES = {"size": 0.03, "rate": 250.0, "seed": 0}
SLOWER = {**SINES, "rate": 125.0}


@pytest.mark.parametrize("name", ["five_bar_heavy", pytest.param("three_rrr", marks=pytest.mark.slow)])
def test_torques_held_out_are_predicted_and_the_bodies_can_exist(name):
    nominal, (true, values) = NOMINAL[name], TRUE[name]
    found = identify(nominal, measured(sines(true, duration=10.0, **SLOWER), true, 0))
    assert found.error_before.min() > 0.1
    assert found.error_after.max() < 0.02
    off = found.values - found.base.combinations.coefficients @ values
    assert np.abs(off / found.deviations).max() < 4.0
    back = found.identified_robot()
    written = torque_parameters(back)
    np.testing.assert_allclose(
        written.values / written.sizes, found.parameters / written.sizes, rtol=0, atol=1e-12
    )
    for body in written.values[: 10 * len(written.bodies)].reshape(-1, 10):
        moments = np.linalg.eigvalsh(pseudo_inertia(body))
        assert moments.min() > -1e-8 * moments.max()


@pytest.mark.slow
def test_parameters_are_within_three_deviations_in_95_percent_of_runs():
    nominal, (true, values) = NOMINAL["five_bar"], TRUE["five_bar"]
    exact = sines(true, duration=2.5, **SINES)
    inside = []
    for seed in range(RUNS):
        found = identify(nominal, measured(exact, true, seed))
        off = found.values - found.base.combinations.coefficients @ values
        inside.append(np.abs(off) < 3.0 * found.deviations)
    assert np.mean(inside, axis=0).min() >= 0.95


def test_an_error_of_one_rod_is_found_and_named():
    def heavier(links, bodies, motors) -> None:
        bodies[links.index("right_rod")] *= 1.5

    nominal = NOMINAL["five_bar_heavy"]
    true, _ = other_robot(nominal, heavier)
    done: list[int] = []
    found = identify(nominal, measured(sines(true, duration=5.0, **SINES), true, 1), progress=done.append)
    assert done == list(range(1, found.instants + 1))
    assert found.changed
    assert all("right_rod" in name for name in found.changed)
    change = dict(zip(found.base.parameters, found.parameters - found.base.described.values, strict=True))
    assert abs(change["right_rod.mx"]) > abs(change["left_rod.mx"])


@pytest.mark.parametrize("duration", [1.0, 2.5])
def test_what_a_short_recording_does_not_show_stays_as_in_the_file(duration):
    """A rod half as heavy again is seen in 1 s, dampings of 0.01 N m s/rad are not."""

    def heavier(links, bodies, motors) -> None:
        bodies[links.index("right_rod")] *= 1.5
        motors[:, 1] = 0.01

    nominal = NOMINAL["five_bar_heavy"]
    true, _ = other_robot(nominal, heavier)
    found = identify(nominal, measured(sines(true, duration=duration, **SINES), true, 1))
    change = found.base.combinations.coefficients @ (found.parameters - found.base.described.values)
    unseen = [name in found.undetermined for name in found.base.names]
    assert any(unseen)
    assert np.abs(change / found.deviations)[unseen].max() < 1e-2
    assert not found.keeps_file
    assert np.linalg.norm(found.error_after) < np.linalg.norm(found.error_before)
    back = found.identified_robot()
    for name, damping in zip(back.actuator_names, back.joint_damping[back.actuated], strict=True):
        if f"{name}.damping" in found.undetermined:
            assert damping == pytest.approx(0.0, abs=1e-5)
    for body in torque_parameters(back).values[: -3 * back.n_a].reshape(-1, 10):
        moments = np.linalg.eigvalsh(pseudo_inertia(body))
        assert moments.min() > -1e-13 * moments.max()


@pytest.mark.slow
def test_no_recording_makes_the_file_worse(tmp_path, capsys):
    """The file's own robot, by noisy torques: what chance shows is written only where it predicts better."""
    robot = NOMINAL["five_bar_heavy"]
    exact, keeping = sines(robot, duration=1.0, **SINES), None
    for seed in range(4):
        data = measured(exact, robot, seed, torque=0.1)
        found = identify(robot, data)
        assert np.linalg.norm(found.error_after) <= np.linalg.norm(found.error_before)
        if found.keeps_file:
            np.testing.assert_array_equal(found.parameters, found.base.described.values)
            keeping = data
    assert keeping is not None
    (tmp_path / "data.csv").write_text(keeping.as_csv())
    assert main(["identify", "five_bar_heavy", str(tmp_path / "data.csv")]) == 0
    assert "the file's stay" in capsys.readouterr().out


def test_the_error_of_a_motion_without_a_singularity_is_known():
    """The delta's `pick` keeps away from Type 2, though its best direction is 40 times its worst."""
    robot = robots.load("delta")
    values = planned_motors(plan_scene(robot, "pick"), 1501)
    found = identify(robot, Recording("pick", motor_columns(robot), values), cutoff=20.0)
    assert (found.error_before < 0.02).all()


def test_a_motion_through_type_2_goes_by_the_platform():
    """Scene C is a line of 1.5 s: it shows less than there is to see, and says so."""
    robot = NOMINAL["five_bar_heavy"]
    plan = plan_scene(robot, "C")
    names, values = motor_columns(robot), planned_motors(plan, 1501)
    x = plan.platform(values[:, 0])
    for stride in (1, 2, 3):  # rounding decides on which side of the crossing an instant lies
        with pytest.raises(Type2Singularity, match="poses must come from the measured platform") as refusal:
            identify(robot, Recording("C", names, values[stride // 2 :: stride]))
        np.testing.assert_allclose(refusal.value.platform, plan.crossings[0].platform, atol=2e-3)
    with_platform = Recording("C", (*names, "platform_x", "platform_y"), np.column_stack([values, x]))
    found = identify(robot, with_platform, cutoff=20.0)
    assert found.poses == "platform"
    assert found.undetermined
    assert found.error_after.max() < 0.01
    assert 0.0 < found.motor_misfit < 1e-3
    values[:, 1] += 0.5 * robot.gear_ratio[0]
    elsewhere = Recording("C", with_platform.names, np.column_stack([values, x]))
    with pytest.raises(InvalidInput, match="motor_angle_left_motor contradicts the measured platform"):
        identify(robot, elsewhere, cutoff=20.0, poses="platform")


def test_whole_turns_of_a_motor_do_not_change_the_motion():
    robot = NOMINAL["five_bar"]
    values, turns = planned_motors(plan_scene(robot, "A"), 301), [0, *(robot.gear_ratio * [1, -2]), 0, 0]
    own, turned = (
        measured_motion(robot, Recording("A", motor_columns(robot), values + more), cutoff=20.0)
        for more in (0.0, 2 * np.pi * np.array(turns))
    )
    np.testing.assert_allclose(turned.motion.q, own.motion.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(turned.motion.a, own.motion.a, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        (lambda v: v[:, :3], {}, "no column torque_left_motor, torque_right_motor"),
        (lambda v: v[:40], {}, "at least 64 are needed"),
        (lambda v: v * [1, 1, 1, 1, 0], {}, "torque_right_motor is zero at all samples"),
        (lambda v: v, {"cutoff": 1e4}, "cutoff: needs"),
        (lambda v: v, {"poses": "both"}, "poses: needs motors or platform"),
        (lambda v: v, {"prior": 0.0}, "prior: must be greater than zero"),
        (lambda v: np.delete(v, 7, axis=0), {}, "time steps differ"),
    ],
)
def test_what_cannot_be_identified_from_is_said(change, options, message):
    robot = NOMINAL["five_bar"]
    values = change(planned_motors(plan_scene(robot, "A"), 301))
    names = motor_columns(robot)[: values.shape[1]]
    with pytest.raises(InvalidInput) as said:
        identify(robot, Recording("data", names, values), **options)
    assert message in str(said.value)


def test_the_command_line_identifies_and_writes_the_robot(tmp_path, capsys, monkeypatch):
    data = tmp_path / "data.csv"
    true, _ = TRUE["five_bar"]
    data.write_text(measured(sines(true, duration=5.0, **SINES), true, 0).as_csv())
    assert main(["identify", "five_bar", str(data), "--out", str(tmp_path / "new"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["rank"], len(found["base_parameters"])) == (9, 9)
    assert max(found["torque_error_after"].values()) < 0.02 < min(found["torque_error_before"].values())
    assert main(["check", found["robot_file"]]) == 0
    capsys.readouterr()
    assert main(["identify", "five_bar", str(data)]) == 0
    assert "left_rod.mx" in capsys.readouterr().out
    module = importlib.import_module("framework.identification.base_parameters")
    monkeypatch.setattr(module, "MIN_RANK_GAP", 1e300)
    assert main(["identify", "five_bar", str(data), "--json"]) == 0
    doubtful = json.loads(capsys.readouterr().out)
    assert (found["certain"], doubtful["certain"]) == (True, False)
    assert "uncertain" in doubtful["warnings"][0]
    assert main(["identify", "five_bar", str(tmp_path / "none.csv")]) == 2
    assert "none.csv" in capsys.readouterr().err
