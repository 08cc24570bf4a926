"""Map of failure, in four panels: what breaks methods, and whether they say so.

`imposed` and `misfit` have modules of their own. Here are the 5R in sizes and durations that no unit suits,
with links of 1 kg, and with payloads and links of any mass: in `masses` their ratio conditions the mass
matrix, which forward methods invert.

Inverse methods are judged by the torques over the largest one, forward ones, driven by the exact torques, by
how far the payload comes off its path over the path's length. All have the settings that suit scene C as
printed: that is the point. Where nothing is returned, or no number, a method has refused.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from framework import assemble, plan_crossing, simulate
from framework.kinematics.frames import frames_at
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from tests.benchmarks.chart import closed_form, imposed, integrators, misfit
from tests.benchmarks.chart.bare import FLAT, BareRobot, Motion
from tests.benchmarks.chart.integrators import Case, Prepared
from tests.benchmarks.chart.measure import Judged, Method, Outcome, Row, Setting, Stage, pairs
from tests.benchmarks.chart.peers.five_bar import SIDES
from tests.benchmarks.chart.reading import counts
from tests.benchmarks.chart.variants import CHECKED, Variant

STEPS = 600  # of forward runs with fixed steps
SAMPLES, DEGREE = 257, 9  # of tables, read by a spline
SHAPELESS = "1e-14 kg m^2 where MuJoCo refuses less inertia"
TOLERANCE = 1e-9  # relative, of scipy's integrator

VariantOf = Callable[[Setting], Variant]


def _torques(variant: Variant, torque: Callable[[Array], Array]) -> Outcome:
    times = CHECKED * variant.duration
    exact = variant.torque(times)
    return Outcome(torque(times), exact, float(np.abs(exact).max()))


def _places(variant: Variant, times: Array, places: Array) -> Outcome:
    return Outcome(places, variant.platform(times), float(np.ptp(variant.platform(times), axis=0).max()))


def _planned(variant: Variant) -> Outcome:
    plan = plan_crossing(
        variant.robot,
        variant.path,
        duration=variant.duration,
        times=[variant.slower * float(closed_form.CROSSING_TIME)],
        speeds=[float(closed_form.CROSSING_SPEED) / variant.slower],
    )
    return _torques(variant, plan.torque)


def _simulated(variant: Variant) -> Outcome:
    robot = variant.robot
    start = assemble(robot, variant.platform(0.0)).q
    run = simulate(robot, variant.torque, start=start, duration=variant.duration, samples=len(CHECKED))
    return _places(variant, run.times, robot.platform.coordinates(frames_at(robot, run.q)))


def _bare(variant: Variant) -> tuple[BareRobot, Motion, Array]:
    """The variant by pinocchio and numpy alone, its motion and the samples of a table."""
    law = closed_form.motion(variant.link, payload=variant.payload)
    times = np.linspace(0.0, float(closed_form.DURATION), SAMPLES)
    powers = np.polynomial.Polynomial([float(c) for c in law.powers])
    s = [powers.deriv(k)(times) / variant.slower**k for k in range(3)]
    robot = BareRobot(variant.robot, assemble(variant.robot, variant.platform(0.0)).q, FLAT, (0, 1))
    return robot, robot.motion(*time_derivatives(variant.path, s)), times * variant.slower


def _pinocchio_inverse(variant: Variant) -> Outcome:
    robot, motion, times = _bare(variant)
    return _torques(variant, make_interp_spline(times, robot.torques(motion), k=DEGREE))


def _mujoco_inverse(variant: Variant) -> Outcome:
    from tests.benchmarks.chart.peers.mujoco_inverse import Tree

    motion, times = _bare(variant)[1:]
    names = [f"{side}_{part}" for side in SIDES for part in ("motor", "elbow")]
    table = Tree(variant.five_bar, names).inverse(*motion[:3]).torque
    return _torques(variant, make_interp_spline(times, table, k=DEGREE))


def _case(variant: Variant) -> Case:
    robot = variant.robot
    return Case(robot, variant.torque, variant.duration, assemble(robot, variant.platform(0.0)).q)


def _integrated(made: Callable[..., Prepared], *options: Any, tolerance: float | None = None) -> Any:
    def run(variant: Variant) -> Outcome:
        course = made(_case(variant), *options)(tolerance or variant.duration / STEPS)()
        robot = variant.robot
        if not np.all(np.isfinite(course.q)):
            raise ArithmeticError("no number")
        return _places(variant, course.times, robot.platform.coordinates(frames_at(robot, course.q)))

    return run


def _simulator(module: str) -> Callable[[Variant], Outcome]:
    def run(variant: Variant) -> Outcome:
        prepared = import_module(f"tests.benchmarks.chart.peers.{module}").prepared
        found = prepared(
            variant.five_bar,
            variant.torque,
            variant.platform(0.0),
            step=variant.duration / STEPS,
            duration=variant.duration,
        )()
        return _places(variant, found.time, found.platform)

    return run


def _methods(cells: tuple[Setting, ...], unit: str, variant_of: VariantOf) -> tuple[Method, ...]:
    """The methods of a panel over these variants of the robot."""

    def prepared(run: Callable[[Variant], Outcome]) -> Callable[[Setting], Callable[[], Outcome]]:
        def prepare(setting: Setting) -> Callable[[], Outcome]:
            variant = variant_of(setting)
            return lambda: run(variant)

        return prepare

    def declared(
        name: str,
        label: str,
        run: Callable[[Variant], Outcome],
        given: str,
        source: str = "",
        package: str | None = None,
    ) -> Method:
        return Method(name, label, prepared(run), given, unit, cells, source, package)

    rk4 = _integrated(integrators.contact_runge_kutta)
    dop853 = _integrated(integrators.scipy_contacts, "DOP853", tolerance=TOLERANCE)
    mujoco, exudyn = _simulator("mujoco_forward"), _simulator("exudyn_five_bar")
    torques, table, steps = "motor torques", f"{SAMPLES} samples, degree {DEGREE}", f"{STEPS} steps"
    return (
        declared("planned", "ours, planned and proved", _planned, "path, duration, time, speed"),
        declared("simulated", "ours, simulated", _simulated, torques),
        declared("pinocchio", "Pinocchio, inverse", _pinocchio_inverse, "path, law", table),
        declared("mujoco", "MuJoCo, inverse", _mujoco_inverse, "joints", f"{table}; {SHAPELESS}", "mujoco"),
        declared("rk4", "Pinocchio, RK4", rk4, torques, steps),
        declared("dop853", "Pinocchio, DOP853", dop853, torques, f"rtol {TOLERANCE}"),
        declared("mujoco_rk4", "MuJoCo, RK4", mujoco, torques, steps, "mujoco"),
        declared("exudyn", "Exudyn, gen. alpha", exudyn, torques, f"{steps}, Newton to 1e-10", "exudyn"),
    )


def judge(method: Method, setting: Setting, result: Outcome) -> Judged:
    """The largest error over the size of what is exact."""
    return Judged(float(np.abs(result.computed - result.exact).max() / result.size))


def _remark(rows: Sequence[Row]) -> str:
    words = ((panel, counts(STAGE.only(panel), rows)) for panel in STAGE.panels)
    return " ".join(f"{panel.capitalize()}: {known}." for panel, known in words if known)


_SIZES = pairs([10.0**k for k in (-6, -4, -2, 0, 2, 4)], [10.0**k for k in (-4, -2, 0, 2, 4)])
_MASSES = pairs([10.0**k for k in (-9, -6, -3, 0, 3, 6)], [10.0**k for k in (-12, -9, -6, -3, 0)])
PANELS = {
    "imposed": imposed.METHODS,
    "misfit": misfit.METHODS,
    "sizes": _methods(
        _SIZES,
        "size over the paper's, duration over the paper's",
        lambda cell: Variant(size=cell[0], slower=cell[1]),
    ),
    "masses": _methods(
        _MASSES,
        "payload [kg], mass of a link over the payload's",
        lambda cell: Variant(payload=cell[0], link=cell[0] * cell[1]),
    ),
}
STAGE = Stage(
    name="failure",
    title="Where methods fail",
    reference="fifty digits: closed form of the 5R, in its own units (chart/closed_form.py), by similarity "
    "(chart/variants.py), two equations at each instant (chart/elastic_form.py)",
    error="largest error over the largest torque or elongation, or over the path",
    methods=tuple(
        replace(one, name=f"{panel}-{one.name}", panel=panel)
        for panel, methods in PANELS.items()
        for one in methods
    ),
    judge=judge,
    remark=_remark,
    is_map=True,
)
