"""Every error a user can meet.

Two families, told apart because the reader acts differently on them:

* `InvalidInput`: what was given cannot be right. Exit code 2 at the command line.
* `NoAnswer`: the question was well posed and the answer is no, or none could be proved. Exit code 1.
  These carry the last iterate and the residual, so that the reader can go on from there.
"""

from __future__ import annotations

import copyreg
import reprlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import KW_ONLY, dataclass
from difflib import get_close_matches
from typing import Any, Self, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike, NDArray

from framework.tolerances import SAME_PLACE

Array = NDArray[np.float64]  # of `numerics`, which stands above
LARGEST_NUMBER = 1e30  # of any quantity in SI units: powers of larger numbers overflow


class FrameworkError(Exception):
    """Base of all errors raised on purpose by this package; all can be pickled.

    Its text is `name: message; clause; clause`. Nothing takes the text apart again. An error does not change
    once it is made: what a caller can add stands in a copy, which the caller raises in its place.

    `name`: the name of the robot or file that the message is about; empty where the message says it.
    `clauses`: what would help, what else was tried, what else is known; added where it is known.
    `remedy`: options with which the same call gives another answer, None for one to leave out; None where
    none is known. A traceback shows the remedy as a note.
    """

    name: str = ""
    clauses: tuple[str, ...] = ()
    remedy: Mapping[str, Any] | None = None
    nearest: Mapping[str, Any] | None = None  # the nearest pose that can be, in plain numbers

    def __init__(self, message: str = "") -> None:
        """Make an error without a name and clauses."""
        super().__init__(message)
        self.message = message

    def __str__(self) -> str:
        return f"{self.name}: {self.sentence}" if self.name else self.sentence

    @property
    def sentence(self) -> str:
        """The message and its clauses."""
        return "; ".join([self.message, *self.clauses])

    def with_changes(self, **attributes: Any) -> Self:
        """Return a copy of the error, with its traceback, its cause and other values of attributes."""
        error = copy(self)
        vars(error).update(attributes)
        if self.__cause__ is not None:  # None, too, would hide the context
            error.__cause__ = self.__cause__
        return error.with_traceback(self.__traceback__)

    def naming(self, name: str) -> Self:
        """Return the error with the name of a robot or file."""
        return self.with_changes(name=name)

    def adding(self, *clauses: str) -> Self:
        """Return the error with further clauses; empty ones are left out."""
        return self.with_changes(clauses=(*self.clauses, *filter(None, clauses)))

    def advising(self, remedy: Mapping[str, Any] | None) -> Self:
        """Return the error with a remedy."""
        words = [
            f"without {name}" if value is None else f"{name}={value}"
            for name, value in (remedy or {}).items()
        ]
        notes = [f"try: {', '.join(words)}"] if words else []
        return self.with_changes(remedy=remedy, __notes__=notes)

    def __reduce__(self) -> tuple[Any, ...]:
        make = copyreg.__newobj__  # type: ignore[attr-defined]  # its stub leaves it out
        return make, (type(self), *self.args), self.__dict__


# ------------------------------------------------------------------ what was given cannot be right


class InvalidInput(FrameworkError, ValueError):
    """An argument, an option or a file that cannot be right; the message has the value and valid ones."""


class RobotFileError(InvalidInput):
    """A robot file or its URDF cannot be used. The message starts with the file and the key."""


@dataclass(eq=False, repr=False)
class MissingPackage(RobotFileError):
    """A robot file takes its URDF from a package that is not installed: `package`."""

    message: str
    _: KW_ONLY
    package: str


class SingularReference(InvalidInput):
    """A robot's reference is on a singularity of its loops.

    There the loop equations `rows` hold nothing, or the passive `joints` move nothing, unlike at the `poses`
    nearby (joint: rad or m).
    """

    def __init__(
        self, robot: str, *, rows: Sequence[str], joints: Sequence[str], poses: Sequence[Mapping[str, float]]
    ) -> None:
        """Write the message: rows and joints without effect, and poses beside the reference.

        Each of the poses has been found to serve as a reference at the digits that are written.
        """
        what = [f"{name} holds nothing" for name in rows] + [f"{name} moves nothing" for name in joints]
        shown = [", ".join(f"{joint}: {angle:.6g}" for joint, angle in pose.items()) for pose in poses]
        advice = "; give a reference beside it, such as " * bool(shown)
        super().__init__(
            f"{robot}: the reference is on a singularity of the loops: {', '.join(what)} there, unlike "
            f"nearby, and the robot can go on in several ways{advice}"
            f"{' or '.join(f'{{{angles}}}' for angles in shown)}"
        )
        self.rows, self.joints, self.poses = tuple(rows), tuple(joints), tuple(poses)


class OutputError(InvalidInput):
    """The place where results should go cannot be written."""


def short(value: object) -> str:
    """Return a value as text, cut to a length that fits a message of one line."""
    return reprlib.repr(value)


def format_distinct(one: float, other: float, digits: int = 4) -> tuple[str, str]:
    """Return two numbers as texts of at least `digits` digits, enough for the texts to differ."""
    for count in range(digits, 18):
        texts = f"{one:.{count}g}", f"{other:.{count}g}"
        if texts[0] != texts[1]:
            break
    return texts


def round_up(value: float, digits: int) -> float:
    """Round a number >= 0 up to so many digits; infinity and zero stay."""
    if not np.isfinite(value) or value == 0.0:
        return value
    unit = 10.0 ** (np.floor(np.log10(value)) - digits + 1)
    return float(f"{np.ceil(value / unit) * unit:.{digits}g}")


def choose_from(what: str, given: object, valid: Iterable[str], meant: Collection[str] = ()) -> str:
    """Return the sentence for a name that is not in a list: the given, the nearest and the valid names.

    `meant` are further names that may be meant, beside the nearest.
    """
    names = sorted(set(valid))
    hint = did_you_mean(given, names, meant)
    return f"unknown {what} {_CUT.repr(given)}{hint} (valid: {list_names(names)})"


def list_names(names: Sequence[str], most: int = 40) -> str:
    """List at most so many names for a message, and count the rest."""
    listed = ", ".join(names[:most]) or "none"
    return listed + (f", and {len(names) - most} more" if len(names) > most else "")


def check_choice(what: str, given: object, valid: Collection[str]) -> None:
    """Raise InvalidInput for a name that is not in a list, with the sentence of `choose_from`."""
    if not isinstance(given, str) or given not in valid:
        raise InvalidInput(choose_from(what, given, valid))


def did_you_mean(given: object, valid: Iterable[str], meant: Collection[str] = ()) -> str:
    """Return the clause that asks whether names meant or similar were intended; empty without any."""
    similar = " or ".join(map(repr, dict.fromkeys([*meant, *nearest(str(given), valid)])))
    return f"; did you mean {similar}?" if similar else ""


def check_name(where: str, what: str, given: object, valid: Collection[str]) -> None:
    """Raise RobotFileError unless a name is one of the valid; `where` starts the complaint."""
    if not isinstance(given, str) or given not in valid:
        raise RobotFileError(f"{where}: {choose_from(what, given, valid)}")


def check_unique(where: str, names: Sequence[str]) -> None:
    """Raise RobotFileError for a repeated name; `where` starts the complaint."""
    for name in names:
        if names.count(name) > 1:
            raise RobotFileError(f"{where}: duplicate {name!r}")


_CUT = reprlib.Repr()  # cuts long values
_CUT.maxstring = _CUT.maxother = 200
_LISTED = 40  # numbers of an array that a message shows


def nearest(given: str, names: Iterable[str]) -> list[str]:
    """Return the valid names that resemble a given one; none where too many to compare.

    Names that differ by capitals alone, else names that begin with the given one, else the most similar one,
    else names that contain the given one.
    """
    names, word = list(names), given.lower()
    # a million pairs of letters are compared in 0.1 s
    if not word or len(word) * sum(map(len, names)) > 1_000_000:
        return []
    alike = {name.lower(): name for name in names}
    begun = [name for lower, name in alike.items() if len(word) > 1 and lower.startswith(word)]
    close = [alike[lower] for lower in get_close_matches(word, alike, n=1)]
    within = [name for lower, name in alike.items() if len(word) > 2 and word in lower]
    return [alike[word]] if word in alike else (begun or close or within)[:3]


def expect(what: str, given: object, kind: type, such_as: str) -> None:
    """Raise InvalidInput unless an object is of a kind; `such_as` is an example for the message."""
    if not isinstance(given, kind):
        raise InvalidInput(
            f"{what}: needs a {kind.__name__}, such as {such_as}, got {short(given)} ({type(given).__name__})"
        )


def expect_call(what: str, given: object, attributes: Sequence[str], such_as: str) -> None:
    """Raise InvalidInput unless an object can be called and has the attributes."""
    if not callable(given) or not all(hasattr(given, name) for name in attributes):
        raise InvalidInput(
            f"{what}: needs {such_as}, or what can be called as {what}(., order) and has "
            f"{' and '.join(attributes)}, got {short(given)}"
        )


def check_order(order: object, highest: int | None = None) -> None:
    """Raise InvalidInput unless this can be the order of a derivative, 0 for the value itself."""
    whole = type(order) is int or (isinstance(order, int | np.integer) and not isinstance(order, bool))
    if not whole or order < 0 or (highest is not None and order > highest):  # type: ignore[operator]
        valid = "of at least 0" if highest is None else f"from 0 to {highest}"
        raise InvalidInput(f"order: must be a whole number {valid}, got {short(order)}")


def whole_number(what: str, given: object, least: int, most: int) -> int:
    """Return the given whole number between two; raise InvalidInput for anything else."""
    whole = isinstance(given, int | float | np.integer | np.floating) and not isinstance(given, bool)
    if not whole or not least <= given <= most or int(given) != given:  # type: ignore[operator,call-overload]
        raise InvalidInput(f"{what}: needs a whole number, {least} to {most}, got {short(given)}")
    return int(given)  # type: ignore[call-overload]


def real_numbers(what: str, given: ArrayLike) -> Array:
    """Return real numbers, which may be infinite, as an array; raise InvalidInput for anything else."""
    if type(given) is np.ndarray and given.dtype == float:
        return given
    try:
        numbers = np.asarray(given)
        if (
            numbers.dtype.kind not in "bcmMSU"
        ):  # no truths, complex numbers, dates or texts, which numpy reads
            return numbers.astype(float, copy=False)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InvalidInput(f"{what}: needs real numbers, got {_CUT.repr(given)}")


def finite_numbers(
    what: str, given: ArrayLike, count: int, *, stacks: bool = False, largest: float = LARGEST_NUMBER
) -> Array:
    """Return numbers as an array (count,), or (T, count) where `stacks` are allowed.

    Raises:
        InvalidInput: no numbers, numbers that are not finite or above the largest, or another count.
    """
    try:
        values = real_numbers(what, given)
    except InvalidInput:
        values = np.empty(0)
    fits = values.shape[-1:] == (count,) and (values.ndim == 1 or (stacks and values.ndim == 2))
    finite = np.abs(values) <= largest
    if fits and finite.all():
        return values
    at_most = f" of at most {largest:g}" if fits and np.isfinite(values).all() else ""
    if fits and values.ndim == 2:
        rows = np.flatnonzero(~finite.all(axis=1)).tolist()
        which = f"{len(rows)} of {len(values)} rows are not, {short(rows)}"
        raise InvalidInput(f"{what} must be finite numbers{at_most}: {which}")
    shown = given.tolist() if isinstance(given, np.ndarray) and given.size <= _LISTED else given
    raise InvalidInput(f"{what} must be {count} finite numbers{at_most}, got {_CUT.repr(shown)}")


# ------------------------------------------------------------------ the answer is no


E = TypeVar("E", bound=FrameworkError)


@dataclass_transform(eq_default=False, kw_only_default=True)
def _with_attributes(error: type[E]) -> type[E]:
    """Decorate an error whose annotated attributes are given by keyword beside its message."""
    return dataclass(eq=False, repr=False, kw_only=True)(error)


@dataclass(eq=False, repr=False)
class NoAnswer(FrameworkError):
    """A question well posed that has no answer, or none that could be proved; `message` is the reason.

    `proof` is what the reason rests on, None where nothing is proved; `evidence` what a search found instead
    (`framework.planning.refusals`).
    """

    message: str
    _: KW_ONLY
    name: str = ""
    clauses: tuple[str, ...] = ()
    proof: object = None
    evidence: object = None

    def __post_init__(self) -> None:
        """Store the message as text of the exception, by whatever arguments an error was made."""
        super().__init__(self.message)


@_with_attributes
class NotAssembled(NoAnswer):
    """The loops do not close. Carries the last iterate `q` (nq,) and its `residual` [m, rad]."""

    q: Array
    residual: float


@_with_attributes
class OutOfReach(NotAssembled):
    """The path leaves the workspace: after path coordinate `s`, at `platform`, the leg of `joint` ends."""

    s: float
    platform: Array
    joint: str


@_with_attributes
class Type1Singularity(NoAnswer):
    """The path meets a Type 1 singularity (a leg stretched or folded) at `s`, in the leg of `joint`."""

    s: float
    platform: Array
    joint: str


@_with_attributes
class Type2Singularity(NotAssembled):
    """The motors lead into a Type 2 singularity, at `platform`, after this `share` of their way.

    `q` is the configuration there.
    """

    share: float
    platform: Array


class SingularPath(NoAnswer):
    """The path runs along the singular locus instead of across."""


class NoLaw(NoAnswer):
    """No motion law can pass, or none was found that advances all the time."""


@_with_attributes
class UncontrolledMotions(NoLaw):
    """The path meets a pose, at `s` and `platform`, in which `count` motions are uncontrolled at once.

    Each of them asks for a condition (8) of its own; a law meets two by its s'^2 and s", more only where they
    agree, and none where the loop equations themselves let the motions go.
    """

    s: float
    platform: Array
    count: int


@_with_attributes
class UnboundedTorque(NoAnswer):
    """The law meets a Type 2 singularity with t_s . W_p != 0: the torque has a pole at `time`.

    `wrench` is t_s . W_p at that instant, in newton when t_s moves the platform's point, in N m when
    t_s only turns it.
    """

    time: float
    s: float
    platform: Array
    wrench: float


@_with_attributes
class SingularPose(NoAnswer):
    """A question about forces at one pose, `platform` (n,), at which the motors do not hold the robot.

    `wrench` is t_s . W_p where it is what forbids an answer [N, or N m for a pure turn].
    """

    platform: Array
    wrench: float | None = None


@_with_attributes
class LoadedJoint(NoAnswer):
    """The motion would load `joint`, which nothing holds, with `torque` [N m or N] at `time` [s]."""

    joint: str
    torque: float
    time: float


@_with_attributes
class LimitsExceeded(NoAnswer):
    """A proved motion that leaves limits of the request: `exceeded`, by joint."""

    exceeded: Mapping[str, str]


@_with_attributes
class NotConverged(NoAnswer):
    """A numerical method did not reach its tolerance; `residual` is the last one.

    Where one place on the path is the cause, `s` and `platform` say which.
    """

    residual: float = np.inf
    s: float | None = None
    platform: Array | None = None


class NotIdentified(NoAnswer):
    """Recorded data show no parameters with which the robot predicts other data better than without."""


class SpringsTooSoft(NotConverged):
    """The forces of the undeformed robot deflect springs, or even stiffer ones, beyond `MAX_DEFLECTION`."""


class LostWorkers(NoAnswer):
    """Processes that computed a task were killed, one after the other, or cannot be started."""


def point(x: Sequence[float] | Array, scale: float | Array = 0.0) -> str:
    """Return coordinates for a message: `(0.1, 0.345)`; rounding against the others or `scale` is 0."""
    values = np.atleast_1d(np.asarray(x, dtype=float))
    least = np.maximum(1e-12 * np.abs(values).max(initial=0.0), SAME_PLACE * np.asarray(scale))
    values = np.where(np.abs(values) < least, 0.0, values)
    return "(" + ", ".join(f"{float(value):.6g}" for value in values) + ")"
