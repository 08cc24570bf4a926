"""The options of a plan, each declared once with its meaning, its valid values and its command-line form.

This declaration generates the record that is planned (`request.Request`), the signature and help of functions
like `plan_crossing` (`takes_options`), the options of the command line (`TYPED`), the options that a scene of
a robot file may state (`scenes.scene_request`), and the request in plan.json. A new option is one more field
of `PlanOptions`, and a line where planning uses it.
"""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, fields
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar

import numpy as np

from framework.dynamics.inverse_dynamics import GEOMETRIES, check_tolerance
from framework.dynamics.motor_friction import FRICTIONS
from framework.dynamics.motor_limits import Limit
from framework.errors import InvalidInput, check_choice
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import check_duration, is_number
from framework.laws.path import Path
from framework.model.description import GOALS
from framework.numerics.arrays import has_entries
from framework.tolerances import TORQUE_TAIL

LAWS = ("auto", "polynomial", "optimal")
SHARINGS = ("free", "least_norm")  # of the load by redundant motors
MOTION, LAW, MODEL, LIMITS = "what to plan", "the law", "the model", "limits"  # topics of the help
OPTIMAL_LAW: dict[str, Any] = {"law": "optimal", "times": None, "speeds": None}  # a remedy of refusals
Check = Callable[[str, Any], Any]  # (option's name, value) -> converted value; raises InvalidInput


class Option(NamedTuple):
    """The meaning of an option, its check and its form on the command line."""

    name: str
    summary: str  # with the unit; the help on the command line
    details: str  # follows the summary in Python's help
    check: Check | None  # None if the check needs the robot: then `Request.of` makes it
    typed: Mapping[str, Any] | None  # arguments of argparse; None if not on the command line
    topic: str  # heading of the command line's help

    @property
    def flag(self) -> str:
        """The option's name on the command line."""
        return "--" + self.name.replace("_", "-")

    @property
    def documentation(self) -> str:
        """The paragraph about the option in a docstring."""
        return textwrap.fill(
            f"{self.name}: {self.summary}{self.details}.",
            width=104,
            initial_indent="    ",
            subsequent_indent="        ",
        )


# ------------------------------------------------------------------ checks of values


def _seconds(name: str, value: Any) -> float:
    """Return a positive number of seconds as a float."""
    check_duration(value, name)
    return float(value)


def _numbers(name: str, value: Any) -> tuple[float, ...]:
    """Convert a list of finite numbers to a tuple."""
    if not has_entries(value):
        raise InvalidInput(f"{name}: needs a list of numbers, got {value!r}")
    for number in value:
        if not is_number(number):
            raise InvalidInput(f"{name}: must be finite numbers, got {number!r}")
    return tuple(map(float, value))


def _end_motion(name: str, value: Any) -> tuple[float, ...] | None:
    """Return s', s", ... at an end as a tuple; None for an end at rest."""
    derivatives = _numbers(name, value if has_entries(value) else [value])
    if not any(derivatives):
        return None
    if derivatives[0] <= 0.0:
        raise InvalidInput(
            f"{name}: s' must be greater than zero, or all must be zero, got {derivatives[0]:g}"
        )
    return derivatives


def _tolerance(name: str, value: Any) -> float:
    """Return a tolerance of the torques as a float."""
    check_tolerance(value)
    return float(value)


def _share(name: str, value: Any) -> float:
    """Return a number in [0, 1)."""
    if not (is_number(value) and 0 <= value < 1):
        raise InvalidInput(f"{name}: must lie in [0, 1), got {value!r}")
    return float(value)


def _yes_or_no(name: str, value: Any) -> bool:
    """Return a truth value as bool; refuse other values, such as 0 and 1."""
    if not isinstance(value, bool | np.bool_):
        raise InvalidInput(f"{name}: must be true or false, got {value!r}")
    return bool(value)


def _one_of(valid: Sequence[str]) -> Check:
    """Return a check that accepts only the valid names."""

    def check(name: str, value: Any) -> str:
        """Return a valid name."""
        check_choice(name, value, valid)
        return str(value)

    return check


# ------------------------------------------------------------------ the options


def _option(
    summary: str,
    details: str = "",
    *,
    default: Any = None,
    check: Check | None = None,
    typed: Mapping[str, Any] | None = None,
    topic: str = LAW,
) -> Any:
    """Declare a field of `PlanOptions` by its default and the fields of its `Option`."""
    meaning = {"summary": summary, "details": details, "check": check, "typed": typed, "topic": topic}
    return field(default=default, metadata=meaning)


@dataclass(frozen=True)
class PlanOptions:
    """All options of a plan, beside its robot and its path."""

    _: KW_ONLY
    duration: float | None = _option(
        "how long the motion takes [s]",
        '; not with optimize="time", which finds the least',
        check=_seconds,
        typed={"type": float, "metavar": "T"},
        topic=MOTION,
    )
    times: Sequence[float] | None = _option(
        "instants of the crossings [s]",
        ", ascending, one for each singular point; chosen when None. Every law meets them: the polynomial, "
        "or the optimal law with its goal, without a duration too. An empty list asks for a polynomial "
        "without crossing conditions",
        check=_numbers,
        typed={"type": float, "nargs": "*", "metavar": "t"},
    )
    speeds: Sequence[float] | None = _option(
        "speeds s' at the crossings [1/s]",
        "; chosen when None",
        check=_numbers,
        typed={"type": float, "nargs": "*", "metavar": "v"},
    )
    at: Sequence[float] | None = _option(
        "path coordinates to impose condition (8) at, instead of the located singular points",
        check=_numbers,
    )
    geometry: str | None = _option(
        "forces of the undeformed (rigid) or of the deformed robot (default: deformed when elastic)",
        ". The first is the paper's hypothesis of small displacements; the deformed robot has its "
        "singular points elsewhere",
        check=_one_of(GEOMETRIES),
        typed={"choices": GEOMETRIES},
        topic=MODEL,
    )
    smoothness: int | None = _option(
        "derivatives of s that are given at both ends, zero at rest (default: 2 rigid, 4 elastic)",
        typed={"type": int, "metavar": "R"},
    )
    start_speed: float | Sequence[float] | None = _option(
        "speed s' [1/s] at which the motion starts, and s\", ... if they are not zero; at rest by default",
        ". One number, or the derivatives of s up to the order `smoothness` at most, with springs up to 10",
        check=_end_motion,
        typed={"type": float, "nargs": "+", "metavar": "v"},
    )
    end_speed: float | Sequence[float] | None = _option(
        "speed s' [1/s] with which it ends; as start_speed",
        check=_end_motion,
        typed={"type": float, "nargs": "+", "metavar": "v"},
    )
    tolerance: float = _option(
        "tail of the torques that counts as resolved", check=_tolerance, default=TORQUE_TAIL
    )
    law: str = _option(
        "polynomial through times and speeds, optimal, or auto: polynomial where it advances (default)",
        " and keeps the limits, and else the optimal law; where the polynomial's largest torque stands "
        "beside a near miss of the singular locus, that of lower peak. The plan's `reason` says which "
        "and why",
        check=_one_of(LAWS),
        typed={"choices": LAWS},
        default="auto",
    )
    optimize: str | None = _option(
        "cost that the optimal law minimises (peak_torque)",
        ': "time"; "peak_torque": the largest ratio of a torque to its limit, or in N m if no motor has one; '
        '"energy": the integral over the motion of the sum of (torque over limit)^2. There a motor '
        "without a limit is weighted by the largest limit of the others, which does not bound it. Of the "
        "laws that cost at most 0.4 % more than the least cost found, the smoothest is taken, or one that "
        "costs more if the torques of none of these are resolved",
        check=_one_of(GOALS),
        typed={"choices": GOALS},
    )
    time_limit: float | None = _option(
        "time of the search for an optimal law, after which it ends with the best so far [s]",
        ", or with `SearchEnded` if none was found yet. The plan's `reason` then says that the search was "
        "ended. The time is checked before each cone program and each step of deflections; it does not "
        "include the computation before the search, the certificate and the proofs",
        check=_seconds,
        typed={"type": float, "metavar": "SECONDS"},
    )
    longest: float | None = _option(
        "bound on a duration that is found [s]",
        ", instead of `duration`; the quickest law is the same whatever it is",
        check=_seconds,
        typed={"type": float, "metavar": "T"},
    )
    torque_limit: Limit = _option(  # noqa: RUF009 - frozen
        "largest torque [N m] of all motors, of each, or JOINT=N of some, motor side; none: no limit",
        "; a force [N] where a motor slides. In Python a number, a list or a dict by joint; inf, or None "
        "for one motor, is no limit. By default those of the robot file; no law of a plan exceeds them",
        typed={"nargs": "+", "metavar": "N"},
        topic=LIMITS,
    )
    speed_limit: Limit = _option(  # noqa: RUF009 - frozen
        "largest speed [rad/s] of all motors, of each, or JOINT=N of some, motor side; none: no limit",
        "; as torque_limit",
        typed={"nargs": "+", "metavar": "N"},
        topic=LIMITS,
    )
    corner_speed: Limit = _option(  # noqa: RUF009 - frozen
        "speed [rad/s] up to which the motors have their largest torque, which falls from there to zero at "
        "the no-load speed; as speed-limit",
        ". A motor that brakes keeps its largest torque. By default those of the robot file; curves of "
        "motors without a torque limit do not count",
        typed={"nargs": "+", "metavar": "N"},
        topic=LIMITS,
    )
    no_load_speed: Limit = _option(  # noqa: RUF009 - frozen
        "speed [rad/s] at which the motors have no torque left; as speed-limit",
        typed={"nargs": "+", "metavar": "N"},
        topic=LIMITS,
    )
    rms_torque_limit: Limit = _option(  # noqa: RUF009 - frozen
        "largest root mean square of the torque [N m] over the motion, or the cycle; as torque-limit",
        typed={"nargs": "+", "metavar": "N"},
        topic=LIMITS,
    )
    cycle_time: float | None = _option(
        "time [s] in which the motion is repeated, over which torques are averaged for rms-torque-limit",
        ". For the rest of it the motors are without torque, as with brakes; by default there is no rest",
        check=_seconds,
        typed={"type": float, "metavar": "T"},
        topic=LIMITS,
    )
    margin: float = _option(
        "share of the limits left free, such as 10% or 0.1",
        " (a number in Python), for the controllers",
        check=_share,
        typed={"metavar": "P"},
        topic=LIMITS,
        default=0.0,
    )
    friction: str = _option(
        "dry friction of driven joints, by the sign of their speed (driven, the default), or none",
        "; that of other joints is not planned with",
        check=_one_of(FRICTIONS),
        typed={"choices": FRICTIONS},
        topic=MODEL,
        default="driven",
    )
    torque_sharing: str | None = _option(
        "how redundant motors share the load: free, within the limits and by the goal, or least_norm "
        "(default: free when rigid)",
        '; "free": the optimal law is sought over all distributions of its torques, and any law takes the '
        "distribution of least norm within the limits, or of least peak if that is the goal; a motion whose "
        'torques of least norm keep the limits keeps these. Elastic robots have "least_norm" alone: their '
        "springs deflect with the distribution",
        check=_one_of(SHARINGS),
        typed={"choices": SHARINGS},
        topic=MODEL,
    )
    wrenches: Mapping[str, Any] | None = _option(
        "external wrenches by URDF link or joint, ON its body, at its origin, (force, moment) (6,)",
        " [N, N m], base axes; or {wrench: (6,), axes: tool} on the axes of the frame, which turn with it; "
        "or, in place of (6,), rows (s, force, moment) with s from 0 to 1, interpolated by a cubic spline. "
        "Plans count them like weight; forces that depend on velocity cannot be given",
        check=lambda name, value: ExternalWrenches.of(value).document or None,
    )
    keep_limits: bool = _option(
        "refuse a plan beyond the ranges of the URDF's joints, or beyond limits of motors that were lifted; "
        "it is reported otherwise",
        " (`CrossingPlan.exceeded`)",
        check=_yes_or_no,
        typed={"action": "store_true"},
        topic=LIMITS,
        default=False,
    )


OPTIONS = {one.name: Option(one.name, **one.metadata) for one in fields(PlanOptions)}
DEFAULTS: dict[str, Any] = {one.name: one.default for one in fields(PlanOptions)}
TYPED = {name: option for name, option in OPTIONS.items() if option.typed is not None}


# ------------------------------------------------------------------ functions that take the options

P = ParamSpec("P")
R = TypeVar("R")


def _with_parameters_of(
    _: Callable[P, PlanOptions],
) -> Callable[[Callable[..., R]], Callable[Concatenate[ParallelRobot, Path, P], R]]:
    """Make a decorator that gives **options the signature and the help of `PlanOptions`.

    The argument is `PlanOptions` itself, from which type checkers take the parameters P.
    """
    named = inspect.signature(PlanOptions).parameters.values()
    listed = "\n".join(option.documentation for option in OPTIONS.values())

    def decorator(function: Callable[..., R]) -> Callable[Concatenate[ParallelRobot, Path, P], R]:
        """Replace the last parameter by the options, and {options} in the docstring by their help."""
        signature = inspect.signature(function)
        *positional, _ = signature.parameters.values()
        function.__signature__ = signature.replace(parameters=[*positional, *named])  # type: ignore[attr-defined]
        function.__doc__ = (inspect.getdoc(function) or "").replace("    {options}", listed)
        return function

    return decorator


takes_options = _with_parameters_of(PlanOptions)
