"""Stage d: forward simulation, of the 5R with 1 kg links along its crossing and of Andrews' squeezer.

The 5R is driven by the torques of its closed form, which all are given as a Chebyshev series, and has to
come along its path; the squeezer has to end at the angles that others have published. Error is the largest
distance of the payload from its path [m], or that of an angle at the end [rad].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.arrays import Array, ArrayLike
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.frames import frames_at
from tests.benchmarks.chart import integrators, published
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.integrators import Case, Course, Prepared
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, singles
from tests.benchmarks.chart.reading import best_within, quickest_to, short

T, HEAVY = given.DURATION, "five_bar_heavy"
CROSSING, SQUEEZER = "5R with 1 kg links, through its singularity", "Andrews' squeezer"
GOALS = (1e-6, 1e-11)  # [m]
NAMED = {
    "ours": ("radau_5", "radau_10", "radau_16", "fixed_steps", "explicit"),
    "Pinocchio": ("pinocchio",),
    "scipy": ("scipy_dop853",),
    "MuJoCo": ("mujoco",),
    "Exudyn": ("exudyn_alpha", "exudyn_trapezoidal"),
}
SIZE = 128  # points of the series of torques: twice what they need


class Planned(NamedTuple):
    """The 5R's motion as all simulators are given it."""

    torques: Array  # Chebyshev coefficients (SIZE, 2)
    places: Array  # (SIZE, 2)

    def torque(self, t: ArrayLike) -> Array:
        """(T, 2) [N m], motor side."""
        return _series(self.torques, t)

    def platform(self, t: ArrayLike, order: int = 0, /) -> Array:
        """(T, 2) [m]."""
        return _series(self.places, t)


def _series(coefficients: Array, t: ArrayLike) -> Array:
    local = np.clip(np.asarray(t, dtype=float) * (2.0 / T) - 1.0, -1.0, 1.0)
    values = np.cos(np.arccos(local)[..., None] * np.arange(len(coefficients)))
    return np.asarray(values @ coefficients)


@cache
def planned() -> Planned:
    """The reference's torques and path."""
    motion = given.exact(HEAVY)
    nodes = np.cos(np.pi * (np.arange(SIZE) + 0.5) / SIZE)
    times = 0.5 * T * (nodes + 1.0)
    torques, places = (
        np.asarray(chebyshev.chebfit(nodes, values, SIZE - 1), dtype=float)
        for values in (motion.torque(times), motion.platform(times))
    )
    return Planned(torques, places)


@cache
def _crossing() -> Case:
    robot = given.robot(HEAVY)
    return Case(robot, planned().torque, T, assemble(robot, given.path()(0.0)).q)


@cache
def _squeezer() -> Case:
    robot = published.squeezer()
    torque = np.array([published.TORQUE])
    return Case(
        robot, lambda t: np.repeat(torque[None], len(t), axis=0), published.DURATION, robot.reference.q
    )


def _on(
    case: Callable[[], Case], made: Callable[..., Prepared], *options: Any
) -> Callable[[Setting], Callable[[], Any]]:
    return lambda setting: made(case(), *options)(setting[0])


def _simulator(module: str, **options: Any) -> Callable[[Setting], Callable[[], Any]]:
    def prepare(setting: Setting) -> Callable[[], Any]:
        from importlib import import_module

        from tests.benchmarks.chart.peers.five_bar import FiveBar

        simulate = import_module(f"tests.benchmarks.chart.peers.{module}").simulate
        robot, motion = FiveBar.of(HEAVY, "rigid"), planned()
        start = motion.platform(np.zeros(1))[0]
        return lambda: simulate(robot, motion.torque, start, step=setting[0], duration=T, **options)

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
    return Judged(float(np.linalg.norm(places - planned().platform(times), axis=1).max()))


_OURS = {
    "radau_5": ("ours, Radau IIA of 5 stages", 5),
    "radau_10": ("ours, Radau IIA of 10 stages", 10),
    "radau_16": ("ours, Radau IIA of 16 stages", 16),
}


def _sentence(rows: Sequence[Row]) -> str:
    lines = []
    for goal in GOALS:
        times = [
            f"{words} {_milliseconds(rows, names, goal)}"
            for words, names in NAMED.items()
            if _made(rows, names)
        ]
        lines.append(f"To {short(goal)} m along the crossing: {', '.join(times)}.")
    squeezed = [row for name in _OURS if (row := best_within(rows, f"squeezer_{name}")) is not None]
    peer = best_within(rows, "squeezer_scipy_dop853")
    if squeezed and peer is not None:
        best = min(squeezed, key=lambda row: row.error)
        lines.append(
            f"The squeezer ends at the published angles to {short(best.error)} rad by ours, to "
            f"{short(peer.error)} rad by scipy."
        )
    return " ".join(lines)


def _made(rows: Sequence[Row], names: Sequence[str]) -> bool:
    return any(row.method in names for row in rows)


def _milliseconds(rows: Sequence[Row], names: Sequence[str], goal: float) -> str:
    """The least time of these methods to an error no larger."""
    found = [row.seconds for name in names if (row := quickest_to(rows, name, goal)) is not None]
    return f"{1e3 * min(found):.3g} ms" if found else "never"


_TORQUES = "motor torques"
_STEPS = singles(*(T / count for count in (75, 150, 300, 600, 1500)))
_POWERS = {
    CROSSING: {"radau_5": (2, 4, 6, 8), "radau_10": (2, 4, 6, 8, 10, 12), "radau_16": (4, 6, 8, 10, 12)},
    SQUEEZER: {"radau_5": (2, 4, 6, 8), "radau_16": (12,)},
}


def _ours(case: Callable[[], Case], panel: str, prefix: str, told: str) -> list[Method]:
    return [
        Method(
            f"{prefix}{name}",
            label,
            told,
            "tolerance",
            singles(*(10.0**-power for power in _POWERS[panel][name])),
            _on(case, integrators.collocation, stages),
            ours=True,
            panel=panel,
        )
        for name, (label, stages) in _OURS.items()
        if name in _POWERS[panel]
    ]


METHODS = (
    *_ours(_crossing, CROSSING, "", _TORQUES),
    Method(
        "fixed_steps",
        "ours, fixed steps",
        _TORQUES,
        "step [s]",
        _STEPS,
        _on(_crossing, integrators.fixed_steps),
        ours=True,
        panel=CROSSING,
    ),
    Method(
        "explicit",
        "ours, explicit of order 8",
        _TORQUES,
        "step [s]",
        singles(*(T / count for count in (6, 8, 12, 16, 24, 32, 48, 64))),
        _on(_crossing, integrators.explicit),
        ours=True,
        panel=CROSSING,
    ),
    Method(
        "pinocchio",
        "Pinocchio's contacts, RK4",
        _TORQUES,
        "step [s]",
        _STEPS,
        _on(_crossing, integrators.contact_runge_kutta),
        panel=CROSSING,
    ),
    Method(
        "scipy_dop853",
        "scipy DOP853, all joints",
        _TORQUES,
        "relative tolerance",
        singles(1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13),
        _on(_crossing, integrators.scipy_planar, "DOP853"),
        panel=CROSSING,
    ),
    Method(
        "mujoco",
        "MuJoCo, RK4",
        _TORQUES,
        "step [s]",
        singles(5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4),
        _simulator("mujoco_forward"),
        peer="mujoco",
        panel=CROSSING,
    ),
    Method(
        "exudyn_alpha",
        "Exudyn, generalised alpha",
        _TORQUES,
        "step [s]",
        singles(1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4),
        _simulator("exudyn_five_bar"),
        peer="exudyn",
        panel=CROSSING,
    ),
    Method(
        "exudyn_trapezoidal",
        "Exudyn, trapezoidal, index 2",
        _TORQUES,
        "step [s]",
        singles(1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4),
        _simulator("exudyn_five_bar", solver="TrapezoidalIndex2"),
        peer="exudyn",
        panel=CROSSING,
    ),
    *_ours(_squeezer, SQUEEZER, "squeezer_", _TORQUES),
    Method(
        "squeezer_fixed_steps",
        "ours, fixed steps",
        _TORQUES,
        "step [s]",
        singles(2e-4, 1e-4, 5e-5, 2e-5),
        _on(_squeezer, integrators.fixed_steps),
        ours=True,
        panel=SQUEEZER,
    ),
    Method(
        "squeezer_scipy_dop853",
        "scipy DOP853, all joints",
        _TORQUES,
        "relative tolerance",
        singles(1e-3, 1e-5, 1e-7, 1e-9, 1e-11),
        _on(_squeezer, integrators.scipy_planar, "DOP853"),
        panel=SQUEEZER,
    ),
    Method(
        "squeezer_scipy_radau",
        "scipy Radau, all joints",
        _TORQUES,
        "relative tolerance",
        singles(1e-3, 1e-5, 1e-7),
        _on(_squeezer, integrators.scipy_planar, "Radau"),
        panel=SQUEEZER,
    ),
)
STAGE = Stage(
    name="forward",
    title="Forward simulation",
    reference="closed form of the path (closed_form.py); angles by Mazzia and Magherini 2008 (published.py)",
    error="largest error  [m], [rad]",
    methods=METHODS,
    judge=judge,
    sentence=_sentence,
)
