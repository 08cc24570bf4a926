"""What to try after a refusal: the error carries it, the command line says it, and it is true."""

import json
import pickle
import shlex

import pytest

import robots
from framework import (
    InvalidInput,
    Line,
    NoAnswer,
    NoLaw,
    ParallelRobot,
    UnboundedTorque,
    locate_singularities,
    plan_crossing,
    plan_scene,
)
from framework.cli import main
from framework.cli.commands import COMMANDS
from framework.planning.path_modification import plan_request_with_modified_path
from framework.planning.request import Request
from framework.planning.scenes import scene_request

LINE = "--from 0.1 0.345 --to -0.05 0.195"
MEANT = [  # a wrong command line, what was meant
    ("plna five_bar --scene C", "did you mean 'plan'?"),
    ("Plan five_bar --scene C", "did you mean 'plan'?"),
    ("robot", "did you mean 'robots'?"),
    ("plan five_bra --scene C", "did you mean 'five_bar'?"),
    ("plan FIVE_BAR --scene C", "did you mean 'five_bar'?"),
    ("check humanoid", "did you mean 'humanoid_ankle' or 'humanoid_knee'?"),
    ("plan five_bar --scene c", "did you mean 'C'?"),
    ("plan delta --scene crss", "did you mean 'cross'?"),
    ("plan five_bar C", "did you mean --scene C?"),
    ("plan five_bar --scen C", "did you mean --scene?"),
    ("plan five_bar --scene C --torque_limit 1", "did you mean --torque-limit?"),
    ("plan five_bar --scene C --optimise time", "did you mean --optimize?"),
    ("plan five_bar --scene C --law optimum", "did you mean 'optimal'?"),
    ("plan five_bar --scene C --flexibility joints", "did you mean 'flexible_joints'?"),
    ("plan five_bar --scene C --optimize torque", "did you mean 'peak_torque'?"),
    ("map five_bar --quantity conditionning", "did you mean 'conditioning'?"),
    ("export five_bar --to mjfc --out a.xml", "did you mean 'mjcf'?"),
    ("robustness five_bar --scene C --controller lqrr", "did you mean 'lqr'?"),
    ("simulate five_bar --scene C --method explicite", "did you mean 'explicit'?"),
    ("plan five_bar --scene C --wrench-on left_tp 0 0 0 0 0 0", "did you mean 'left_tip'?"),
    ("simulate five_bar --scene C --controller lqr", "an option of crossing robustness"),
    (f"plan five_bar {LINE}", "needed in seconds, unless"),  # without one that is not tried
    ("check my_robt.yaml", "did you mean 'my_robot.yaml'?"),
    ("calibrate five_bar none.csv --noise motor_angel=1", "did you mean 'motor_angle'?"),
]
TRIED = [  # a wrong command line, its exit code, what to try
    ("plan five_bar", 2, "plan five_bar --scene A"),
    ("plan --scene C", 2, "plan five_bar --scene C --out move"),
    ("pose", 2, "pose five_bar --motors 1.2 1.9"),
    ("pose five_bar", 2, "pose five_bar --motors 1.27186 1.08362"),
    ("--json check five_bar", 2, "check five_bar --json"),
    (f"plan five_bar --scene A {LINE}", 2, "plan five_bar --scene A"),
    ("plan five_bar --scene C --duration 0.3", 2, "plan five_bar --scene C --duration 0.3 --law optimal"),
    ("plan five_bar --scene C --law optimal --times 2", 2, "plan five_bar --scene C --law optimal"),
    ("plan five_bar --scene C --smoothness 1", 2, "plan five_bar --scene C"),
    ("plan five_bar --scene C --bend --raw", 2, "plan five_bar --scene C --bend"),
    ("simulate five_bar --scene A --sensors", 2, "simulate five_bar --scene A --sensors --out run"),
    ("export five_bar --to mjcf --out a.txt", 2, "export five_bar --to mjcf --out a.xml"),
    ("plan five_bar --scene B", 1, "plan five_bar --scene B --law optimal"),
    (
        "simulate five_bar --scene B --method stiff",
        1,
        "simulate five_bar --scene B --method stiff --law optimal",
    ),
    (
        "plan --law polynomial five_bar --scene C --times 0.01",
        1,
        "plan five_bar --scene C --law optimal",
    ),  # a motion that runs back
    ("pose five_bar --motors 1.27 -5.2", 1, "pose five_bar --motors 1.27 -5.2 --all"),
    ("plan five_bar --scene C --law optimal --torque-limit=0.01", 1, None),  # a duration
    (
        "plan five_bar --scene C --law optimal --torque-limit 0.5 --times 0.01",
        1,
        "plan five_bar --scene C --law optimal --torque-limit 0.5",
    ),  # limits 500 times as high are not tried
]
SLOW = {  # optimal laws; the plain suite tries the one of scene B
    "plan five_bar --scene C --duration 0.3",
    "plan five_bar --scene C --law optimal --times 2",
    "simulate five_bar --scene B --method stiff",
    "plan --law polynomial five_bar --scene C --times 0.01",
    "plan five_bar --scene C --law optimal --torque-limit=0.01",
    "plan five_bar --scene C --law optimal --torque-limit 0.5 --times 0.01",
}


def run(capsys, line: str, *more: str) -> tuple[int, str, str]:
    """The exit code of a command line, its stdout and its stderr."""
    code = main([*shlex.split(line), *more])
    return code, *capsys.readouterr()


@pytest.mark.parametrize(("line", "hint"), MEANT, ids=[line for line, _ in MEANT])
def test_a_word_that_is_nearly_right_is_told(capsys, tmp_path, monkeypatch, line, hint):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_robot.yaml").touch()
    (tmp_path / "none.csv").write_text("motor_angle_left_motor\n0\n")
    code, out, err = run(capsys, line)
    assert (code, out) == (2, "")
    assert hint in err
    assert err.count("\n") == 1
    if "argument" in err:
        name = line.split()[0]
        assert f"`crossing {name if name in COMMANDS else '--help'}" in err


@pytest.mark.parametrize(
    ("line", "code", "expected"),
    [pytest.param(*one, id=one[0], marks=[pytest.mark.slow] * (one[0] in SLOW)) for one in TRIED],
)
def test_what_is_to_be_tried_ends_otherwise(capsys, tmp_path, monkeypatch, line, code, expected):
    monkeypatch.chdir(tmp_path)
    got, out, err = run(capsys, line)
    assert (got, out if "--json" not in line else "") == (code, "")
    assert err.count("\n") == 1
    instead = err.strip().split("; try: crossing ")[1]
    assert expected is None or instead == expected
    monkeypatch.setattr("framework.show.plots.save_figures", lambda *_: None)
    if "--help" in instead:
        with pytest.raises(SystemExit) as ended:
            main(shlex.split(instead))
        assert ended.value.code == 0
    else:
        assert run(capsys, instead)[0] == 0


def test_json_has_what_to_try(capsys):
    code, out, err = run(capsys, "plan five_bar --scene B", "--json")
    error = json.loads(out)["error"]
    assert (code, error["try"]) == (1, "crossing plan five_bar --scene B --law optimal")
    assert err == f"crossing: {error['message']}\n"


def test_advice_in_a_terminal_stands_on_a_line_of_its_own(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setenv("COLUMNS", "80")
    _, _, err = run(capsys, "plan five_bar --scene B")
    *why, advice = err.splitlines()
    assert advice == "  try: crossing plan five_bar --scene B --law optimal"
    assert max(map(len, why)) <= 80


def test_an_error_with_a_remedy_can_be_pickled():
    with pytest.raises(UnboundedTorque) as caught:
        plan_scene(robots.load("five_bar"), "B")
    assert caught.value.remedy == {"law": "optimal", "times": None, "speeds": None}
    assert pickle.loads(pickle.dumps(caught.value)).remedy == caught.value.remedy


def test_what_was_tried_is_not_advised(capsys, monkeypatch):
    def refuse(options):
        raise NoLaw("no").advising({"bend": True})

    monkeypatch.setattr("framework.cli.plan.run_plan", refuse)
    assert "; try: crossing plan five_bar --scene C --bend\n" in run(capsys, "plan five_bar --scene C")[2]
    for line in (
        "plan five_bar --scene C --bend",
        "plan five_bar --bend --scene C",
        "plan --bend 1% five_bar",
    ):
        assert ("try" in run(capsys, line)[2]) is ("1%" in line)
    monkeypatch.setattr("framework.cli.simulate.run_simulate", refuse)
    assert "try" not in run(capsys, "simulate five_bar --scene C")[2]  # it knows no such option


def test_an_example_is_advised_where_it_runs_in_any_folder(capsys):
    shown = {name: run(capsys, f"{name} --nonsense")[2].partition("try: crossing ")[2] for name in COMMANDS}
    needing_files = {name for name, example in shown.items() if not example}
    assert needing_files == {
        "calibrate",
        "completion",
        "identify",
        "report",
        "robots",
    }  # robots lacks nothing


def test_an_end_on_the_locus_has_no_remedy():
    robot = robots.load("five_bar")
    (point,) = locate_singularities(robot, Line([0.1, 0.345], [-0.05, 0.195]))
    with pytest.raises(NoLaw) as caught:
        plan_crossing(robot, Line([0.1, 0.345], point.platform), duration=1.5)
    assert caught.value.remedy is None


# sliding and turning motors, one that turns round, that only turns, in space, redundant
REMEDIED = {
    "biglide": ("bow",),
    "five_bar": ("B", "C"),
    "four_bar": ("full_turn",),
    "agile_eye": ("sweep",),
    "delta": ("cross-unprepared",),
    "two_arms": ("turn",),
}


def asked(duration: float, peak: float) -> list[dict]:
    """Options of a plan, many of which are refused; `peak` is the least peak torque in the duration."""
    free = {"times": None, "speeds": None}
    return [
        {},
        {"law": "polynomial"},
        {"law": "polynomial", "duration": 5 * duration, **free},
        {"times": []},
        {"times": [0.1 * duration]},
        {"torque_limit": 0.7 * peak, "duration": duration},
        {"torque_limit": 0.3 * peak, "duration": 0.5 * duration},
    ]


def planned(robot: ParallelRobot, scene: str, options: dict) -> None:
    """Plan a scene, on a bent path where that is asked for."""
    options = dict(options)
    bend = options.pop("bend", None)
    request = scene_request(robot, scene, **options)
    if bend:
        plan_request_with_modified_path(robot, request)
    else:
        plan_scene(robot, scene, **options)


@pytest.mark.slow
@pytest.mark.parametrize("name", REMEDIED)
@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")  # as on the command line
def test_remedies_are_true_and_advise_no_law_that_was_tried(name):
    robot = robots.load(name)
    refused, advised = 0, 0
    for scene in REMEDIED[name]:
        best = plan_scene(robot, scene, law="optimal", times=None, speeds=None)
        for options in asked(best.duration, max(best.peak_torque.values())):
            try:
                plan_scene(robot, scene, **options)
            except InvalidInput:  # a number of times that the path has no crossings for
                continue
            except NoAnswer as refusal:
                refused += 1
                if refusal.remedy is None:
                    continue
                advised += 1
                if refusal.remedy.get("law") == "optimal":
                    assert scene_request(robot, scene, **options).kind == "polynomial"
                planned(robot, scene, options | dict(refusal.remedy))
    assert advised or not refused


CONTRADICTIONS = [
    {"law": "polynomial", "optimize": "time", "duration": 1.5},
    {"law": "polynomial", "margin": 0.1, "duration": 1.5},
    {"law": "polynomial", "optimize": "energy", "longest": 2.0, "duration": 1.5},
    {"optimize": "time", "times": [0.6], "speeds": [0.9], "duration": 1.5},
    {"optimize": "time", "smoothness": 12, "duration": 1.5},
    {"law": "polynomial", "optimize": "peak_torque"},  # wants a duration, which only the user can choose
]


@pytest.mark.parametrize("options", CONTRADICTIONS, ids=" ".join)
def test_contradicting_options_are_answered_with_what_makes_them_valid_together(options):
    robot, path = robots.load("five_bar"), Line([0.1, 0.345], [-0.05, 0.195])
    limited = {"torque_limit": 2.0, **options}
    with pytest.raises(InvalidInput) as caught:
        Request.of(robot, path, **limited)
    remedy = caught.value.remedy
    assert (remedy is None) == (options is CONTRADICTIONS[-1])
    if remedy is not None:
        changed = {**limited, **remedy}
        Request.of(robot, path, **{key: value for key, value in changed.items() if value is not None})


@pytest.mark.slow
def test_limits_that_are_too_low_are_answered_with_the_duration_that_keeps_them():
    robot = robots.load("five_bar")
    with pytest.raises(NoLaw) as caught:
        plan_scene(robot, "C", law="optimal", torque_limit=0.01)
    ((name, value),) = caught.value.remedy.items()
    assert name == "duration"
    assert plan_scene(robot, "C", law="optimal", torque_limit=0.01, duration=value).duration == value
    with pytest.raises(NoLaw):
        plan_scene(robot, "C", law="optimal", torque_limit=0.01, duration=0.97 * value)


MENDED = [  # a command line with numbers that are none, and the same with what is meant
    ("--scene C plan five_bar", "plan five_bar --scene C"),
    ("plan five_bar --scene C --duration 1.5s", "plan five_bar --scene C --duration 1.5"),
    ("plan five_bar --duration=1.5s --scene C", "plan five_bar --duration 1.5 --scene C"),
    (
        "plan five_bar --from 0.1,0.345 --to -0.05,0.195 --duration 1.5",
        f"plan five_bar {LINE} --duration 1.5",
    ),
    (
        "plan five_bar --from 0.1 0.345 --to -0.05,0.195 --duration 1.5",
        f"plan five_bar {LINE} --duration 1.5",
    ),
    ("plan five_bar --scene C --wrench 0N -1N", "plan five_bar --scene C --wrench 0 -1"),
    ("plan five_bar --from 100mm 345mm --to 0 0", None),  # another unit
    ("plan five_bar --scene C --duration soon", None),
    ("map five_bar --window 0 1", None),
    ("map five_bar --size 0", None),
]


@pytest.mark.parametrize(("line", "meant"), MENDED, ids=[line for line, _ in MENDED])
def test_numbers_with_commas_or_units_are_mended_in_the_line_that_was_typed(capsys, line, meant):
    code, out, err = run(capsys, line)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    tried = err.strip().partition("; try: crossing ")[2]
    assert tried == (meant or "")
    assert not meant or run(capsys, tried)[0] == 0


@pytest.mark.parametrize("kind", ["fixed", "universal"])
def test_no_reference_is_advised_at_which_no_command_works(kind, write_robot, capsys):
    file = write_robot(("closures.0.kind", kind))
    assert main(["check", str(file)]) == 1
    told = capsys.readouterr()
    assert "try:" not in told.err
    assert "A is not square" in told.err
    assert "look at tip first" in told.out


@pytest.mark.slow
@pytest.mark.parametrize("motors", ["1.27 4.5", "3.1 0"])
def test_all_modes_are_not_advised_where_none_has_a_pose(capsys, motors):
    """The tips of both arms are farther apart than both rods are long together."""
    code, out, err = run(capsys, f"pose five_bar --motors {motors}")
    assert (code, out) == (1, "")
    assert "try:" not in err
    assert "0 real" in run(capsys, f"pose five_bar --motors {motors} --all")[1]


@pytest.mark.slow
@pytest.mark.parametrize(("duration", "time", "has_remedy"), [(0.3, 0.2, True), (0.12, 0.08, False)])
def test_the_undeformed_geometry_is_advised_only_where_it_has_a_plan(capsys, duration, time, has_remedy):
    """Springs too soft for a quick motion: the undeformed robot may be refused, too."""
    line = f"plan five_bar --scene C --flexibility flexible_links --law polynomial --times {time}"
    code, _, err = run(capsys, f"{line} --duration {duration}")
    assert code == 1
    assert ("--geometry rigid" in err) is has_remedy
    assert run(capsys, f"{line} --duration {duration} --geometry rigid")[0] == (0 if has_remedy else 1)
