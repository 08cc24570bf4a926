"""Seven hundred files and command lines that are not quite right: one clear line, or an answer that is right.

Every mutant is made from a good file or command line by a fixed seed. What is refused is refused in one line
with exit code 1 or 2. Of robots that are accepted one half is planned by command. The other half has bodies
that can be, closes all its loops at the reference and along a motion, by equations of the tests' own; every
fourth mutant is driven by its planned torques, and comes along its path.
"""

import json
import os
import random
import subprocess
import sys
import traceback
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import robots
from framework import (
    FrameworkError,
    Line,
    Mechanism,
    NotAssembled,
    ParallelRobot,
    SingularReference,
    plan_crossing,
    plan_scene,
    simulate,
)
from framework.cli import main
from framework.model.description import FLEXIBILITIES
from framework.model.readers import read_any
from framework.planning.saved import plan_document
from framework.show.jogging import PageServer
from tests.fuzz.mutate import changed_json, changed_words, changed_xml, changed_yaml, is_well_formed
from tests.oracles.closure_rows import closure_errors
from tests.oracles.forward_simulation import kinematics
from tests.test_console import is_one_line
from tests.watchdog import bounded

pytestmark = pytest.mark.slow

MUTANTS = 20  # of each file
PATHS = {"PYTHONPATH": os.pathsep.join(sys.path)}
LONGEST = 20.0  # [s] of work that a mutant may take
WELL_FORMED = 0.3  # least share of the files that parse
DIALECTS = Path(__file__).parents[1] / "data" / "dialects"
OWN = (
    *("five_bar", "four_bar", "slider_crank", "biglide", "three_rrr", "three_rpr", "n_four_bar", "delta"),
    *("agile_eye", "bricard", "gough_stewart"),
)
PLAIN = {"axes": ["x", "y"]}
POSE = {"left_motor": 1.27186, "left_elbow": -0.83362, "right_motor": 1.08362, "right_elbow": 1.53859}
MOTORS = ["left_motor", "right_motor"]
FOREIGN = {  # file that is changed: file that is given, and what has to be said beside it
    "gepetto/robot.yaml": ("robot.yaml", {"platform": "tip_A", **PLAIN}),
    "gepetto/robot.urdf": ("robot.yaml", {"platform": "tip_A", **PLAIN}),
    "five_bar_plus.urdf": ("five_bar_plus.urdf", {"platform": "tip_predecessor", "motors": MOTORS, **PLAIN}),
    "five_bar_ros.urdf": ("five_bar_ros.urdf", {"platform": "tip_parent", "reference": POSE, **PLAIN}),
    "five_bar_onshape.urdf": (
        "five_bar_onshape.urdf",
        {"platform": "closing_tip_1", "reference": POSE, "motors": MOTORS, **PLAIN},
    ),
    "five_bar_sites.xml": ("five_bar_sites.xml", {"platform": "left_tip", **PLAIN}),
    "five_bar_anchor.xml": ("five_bar_anchor.xml", {"platform": "connect_1_1", **PLAIN}),
}
PLANS = (
    ("five_bar", "C", {"flexibility": "flexible_links"}),
    ("four_bar", "dead_point", {}),
    ("five_bar", "A", {"duration": None, "optimize": "time", "torque_limit": 0.3}),
)
COMMANDS = (
    "robots",
    "check five_bar",
    "check five_bar --flexibility flexible_links --json",
    "check {dialects}/five_bar_plus.urdf --platform left_rod --axes x y --motors left_motor right_motor",
    "check four_bar --reference crank=0.3",
    "convert {dialects}/five_bar_ros.urdf --platform left_rod --axes x y --out out",
    "locate five_bar --scene C",
    "locate five_bar --from 0.1 0.345 --to -0.05 0.195 --flexibility flexible_links --json",
    "plan five_bar --scene C --json",
    "plan five_bar --scene C --flexibility flexible_joints --geometry rigid",
    "plan five_bar --from 0.1 0.345 --to -0.05 0.195 --duration 1.5 --times 1 --speeds 1.5 --smoothness 3",
    "plan five_bar --scene B --raw --samples 50",
    "plan four_bar --scene dead_point --samples 10",
    "simulate five_bar --scene C --method stiff --tolerance 1e-5",
    "plan five_bar --scene A --duration 1 --law optimal --smoothness 2 --json",
    "plan five_bar --from 0.1 0.345 --to -0.05 0.195 --optimize time --torque-limit 0.165 --margin 10%",
    "simulate plan --method fast --step 1e-3 --damping 0.01",
    "robustness five_bar --scene C --runs 2 --period 5e-3 --controller feedforward --payload 0.1",
    "robustness plan --runs 2 --period 5e-3 --delay 1e-3 --friction 0.1 --limit 1 --seed 3 --sensors joints",
    "show five_bar --scene C --html page.html",
    "report plan",
    "show plan --html page.html",
)


class Outcome:
    """What came of the mutants of one kind, and the faults found."""

    def __init__(self) -> None:
        self.faults: list[str] = []
        self.codes: dict[int, int] = {}  # how often each exit code came
        self.well_formed = 0
        self.planned = 0  # motions
        self.simulated = 0

    def fault(self, mutant: object, what: str) -> None:
        self.faults.append(f"{mutant}: {what}")

    def __str__(self) -> str:
        return (
            f"{sum(self.codes.values())} commands, {self.well_formed} files well-formed; exit codes "
            f"{self.codes}; "
            f"{self.planned} motions planned, {self.simulated} simulated; {len(self.faults)} faults:\n"
            + "\n".join(self.faults[:40])
        )


@pytest.fixture
def run(capfd):
    """Runs one command: its exit code, and what is wrong with what it says."""

    def run(outcome: Outcome, mutant: object, *words: str) -> int:
        capfd.readouterr()
        try:
            with bounded(LONGEST):
                code = main(list(words))
        except SystemExit as end:  # --help, --version
            code = int(end.code or 0)
        except AssertionError as slow:
            outcome.fault(mutant, str(slow))
            code = -1
        out, err = capfd.readouterr()
        outcome.codes[code] = outcome.codes.get(code, 0) + 1
        wrong = _wrong(code, out, err, machine="--json" in words)
        if wrong:
            outcome.fault(mutant, f"{wrong}; exit code {code}, stdout {out[-200:]!r}, stderr {err[-600:]!r}")
        return code

    return run


def _wrong(code: int, out: str, err: str, *, machine: bool) -> str:
    """What is wrong with an answer, if anything."""
    if code not in (0, 1, 2):
        return "neither done nor refused"
    if code == 0 and err:
        return "done, and yet a complaint"
    if code and not (err.startswith("crossing: ") and is_one_line(err)):
        return "not one line"
    found_elsewhere = code == 1 and "they do at the pose that is printed as reference" in err
    not_square = code == 2 and ("A is not square" in err or "do not tell" in err)
    diagnosed = found_elsewhere or not_square  # `check` prints what it has found, and what is wrong with it
    if code and out and not machine and not diagnosed:
        return "refused, and yet an answer"
    if machine and code in (1, 2):
        try:
            json.loads(out)["error"]["message"]
        except (ValueError, KeyError, TypeError):
            return "not one JSON object"
    return ""


def check_bodies(robot: Mechanism) -> None:
    """No body has less than no mass, nor an inertia that no mass gives."""
    for inertia in robot.model.inertias:
        assert np.isfinite(inertia.mass)
        assert inertia.mass >= 0
        moments = np.linalg.eigvalsh(inertia.inertia)
        slack = 2e-2 * np.abs(moments).max() + 1e-11 * inertia.mass
        assert moments[0] >= -slack
        assert moments[2] <= moments[0] + moments[1] + slack


def opening(robot: ParallelRobot, q: np.ndarray) -> float:
    """How far the loops are open at most [m, rad], all rows, by the words of the robot file."""
    data, still = robot.model.createData(), np.zeros(robot.model.nv)
    errors = []
    for configuration in q:
        kinematics(robot.model, data, configuration, still)
        errors.append(np.abs(closure_errors(robot.model, data, robot.description.closures)).max())
    return float(np.max(errors))


def check_robot_answers(outcome: Outcome, mutant: object, mechanism: Mechanism, *, simulated: bool) -> None:
    """What was accepted has to be right: bodies, loops, a motion, and the simulation of its torques."""
    scale = max(mechanism.length, 1.0)
    check_bodies(mechanism)
    try:
        robot = ParallelRobot.of(mechanism)
    except (NotAssembled, SingularReference):  # `check` says so, and describes another pose
        return
    start = robot.reference
    assert opening(robot, start.q[None]) < 1e-8 * scale
    try:
        if robot.description.scenes:
            plan = plan_scene(robot, next(iter(robot.description.scenes)))
        else:
            away = np.where(robot.translations, 0.01 * robot.length, 0.01)
            plan = plan_crossing(robot, Line(start.x, start.x + away), duration=1.0)
    except FrameworkError:  # it says no
        return
    outcome.planned += 1
    times = np.linspace(0.0, plan.duration, 33)
    assert opening(robot, plan.dynamics.configuration(times)) < 1e-8 * scale
    if not simulated:
        return
    try:
        result = simulate(robot, plan.dynamics, method="stiff", tolerance=1e-6)
    except FrameworkError:  # it cannot tell
        return
    outcome.simulated += 1
    assert result.closure_error < 1e-4 * scale
    assert (result.tracking_error or 0.0) < 1e-3 * scale


def finish(outcome: Outcome, capfd, *, files: int = 0) -> None:
    with capfd.disabled():
        print(f"\n{outcome}")
    assert outcome.well_formed >= WELL_FORMED * files
    assert not outcome.faults, str(outcome)


def answers(outcome: Outcome, mutant: object, load, *, simulated: bool) -> None:
    """Hold what was accepted against what is known of right robots."""
    try:
        with bounded(LONGEST), np.errstate(all="ignore"):
            check_robot_answers(outcome, mutant, load(), simulated=simulated)
    except AssertionError as wrong:
        outcome.fault(mutant, f"accepted, but {' '.join(str(wrong).split())[:400]} {_line(wrong)}")
    except Exception as error:  # noqa: BLE001  this is what is looked for
        outcome.fault(mutant, f"accepted, but {type(error).__name__}: {str(error)[:300]} {_line(error)}")


def _line(error: BaseException) -> str:
    """The last lines of code that an error came by."""
    frames = traceback.extract_tb(error.__traceback__)[-3:]
    return " < ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in reversed(frames))


@pytest.mark.parametrize("name", OWN)
@pytest.mark.parametrize("part", ["yaml", "urdf"])
def test_mutants_of_robot_files(run, capfd, tmp_path, name, part):
    outcome, source = Outcome(), robots.CATALOGUE[name].file
    texts = {
        "yaml": source.read_text(encoding="utf-8"),
        "urdf": source.with_suffix(".urdf").read_text("utf-8"),
    }
    change, kind = (changed_yaml, "yaml") if part == "yaml" else (changed_xml, "xml")
    for seed in range(MUTANTS):
        rng = random.Random(f"{name} {part} {seed}")
        mutant = change(texts[part], rng)
        outcome.well_formed += is_well_formed(mutant, kind)
        for other, text in {**texts, part: mutant}.items():
            (tmp_path / source.with_suffix(f".{other}").name).write_text(text, "utf-8", "surrogatepass")
        flexibility = rng.choice(FLEXIBILITIES)
        file = tmp_path / source.name
        words = ["check", os.fspath(file), "--flexibility", flexibility, *rng.choice(([], ["--json"]))]
        if run(outcome, (name, part, seed), *words) != 0:
            continue
        if seed % 2:
            words = ["plan", *words[1:], "--scene", next(iter(robots.load(name).description.scenes))]
            run(outcome, (name, part, seed, "plan"), *words)
        else:
            load = partial(Mechanism.from_file, file, flexibility=flexibility)
            answers(outcome, (name, part, seed), load, simulated=seed % 4 == 0)
    finish(outcome, capfd, files=MUTANTS)


@pytest.mark.parametrize("name", FOREIGN)
def test_mutants_of_dialects(run, capfd, tmp_path, name):
    outcome, (given, said), folder = Outcome(), FOREIGN[name], (DIALECTS / name).parent
    for file in folder.iterdir():
        if file.is_file():
            (tmp_path / file.name).write_bytes(file.read_bytes())
    text = (DIALECTS / name).read_text(encoding="utf-8")
    change, kind = (changed_yaml, "yaml") if name.endswith("yaml") else (changed_xml, "xml")
    file = tmp_path / given
    words = ["check", os.fspath(file)]
    for option, value in said.items():
        values = [f"{joint}={angle}" for joint, angle in value.items()] if isinstance(value, dict) else value
        words += [f"--{option}", *([values] if isinstance(values, str) else values)]
    for seed in range(MUTANTS):
        rng = random.Random(f"{name} {seed}")
        mutant = change(text, rng)
        outcome.well_formed += is_well_formed(mutant, kind)
        (tmp_path / Path(name).name).write_text(mutant, "utf-8", "surrogatepass")
        if run(outcome, (name, seed), *words, *rng.choice(([], ["--json"]))) == 0:

            def load() -> Mechanism:
                return Mechanism.from_description(read_any(file, **said))

            answers(outcome, (name, seed), load, simulated=seed % 4 == 0)
    finish(outcome, capfd, files=MUTANTS)


@pytest.fixture(scope="module")
def plans(tmp_path_factory) -> dict[str, str]:
    """plan.json of some motions."""
    found = {}
    for name, scene, options in PLANS:
        robot = robots.load(name, flexibility=options.get("flexibility", "rigid"))
        rest = {key: value for key, value in options.items() if key != "flexibility"}
        found[f"{name} {scene}"] = json.dumps(plan_document(plan_scene(robot, scene, **rest)))
    return found


@pytest.mark.parametrize("name", [f"{name} {scene}" for name, scene, _ in PLANS])
def test_mutants_of_plans(run, capfd, tmp_path, plans, name):
    outcome = Outcome()
    for seed in range(MUTANTS):
        rng = random.Random(f"{name} {seed}")
        mutant = changed_json(plans[name], rng)
        outcome.well_formed += is_well_formed(mutant, "json")
        (tmp_path / "plan.json").write_text(mutant, "utf-8", "surrogatepass")
        words = ["simulate", os.fspath(tmp_path), "--method", "stiff", "--tolerance", "1e-5"]
        if run(outcome, (name, seed), *words, *rng.choice(([], ["--json"]))) == 0:
            outcome.simulated += 1  # and on its path: `simulate` says no otherwise
    finish(outcome, capfd, files=MUTANTS)


def test_mutants_of_command_lines(run, capfd, tmp_path, plans, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(PageServer, "serve_until_interrupted", lambda server: server.server_close())
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    monkeypatch.setattr("framework.show.plots.save_figures", lambda plan, folder: [])
    outcome = Outcome()
    for seed in range(4 * MUTANTS):
        rng = random.Random(f"command line {seed}")
        (tmp_path / "plan").mkdir(exist_ok=True)
        (tmp_path / "plan" / "plan.json").write_text(plans["five_bar C"])
        words = rng.choice(COMMANDS).format(dialects=DIALECTS).split()
        words = changed_words(words, rng)
        run(outcome, (seed, words), *words)
    finish(outcome, capfd)


def test_mutants_in_processes_of_their_own(tmp_path):
    """What only the end of a process shows, on a few: streams flushed, nothing left over, the exit code."""
    source = robots.CATALOGUE["five_bar"].file
    texts = {
        "yaml": source.read_text(encoding="utf-8"),
        "urdf": source.with_suffix(".urdf").read_text("utf-8"),
    }
    for seed in range(12):
        rng = random.Random(f"process {seed}")
        mutants = {"yaml": changed_yaml(texts["yaml"], rng), "urdf": texts["urdf"]}
        if seed % 2:
            mutants = {"yaml": texts["yaml"], "urdf": changed_xml(texts["urdf"], rng)}
        for part, text in mutants.items():
            (tmp_path / f"five_bar.{part}").write_text(text, "utf-8", "surrogatepass")
        command = [sys.executable, "-m", "framework", "check", "five_bar.yaml", "--json"]
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=300, env={**os.environ, **PATHS}
        )
        assert not _wrong(done.returncode, done.stdout, done.stderr, machine=True), (seed, done)
        assert {path.name for path in tmp_path.iterdir()} == {"five_bar.yaml", "five_bar.urdf"}
