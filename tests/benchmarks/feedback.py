"""Elastic robots under lqg: does the set of sensors that `--sensors suggest` names pass, and as predicted?

    python -m tests.benchmarks.feedback five_bar:C delta:cross upright:three_rrr:crossing 0 1 7

A number is a robot of `tests.dynamics.upright_robots`; others are scenes of the catalogue, upright or as they
are. The robots differ in payload (10 %), springs (20 %) and friction (5 %). One period of 1 ms is a known
delay; encoders have 8192 counts, those behind springs 2^18; motors have 1.2 times the planned peaks. The
deviation of 40 runs at one instant is compared with the predicted one by the 68.27 % quantile, which one
escaping run does not fill.
"""

import sys
from dataclasses import replace

import numpy as np

from framework import CrossingPlan, NoAnswer, ParallelRobot, load_robot, plan_crossing, plan_scene
from framework.control import ControlLoop, Spread, StudySetup, predict_by_sensors
from framework.control.closed_loop import PERIODS_PER_CHECK
from tests.dynamics.upright_robots import G, drawn

SPREAD = Spread(payload=0.1, stiffness=0.2, friction=0.05)
RUNS, SEED = 40, 7


def main(names: list[str]) -> None:
    """Print a line for each robot."""
    for name in names:
        try:
            print(name, study(plan_of(name)), flush=True)
        except NoAnswer as refusal:
            print(name, "is not planned:", refusal, flush=True)


def plan_of(name: str) -> CrossingPlan:
    """The plan of a random robot by number, or of a scene of the catalogue, with links as springs."""
    if name.isdigit():
        one = drawn(int(name))
        return plan_crossing(one.robot(1.0), one.path, duration=one.duration)
    *upright, key, scene = name.split(":")
    robot = load_robot(key, flexibility="flexible_links")
    if upright:
        description = replace(robot.description, gravity=(0.0, -G, 0.0))
        robot = ParallelRobot.from_description(description, flexibility="flexible_links")
    return plan_scene(robot, scene)


def study(plan: CrossingPlan) -> str:
    """The sensors that are suggested, the runs that pass, and the deviation over the predicted one."""
    limit = tuple(1.2 * peak for peak in plan.peak_torque.values())
    loop = ControlLoop(delay=1e-3, counts=8192, link_counts=2**18, limit=limit)
    setup = StudySetup(plan, 1e-3, loop, SPREAD, SEED)
    predictions = predict_by_sensors(setup.reference, loop, SPREAD, models=setup.linear_models)
    trials = setup.try_sensors(predictions)
    tried = ", ".join(f"{one.sensors} {one.passed}/{one.runs}" for one in trials)
    if not trials or not trials[-1].is_enough:
        return f"no sensors are named: {tried or 'none is predicted to pass'}"
    chosen = setup.with_sensors(trials[-1].sensors)
    predicted = next(one for one in predictions if one.sensors == trials[-1].sensors)
    run = chosen.run("lqg", *range(RUNS))
    reference = setup.reference
    at = np.minimum(PERIODS_PER_CHECK * np.arange(len(run.x)), len(reference.times) - 1)  # of the checks
    deviation = np.abs(run.x - reference.x[at][:, None]) / reference.robot.platform_scale  # (checks, R, n)
    quantile = np.quantile(np.nan_to_num(deviation, nan=1.0), 0.6827, axis=1).max()  # lost runs are far off
    return (
        f"{run.passed.sum()}/{RUNS} pass, tried {tried}; predicted {predicted.platform:.2e}, the runs have "
        f"{quantile:.2e}, {quantile / predicted.platform:.2f} of it {predicted.warning(loop.tolerance)}"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
