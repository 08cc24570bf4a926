"""Readers of typed values from a document: a table for each mapping, from its keys to readers.

A reader is called with the place of a value in the document, `where`, such as `actuators[0].joint`, and with
the `raw` value. It returns the typed value, or raises an InvalidInput that names the place, the given value
and valid ones. Most functions here are such readers, or make one from other readers (`read`). For messages,
`what` says what a name stands for, such as "joint".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import MISSING, fields
from difflib import get_close_matches
from functools import partial
from numbers import Real
from typing import Any, NamedTuple, TypeAlias, TypeVar

from framework.errors import LARGEST_NUMBER, InvalidInput, RobotFileError, check_name, choose_from, short

MIN_ROWS, MAX_ROWS = 2, 10_000_000  # of the table of a motion
T = TypeVar("T")
Reader = Callable[[str, Any], T]  # (where, raw) -> typed value


class Field(NamedTuple):
    """The reader of a key's value, and its default."""

    read: Reader[Any]
    default: Any = None  # value of a key that is left out
    required: bool = False  # whether the key must be given
    also: Collection[str] = ()  # other words for the key, which are refused and point to it


optional = Field  # declares a key that may be left out
required = partial(Field, required=True)  # declares a key that must be given
Table = Mapping[str, Field]


def below(where: str, key: object) -> str:
    """Return the place of a key in the mapping at `where`, which is empty for the whole file."""
    return f"{where}.{key}" if where else str(key)


# ------------------------------------------------------------------ mappings and lists


def mapping(where: str, raw: Any) -> dict[Any, Any]:
    """Read a mapping of any keys."""
    if not isinstance(raw, dict):
        raise InvalidInput(f"{where or 'the file'}: needs a mapping of keys, got {str(raw)[:60]!r}")
    return raw


def read_table(where: str, raw: Any, table: Table, *, others: Collection[str] | None = ()) -> dict[str, Any]:
    """Read the value of each key of a table from the mapping `raw`.

    Args:
        others: keys that may be given in addition and are not read; None allows any key.

    Raises:
        InvalidInput: a key is missing or unknown, or its reader refuses the value.
    """
    content = mapping(where, raw)
    values = {}
    for key, field in table.items():
        if key in content:
            values[key] = field.read(below(where, key), content[key])
        elif field.required:
            unknown = [str(name) for name in content if name not in table]
            similar = get_close_matches(key, unknown, n=1)
            hint = f"; is {similar[0]!r} a misspelling?" if similar else ""
            listed = ", ".join(map(str, content)) or "nothing"
            raise InvalidInput(f"{below(where, key)}: missing{hint} (given: {listed})")
        else:
            values[key] = field.default
    valid = content if others is None else (*table, *others)
    for key in content:
        if key not in valid:
            meant = [name for name, field in table.items() if key in field.also]
            raise InvalidInput(f"{below(where, key)}: {choose_from('key', key, valid, meant)}")
    return values


def record(
    table: Table, make: Callable[[str, dict[str, Any]], Any] = lambda _, values: values
) -> Reader[Any]:
    """Return a reader of a mapping by a table; `make` converts place and values into an object."""
    return lambda where, raw: make(where, read_table(where, raw, table))


def dataclass_of(kind: type[T], readers: Mapping[str, Reader[Any]]) -> Reader[T]:
    """Return a reader of a mapping that becomes a dataclass of this kind.

    `readers` are those of the fields, by name. A field without a default is required.
    """
    defaults = {field.name: field.default for field in fields(kind)}  # type: ignore[arg-type]
    table = {}
    for name, read in readers.items():
        default = defaults[name]
        table[name] = Field(read, default, required=default is MISSING)
    return record(table, lambda _, values: kind(**values))


def mapping_of(read: Reader[T], read_name: Reader[str] = lambda _, name: str(name)) -> Reader[dict[str, T]]:
    """Return a reader of a mapping from names to values, read by `read_name` and `read`.

    By default any name is valid.
    """

    def read_named(where: str, raw: Any) -> dict[str, T]:
        """Read each name and its value."""
        values = {}
        for name, value in mapping(where, raw).items():
            place = below(where, name)
            values[read_name(place, name)] = read(place, value)
        return values

    return read_named


def list_of(read: Reader[T], *, least: int = 0) -> Reader[tuple[T, ...]]:
    """Return a reader of a list with at least `least` (0 or 1) values of one kind."""

    def read_list(where: str, raw: Any) -> tuple[T, ...]:
        """Read each item at its place in the list."""
        if not isinstance(raw, list | tuple) or len(raw) < least:
            words = "a list with at least one entry" if least else "a list"
            raise InvalidInput(f"{where}: needs {words}, got {short(raw)}")
        return tuple(read(f"{where}[{i}]", item) for i, item in enumerate(raw))

    return read_list


def one_or_list_of(read: Reader[T]) -> Reader[tuple[T, ...]]:
    """Return a reader of one value of a kind, or of a list of such values."""
    return lambda where, raw: list_of(read)(where, raw if isinstance(raw, list) else [raw])


def distinct(what: str, valid: Collection[str]) -> Reader[tuple[str, ...]]:
    """Return a reader of one valid name, or of a list of different valid names."""

    def read_names(where: str, raw: Any) -> tuple[str, ...]:
        """Read the names; refuse repeated ones."""
        names = one_or_list_of(one_of(what, valid))(where, raw)
        check_distinct(where, what, names, valid)
        return names

    return read_names


def check_distinct(where: str, what: str, names: Sequence[str], valid: Collection[str]) -> None:
    """Raise RobotFileError for repeated names, for names that are not `valid`, and for an empty list."""
    for name in names:
        check_name(where, what, name, valid)
    if not names or len(set(names)) < len(names):
        raise RobotFileError(f"{where}: needs at least one {what}, and each once, got {list(names)}")


# ------------------------------------------------------------------ texts and numbers


def anything(where: str, raw: Any) -> Any:
    """Read any value."""
    return raw


def or_null(read: Reader[T]) -> Reader[T | None]:
    """Return a reader that returns None for null, and reads any other value by `read`."""
    return lambda where, raw: None if raw is None else read(where, raw)


def _instance_of(kind: type[T], words: str) -> Reader[T]:
    """Return a reader of values of the type `kind`, called `words` in complaints."""

    def read_instance(where: str, raw: Any) -> T:
        """Return the value; refuse other types."""
        if not isinstance(raw, kind):
            raise InvalidInput(f"{where}: needs {words}, got {short(raw)}")
        return raw

    return read_instance


def one_of(what: str, valid: Collection[str]) -> Reader[str]:
    """Return a reader of a name out of the valid ones."""

    def read_name(where: str, raw: Any) -> str:
        """Return the name; refuse others, with the nearest valid ones."""
        if not isinstance(raw, str) or raw not in valid:
            raise InvalidInput(f"{where}: {choose_from(what, raw, valid)}")
        return raw

    return read_name


def _restrict(read: Reader[T], is_valid: Callable[[T], bool], complaint: str) -> Reader[T]:
    """Return a reader like `read` that refuses values unless `is_valid`, with a complaint."""

    def read_valid(where: str, raw: Any) -> T:
        """Read a value; refuse an invalid one."""
        value = read(where, raw)
        if not is_valid(value):
            raise InvalidInput(f"{where}: {complaint}, got {raw!r}")
        return value

    return read_valid


def number(where: str, raw: Any) -> float:
    """Read a finite number of at most LARGEST_NUMBER.

    A number may be given as text, since YAML 1.1 reads 1e5 as text.
    """
    try:
        if isinstance(raw, bool) or not isinstance(raw, Real | str):
            raise ValueError
        value = float(raw)
    except ValueError:
        raise InvalidInput(f"{where}: needs a number, got {raw!r}") from None
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise InvalidInput(f"{where}: needs a finite number, got {raw!r}")
    if abs(value) > LARGEST_NUMBER:
        raise InvalidInput(f"{where}: must be at most {LARGEST_NUMBER:g} in size, got {raw!r}")
    return value


text_or_empty = _instance_of(str, "a text")
text = _restrict(text_or_empty, bool, "needs a text")
integer = _restrict(
    _instance_of(int, "a whole number"), lambda value: not isinstance(value, bool), "needs a whole number"
)
whole = _restrict(integer, lambda value: value >= 0, "must not be negative")
positive = _restrict(number, lambda value: value > 0, "must be greater than zero")
not_negative = _restrict(number, lambda value: value >= 0, "must not be negative")
Positive: TypeAlias = float  # annotations of numbers that `CheckedNumbers` checks
NotNegative: TypeAlias = float
CHECKS = {"Positive": positive, "NotNegative": not_negative}


class CheckedNumbers:
    """Base of frozen dataclasses whose numbers are checked, and stored as floats, by their annotations."""

    def __post_init__(self) -> None:
        """Check each number; None is valid where its annotation says so."""
        for field in fields(self):  # type: ignore[arg-type]
            kind, _, or_none = str(field.type).partition(" | ")
            value = getattr(self, field.name)
            if kind in CHECKS and not (or_none and value is None):
                object.__setattr__(self, field.name, CHECKS[kind](field.name, value))


def vector3(where: str, raw: Any) -> tuple[float, float, float]:
    """Read three finite numbers."""
    vector = list_of(number)(where, raw)
    if len(vector) != 3:
        raise InvalidInput(f"{where}: needs three numbers, got {raw!r}")
    return vector[0], vector[1], vector[2]
