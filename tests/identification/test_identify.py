"""Identified parameters against those that the data were made with."""

import importlib
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import InvalidInput, NotAssembled, ParallelRobot, Type2Singularity, plan_scene
from framework.cli import main
from framework.dynamics.body_parameters import pseudo_inertia
from framework.identification import Conversions, Identification, Recording, identify
from framework.identification.base_parameters import (
    collect_link_parameters,
    torque_parameters,
    with_masses_and_motors,
)
from framework.identification.least_squares import posterior_root
from framework.identification.measured_motion import (
    MIN_SAMPLES,
    begin_at_first_row,
    measured_motion,
    motor_distances,
    smooth,
)
from framework.identification.recording import HELD_OUT_EVERY
from framework.identification.unknowns import choose_unknowns, rests_on_data
from framework.numerics.arrays import Array
from framework.proofs.assembly_modes import assembly_modes
from framework.proofs.working_modes import working_modes
from tests.benchmarks.intervals import MOTIONS, exact_motion, measure_coverage, record, true_robot
from tests.identification.recorded_motions import exact_motors, measured, motor_columns, planned_motors, sines

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
LONG = {**SINES, "duration": 5.0}
SLOW = {**SINES, "duration": 8.0, "rate": 50.0}
EXACT = sines(TRUE["five_bar_heavy"][0], **SLOW)


def assert_predicted_to_the_noise(found: Identification, true: ParallelRobot, data: Recording) -> None:
    """Torques held out are predicted as by the truth, but for what p parameters take of the noise.

    N equations of a motor with the noise s leave an expected squared error of p s^2 / N in predictions at
    most, and parameters that stay at the file's values add as much. Chance doubles both at most. In M
    equations held out an error of E s^2 meets their noise in a product of the deviation 2 s^2 sqrt(E / M).
    """
    noise = identify(true, data).error_before  # of the truth
    N = found.equations / found.robot.n_a
    share = 2.0 * found.base.rank / N
    most = 1.0 + 2.0 * share + 3.0 * 2.0 * np.sqrt(share / (N / (HELD_OUT_EVERY - 1)))
    assert (found.error_after < np.sqrt(most) * noise).all()


@pytest.mark.parametrize("name", ["five_bar_heavy", pytest.param("three_rrr", marks=pytest.mark.slow)])
def test_torques_held_out_are_predicted_and_the_bodies_can_exist(name):
    nominal, (true, values) = NOMINAL[name], TRUE[name]
    data = measured(sines(true, **SLOW), true, 0)
    found = identify(nominal, data)
    assert found.error_before.min() > 0.1
    assert found.refusal is None
    assert_predicted_to_the_noise(found, true, data)
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
@pytest.mark.parametrize(
    ("name", "motion"),
    [
        *(("five_bar_heavy", motion) for motion in MOTIONS),
        ("three_rrr", "to and fro"),  # whose accelerations are four times their noise
    ],
)
def test_intervals_hold_the_truth_as_often_as_they_say(name, motion):
    """Intervals of 95 %, in 40 runs whose 10 parameters share the noise: within 4 points of it."""
    found = measure_coverage(name, motion, RUNS)
    assert found.share() == pytest.approx(0.95, abs=0.04)
    friction = found.determined.mean(axis=0)[-1]
    assert friction > 0.9


def test_what_rests_on_data_errs_mostly_by_their_noise():
    """Noise of unit rows R leaves P R'R P of the covariance P = (R'R + 1)^-1; errors of the file the rest."""
    rows = np.geomspace(1e-2, 1e2, 5)[:, None] * np.linalg.qr(np.random.default_rng(0).normal(size=(5, 5)))[0]
    sums = np.random.default_rng(1).normal(size=(200, 5)) ** 3
    S = posterior_root(rows)
    P = np.linalg.inv(rows.T @ rows + np.eye(5))
    by_noise = np.einsum("qi,ij,qj->q", sums, P @ rows.T @ rows @ P, sums)
    by_file = np.linalg.norm(sums @ S @ S.T, axis=1)
    most = rests_on_data(np.linalg.norm(sums @ S, axis=1), by_file)
    np.testing.assert_array_equal(most, by_noise > by_file**2)
    assert 0 < most.sum() < len(most)


@pytest.mark.slow
def test_one_stroke_of_a_delta_leads_no_parameter_far_off():
    """A line shows a few sums of forty parameters; the file has to hold the others in every step."""
    assert np.abs(measure_coverage("delta", "stroke", 1).ratios).max() < 4.0


def test_an_error_of_one_rod_is_found_and_named():
    def heavier(links, bodies, motors) -> None:
        bodies[links.index("right_rod")] *= 1.5

    nominal = NOMINAL["five_bar_heavy"]
    true, _ = other_robot(nominal, heavier)
    done: list[int] = []
    found = identify(nominal, measured(sines(true, **SLOW), true, 1), progress=done.append)
    assert done == list(range(1, len(done) + 1))
    assert len(done) > 10
    assert found.changed
    assert all("right_rod" in name for name in found.changed)
    change = dict(zip(found.base.parameters, found.parameters - found.base.described.values, strict=True))
    assert abs(change["right_rod.mx"]) > abs(change["left_rod.mx"])


def test_what_a_short_recording_does_not_show_stays_near_the_file():
    """A rod half as heavy again is seen in 1 s, dampings of 0.01 N m s/rad are not."""

    def heavier(links, bodies, motors) -> None:
        bodies[links.index("right_rod")] *= 1.5
        motors[:, 1] = 0.01

    nominal = NOMINAL["five_bar_heavy"]
    true, _ = other_robot(nominal, heavier)
    found = identify(nominal, measured(sines(true, duration=1.0, **SINES), true, 1))
    change = found.base.combinations.coefficients @ (found.parameters - found.base.described.values)
    unseen = [name in found.undetermined for name in found.base.names]
    assert any(unseen)
    by_file = np.linalg.norm(choose_unknowns(found.base, found.links).design, axis=1)
    assert (np.abs(change) < by_file)[unseen].all()  # where the file itself may be off
    assert np.linalg.norm(found.error_after) < np.linalg.norm(found.error_before)
    back = found.identified_robot()
    for name, damping in zip(back.actuator_names, back.joint_damping[back.actuated], strict=True):
        if f"{name}.damping" in found.undetermined:
            assert damping < found.deviations[found.base.names.index(f"{name}.damping")]
    for body in torque_parameters(back).values[: -3 * back.n_a].reshape(-1, 10):
        moments = np.linalg.eigvalsh(pseudo_inertia(body))
        assert moments.min() > -1e-13 * moments.max()


@pytest.mark.slow
def test_a_twin_no_better_than_the_file_is_not_written(tmp_path, capsys):
    """The file's own robot: nothing but noise can be found, and the answer is no."""
    robot = NOMINAL["five_bar_heavy"]
    file = tmp_path / "data.csv"
    file.write_text(
        measured(sines(robot, **{**SINES, "duration": 1.0, "rate": 125.0}), robot, 0, torque=0.1).as_csv()
    )
    assert main(["identify", "five_bar_heavy", str(file), "--out", str(tmp_path / "twin")]) == 1
    said = capsys.readouterr()
    assert "no better than" in said.err
    assert "friction alone" in said.out
    assert not (tmp_path / "twin").exists()


@pytest.mark.slow
def test_torques_in_steps_that_hide_the_motion_are_the_reason():
    robot = NOMINAL["five_bar_heavy"]
    data = measured(sines(robot, **SLOW), robot, 0).rows(slice(150))
    values = data.values.copy()
    steps = 0.5 * np.abs(values[:, 3:5]).max(axis=0)
    values[:, 3:5] = np.round(values[:, 3:5] / steps) * steps
    found = identify(robot, Recording("coarse", data.names, values))
    assert found.refusal is not None
    assert "steps of 50 % of its largest value" in str(found.refusal)


def payload(name: str, link: str, *, size: float, held_out: bool):
    """What a recording of 5 s shows of a payload a tenth heavier, and its true mass and first moment."""
    nominal = robots.load(name)

    def heavier(links, bodies, motors) -> None:
        bodies[links.index(link)] *= 1.1

    true, _ = other_robot(nominal, heavier)
    settings = {"size": size, "rate": 125.0}
    other = measured(sines(true, duration=2.5, seed=4, **settings), true, 1) if held_out else None
    data = measured(sines(true, duration=5.0, seed=0, **settings), true, 0)
    found = identify(nominal, data, only=["payload"], held_out=other)
    links = collect_link_parameters(true, torque_parameters(true))
    return found, links.values[10 * links.links.index(link) :][:4]


def test_the_mass_of_a_payload_is_known_to_a_percent_and_nothing_else_changes():
    found, (mass, *_) = payload("five_bar_heavy", "left_tip", size=0.03, held_out=True)
    assert found.refusal is None
    (shown,) = (quantity for quantity in found.quantities if quantity.determined)
    assert shown.name == "left_tip.mass"
    assert shown.value == pytest.approx(mass, abs=4.0 * shown.deviation)
    assert shown.deviation < 0.01 * mass
    for name, part in zip(found.links.links, found.links.link_slices, strict=True):
        if name != "left_tip":
            np.testing.assert_array_equal(found.link_values[part], found.links.values[part])


@pytest.mark.slow
def test_mass_and_centre_of_a_platform_are_known_to_a_percent():
    found, (mass, *moments) = payload("gough_stewart", "platform", size=0.1, held_out=False)
    assert found.refusal is None
    shown = {quantity.name: quantity for quantity in found.quantities}
    assert shown["platform.mass"].value == pytest.approx(mass, rel=0.01)
    for axis, moment in zip("xyz", moments, strict=True):
        centre = shown[f"platform.centre_{axis}"]
        assert centre.value == pytest.approx(moment / mass, abs=0.01 * found.robot.length)
        assert centre.value == pytest.approx(moment / mass, abs=4.0 * centre.deviation)


@pytest.mark.slow
def test_intervals_of_a_payload_hold_the_truth_from_a_poor_stroke(monkeypatch):
    """Mass and centre in 40 runs of one stroke: 95 % within 4 points, 2 deviations of chance."""
    monkeypatch.setitem(MOTIONS, "stroke", (1.0, 125.0))
    nominal = robots.load("gough_stewart")

    def heavier(links, bodies, motors) -> None:
        bodies[links.index("platform")] *= 1.1

    true, _ = other_robot(nominal, heavier)
    links = collect_link_parameters(true, torque_parameters(true))
    mass, *moments = links.values[10 * links.links.index("platform") :][:4]
    truth = [mass, *(moment / mass for moment in moments)]
    exact = exact_motion(true, "stroke", size=0.02)
    inside = []
    for seed in range(RUNS):
        shown = identify(nominal, record(true, exact, seed), only=["payload"]).quantities[:4]
        inside += [abs(q.value - value) < 1.96 * q.deviation for q, value in zip(shown, truth, strict=True)]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.04)


def geared(inertia: float) -> ParallelRobot:
    """The five-bar with these rotor inertias."""

    def change(links, bodies, motors) -> None:
        motors[:, 0] = inertia

    return other_robot(NOMINAL["five_bar_heavy"], change)[0]


@pytest.mark.slow
def test_rotors_that_the_file_does_not_have_are_found_if_they_are_asked_for():
    true = geared(2e-4)
    found = identify(geared(0.0), measured(sines(true, **LONG), true, 0), only=["rotor"])
    assert found.refusal is None
    for rotor in found.quantities:
        assert rotor.determined
        assert rotor.value == pytest.approx(2e-4, abs=4.0 * rotor.deviation)


def mistaken(data: Recording, change) -> Recording:
    """The recording with its columns changed in place."""
    values = data.values.copy()
    change(values)
    return Recording("mistaken", data.names, values)


def scale(columns, factor):
    def change(values: np.ndarray) -> None:
        values[:, columns] *= factor

    return change


def exchange(columns):
    def change(values: np.ndarray) -> None:
        values[:, columns] = values[:, columns[::-1]]

    return change


RIGHT_TORQUE = "torque_right_motor"
RIGHT_MOTOR = ("motor_angle_right_motor", RIGHT_TORQUE)
ANGLES = ("motor_angle_left_motor", RIGHT_MOTOR[0])
LEFT_MOTOR = ("motor_angle_left_motor", "torque_left_motor")
EXCHANGED = tuple(zip(LEFT_MOTOR, RIGHT_MOTOR, strict=True))  # angles, torques


@pytest.mark.parametrize(
    ("change", "declared"),
    [
        (scale([0], 1e3), Conversions(units={"time": "ms"})),
        pytest.param(scale([3, 4], -1.0), Conversions(signs={"torque": -1}), marks=pytest.mark.slow),
        pytest.param(scale([4], -1.0), Conversions(signs={RIGHT_TORQUE: -1}), marks=pytest.mark.slow),
        pytest.param(
            scale([1, 2], np.degrees(1.0)),
            Conversions(units={"motor_angle": "deg"}),
            marks=pytest.mark.slow,
        ),
        pytest.param(scale([3, 4], 1e3), Conversions(units={"torque": "mNm"}), marks=pytest.mark.slow),
        pytest.param(scale([3, 4], 1e2), Conversions(units={"torque": "Ncm"}), marks=pytest.mark.slow),
        pytest.param(
            scale([2, 4], -1.0), Conversions(signs=dict.fromkeys(RIGHT_MOTOR, -1)), marks=pytest.mark.slow
        ),
        pytest.param(scale([5, 6], 1e3), Conversions(units={"platform": "mm"}), marks=pytest.mark.slow),
        pytest.param(exchange([1, 2]), Conversions(swaps=dict(EXCHANGED[:1])), marks=pytest.mark.slow),
        pytest.param(exchange([3, 4]), Conversions(swaps=dict(EXCHANGED[1:])), marks=pytest.mark.slow),
        pytest.param(
            scale([1, 2], 1.0 / 50.0),
            Conversions(units=dict.fromkeys(ANGLES, "50")),
            marks=pytest.mark.slow,
        ),
        pytest.param(exchange([1, 3, 4, 2]), Conversions(swaps=dict(EXCHANGED)), marks=pytest.mark.slow),
    ],
    ids=lambda value: str(value) if isinstance(value, Conversions) else "",
)
def test_a_mistaken_column_is_named_with_the_option_that_declares_it(change, declared):
    data = measured(EXACT, TRUE["five_bar_heavy"][0], 0).rows(slice(150))
    wrong = mistaken(data, change)
    with pytest.raises(InvalidInput) as said:
        identify(NOMINAL["five_bar_heavy"], wrong)
    assert f"but with {declared} only by" in str(said.value)  # and no other fits as well
    back = declared.convert(wrong)
    columns = [back.names.index(name) for name in data.names]
    np.testing.assert_allclose(back.values[:, columns], data.values, rtol=1e-12)


@pytest.mark.slow
def test_a_zero_that_no_platform_tells_is_told_by_the_torques():
    robot = NOMINAL["five_bar_heavy"]
    data = measured(sines(robot, duration=2.0, rate=200.0, size=0.04, seed=3), robot, 0)
    values = data.values[:, :5].copy()
    values[:, 2] += 0.05 * robot.gear_ratio[1]
    with pytest.raises(InvalidInput, match="--zero motor_angle_right_motor=") as said:
        identify(robot, Recording("shifted", data.names[:5], values))
    zero = float(str(said.value).partition("--zero motor_angle_right_motor=")[2].split()[0].strip("),"))
    assert zero == pytest.approx(0.05 * robot.gear_ratio[1], rel=0.05)


@pytest.mark.slow
def test_the_option_that_a_refusal_names_is_taken(tmp_path, capsys):
    file = tmp_path / "data.csv"
    data = measured(EXACT, TRUE["five_bar_heavy"][0], 0).rows(slice(150))
    file.write_text(mistaken(data, scale([0], 1e3)).as_csv())
    assert main(["identify", "five_bar_heavy", str(file)]) == 2
    assert "--unit time=ms" in capsys.readouterr().err
    assert main(["identify", "five_bar_heavy", str(file), "--unit", "time=ms"]) == 0


def test_what_one_stroke_shows_of_sums_is_not_lost():
    """No parameter of a four-bar is determined alone, but their sums predict the torques to the noise."""
    nominal = robots.load("four_bar")
    true, _ = true_robot(nominal)
    data = record(true, exact_motion(true, "stroke"), 1)
    found = identify(nominal, data)
    assert len(found.undetermined) >= found.base.rank / 2
    assert found.error_before.min() > 0.5
    assert_predicted_to_the_noise(found, true, data)
    alone = {quantity.name for quantity in found.quantities if quantity.alone}
    assert {quantity.name for quantity in found.quantities if quantity.determined} <= alone
    assert {f"{joint}.friction" for joint in nominal.actuator_names} <= alone
    assert not {f"{link}.centre_z" for link in found.links.links} & alone  # across the plane
    assert not alone & set(found.base.without_effect)


@pytest.mark.slow
def test_bodies_without_mass_in_the_file_are_found_on_demand():
    """Rods of 1 kg that the file of the 5R does not have."""
    true, theta = true_robot(NOMINAL["five_bar_heavy"])
    found = identify(NOMINAL["five_bar"], record(true, exact_motion(true, "stroke"), 1), massless=True)
    theirs = dict(zip(torque_parameters(true).names, theta, strict=True))
    truth = found.base.combinations.coefficients @ [theirs.get(name, 0.0) for name in found.base.parameters]
    assert (np.abs(found.values - truth) <= 4.0 * found.deviations).all()
    assert found.determined[:2].all()


def test_unequal_time_steps_are_taken_as_they_are():
    """A tenth of the rows is missing, and a gap of 140 ms: friction is found within its interval."""
    nominal, (true, values) = NOMINAL["five_bar_heavy"], TRUE["five_bar_heavy"]
    data = measured(EXACT, true, 0)
    random = np.random.default_rng(0)
    kept = np.sort(random.permutation(len(data))[: len(data) * 9 // 10])
    found = identify(nominal, data.rows(kept[(kept < 100) | (kept > 106)]))
    assert found.refusal is None
    off = found.values - found.base.combinations.coefficients @ values
    assert np.abs(off / found.deviations).max() < 4.0


def test_accelerations_are_not_known_at_the_ends_and_in_a_gap():
    """Their noise there is three times the median: root mean squares of 300 signals of white noise."""
    random = np.random.default_rng(3)
    kept = np.sort(random.permutation(400)[:360])
    times = kept[(kept < 200) | (kept > 208)] / 125.0
    smoothed = smooth(times, random.standard_normal((len(times), 300)), cutoff=15.0)
    noise = np.sqrt(np.mean(smoothed.values[2] ** 2, axis=1))
    known = smoothed.acceleration_known
    assert noise[known].max() < 1.5 * 3.0 * np.median(noise)
    assert noise[~known].min() > 3.0 / 1.5 * np.median(noise)
    assert not known[[0, -1]].any()
    assert 0.9 < known.mean() < 1.0


def test_accelerations_beside_a_rest_are_left_out_as_splines_round_corners_there():
    """Two strokes that meet at rest, where the jerk turns round: against differences of exact angles."""
    robot = NOMINAL["five_bar"]
    t = np.arange(101) / 100.0  # [s]
    u, back = t % 0.5 / 0.5, t % 1.0 >= 0.5
    s = u**3 * (10.0 + u * (6.0 * u - 15.0))  # at rest at both ends
    ds, dds = 30.0 * (u * (1.0 - u)) ** 2 / 0.5, 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / 0.25
    line, sign = np.array([-0.04, -0.06]), np.where(back, -1.0, 1.0)
    x = robot.reference.x + np.outer(np.where(back, 1.0 - s, s), line)
    angles, torques = exact_motors(robot, x, np.outer(sign * ds, line), np.outer(sign * dds, line))
    noise = 1e-5 * np.random.default_rng(0).standard_normal(angles.shape)
    data = Recording("strokes", motor_columns(robot), np.column_stack([t, angles + noise, torques]))
    recorded = measured_motion(robot, data, cutoff=12.0)
    found = robot.gear_ratio * recorded.motion.a[1:-1, robot.actuated]
    error = np.abs(found - np.diff(angles, 2, axis=0) * 100.0**2).max(axis=1)  # (99,)
    known = recorded.acceleration_known[1:-1]
    assert not known[49]
    assert error[known].max() < 0.5 * error[49]
    assert known.mean() > 0.7


def in_another_mode(robot: ParallelRobot, modes: list[Array] | None = None) -> ParallelRobot:
    """The robot with its reference in another mode, by default a working mode at the same platform pose."""
    if modes is None:
        modes = [mode.q for mode in working_modes(robot, robot.reference.x).modes]
    q = next(q for q in modes if np.abs(q - robot.reference.q).max() > 0.5)
    names = {k: robot.coordinates.name_of(k) for k in range(robot.nv)}
    positions = dict(zip(names.values(), robot.coordinates.positions(q[None])[0].tolist(), strict=True))
    return ParallelRobot.from_description(replace(robot.description, reference=positions))


def test_the_working_mode_is_that_of_the_first_row_or_of_start():
    """The platform's columns tell it; without them joints near the first row do."""
    robot = NOMINAL["five_bar_heavy"]
    other = in_another_mode(robot)
    data = sines(other, duration=1.0, **SINES)
    expected = measured_motion(other, data).motion.q
    found = measured_motion(robot, data)
    np.testing.assert_allclose(found.motion.q, expected, rtol=0, atol=1e-9)
    # also where the motors do not lead there
    begin = Recording("begin", data.names, data.values[:MIN_SAMPLES])
    found = measured_motion(robot, begin, poses="platform")
    np.testing.assert_allclose(found.motion.q, expected[:MIN_SAMPLES], atol=1e-2)  # modes are 0.5 apart
    motors = Recording("motors", data.names[:5], data.values[:, :5])
    names = [robot.coordinates.name_of(int(k)) for k in robot.passive]
    start = dict(zip(names, other.coordinates.positions(expected[:1])[0, robot.passive] + 0.05, strict=True))
    found = measured_motion(robot, motors, start=start)
    np.testing.assert_allclose(found.motion.q, expected, rtol=0, atol=1e-9)
    late = data.values.copy()
    late[: len(late) // 2, 5:] = np.nan  # a tracker that begins later says nothing about the first row
    begun = [begin_at_first_row(robot, each, start) for each in (motors, replace(data, values=late))]
    np.testing.assert_array_equal(begun[1].reference.q, begun[0].reference.q)
    with pytest.raises(InvalidInput, match="unknown joint of --start 'knee'"):
        measured_motion(robot, motors, start={"knee": 1.0})


def test_a_first_row_with_the_references_motors_in_another_assembly_mode_is_found(monkeypatch):
    """Also where no path of the platform leads there."""
    robot = NOMINAL["five_bar_heavy"]
    angles = robot.actuated_coordinates(robot.reference.q[None])[0]
    other = in_another_mode(robot, [mode.q for mode in assembly_modes(robot, angles).modes])
    data = sines(other, duration=1.0, **SINES)

    def refuse(*_: object) -> None:
        raise NotAssembled("no path leads there", q=robot.reference.q, residual=1.0)

    monkeypatch.setattr("framework.identification.measured_motion.assemble", refuse)
    found = measured_motion(robot, data).motion.q
    np.testing.assert_allclose(found, measured_motion(other, data).motion.q, rtol=0, atol=1e-9)


def test_a_zero_that_is_off_is_named_with_its_value_and_taken_by_the_option():
    robot = NOMINAL["five_bar_heavy"]
    data = sines(robot, duration=1.0, **SINES)
    values = data.values.copy()
    values[:, 2] += 0.7 * robot.gear_ratio[1]
    shifted = Recording("shifted", data.names, values)
    with pytest.raises(
        InvalidInput, match=r"its zero alone is off: --zero motor_angle_right_motor=35"
    ) as said:
        measured_motion(robot, shifted, poses="platform")
    zero = float(str(said.value).rpartition("=")[2])
    assert zero == pytest.approx(0.7 * robot.gear_ratio[1], rel=1e-4)
    conversions = Conversions(zeros={"motor_angle_right_motor": zero})
    back = measured_motion(robot, conversions.convert(shifted), poses="platform")
    assert back.motor_misfit < 1e-3


def test_the_error_of_a_motion_without_a_singularity_is_known():
    """The delta's `pick` keeps away from Type 2, though its best direction is 40 times its worst."""
    robot = robots.load("delta")
    values = planned_motors(plan_scene(robot, "pick"), 376)
    found = identify(robot, Recording("pick", motor_columns(robot), values), cutoff=20.0)
    assert (found.error_before < 0.02).all()


@pytest.mark.parametrize("poses", ["motors", "platform"])
def test_a_tracker_that_is_slower_and_later_leaves_the_rows_of_the_motors(poses):
    """The poses are those of the motors at all rows from the tracker's first to its last."""
    robot = NOMINAL["five_bar"]
    plan = plan_scene(robot, "A")
    values = planned_motors(plan, 301)
    x = plan.platform(values[:, 0])
    x[np.arange(301) % 4 != 2] = np.nan
    data = Recording("A", (*motor_columns(robot), "platform_x", "platform_y"), np.column_stack([values, x]))
    found = measured_motion(robot, data, cutoff=7.0, poses=poses)
    first, last = (0, 301) if poses == "motors" else (2, 299)
    np.testing.assert_array_equal(found.times, values[first:last, 0])
    motors = robot.gear_ratio * robot.actuated_coordinates(found.motion.q)
    np.testing.assert_allclose(motors, values[first:last, 1:3], rtol=0, atol=1e-3)
    assert found.errors.accelerations.shape[0] == 2 * len(found.times)  # of two signals


@pytest.mark.slow
def test_a_tracker_of_too_few_rows_is_left_out_by_what_the_refusal_says():
    """With the motors' poses the answer is that without its columns."""
    robot = NOMINAL["five_bar_heavy"]
    data = measured(sines(robot, duration=1.0, rate=200.0, size=0.04, seed=3), robot, 0)
    values = data.values.copy()
    values[np.arange(len(values)) % 20 > 0, 5:] = np.nan
    few = replace(data, values=values)
    with pytest.raises(InvalidInput, match=r"11 samples of platform; .* --poses motors does without"):
        identify(robot, few)
    without = Recording("motors", data.names[:5], data.values[:, :5])
    found = [identify(robot, each, poses="motors") for each in (few, without)]
    np.testing.assert_allclose(found[0].values, found[1].values, rtol=1e-6, atol=1e-9)


def test_a_motion_through_type_2_goes_by_the_platform():
    """Scene C is a line of 1.5 s: it shows less than there is to see, and says so."""
    robot = NOMINAL["five_bar_heavy"]
    plan = plan_scene(robot, "C")
    names, values = motor_columns(robot), planned_motors(plan, 1501)
    x = plan.platform(values[:, 0])
    for stride in (4, 5):  # rounding decides on which side of the crossing an instant lies
        with pytest.raises(Type2Singularity, match="poses must come from the measured platform") as refusal:
            measured_motion(robot, Recording("C", names, values[stride // 2 :: stride]))
        np.testing.assert_allclose(refusal.value.platform, plan.crossings[0].platform, atol=2e-3)
    values, x = values[::2], x[::2]
    with_platform = Recording("C", (*names, "platform_x", "platform_y"), np.column_stack([values, x]))
    found = identify(robot, with_platform, cutoff=20.0)
    assert found.poses == "platform"
    assert not all(quantity.determined for quantity in found.quantities)
    assert found.error_after.max() < 0.01
    assert 0.0 < found.motor_misfit < 1e-3
    values[:, 1] += 0.5 * robot.gear_ratio[0]
    elsewhere = Recording("C", with_platform.names, np.column_stack([values, x]))
    with pytest.raises(InvalidInput, match="motor_angle_left_motor contradicts the measured platform"):
        measured_motion(robot, elsewhere, cutoff=20.0, poses="platform")


def test_a_tracker_in_another_frame_is_left_out_by_what_the_refusal_says():
    robot = NOMINAL["five_bar"]
    plan = plan_scene(robot, "A")
    names, values = motor_columns(robot), planned_motors(plan, 301)
    turned = plan.platform(values[:, 0]) @ [[0.9, 0.4], [-0.4, 0.9]]
    tracked = Recording("A", (*names, "platform_x", "platform_y"), np.column_stack([values, turned]))
    with pytest.raises(InvalidInput, match="in another frame, --poses motors does without it"):
        measured_motion(robot, tracked, cutoff=20.0)
    own = measured_motion(robot, Recording("A", names, values), cutoff=20.0)
    without = measured_motion(robot, tracked, cutoff=20.0, poses="motors")
    np.testing.assert_allclose(without.motion.q, own.motion.q, rtol=0, atol=1e-9)


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
        (
            lambda v: v + 1e3 * np.outer(np.arange(301) > 99, [0, 1, 0, 0, 0]),
            {},
            "half a turn or more from one",
        ),
        (lambda v: v, {"cutoff": 1e4}, "cutoff: needs"),
        (lambda v: v, {"poses": "both"}, "poses: needs motors or platform"),
        (lambda v: v, {"prior": 0.0}, "prior: must be greater than zero"),
        (lambda v: v, {"only": ["lift"]}, "--only: 'lift' is none of payload, friction, rotor, "),
        (lambda v: v, {"sensor_errors": {"drift": 1.0}}, "unknown sensor error 'drift'"),
    ],
)
def test_what_cannot_be_identified_from_is_said(change, options, message):
    robot = NOMINAL["five_bar"]
    values = change(planned_motors(plan_scene(robot, "A"), 301))
    names = motor_columns(robot)[: values.shape[1]]
    with pytest.raises(InvalidInput) as said:
        identify(robot, Recording("data", names, values), **options)
    assert message in str(said.value)


@pytest.mark.slow
def test_the_command_line_identifies_and_writes_the_robot(tmp_path, capsys, monkeypatch):
    data = tmp_path / "data.csv"
    true, _ = TRUE["five_bar"]
    recorded = measured(sines(true, **SLOW), true, 0)
    data.write_text(recorded.as_csv())
    assert main(["identify", "five_bar", str(data), "--out", str(tmp_path / "new"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["rank"], len(found["base_parameters"])) == (9, 9)
    assert found["accepted"]
    assert min(found["torque_error_before"].values()) > 0.1
    assert main(["check", found["robot_file"]]) == 0
    capsys.readouterr()
    module = importlib.import_module("framework.identification.base_parameters")
    monkeypatch.setattr(module, "MIN_RANK_GAP", 1e300)
    assert found["certain"]
    assert main(["identify", "five_bar", str(data), "--all"]) == 0
    report = capsys.readouterr().out
    for words in ("left_rod.mx", "friction alone", "uncertain"):
        assert words in report
    # with some unknowns alone, deviations rest on all others as in the file, whose rotors are a fifth off
    assert main(["identify", "five_bar", str(data), "--only", "payload", "friction"]) == 0
    rows = [row for row in capsys.readouterr().out.splitlines() if "motor.friction  " in row]
    assert len(rows) == 2
    assert all("if other values of the file are right" in row for row in rows)
    assert main(["identify", "five_bar", str(tmp_path / "none.csv")]) == 2
    assert "none.csv" in capsys.readouterr().err


def test_offsets_of_motors_are_angles_up_to_whole_turns_or_shares_of_the_length():
    hinged, sliding = robots.load("five_bar"), robots.load("orthoglide")
    assert motor_distances(hinged, np.array([2 * np.pi - 0.1, 0.2])) == pytest.approx([0.1, 0.2])
    assert motor_distances(sliding, sliding.length * np.array([0.1, -0.2, 7.0])) == pytest.approx(
        [0.1, 0.2, 7.0]
    )


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_accelerations_hold_where_time_stamps_jitter(memory):
    """No cutoff makes a quarter of the error, also where one error of a stamp is like the one before."""
    random = np.random.default_rng(0)
    T, last = 2000, slice(100, -100)
    white = random.standard_normal(T)
    late = np.zeros(T)
    for k in range(1, T):
        late[k] = memory * late[k - 1] + np.sqrt(1.0 - memory**2) * white[k]
    omega = 2.0 * np.pi * 0.2 * np.arange(1, 6)
    amplitudes = random.standard_normal((5, 2)) / omega[:, None]
    times = 0.005 * np.arange(T)
    samples = np.sin(np.outer(times + 4e-4 * late, omega)) @ amplitudes
    accelerations = -np.sin(np.outer(times, omega)) @ (omega[:, None] ** 2 * amplitudes)

    def error(cutoff: float | None) -> float:
        return float(np.linalg.norm((smooth(times, samples, cutoff).values[2] - accelerations)[last]))

    assert error(None) < 4.0 * min(map(error, (2.0, 3.0, 4.0)))


def test_friction_alone_explains_no_less_than_nothing():
    """Least squares leave no more than the torques where both are the same data."""
    nominal = robots.load("four_bar")
    data = measured(sines(nominal, duration=4.0, rate=50.0, size=0.03, seed=2), nominal, 0)
    found = identify(nominal, data, held_out=data)
    left = {prediction.model: np.linalg.norm(prediction.errors) for prediction in found.predictions}
    assert left["friction alone"] <= left["zero"] * (1.0 + 1e-9)


def test_smoothing_does_not_know_when_the_clock_was_started():
    times = np.linspace(0.0, 1.0, 201)
    samples = np.sin(np.outer(times, [3.0, 7.0]))
    now, later = (smooth(start + times, samples, cutoff=20.0) for start in (0.0, 64.0))
    np.testing.assert_allclose(later.values, now.values, rtol=0, atol=1e-8 * np.abs(now.values).max())
    np.testing.assert_array_equal(later.acceleration_known, now.acceleration_known)


@pytest.mark.parametrize(("found", "kept"), [([1.0, 2.0], True), ([1.0, 2.5], False), ([0.5, 2.5], False)])
def test_the_values_of_the_file_stay_only_if_none_has_changed(found, kept):
    one = SimpleNamespace(link_values=np.array(found), links=SimpleNamespace(values=np.array([1.0, 2.0])))
    with pytest.deprecated_call():
        assert Identification.keeps_file.fget(one) is kept
