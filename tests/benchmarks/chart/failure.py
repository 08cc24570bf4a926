"""Map of failure, in four panels: what breaks methods, and whether they say so.

- imposed: condition (8) is imposed `offset` beside the singular point, against the step. The true torque has
  a pole, the narrower the smaller the offset. Errors are over the largest torque of the right law.
- misfit: the law of the deformed 5R crosses beside the singular point under load, against the load. In a band
  about it there is no equilibrium, so the right answer is no; another counts as wrong. Springs are softer by
  the factor that the load over the stiffness is more than the paper's.
- sizes, masses: the 5R in sizes and durations that no unit suits, with links of 1 kg, and with payloads and
  links of any mass: their ratio conditions the mass matrix, which forward methods invert. Inverse methods are
  judged by torques, forward ones, driven by the exact torques, by how far the payload comes off its path.

Near poles errors are looked at as near as 10 us. All methods have the settings that suit scene C as printed:
that is the point. Where nothing is returned, or no number, a method has refused.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, localcontext
from functools import cache, partial
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize
from scipy.interpolate import make_interp_spline

from framework import (
    Condition,
    Law,
    Line,
    NotConverged,
    ParallelRobot,
    assemble,
    inverse_dynamics,
    plan_crossing,
    simulate,
    track_path,
)
from framework.dynamics import finite_difference_torques
from framework.dynamics.elasticity import Pass, evaluate_pass
from framework.kinematics import Branch
from framework.kinematics.frames import frames_at
from framework.laws import time_derivatives
from framework.numerics import Array, TimeFunction, TimeGrid
from tests.benchmarks.chart import closed_form, contacts, elastic_form
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.bare import BareRobot, Motion
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, pairs
from tests.benchmarks.chart.peers.five_bar import SIDES, FiveBar
from tests.benchmarks.chart.reading import counts
from tests.benchmarks.chart.robot import SceneC, planned
from tests.benchmarks.chart.torque import DifferencedLaw, doubled, pseudo_inverse, tabulated

T, T_C, SPEED = given.DURATION, given.CROSSING_TIME, given.CROSSING_SPEED
CHECKED = np.delete(np.linspace(0.0, 1.0, 61), 40)  # of the duration, not the very instant of the crossing
NEAREST = 5  # decades of seconds to a pole
SAMPLES = 257  # of tables, read by a spline
DEGREE, ELASTIC_DEGREE = 9, 5  # of the splines
STEPS = 600  # of forward runs with fixed steps
TOLERANCE = 1e-9  # relative, of scipy's integrator
CUT, AGREEMENT = 1e-3, 1e-9  # of singular values; of tables [N m]
NODES, MOST, FEW = 96, 60, 4  # of a grid; passes of plain repetition; passes over a table
SETTLED = 1e-13  # change over the largest deflection that ends the repetition
NO_ANSWER = 1e3  # error of an answer where there is none


class Outcome(NamedTuple):
    """What a method returned, what is exact, and the size of that."""

    computed: Array
    exact: Array
    size: float


Function = Callable[[Array], Array]  # times (T,) [s] -> torques [N m] or elongations [m] (T, 2)
Ready = Callable[[], Outcome]


# ------------------------------------------------------------------ imposed


def _judged_torques(function_of: Callable[[Setting], Callable[[], Function]]) -> Callable[[Setting], Ready]:
    """Errors of torques, over the largest torque of the right law."""

    def prepare(cell: Setting) -> Ready:
        run, (times, exact, size) = function_of(cell), _exact_torques(cell[0])
        return lambda: Outcome(run()(times), exact, size)

    return prepare


@cache
def _exact_torques(offset: float) -> tuple[Array, Array, float]:
    """Instants (T,) [s], torques there (T, 2) [N m], and the largest torque of the right law."""
    motion = given.exact(offset=offset)
    with localcontext(prec=closed_form.DIGITS):
        pole = motion.singular_time()
        near = [float(pole + sign * Decimal(10) ** -k) for k in range(1, NEAREST + 1) for sign in (-1, 1)]
    times = np.sort(np.concatenate([T * CHECKED, near]))
    return times, motion.torque(times), float(np.abs(given.exact().torque(T * CHECKED)).max())


def _table_of(way: Callable[[Law, float], Function]) -> Callable[[Setting], Callable[[], Function]]:
    """Tables with a cell's step [s] of the torques that `way` gives under the law, with that step."""

    def prepare(cell: Setting) -> Callable[[], Function]:
        offset, step = cell
        torque = way(given.law(offset=offset), step)
        return lambda: tabulated(torque, (T / step + 1, DEGREE)).table

    return prepare


def _evaluated(way: Callable[[SceneC, float], Function]) -> Callable[[Setting], Callable[[], Function]]:
    return lambda cell: lambda: way(SceneC(given.law(offset=cell[0])), cell[1])


def _cut(law: Law, step: float) -> Function:
    return lambda times: SceneC(law).pointwise(times, pseudo_inverse(CUT))


def _doubled(cell: Setting) -> Callable[[], Function]:
    run = doubled(given.law(offset=cell[0]), AGREEMENT)
    return lambda: run().table


def _imposed() -> tuple[Method, ...]:
    offsets = [10.0**-k for k in (2, 4, 6, 8, 10, 12)]  # of the path
    steps = pairs(offsets, [T / 2**k for k in (4, 6, 8, 10, 12)])
    mean_steps = pairs(offsets, [T / size for size in (16, 32, 64, 128)])  # of Chebyshev nodes
    tolerance = pairs(offsets, [1e-10])  # in place of a step
    unit, followed, wanted = (
        "distance to Type 2 [path], step [s]",
        "path followed; s, s', s\" exact",
        "path and law",
    )
    splines, tables = "splines of degree 9", f"as in the stage torque, until tables agree to {AGREEMENT} N m"

    def row(name: str, label: str, function_of: Any, what: str, cells: Any, source: str = "") -> Method:
        return Method(name, label, _judged_torques(function_of), what, unit, cells, source)

    return (
        row("proved", "ours, proved", _evaluated(SceneC.proved), wanted, tolerance),
        row(
            "nodes",
            "ours, nodes, not proved",
            _evaluated(lambda case, step: case.nodes(T / step)),
            followed,
            mean_steps,
        ),
        row("table", "pointwise", _table_of(lambda law, _: SceneC(law).pointwise), followed, steps, splines),
        row("pseudo_inverse", f"pseudo-inverse, cut {CUT:.0e}", _table_of(_cut), followed, steps, splines),
        row(
            "differences",
            "central differences",
            _table_of(lambda law, step: SceneC(DifferencedLaw(law, step)).pointwise),
            "path followed; s alone",
            steps,
            f"step as in the map, {splines}",
        ),
        row("doubled", "Pinocchio's tables, doubled", _doubled, wanted, tolerance, tables),
    )


# ------------------------------------------------------------------ misfit


@cache
def _elastic(load: float) -> tuple[Branch, list[int]]:
    """Scene C followed with springs softer by `load`, and the rods' columns, left before right."""
    stiff = given.robot("five_bar", "flexible_links")
    robot = replace(stiff, stiffness=stiff.stiffness / load)
    return track_path(robot, given.path()), [k for k, name in enumerate(robot.elastic_names) if "rod" in name]


@cache
def _law_beside(load: float, misfit: float) -> Law:
    """Through the point that is `misfit` beside the singular one of the deformed robot."""
    s_c = float(elastic_form.elastic_motion(1 / load).motion.s_c) + misfit
    inner = [Condition(T_C, order, value) for order, value in enumerate((s_c, SPEED, 0.0))]
    return Law.rest_to_rest(T, elastic_form.SMOOTHNESS, inner)


def _rods_proved(cell: Setting) -> Callable[[], Function]:
    (branch, columns), law = _elastic(cell[0]), _law_beside(*cell)

    def run() -> Function:
        deflections = inverse_dynamics(branch.robot, branch.path, law, geometry="deformed").deflections
        return lambda t: deflections(t)[:, columns]

    return run


def _rods_repeated(cell: Setting) -> Callable[[], Function]:
    """Plain repetition on Chebyshev nodes: forces cause deflections, these move the robot, and so on."""
    (branch, columns), law = _elastic(cell[0]), _law_beside(*cell)
    scale = branch.robot.column_scale[branch.robot.elastic]
    grid = TimeGrid.clear_of(np.array([T_C]), np.array([0.0, T]), NODES)

    def run() -> Function:
        function = best = TimeFunction(grid.edges, np.zeros((1, grid.size, branch.robot.n_e)))
        before: Pass | None = None
        least = np.inf
        for _ in range(MOST):
            before = evaluate_pass(branch, grid, law, function, before)
            change = float(np.abs(before.residual / scale).max() / np.abs(before.caused / scale).max())
            function = grid.fit_truncated(before.caused)
            if change < least:
                least, best = change, function
            if change < SETTLED or change > 1e3 * least:
                break
        if not least < 1.0:
            raise NotConverged("plain repetition: the deflections grow", residual=least)
        return lambda t: best(t)[:, columns]

    return run


def _rods_by_differences(cell: Setting) -> Callable[[], Function]:
    (branch, columns), law = _elastic(cell[0]), _law_beside(*cell)

    def run() -> Function:
        table = finite_difference_torques(
            branch.robot, branch.path, law, samples=SAMPLES, geometry="deformed", passes=FEW, branch=branch
        )
        rods = table.deflection[:, columns]
        sound = np.isfinite(rods).all(axis=1)
        return make_interp_spline(table.time[sound], rods[sound], k=ELASTIC_DEGREE)

    return run


def _rods_by_root(cell: Setting) -> Callable[[], Function]:
    """scipy's root, instant by instant, on the two equations of the 5R in floats, from the instant before."""
    law, stiffness = _law_beside(*cell), float(closed_form.ROD_STIFFNESS) / cell[0]
    length, payload = float(closed_form.LENGTH), float(closed_form.PAYLOAD)
    start, end = (complex(*map(float, point)) for point in (closed_form.START, closed_form.END))
    times = np.linspace(0.0, T, SAMPLES)
    bases, elbows = np.array(list(map(float, closed_form.BASES))), np.array(closed_form.ELBOWS)

    def residual(stretch: Array, x: complex, load: complex) -> Array:
        eps = (stretch - 1) * length
        reach = x - bases
        square = np.abs(reach) ** 2
        along = ((length**2 - (length + eps) ** 2) / square + 1) / 2
        rod = reach - (along + 1j * elbows * np.sqrt(length**2 / square - along**2)) * reach
        below = (np.conj(rod[0]) * rod[1]).imag
        share = np.array([(np.conj(load) * rod[1]).imag, (np.conj(rod[0]) * load).imag]) / below
        return np.asarray((eps - share * (length + eps) / stiffness) / length)

    def run() -> Function:
        x, loads = start + law(times) * (end - start), -payload * law(times, 2) * (end - start)
        table, stretch = np.empty((SAMPLES, 2)), np.ones(2)
        for k in range(SAMPLES):
            solved = optimize.root(residual, stretch, (x[k], loads[k]), tol=1e-14)
            if not (solved.success or np.abs(solved.fun).max() < 1e-12):
                raise ArithmeticError(f"scipy's root at t = {times[k]:.4g} s: {solved.message}")
            stretch = solved.x
            table[k] = (stretch - 1) * length
        return make_interp_spline(times, table, k=ELASTIC_DEGREE)

    return run


@cache
def _exact_rods(load: float, misfit: float) -> tuple[Array, Array | None]:
    """Instants (T,) [s] on both sides of the point, and elongations (T, 2) [m]; None where there are none."""
    solved = elastic_form.elastic_motion(1 / load)
    with localcontext(prec=closed_form.DIGITS):
        s_c = solved.motion.s_c
        powers = closed_form.law_through(s_c + Decimal(misfit), Decimal(0), elastic_form.SMOOTHNESS)
        motion = closed_form.ExactMotion(powers, s_c, Decimal(0))
        pole = motion.singular_time()
        far = min(pole, closed_form.DURATION - pole) * Decimal("0.99")
        distances = [d for k in range(60) if (d := far / 2**k) > Decimal(10) ** -NEAREST]
        sides = [[pole + side * d for d in distances] for side in (-1, 1)]
        stiffness = closed_form.ROD_STIFFNESS * solved.scale
        try:
            rods = [eps for times in sides for eps in elastic_form.followed(motion, times, stiffness)]
        except ArithmeticError:
            return np.empty(0), None
    return np.array(sides, dtype=float).ravel(), np.array(rods, dtype=float)


def _judged_rods(rods_of: Callable[[Setting], Callable[[], Function]]) -> Callable[[Setting], Ready]:
    """Errors of the rods over their largest elongation."""

    def prepare(cell: Setting) -> Ready:
        run, (times, exact) = rods_of(cell), _exact_rods(*cell)

        def judged() -> Outcome:
            rods = run()
            if exact is None:
                return Outcome(np.array([NO_ANSWER]), np.zeros(1), 1.0)
            return Outcome(rods(times), exact, float(np.abs(exact).max()))

        return judged

    return prepare


def _misfit() -> tuple[Method, ...]:
    loads = (0.01, 0.1, 1.0, 3.0, 10.0, 16.0)  # over the stiffness, over the paper's
    cells = pairs(loads, (0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2))  # of the path
    unit, table = "load / stiffness, misfit [path]", f"{SAMPLES} samples, spline of degree {ELASTIC_DEGREE}"
    plain = f"{NODES} nodes, at most {MOST} passes, kept where a pass changes least"
    return tuple(
        Method(name, label, _judged_rods(rods_of), "path and law", unit, cells, source)
        for name, label, rods_of, source in (
            ("proved", "ours, proved", _rods_proved, ""),
            ("root", "scipy root at each instant", _rods_by_root, f"hybr to 1e-14, {table}"),
            ("repeated", "plain repetition", _rods_repeated, plain),
            ("differences", f"differences, {FEW} passes", _rods_by_differences, table),
        )
    )


# ------------------------------------------------------------------ sizes, masses


@dataclass(frozen=True)
class Variant:
    """Masses of the payload and of each link [kg], size and duration over those of the paper.

    Sizes and durations need no new reference: with all lengths times a and times b, the rotors' inertia times
    a^2 and the masses kept, torques are a^2 / b^2 of those of scene C, and places a times as far.
    """

    payload: float = 10.0
    link: float = 1.0
    size: float = 1.0
    slower: float = 1.0

    @property
    def duration(self) -> float:
        """[s]"""
        return T * self.slower

    @property
    def path(self) -> Line:
        """Scene C's, as large as the robot."""
        return Line(self.size * given.path()(0.0), self.size * given.path()(1.0))

    @property
    def robot(self) -> ParallelRobot:
        return _robot(self.payload, self.link, self.size)

    @property
    def start(self) -> Array:
        """Joints (4,) at the start of the path."""
        return assemble(self.robot, self.platform(0.0)).q

    @property
    def five_bar(self) -> FiveBar:
        """For the peers."""
        return FiveBar(link_mass=self.link, payload=self.payload, size=self.size)

    def torque(self, t: ArrayLike) -> Array:
        """Exact torques (T, 2) [N m], motor side."""
        factor = (self.size / self.slower) ** 2
        return factor * planned(self.link, self.payload).torque(np.asarray(t) / self.slower)

    def platform(self, t: ArrayLike) -> Array:
        """Exact places (T, 2) [m]."""
        return self.size * planned(self.link, self.payload).platform(np.asarray(t) / self.slower)


@cache
def _robot(payload: float, link: float, size: float) -> ParallelRobot:
    description = given.robot("five_bar_heavy").description
    root = ElementTree.fromstring(description.urdf_text)
    for origin in root.iter("origin"):
        origin.set("xyz", " ".join(repr(size * float(part)) for part in origin.get("xyz", "0 0 0").split()))
    for inertial in root.iter("inertial"):
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        assert mass is not None
        assert inertia is not None
        heavy = float(mass.get("value", "0")) == float(closed_form.PAYLOAD)
        mass.set("value", repr(payload if heavy else link))
        for axis, moment in inertia.items():
            inertia.set(axis, repr(link * size**2 * float(moment)))  # those of the payload are zero
    actuators = tuple(
        replace(one, rotor_inertia=size**2 * one.rotor_inertia) for one in description.actuators
    )
    text = ElementTree.tostring(root, encoding="unicode")
    return ParallelRobot.from_description(replace(description, urdf_text=text, actuators=actuators))


def _torques(variant: Variant, torque: Function) -> Outcome:
    times = CHECKED * variant.duration
    exact = variant.torque(times)
    return Outcome(torque(times), exact, float(np.abs(exact).max()))


def _places(variant: Variant, times: Array, places: Array) -> Outcome:
    return Outcome(places, variant.platform(times), float(np.ptp(variant.platform(times), axis=0).max()))


def _planned(variant: Variant) -> Outcome:
    times, speeds = [variant.slower * T_C], [SPEED / variant.slower]
    plan = plan_crossing(variant.robot, variant.path, duration=variant.duration, times=times, speeds=speeds)
    return _torques(variant, plan.torque)


def _simulated(variant: Variant) -> Outcome:
    robot, samples = variant.robot, len(CHECKED)
    run = simulate(robot, variant.torque, start=variant.start, duration=variant.duration, samples=samples)
    return _places(variant, run.times, robot.platform.coordinates(frames_at(robot, run.q)))


def _bare(variant: Variant) -> tuple[BareRobot, Motion, Array]:
    """The variant by pinocchio and numpy alone, its motion and the samples of a table."""
    law = closed_form.motion(variant.link, payload=variant.payload)
    times = np.linspace(0.0, T, SAMPLES)
    powers = np.polynomial.Polynomial([float(c) for c in law.powers])
    s = [powers.deriv(k)(times) / variant.slower**k for k in range(3)]
    robot = BareRobot(variant.robot, variant.start)
    return robot, robot.motion(*time_derivatives(variant.path, s)), times * variant.slower


def _pinocchio_inverse(variant: Variant) -> Outcome:
    robot, motion, times = _bare(variant)
    return _torques(variant, make_interp_spline(times, robot.torques(motion), k=DEGREE))


def _mujoco_inverse(variant: Variant) -> Outcome:
    from tests.benchmarks.chart.peers.mujoco_inverse import Tree

    _, motion, times = _bare(variant)
    names = [f"{side}_{part}" for side in SIDES for part in ("motor", "elbow")]
    table = Tree(variant.five_bar, names).inverse(*motion[:3]).torque
    return _torques(variant, make_interp_spline(times, table, k=DEGREE))


def _integrated(variant: Variant, integrate: Callable[..., Array], samples: int) -> Outcome:
    robot, times = variant.robot, np.linspace(0.0, variant.duration, samples)
    q = integrate(robot, variant.torque, variant.start, times)
    if not np.all(np.isfinite(q)):
        raise ArithmeticError("no number")
    return _places(variant, times, robot.platform.coordinates(frames_at(robot, q)))


def _by_simulator(variant: Variant, module: str) -> Outcome:
    prepared = import_module(f"tests.benchmarks.chart.peers.{module}").prepared
    step, start = variant.duration / STEPS, variant.platform(0.0)
    run = prepared(variant.five_bar, variant.torque, start, step=step, duration=variant.duration)
    found = run()
    return _places(variant, found.time, found.platform)


def _variants(
    cells: tuple[Setting, ...], unit: str, variant_of: Callable[[Setting], Variant]
) -> tuple[Method, ...]:
    """The methods of a panel over these variants of the robot."""

    def row(
        name: str,
        label: str,
        way: Callable[[Variant], Outcome],
        what: str,
        source: str = "",
        package: str | None = None,
    ) -> Method:
        return Method(
            name, label, lambda cell: partial(way, variant_of(cell)), what, unit, cells, source, package
        )

    rk4 = partial(_integrated, integrate=contacts.runge_kutta, samples=STEPS + 1)
    integrate = partial(contacts.dop853, tolerance=TOLERANCE)
    dop853 = partial(_integrated, integrate=integrate, samples=len(CHECKED))
    mujoco, exudyn = (partial(_by_simulator, module=name) for name in ("mujoco_forward", "exudyn_five_bar"))
    torques, table, steps = "motor torques", f"{SAMPLES} samples, degree {DEGREE}", f"{STEPS} steps"
    shapeless = f"{table}; 1e-14 kg m^2 where MuJoCo refuses less inertia"
    return (
        row("planned", "ours, planned and proved", _planned, "path, duration, time, speed"),
        row("simulated", "ours, simulated", _simulated, torques),
        row("pinocchio", "Pinocchio, inverse", _pinocchio_inverse, "path, law", table),
        row("mujoco", "MuJoCo, inverse", _mujoco_inverse, "joints", shapeless, "mujoco"),
        row("rk4", "Pinocchio, RK4", rk4, torques, steps),
        row("dop853", "Pinocchio, DOP853", dop853, torques, f"rtol {TOLERANCE}"),
        row("mujoco_rk4", "MuJoCo, RK4", mujoco, torques, steps, "mujoco"),
        row("exudyn", "Exudyn, gen. alpha", exudyn, torques, f"{steps}, Newton to 1e-10", "exudyn"),
    )


def judge(method: Method, setting: Setting, result: Outcome) -> Judged:
    """The largest error over the size of what is exact."""
    return Judged(float(np.abs(result.computed - result.exact).max() / result.size))


def _remark(rows: Sequence[Row]) -> str:
    words = ((panel, counts(STAGE.only(panel), rows)) for panel in STAGE.panels)
    return " ".join(f"{panel.capitalize()}: {known}." for panel, known in words if known)


PANELS = {
    "imposed": _imposed(),
    "misfit": _misfit(),
    "sizes": _variants(
        pairs([10.0**k for k in (-6, -4, -2, 0, 2, 4)], [10.0**k for k in (-4, -2, 0, 2, 4)]),
        "size over the paper's, duration over the paper's",
        lambda cell: Variant(size=cell[0], slower=cell[1]),
    ),
    "masses": _variants(
        pairs([10.0**k for k in (-9, -6, -3, 0, 3, 6)], [10.0**k for k in (-12, -9, -6, -3, 0)]),
        "payload [kg], mass of a link over the payload's",
        lambda cell: Variant(payload=cell[0], link=cell[0] * cell[1]),
    ),
}
STAGE = Stage(
    name="failure",
    title="Where methods fail",
    reference="fifty digits: closed form of the 5R, in its own units (chart/closed_form.py), by similarity "
    "(chart/failure.py), two equations at each instant (chart/elastic_form.py)",
    error="largest error over the largest torque or elongation, or over the path",
    methods=tuple(
        replace(one, name=f"{panel}-{one.name}", panel=panel)
        for panel, methods in PANELS.items()
        for one in methods
    ),
    judge=judge,
    remark=_remark,
)
