"""Closed loops and studies of many: who passes, who does not, and that nothing depends on who computes."""

import csv
import json
from functools import cache
from statistics import NormalDist
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, plan_scene
from framework.cli import main
from framework.cli.robustness import _describe_study
from framework.control import (
    ControlLoop,
    LoopPrediction,
    Spread,
    Study,
    StudySetup,
    Variation,
    draw,
    load_study,
    reference_of,
    run_closed_loop,
    run_study,
    tuned_controller,
)
from framework.control import study as study_module
from framework.control.controllers import FeedforwardPD
from framework.control.study import FIRST_TRIAL, run_store, run_studies
from framework.control.variations import apply_variation
from framework.dynamics.open_loop import MotorControl
from tests.conftest import REMOVED, put

PAYLOAD = Spread(payload=0.05)


@cache
def controller(name, period=2e-3, robot="five_bar", flexibility="rigid"):
    plan = plan_scene(
        robots.load(robot, flexibility=flexibility),
        "C",
        **({} if flexibility != "rigid" else {"smoothness": 4}),
    )
    return tuned_controller(name, reference_of(plan, period=period))


def unvaried(controller, count=1):
    robot = controller.reference.robot
    return [draw(robot, Spread(), (0, k)) for k in range(count)]


def held(plan, periods) -> list[float]:
    """Tracking errors of the plan's torques alone, held over periods [s]."""
    errors = []
    for period in periods:
        reference = reference_of(plan, period=period)
        gains = MotorControl(*np.zeros((2, reference.robot.n_a)))
        runs = [draw(reference.robot, Spread(), (0, 0))]
        run = run_closed_loop(FeedforwardPD(reference, gains), ControlLoop(), Spread(), runs)
        errors.append(run.tracking_error[0])
    return errors


def test_the_plan_held_over_each_period_comes_back_to_second_order():
    """Open loop: the error of holding the torque and of the integration goes as the square of the period."""
    errors = held(plan_scene(robots.load("five_bar"), "C", smoothness=4), (8e-3, 4e-3))
    assert errors[1] < 8e-5  # robot lengths
    assert 3.0 < errors[0] / errors[1] < 5.5


@pytest.mark.slow
def test_the_plan_of_an_elastic_robot_is_held_as_well():
    """Simulated in steps of a quarter of a millisecond, whatever the period, which leave 5e-7."""
    errors = held(
        plan_scene(robots.load("five_bar", flexibility="flexible_links"), "C", smoothness=4), (4e-3, 2e-3)
    )
    assert errors[1] < 0.5 * errors[0] < 2e-6  # robot lengths


@pytest.mark.slow
def test_an_optimal_law_is_held_over_each_period_to_second_order_too():
    limits = {"optimize": "time", "torque_limit": 0.165, "smoothness": 4}
    errors = held(plan_scene(robots.load("five_bar"), "C", **limits), (2e-3, 1e-3))
    assert 3.0 < errors[0] / errors[1] < 5.5


@pytest.mark.slow
def test_the_quickest_law_passes_as_the_polynomial_does_if_it_leaves_a_tenth_of_the_torque():
    """The README's numbers, with motors that give no more than the polynomial's own peak.

    Each controller makes 40 runs of both quickest laws, and 12 of the polynomial, which is slow and passes.
    """
    robot = robots.load("five_bar")
    polynomial = plan_scene(robot, "C", smoothness=4)
    limit = max(polynomial.peak_torque.values())
    loop = ControlLoop(limit=(limit, limit))
    quickest = {"optimize": "time", "torque_limit": limit, "smoothness": 4}
    plans = {"polynomial": polynomial, "all": plan_scene(robot, "C", **quickest)}
    plans["nine tenths"] = plan_scene(robot, "C", **quickest, margin=0.1)
    passed = {}
    for law, plan in plans.items():
        reference = reference_of(plan, period=1e-3)
        for name in ("feedforward", "lqr", "computed_torque"):
            runs = 12 if law == "polynomial" else 40
            study = run_study(tuned_controller(name, reference), loop, PAYLOAD, runs=runs)
            passed[law, name] = int(study.passed.sum())
    for name in ("feedforward", "lqr", "computed_torque"):
        assert passed["polynomial", name] == 12
        assert passed["nine tenths", name] == 40
        assert passed["all", name] <= 35
    assert plans["nine tenths"].duration < 0.55 * polynomial.duration


@pytest.mark.slow
def test_robust_controllers_pass_with_a_wrong_payload_where_naive_computed_torque_does_not():
    names = ("feedforward", "lqr", "computed_torque", "naive_computed_torque")
    studies = run_studies({name: controller(name) for name in names}, ControlLoop(), PAYLOAD, runs=12)
    passed = {study.controller: study.probability for study in studies}
    assert [passed[name] for name in ("feedforward", "lqr", "computed_torque")] == [1.0, 1.0, 1.0]
    assert passed["naive_computed_torque"] < 0.5


def test_the_interval_is_wilsons():
    """From either end the share of the runs that pass is as far as 1.96 standard deviations of that end."""
    study = run_study(controller("naive_computed_torque", period=5e-3), ControlLoop(), PAYLOAD, runs=7)
    share, z = study.passed.mean(), NormalDist().inv_cdf(0.975)
    low, high = study.interval
    assert low <= share <= high
    assert low < high
    for end in (low, high):
        assert (share - end) ** 2 == pytest.approx(z**2 * end * (1.0 - end) / 7, abs=1e-12)


def test_68_percent_of_normal_deviations_are_within_one_whatever_single_runs_do():
    """Their mean of squares is filled by one run that escapes."""
    errors = 1e-3 * np.array([NormalDist().inv_cdf(0.5 + (k + 0.5) / 400) for k in range(200)])
    errors[-1] = 1.0
    zeros = np.zeros(200)
    study = Study(
        controller="lqg",
        spread=Spread(),
        seed=0,
        seconds=0.0,
        passed=errors < 2.5e-3,
        why=("",) * 200,
        tracking_error=errors,
        end_error=errors,
        peak_torque=zeros[:, None],
        payload=zeros,
    )
    found = _describe_study(study, np.ones(1))["tracking_error"]
    assert found["68 %"] == pytest.approx(1e-3, rel=0.01)
    assert np.sqrt(np.mean(errors**2)) > 50 * found["68 %"]


def predicted(sensors, platform):
    return LoopPrediction(controller="lqg", sensors=sensors, platform=platform, torque=0.1, load=0.1)


@pytest.mark.parametrize(
    ("failed", "trials"),
    [
        ({"motors": {3}}, [("motors", 19, 20), ("links", 20, 20)]),  # the next one passes with all
        ({"motors": {3, 30}, "links": {1, 2}}, [("motors", 19, 20), ("links", 18, 20), ("motors", 38, 40)]),
        ({"motors": {3, 4, 5}, "links": {1, 2, 9}}, [("motors", 17, 20), ("links", 17, 20)]),
    ],
)
def test_sensors_are_tried_in_turn_and_the_best_on_as_many_robots_more(monkeypatch, failed, trials):
    """Those that may pass within the whole tolerance come last; none of the robots is one of the study."""

    def run(setup, name, *numbers):
        assert min(numbers) >= FIRST_TRIAL
        lost = failed.get(setup.loop.sensors, ())
        return SimpleNamespace(passed=np.array([k - FIRST_TRIAL not in lost for k in numbers]))

    monkeypatch.setattr(StudySetup, "run", run)
    setup = StudySetup(None, 1e-3, ControlLoop(tolerance=2.5e-3), Spread(), 0)
    given = [predicted("links", 2e-3), predicted("motors", 1e-3), predicted("elbows", 3e-3)]
    made = setup.try_sensors(given)
    assert [tuple(trial) for trial in made] == trials
    assert made[-1].is_enough == (made[-1].passed in (20, 38))


def test_torques_stay_within_the_limit():
    limit = (0.10, 0.09)
    run = run_study(controller("lqr", period=5e-3), ControlLoop(limit=limit), PAYLOAD, runs=3)
    np.testing.assert_allclose(run.peak_torque.max(axis=0), limit, rtol=1e-12)  # the plan asks for more
    assert not run.passed.any()


@pytest.mark.slow
def test_what_comes_late_and_what_rubs_leaves_a_larger_error():
    one = controller("feedforward")
    nothing = unvaried(one)[0]
    error = {
        what: run_closed_loop(
            one, ControlLoop(), Spread(), [Variation(**{**vars(nothing), **change})]
        ).tracking_error[0]
        for what, change in {
            "nothing": {},
            "late": {"delay": 0.01},
            "later": {"delay": 0.02},
            "rubs": {"friction": np.array([0.1, 0.1])},
        }.items()
    }
    assert error["nothing"] < 0.1 * error["late"] < 0.1 * error["later"]
    assert error["rubs"] > 10 * error["nothing"]


@pytest.mark.parametrize("robot", ["five_bar", "five_bar_heavy", "gough_stewart", "delta"])
def test_a_heavier_payload_adds_its_inertia_and_nothing_else(robot):
    """Kinetic energy is linear in the payload: 1 +- p about the same robot are symmetric about 1."""
    nominal = robots.load(robot)
    random = np.random.default_rng(3)
    q, v = (
        pin.integrate(nominal.model, nominal.q_near, random.standard_normal(nominal.model.nv)),
        random.standard_normal(nominal.model.nv),
    )
    nothing = draw(nominal, Spread(), (0, 0))

    def energy(factor):
        model = apply_variation(nominal, Variation(**{**vars(nothing), "payload": factor})).model
        return pin.computeKineticEnergy(model, model.createData(), q, v)

    assert energy(1.0) == pytest.approx(
        pin.computeKineticEnergy(nominal.model, nominal.model.createData(), q, v)
    )
    assert energy(1.3) > energy(1.0)
    np.testing.assert_allclose(energy(1.3) - energy(1.0), energy(1.0) - energy(0.7), rtol=1e-9)


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: Spread(payload=-0.1), "payload"),
        (lambda: Spread(payload=1.0), "below 1"),
        (lambda: Spread(delay=np.nan), "delay"),
        (lambda: ControlLoop(tolerance=0.0), "tolerance"),
        (lambda: ControlLoop(sensors="eyes"), "motors"),
        (lambda: run_study(controller("lqr"), ControlLoop(), Spread(), runs=0), "runs"),
        (lambda: run_study(controller("lqr"), ControlLoop(), Spread(), runs=1, seed=-1), "seed"),
        (
            lambda: run_study(controller("lqr"), ControlLoop(limit=(1.0, 2.0, 3.0)), Spread(), runs=1),
            "limit",
        ),
        (lambda: run_study(controller("lqr"), ControlLoop(limit=(-1.0,)), Spread(), runs=1), "limit"),
    ],
)
def test_what_cannot_be_is_refused_by_name(build, says):
    with pytest.raises(InvalidInput, match=says):
        build()


# ------------------------------------------------------------------ the command


SHORT = ["robustness", "five_bar", "--scene", "C", "--smoothness", "4", "--period", "5e-3", "--runs", "4"]


@pytest.mark.slow
def test_the_command_writes_a_table_all_seeds_and_a_figure(tmp_path, capsys):
    arguments = [*SHORT, "--controller", "lqr", "naive_computed_torque", "--out", str(tmp_path / "study")]
    assert main(arguments) == 0
    out, _ = capsys.readouterr()
    assert "lqr" in out
    assert "100.0%" in out
    written = {path.name for path in (tmp_path / "study").iterdir()}
    assert written == {"robustness.json", "runs.csv", "robustness.pdf", "robustness.png"}
    with open(tmp_path / "study" / "runs.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    stored = json.loads((tmp_path / "study" / "robustness.json").read_text())
    failed = {tuple(failure["seed"]) for failure in stored["studies"][1]["failures"]}
    assert failed == {(0, int(row["run"])) for row in rows if row["passed"] == "0"}


@pytest.mark.slow
def test_the_command_takes_a_plan_that_was_written(tmp_path, capsys):
    assert main(["plan", "five_bar", "--scene", "C", "--smoothness", "4", "--json"]) == 0
    (tmp_path / "plan.json").write_text(capsys.readouterr().out)
    assert main([*SHORT, "--json"]) == 0
    asked = json.loads(capsys.readouterr().out)
    assert main(["robustness", str(tmp_path), "--period", "5e-3", "--runs", "4", "--json"]) == 0
    stored = json.loads(capsys.readouterr().out)
    assert stored["studies"][0]["tracking_error"]["largest"] == pytest.approx(
        asked["studies"][0]["tracking_error"]["largest"], rel=1e-6
    )


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (["--runs", "-1"], "--runs"),
        (["--workers", "0"], "--workers"),
        (["--payload", "-1"], "payload"),
        (["--period", "7"], "period"),
        (["--dask", "no address"], "dask"),
        (["--limit", "0"], "limit"),
    ],
)
def test_the_command_refuses_by_name(refusal, change, says):
    assert says in refusal(2, *SHORT, *change)


def test_a_plan_has_its_motion_already(tmp_path, refusal):
    (tmp_path / "plan.json").write_text("{}")
    assert "--scene" in refusal(2, "robustness", tmp_path, "--scene", "C")


# ------------------------------------------------------------------ a study that is stopped


def computed(monkeypatch, stop_after=None):
    """Numbers of the runs that are computed, in chunks of two; Ctrl-C comes after so many chunks."""
    numbers, whole = [], study_module.run_chunk

    def counting(controllers, loop, spread, seed, chunk, *rest):
        if stop_after is not None and len(numbers) == 2 * stop_after:
            raise KeyboardInterrupt
        numbers.extend([number for number in chunk for _ in controllers])
        return whole(controllers, loop, spread, seed, chunk, *rest)

    monkeypatch.setattr(study_module, "RUNS_PER_CHUNK", 2)
    monkeypatch.setattr(study_module, "run_chunk", counting)
    return numbers


@pytest.mark.slow
def test_a_study_that_is_stopped_goes_on_from_its_finished_runs(tmp_path, capsys, monkeypatch):
    out = tmp_path / "new" / "out"
    two = [*SHORT, "--controller", "lqr", "feedforward", "--noise", "1e-6", "--period", "1e-2", "--json"]
    with monkeypatch.context() as patched:
        computed(patched, stop_after=3)
        assert main([*two, "--out", str(out)]) == 130
    assert capsys.readouterr().err == (
        f"crossing: interrupted: 6 of 8 runs are kept in {out}, and the same command goes on from them\n"
    )
    kept = [path for path in out.rglob("*") if path.is_file()]
    assert len(kept) == 3
    kept[0].write_bytes(kept[0].read_bytes()[:100])  # a file that a full disk left
    numbers = computed(monkeypatch)
    assert main([*two, "--out", str(out), "--workers", "1"]) == 0
    assert len(numbers) == 4
    gone_on = json.loads(capsys.readouterr().out)["studies"]
    assert main(two) == 0
    for study in (*gone_on, *(plain := json.loads(capsys.readouterr().out)["studies"])):
        del study["seconds"]
    assert gone_on == plain
    assert not [path for path in out.iterdir() if path.name.startswith(".")]


def test_runs_are_stored_in_chunks_of_at_most_25(tmp_path, monkeypatch):
    """Of two controllers, hence of 12 robots."""
    chunks, whole = [], study_module.run_chunk

    def one_run(controllers, loop, spread, seed, chunk, *rest):
        chunks.append(len(chunk))
        if len(chunks) == 2:
            raise KeyboardInterrupt
        return {
            key: np.repeat(value, len(chunk), 0)
            for key, value in whole(controllers, loop, spread, seed, chunk[:1], *rest).items()
        }

    monkeypatch.setattr(study_module, "run_chunk", one_run)
    words = [*SHORT, "--runs", "60", "--period", "1e-2", "--workers", "1", "--out", str(tmp_path)]
    assert main([*words, "--controller", "feedforward", "lqr"]) == 130
    assert chunks == [12, 12]
    assert len(list(tmp_path.rglob("*.npz"))) == 1


@pytest.mark.slow
def test_runs_of_another_study_are_not_taken(tmp_path, monkeypatch):
    words = [*SHORT, "--period", "1e-2", "--out", str(tmp_path)]
    with monkeypatch.context() as patched:
        computed(patched, stop_after=1)
        assert main(words) == 130
    for change in (["--payload", "0.04"], ["--controller", "lqr"]):
        with monkeypatch.context() as patched:
            numbers = computed(patched, stop_after=1)
            assert main([*words, *change]) == 130
            assert numbers == [0, 1]


def test_ctrl_c_before_any_run_is_finished_leaves_nothing(tmp_path, capsys, monkeypatch):
    computed(monkeypatch, stop_after=0)
    assert main([*SHORT, "--out", str(tmp_path / "new" / "out"), "--json"]) == 130
    out, err = capsys.readouterr()
    assert err == "crossing: interrupted\n"
    assert json.loads(out) == {"error": {"kind": "KeyboardInterrupt", "message": "interrupted"}}
    assert list(tmp_path.iterdir()) == []


def test_in_this_process_progress_is_told_while_a_chunk_is_under_way():
    done = []
    run_study(controller("feedforward", period=5e-3), ControlLoop(), PAYLOAD, runs=5, progress=done.append)
    assert set(done) == {0, 1, 2, 3, 4, 5}


# ------------------------------------------------------------------ a run once more


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    spread = ["--places", "1e-5", "--friction", "0.02", "--noise", "1e-6", "--tolerance", "1e-3"]
    controllers = ["--controller", "lqr", "naive_computed_torque"]
    assert main([*SHORT, *spread, *controllers, "--limit", "2", "--out", str(folder)]) == 0
    return folder


def test_a_tolerance_in_millimetres_is_that_share_of_the_robot(document, refusal):
    words = ["robustness", "five_bar", "--scene", "C", "--runs", "1", "--period", "5e-3"]
    told = document(*words, "--tolerance", "0.5mm")
    length = robots.load("five_bar").length
    assert told["tolerance"] * length == pytest.approx(0.5e-3, rel=1e-12)
    for wrong in ("0.5 inch", "mm", "-1mm"):
        assert "tolerance" in refusal(2, *words, "--tolerance", wrong)


def test_a_study_keeps_all_that_a_rerun_needs(study):
    saved = json.loads((study / "robustness.json").read_text())
    assert saved["spread"] == dict(
        payload=0.05, stiffness=0.0, places=1e-5, friction=0.02, delay=0.0, noise=1e-6, speed_noise=0.0
    )
    assert (saved["period"], saved["limit"], saved["tolerance"], saved["seed"]) == (
        5e-3,
        [2.0, 2.0],
        0.001,
        0,
    )
    assert saved["plan"]["robot_file"] == "five_bar"
    assert {"parallel-singularity-crossing", "pin", "numpy", "scipy", "python"} <= set(saved["versions"])


def test_a_failure_is_run_again_from_what_was_written(study, tmp_path, capsys):
    """The file alone, elsewhere, in another process of the program: to the last bit."""
    saved = json.loads((study / "robustness.json").read_text())
    (tmp_path / "robustness.json").write_text(json.dumps(saved))
    failure = saved["studies"][1]["failures"][0]
    replay = ["robustness", str(tmp_path), "--replay", str(failure["seed"][1])]
    assert main([*replay, "--controller", "naive_computed_torque", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["as_written"]
    assert (found["why"], found["tracking_error"]) == (failure["why"], failure["tracking_error"])
    setup, _ = load_study(tmp_path)
    run = setup.run("naive_computed_torque", failure["seed"][1])
    assert run.tracking_error[0] == failure["tracking_error"]
    assert len(run.torque) > 100


def test_a_run_that_is_not_what_was_written_is_told_with_the_versions(study, tmp_path, capsys):
    saved = json.loads((study / "robustness.json").read_text())
    failure = saved["studies"][1]["failures"][0]
    failure["tracking_error"] *= 1.5
    saved["versions"]["numpy"] = "1.0"
    (tmp_path / "robustness.json").write_text(json.dumps(saved))
    number = str(failure["seed"][1])
    assert (
        main(["robustness", str(tmp_path), "--replay", number, "--controller", "naive_computed_torque"]) == 0
    )
    out = capsys.readouterr().out
    assert "otherwise than in the study" in out
    assert "numpy 1.0 then" in out


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (["--replay", "4", "--controller", "lqr"], "0 to 3"),
        (["--replay", "0"], "--controller: give one of this study: lqr, naive_computed_torque"),
        (["--replay", "0", "--controller", "feedforward"], "--controller"),
        (["--replay", "0", "--controller", "lqr", "--payload", "0.1"], "--payload: the study"),
        (["--replay", "0", "--controller", "lqr", "--from", "0", "0"], "--from: the study"),
        (["--replay", "-1"], "--replay"),
    ],
)
def test_a_replay_that_cannot_be_is_refused_by_name(study, refusal, change, says):
    assert says in refusal(2, "robustness", study, *change)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(
            (key, REMOVED)
            for key in ("plan", "period", "spread", "limit", "tolerance", "studies", "runs", "seed")
        ),
        ("versions", REMOVED),
        ("spread", {"payload": -1.0}),
        ("spread.colour", 1.0),
        ("limit", None),
        ("tolerance", "wide"),
        ("sensors", "eyes"),
        ("period", "short"),
        ("plan", []),
        ("plan.law", None),
        ("studies", {"lqr": 1}),
        ("studies.0.failures", 3),
    ],
)
def test_a_file_that_is_no_study_is_refused_in_one_line(study, tmp_path, refusal, key, value):
    saved = json.loads((study / "robustness.json").read_text())
    put(saved, key, value)
    (tmp_path / "robustness.json").write_text(json.dumps(saved))
    err = refusal(2, "robustness", tmp_path, "--replay", "0", "--controller", "lqr")
    assert "robustness.json" in err or str(tmp_path) in err


@pytest.mark.slow
def test_a_study_has_the_limits_of_the_plan_or_says_that_the_plan_exceeds_them(
    write_robot, crossing, tmp_path
):
    file = write_robot(*((f"actuators.{k}.torque_limit", 0.1) for k in range(2)))  # the law needs 0.16
    plan = tmp_path / "lifted"
    assert crossing("plan", file, "--scene", "C", "--torque-limit", "none", "--out", plan)[0] == 0
    short = ("robustness", plan, "--runs", "2", "--period", "5e-3")
    code, lifted, _ = crossing(*short)
    assert code == 0
    assert "100.0%" in lifted
    assert "exceeds" not in lifted
    _, bound, _ = crossing(*short, "--limit", "0.1")
    assert (
        "the plan itself exceeds the limits: left_motor 0.1471 of 0.1, right_motor" in bound.splitlines()[0]
    )
    assert "2 of 2 failed runs of feedforward met the torque limits, of which the plan takes" in bound
    assert "failed runs" not in lifted


def test_shifted_joints_move_all_that_they_carry():
    """The place of a joint moves by the shifts of those before it and its own, each turned as its parent."""
    nominal = robots.load("gough_stewart")
    shifts = np.random.default_rng(5).standard_normal((nominal.model.njoints - 1, 3))
    nothing = draw(nominal, Spread(), (0, 0))
    model = apply_variation(nominal, Variation(**{**vars(nothing), "shifts": shifts})).model
    data, moved = nominal.model.createData(), model.createData()
    for tree, of_tree in ((nominal.model, data), (model, moved)):
        pin.forwardKinematics(tree, of_tree, nominal.reference.q)
    added = [np.zeros(3)]
    for j in range(1, nominal.model.njoints):
        parent = nominal.model.parents[j]
        added.append(added[parent] + data.oMi[parent].rotation @ shifts[j - 1])
        np.testing.assert_allclose(moved.oMi[j].translation, data.oMi[j].translation + added[j], atol=1e-12)


def test_runs_are_kept_by_what_was_planned_and_not_by_how_long_it_took(tmp_path):
    plan = {"duration": 1.5, "law": [0.0, 1.0], "seconds": 0.2}
    folder = run_store(tmp_path, {"plan": plan}, ["lqr"]).folder
    assert run_store(tmp_path, {"plan": {**plan, "seconds": 0.3}}, ["lqr"]).folder == folder
    assert run_store(tmp_path, {"plan": {**plan, "duration": 1.4}}, ["lqr"]).folder != folder
