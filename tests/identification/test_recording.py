"""Recorded data: read as they were written, and what is wrong with them said in one sentence."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import robots
from framework import InvalidInput, plan_scene, simulate
from framework.cli import main
from framework.identification import Recording, Sensors, read_recording, record_sensors
from framework.identification.conversions import Conversions, _search_zero, load_recording
from framework.identification.measured_motion import check_signals

ROBOT = robots.load("five_bar")
HEADER = "time,motor_angle_left_motor,motor_angle_right_motor,torque_left_motor,torque_right_motor,note"
ROWS = ["0.0,63.5,54.2,0.1,0.2,7", "0.1,63.6,54.3,0.1,0.2,7", "0.2,63.7,54.4,0.1,0.2,7"]


def written(folder: Path, lines: list[str]) -> Path:
    file = folder / "data.csv"
    file.write_text("\n".join(lines) + "\n")
    return file


def test_columns_of_the_robot_are_read_and_others_passed_over(tmp_path):
    data = read_recording(ROBOT, written(tmp_path, [HEADER, *ROWS]))
    assert "note" not in data.names
    np.testing.assert_array_equal(data.column("motor_angle_left_motor"), [63.5, 63.6, 63.7])
    assert not data.has("platform", ["x", "y"])
    with pytest.raises(InvalidInput, match="no column platform_x, platform_y"):
        data.columns("platform", ["x", "y"])


def test_a_quote_without_an_end_is_named_by_the_line_in_which_it_begins(tmp_path):
    torn = ROWS[0].replace("63.5", '"63.5')
    with pytest.raises(InvalidInput, match=r"data.csv: line 5: not a row of CSV"):
        read_recording(ROBOT, written(tmp_path, [HEADER, *ROWS, torn, *ROWS * 2000]))


def test_motion_csv_is_a_recording(tmp_path):
    plan = plan_scene(ROBOT, "A")
    plan.to_csv(tmp_path / "motion.csv")
    data = read_recording(ROBOT, tmp_path / "motion.csv")
    t = data.column("time")
    np.testing.assert_array_equal(data.columns("torque", ROBOT.actuator_names), plan.torque(t))
    assert data.has("joint", ["left_elbow", "right_elbow"])


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (
            [HEADER, ROWS[0], "0.1,63.6,54.3,x,0.2,7"],
            "line 3: torque_left_motor needs a finite number, got 'x'",
        ),
        ([HEADER, ROWS[0], "0.1,63.6,54.3,inf,0.2,7"], "line 3: torque_left_motor needs a finite number"),
        ([HEADER, ROWS[0], "0.1,63.6,54.3,nan,0.2,7"], "1 rows of numbers"),
        (
            [HEADER, *(row.replace(",0.1,0.2", ",0.1,") for row in ROWS)],
            "column torque_right_motor has no number",
        ),
        ([HEADER, ROWS[0], "0.1,63.6,54.3,1e308,0.2,7"], "line 3: torque_left_motor needs a finite number"),
        ([HEADER, ROWS[0], "0.1,63.6"], "line 3: 2 cells for 6 columns"),
        ([HEADER, ROWS[0].replace(".", ",") + ",0"], "12 cells for 6 columns; decimals need points"),
        ([HEADER, ROWS[0]], "1 rows of numbers"),
        ([HEADER, ROWS[1], ROWS[0]], "time does not advance after line 2"),
        ([HEADER, ROWS[0], ROWS[0].replace("63.5", "63.6")], "time does not advance after line 2"),
        (["a,b", "1,2"], "no column of five_bar"),
        (["time,time", "1,2"], "column time is there 2 times"),
        ([""], "data.csv: is empty"),
    ],
)
def test_what_is_wrong_with_data_is_said(tmp_path, lines, message):
    with pytest.raises(InvalidInput) as said:
        read_recording(ROBOT, written(tmp_path, lines))
    assert message in str(said.value)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_other_separators_leave_the_comma_to_decimals(tmp_path, separator):
    lines = [HEADER, *ROWS]
    expected = read_recording(ROBOT, written(tmp_path, lines))
    foreign = [line.replace(",", separator).replace(".", ",") for line in lines]
    data = read_recording(ROBOT, written(tmp_path, ["\ufeff" + foreign[0], *foreign[1:]]))
    assert data.names == expected.names
    np.testing.assert_array_equal(data.values, expected.values)


def test_rows_without_a_number_and_repeated_ones_are_left_out_and_counted(tmp_path):
    gap = [ROWS[0].replace("54.2", "nan"), ROWS[0].replace("0.1", "")]
    data = read_recording(ROBOT, written(tmp_path, [HEADER, *gap, ROWS[0], ROWS[0], *ROWS[1:]]))
    np.testing.assert_array_equal(data.column("time"), [0.0, 0.1, 0.2])
    assert (data.left_out, data.row(1)) == (3, "line 6")
    # without time a row that repeats one is another measurement of the same pose
    poses = [line.partition(",")[2] for line in (HEADER, ROWS[0], ROWS[0], ROWS[1])]
    assert len(read_recording(ROBOT, written(tmp_path, poses))) == 3


def test_columns_with_other_names_are_named_and_declared(tmp_path):
    lines = [HEADER.replace("torque_left_motor", "effort [Nm]"), *ROWS]
    file = written(tmp_path, lines)
    with pytest.raises(InvalidInput, match=r"unread effort \[Nm\], note; --column torque_left_motor=HEADER"):
        read_recording(ROBOT, file).columns("torque", ROBOT.actuator_names)
    declared = Conversions(headers={"torque_left_motor": "effort [Nm]"})
    np.testing.assert_array_equal(load_recording(ROBOT, file, declared).column("torque_left_motor"), 0.1)
    with pytest.raises(InvalidInput, match="unknown header of --column 'effort'"):
        load_recording(ROBOT, file, Conversions(headers={"torque_left_motor": "effort"}))
    twice = Conversions(headers=dict.fromkeys(["torque_left_motor", "torque_right_motor"], "effort [Nm]"))
    with pytest.raises(InvalidInput, match="--column: 2 names for 1 header"):
        load_recording(ROBOT, file, twice)
    with pytest.raises(InvalidInput, match="names columns of a file"):
        load_recording(ROBOT, load_recording(ROBOT, file, declared), declared)


def test_angles_that_begin_anew_are_declared_and_spikes_are_named_by_their_rows():
    times = np.linspace(0.0, 2.0, 400)
    angles = 40.0 * (1.0 - np.cos(times))  # several turns
    friction = 0.1 * np.sign(np.sin(8.0 * times)) + 0.02 * np.sin(50.0 * times)
    values = np.column_stack([times, np.mod(angles, 2.0 * np.pi), angles, friction, friction])
    data = Recording("log", tuple(HEADER.split(",")[:5]), values)
    with pytest.raises(
        InvalidInput, match=r"sample .* begins anew after a turn; --unwrap motor_angle_left_m"
    ):
        check_signals(ROBOT, data)
    counted = Conversions(unwrapped=["motor_angle_left_motor"]).convert(data)
    np.testing.assert_allclose(counted.column("motor_angle_left_motor"), angles, rtol=0, atol=1e-12)
    check_signals(ROBOT, counted)  # steps of dry friction are no spikes
    gap = np.delete(counted.values, slice(300, 331), axis=0)  # in which the motor makes a turn
    check_signals(ROBOT, replace(counted, values=gap))
    with pytest.raises(InvalidInput, match="--unwrap torque: has no angles"):
        Conversions(unwrapped=["torque"]).convert(data)
    for column, spike in ((1, 9.0), (4, -0.5)):
        values = counted.values.copy()
        values[[70, 300], column] += spike
        with pytest.raises(InvalidInput, match=f"sample 71, sample 301: a spike, {data.names[column]} is"):
            check_signals(ROBOT, replace(counted, values=values))
    # a tracker's glitch blames no motor, and motors do without it
    x = 0.2 + 0.05 * np.cos(times)
    x[200] += 0.5
    names = (*counted.names, "platform_x", "platform_y")
    tracked = replace(counted, names=names, values=np.column_stack([counted.values, x, times]))
    with pytest.raises(InvalidInput, match="sample 201: a spike, platform_x is"):
        check_signals(ROBOT, tracked)
    check_signals(ROBOT, tracked, "motors")


def test_turns_are_counted_over_gaps_where_the_speed_tells_them():
    times = np.linspace(0.0, 2.0, 1001)
    angles = 30.0 + 20.0 * np.sin(2.0 * times) ** 2  # up to 40 rad/s
    wrapped = np.column_stack([times, np.mod(angles, 2.0 * np.pi), angles])
    names = ("time", "motor_angle_left_motor", "motor_angle_right_motor")
    count = Conversions(unwrapped=["motor_angle_left_motor"])
    gap = np.delete(wrapped, slice(200, 320), axis=0)  # more than a turn, at a speed that hardly changes
    assert 2.0 * np.pi < np.ptp(angles[199:321])
    found = count.convert(Recording("gap", names, gap)).columns("motor_angle", ["left_motor", "right_motor"])
    np.testing.assert_allclose(found[:, 0], found[:, 1] - 8.0 * np.pi, rtol=0, atol=1e-9)
    wide = np.delete(wrapped, slice(100, 600), axis=0)  # the motor turns back in it
    with pytest.raises(InvalidInput, match="more or fewer turns between sample 100 and sample 101; record"):
        count.convert(Recording("wide", names, wide))
    with pytest.raises(InvalidInput, match="half a turn or more from one sample to the next"):
        count.convert(Recording("slow", names, wrapped[::120]))


def test_counts_of_an_encoder_are_declared_by_their_size():
    times = np.linspace(0.0, 1.0, 100)
    counts = np.round(4096.0 / (2.0 * np.pi) * np.sin(times))
    values = np.column_stack([times, counts, np.sin(times), times, times])
    data = Recording("log", tuple(HEADER.split(",")[:5]), values)
    with pytest.raises(InvalidInput, match=r"motor_angle_left_motor has whole numbers alone.*=SIZE declares"):
        check_signals(ROBOT, data)
    radians = Conversions(units={"motor_angle_left_motor": f"{2.0 * np.pi / 4096.0!r}"}).convert(data)
    angles = radians.columns("motor_angle", ROBOT.actuator_names)
    np.testing.assert_allclose(angles[:, 0], angles[:, 1], rtol=0, atol=np.pi / 4096.0)
    check_signals(ROBOT, radians)
    for size in ("0", "nan", "inf"):
        with pytest.raises(InvalidInput, match="unit of torque: needs a name or a number"):
            Conversions(units={"torque": size}).convert(data)


@pytest.mark.parametrize("count", [0, 1, 2, 40])
def test_a_tracker_of_too_few_rows_is_refused(count):
    times = np.linspace(0.0, 1.0, 200)
    smooth = np.sin(np.outer(times, np.arange(1.0, 7.0)))  # (200, 6)
    smooth[count:, 4:] = np.nan
    names = (*HEADER.split(",")[:5], "platform_x", "platform_y")
    few = Recording("few", names, np.column_stack([times, smooth]))
    with pytest.raises(InvalidInput, match=f"{count} samples of platform; at least 64 .* --poses motors"):
        check_signals(ROBOT, few)
    check_signals(ROBOT, few, "motors")


def test_rows_without_a_slower_tracker_are_rows_of_the_motors(tmp_path):
    header = HEADER.replace("note", "platform_x")
    lines = [header, ROWS[0], ROWS[1].removesuffix("7"), ROWS[1].removesuffix("7"), ROWS[2]]
    data = read_recording(ROBOT, written(tmp_path, lines))
    np.testing.assert_array_equal(data.column("time"), [0.0, 0.1, 0.2])
    assert data.left_out == 1  # which repeats one
    poses = data.complete()
    np.testing.assert_array_equal(poses.column("time"), [0.0, 0.2])
    assert (poses.left_out, poses.row(1)) == (2, "line 5")


def test_columns_are_converted_as_declared_and_rows_counted_as_in_a_spreadsheet(tmp_path):
    data = read_recording(ROBOT, written(tmp_path, [HEADER, ROWS[0], "", *ROWS[1:]]))
    assert [data.row(k) for k in range(3)] == ["line 2", "line 4", "line 5"]
    assert data.rows(slice(1, None)).row(0) == "line 4"
    declared = Conversions(
        units={"motor_angle_left_motor": "deg", "time": "ms"},
        signs={"torque": -1},
        swaps={"torque_left_motor": "torque_right_motor"},
    )
    converted = declared.convert(data)
    np.testing.assert_allclose(converted.column("time"), [0.0, 1e-4, 2e-4])
    np.testing.assert_allclose(converted.column("motor_angle_left_motor"), np.radians([63.5, 63.6, 63.7]))
    np.testing.assert_array_equal(converted.column("torque_left_motor"), [-0.2] * 3)
    # a unit of the platform is that of its lengths, or of its turns
    poses = Recording("poses", ("platform_x", "platform_rz"), np.array([[20.0, 90.0]]))
    both = Conversions(units={"platform": "mm", "platform_rz": "deg"}).convert(poses)
    np.testing.assert_allclose(both.values, [[0.02, np.pi / 2.0]])
    with pytest.raises(InvalidInput, match="unknown unit of platform_x 'deg'"):
        Conversions(units={"platform_x": "deg"}).convert(poses)
    for wrong, message in (
        (Conversions(units={"torque": "deg"}), "unknown unit of torque 'deg'"),
        (Conversions(signs={"torque": 2.0}), "needs 1 or -1"),
        (Conversions(units={"angle": "deg"}), "unknown column of --unit 'angle'"),
    ):
        with pytest.raises(InvalidInput, match=message):
            wrong.convert(data)


def test_sensors_record_what_was_simulated():
    plan = plan_scene(ROBOT, "A")
    run = simulate(ROBOT, plan, method="stiff")
    exact = record_sensors(
        run, plan.torque, Sensors(angle_step=0.0, torque_noise=0.0, platform_noise=0.0, rate=100.0)
    )
    t = exact.column("time")
    assert len(t) == 151
    np.testing.assert_allclose(exact.columns("platform", "xy"), plan.platform(t), rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        exact.columns("motor_angle", ROBOT.actuator_names), plan.motor_angle(t), rtol=0, atol=1e-4
    )
    noisy = record_sensors(
        run, plan.torque, Sensors(angle_step=1e-3, torque_noise=0.02, platform_noise=1e-4, rate=1000.0)
    )
    assert np.abs(noisy.column("motor_angle_left_motor") / 1e-3 % 1.0 - 0.5).min() > 0.49
    t = noisy.column("time")
    torque = plan.torque(t)
    spread = np.std(noisy.columns("torque", ROBOT.actuator_names) - torque, axis=0)
    np.testing.assert_allclose(spread, 0.02 * np.abs(torque).max(axis=0), rtol=0.1)
    np.testing.assert_allclose(
        np.std(noisy.columns("platform", "xy") - run.platform(t), axis=0), 1e-4, rtol=0.1
    )


def test_the_command_line_writes_sensors_beside_the_simulation(tmp_path, capsys):
    words = ["simulate", "five_bar", "--scene", "A", "--method", "stiff", "--sensors", "rate=200", "seed=3"]
    assert main([*words, "--out", str(tmp_path / "run")]) == 0
    assert len(read_recording(ROBOT, tmp_path / "run" / "sensors.csv")) == 301
    assert json.loads((tmp_path / "run" / "simulation.json").read_text())["robot"] == "five_bar"
    assert main(words) == 2
    assert "--out" in capsys.readouterr().err
    assert main([*words, "speed=2", "--out", str(tmp_path / "b")]) == 2
    assert "unknown property of --sensors 'speed'" in capsys.readouterr().err


@pytest.mark.parametrize("share", [-0.9, -0.3, 0.01, 0.2, 0.8])
def test_a_zero_is_found_wherever_it_is_within_the_travel_of_its_column(share):
    motor = "motor_angle_left_motor"
    true = 3.0 + np.linspace(-1.0, 1.0, 21) ** 3  # travels by 2

    def misfit(recording):
        return np.square(recording.column(motor) - true).mean()

    data = Recording(
        "shifted",
        (motor,),
        Conversions(zeros={motor: -2.0 * share})
        .convert(Recording("true", (motor,), true[:, None]))
        .column(motor)[:, None],
    )
    least, found = _search_zero(data, motor, misfit)
    assert least < 1e-4
    assert found.zeros[motor] == pytest.approx(2.0 * share, abs=1e-2)
