"""Stage d: forward simulation, of the 5R with 1 kg links along its crossing and of Andrews' squeezer.

The 5R is driven by the torques of its closed form, which all are given as a Chebyshev series, and has to
come along its path; the squeezer has to end at the angles of two programs that share nothing. Error is the
largest distance of the payload from its path [m], or that of an angle at the end [rad].
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import numpy as np

from framework import assemble
from framework.kinematics.frames import frames_at
from tests.benchmarks.chart import integrators, published
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.integrators import Case, Course, Prepared
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, singles
from tests.benchmarks.chart.reading import short
from tests.benchmarks.chart.variants import Planned, planned

T, HEAVY = given.DURATION, "five_bar_heavy"
CROSSING, SQUEEZER = "5R with 1 kg links, through its singularity", "Andrews' squeezer"


def motion() -> Planned:
    """The reference's torques and path."""
    return planned(given.MASSES[HEAVY])


@cache
def _crossing() -> Case:
    robot = given.robot(HEAVY)
    return Case(robot, motion().torque, T, assemble(robot, given.path()(0.0)).q)


@cache
def _squeezer() -> Case:
    robot = published.squeezer()
    torque = np.array([published.TORQUE])
    return Case(
        robot, lambda t: np.repeat(torque[None], len(t), axis=0), published.DURATION, robot.reference.q
    )


def _simulator(module: str, **options: Any) -> Callable[[Setting], Callable[[], Any]]:
    def prepare(setting: Setting) -> Callable[[], Any]:
        from importlib import import_module

        from tests.benchmarks.chart.peers.five_bar import FiveBar

        prepared = import_module(f"tests.benchmarks.chart.peers.{module}").prepared
        robot, plan = FiveBar.of(HEAVY, "rigid"), motion()
        start = plan.platform(np.zeros(1))[0]
        run: Callable[[], Any] = prepared(robot, plan.torque, start, step=setting[0], duration=T, **options)
        return run

    return prepare


def judge(method: Method, setting: Setting, result: Any) -> Judged:
    """The largest error of the payload along the way, or of an angle at the end."""
    if method.panel == SQUEEZER:
        return Judged(published.off(published.squeezer(), result.q[-1]))
    if isinstance(result, Course):
        robot = given.robot(HEAVY)
        if not np.all(np.isfinite(result.q)):
            return Judged(np.inf)
        places, times = robot.platform.coordinates(frames_at(robot, result.q)), result.times
    else:  # a peer's
        places, times = result.platform, result.time
    return Judged(float(np.linalg.norm(places - motion().platform(times), axis=1).max()))


def _row(
    name: str,
    label: str,
    unit: str,
    settings: tuple[Setting, ...],
    case: Callable[[], Case],
    made: Callable[..., Prepared],
    *options: Any,
    source: str = "",
) -> Method:
    """A method of `integrators` on one of the two problems."""
    prefix, panel = ("squeezer_", SQUEEZER) if case is _squeezer else ("", CROSSING)
    prepare = lambda setting: made(case(), *options)(setting[0])  # noqa: E731
    return Method(prefix + name, label, prepare, _TORQUES, unit, settings, source, panel=panel)


def _powers(first: int, last: int, by: float = 1.0) -> tuple[Setting, ...]:
    return singles(*(10.0**-power for power in np.arange(first, last + 0.1, by)))


def _steps(*counts: int) -> tuple[Setting, ...]:
    return singles(*(T / count for count in counts))


def _remark(rows: Sequence[Row]) -> str:
    ends = [row for row in rows if row.method.startswith("squeezer_")]
    least = min(ends, key=lambda row: row.error, default=None)
    if least is None or not np.isfinite(least.error):
        return ""
    label = STAGE.method(least.method).label
    return (
        f"Nobody comes nearer to the squeezer's end than {short(least.error)} rad ({label}). The published "
        f"angles are off by {short(published.floor())}: all are held against two programs of 20 digits."
    )


_TORQUES = "motor torques"
_CONTACTS = f"constraintDynamics with 3D contacts, ProximalSettings{integrators.PROXIMAL}"
_COUNTS = (75, 150, 300, 600, 1200, 2400, 4800, 9600, 19200)
_SHORT = 0.03  # [s] of the squeezer
_PEER_STEPS = singles(2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5)
_peer = partial(Method, given=_TORQUES, unit="step [s]", settings=_PEER_STEPS, panel=CROSSING)
METHODS = (
    *(
        _row(
            f"radau_{stages}",
            f"ours, Radau IIA of {stages} stages",
            "tolerance",
            _powers(2, 14, 2),
            case,
            integrators.collocation,
            stages,
        )
        for case, count in ((_crossing, (5, 10, 16)), (_squeezer, (5, 16)))
        for stages in count
    ),
    _row(
        "fixed_steps", "ours, fixed steps", "step [s]", _steps(*_COUNTS), _crossing, integrators.fixed_steps
    ),
    _row(
        "explicit",
        "ours, explicit of order 8",
        "step [s]",
        _steps(6, 8, 12, 16, 24, 32, 48, 64, 96, 128),
        _crossing,
        integrators.explicit,
    ),
    _row(
        "pinocchio",
        "Pinocchio's contacts, RK4",
        "step [s]",
        _steps(*_COUNTS),
        _crossing,
        integrators.contact_runge_kutta,
        source=f"{_CONTACTS}; forces precomputed",
    ),
    _row(
        "scipy_dop853",
        "Pinocchio's contacts, scipy DOP853",
        "relative tolerance",
        _powers(2, 14),
        _crossing,
        integrators.scipy_contacts,
        "DOP853",
        source=f"{_CONTACTS}; atol 0.01 rtol",
    ),
    *(
        _row(
            f"scipy_{name.lower()}",
            f"Pinocchio's M, numpy, scipy {name}",
            "relative tolerance",
            _powers(2, 14),
            _squeezer,
            integrators.scipy_planar,
            name,
            source="[M J'; J 0] solved by numpy in each call, atol 0.01 rtol",
        )
        for name in ("DOP853", "LSODA")
    ),
    _peer(
        "mujoco",
        "MuJoCo, RK4",
        _simulator("mujoco_forward"),
        source="rollout, solref of two steps and the hardest solimp, control callback from a table",
        package="mujoco",
    ),
    *(
        _peer(
            f"exudyn_{name}",
            f"Exudyn, {words}",
            _simulator("exudyn_five_bar", solver=solver),
            source="redundant coordinates, modified Newton to 1e-10, loads from a table",
            package="exudyn",
        )
        for name, words, solver in (
            ("alpha", "generalised alpha", "GeneralizedAlpha"),
            ("trapezoidal", "trapezoidal, index 2", "TrapezoidalIndex2"),
        )
    ),
    _row(
        "fixed_steps",
        "ours, fixed steps",
        "step [s]",
        singles(*(_SHORT / count for count in (150, 300, 600, 1200, 2400, 4800))),
        _squeezer,
        integrators.fixed_steps,
    ),
)
STAGE = Stage(
    name="forward",
    title="Forward simulation",
    reference="closed form of the path (closed_form.py); the squeezer by energy in 34 digits (angles.txt)",
    error="largest error  [m], [rad]",
    methods=METHODS,
    judge=judge,
    goals=(1e-6, 1e-10),
    remark=_remark,
)
