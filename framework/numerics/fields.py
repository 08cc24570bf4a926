"""Typed values out of the mappings of a document: a table for each mapping, from its keys to readers.

A reader is called with the place `where` a value stands, such as `actuators[0].joint`, and the value `raw`
there. It returns the value read, or raises an InvalidInput that names the place, the value given and valid
ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import MISSING, fields
from difflib import get_close_matches
from functools import partial
from numbers import Real
from typing import Any, NamedTuple, TypeVar

from framework.errors import InvalidInput, RobotFileError, check_name, choose_from, short

LARGEST_NUMBER = 1e30  # of any quantity in SI units: powers of others overflow
T = TypeVar("T")
Reader = Callable[[str, Any], T]


class Field(NamedTuple):
    """The reader of a key's value, and its default."""

    read: Reader[Any]
    default: Any = None
    required: bool = False


optional = Field  # declares a key that may be left out
required = partial(Field, required=True)  # and one that must be given
Table = Mapping[str, Field]


def below(where: str, key: object) -> str:
    """Return the place of a key in the mapping at `where`.

    The place of the file itself is empty.
    """
    return f"{where}.{key}" if where else str(key)


# ------------------------------------------------------------------ mappings and lists


def mapping(where: str, raw: Any) -> dict[Any, Any]:
    """Read a mapping of any keys."""
    if not isinstance(raw, dict):
        raise InvalidInput(f"{where or 'the file'}: needs a mapping of keys, got {str(raw)[:60]!r}")
    return raw


def read_table(where: str, raw: Any, table: Table, *, others: Collection[str] | None = ()) -> dict[str, Any]:
    """Read the value of each key of the table.

    The keys `others` may be given too, None for any.

    Raises:
        InvalidInput: a key is missing or unknown, or its reader refuses the value.
    """
    content = mapping(where, raw)
    values = {}
    for key, field in table.items():
        if key in content:
            values[key] = field.read(below(where, key), content[key])
        elif field.required:
            similar = get_close_matches(key, [str(name) for name in content if name not in table], n=1)
            hint = f"; is {similar[0]!r} a misspelling?" if similar else ""
            listed = ", ".join(map(str, content)) or "nothing"
            raise InvalidInput(f"{below(where, key)}: missing{hint} (given: {listed})")
        else:
            values[key] = field.default
    valid = content if others is None else (*table, *others)
    for key in content:
        if key not in valid:
            raise InvalidInput(f"{below(where, key)}: {choose_from('key', key, valid)}")
    return values


def record(
    table: Table, make: Callable[[str, dict[str, Any]], Any] = lambda _, values: values
) -> Reader[Any]:
    """Return a reader of a mapping by a table.

    `make` converts place and values into the object read.
    """
    return lambda where, raw: make(where, read_table(where, raw, table))


def table_of(kind: type[Any], readers: Mapping[str, Reader[Any]]) -> Table:
    """Return the table of a dataclass: a reader for each field, by type."""
    table = {}
    for field in fields(kind):
        read = readers[str(field.type)]
        table[field.name] = required(read) if field.default is MISSING else optional(read, field.default)
    return table


def mapping_of(read: Reader[T], read_name: Reader[str] | None = None) -> Reader[dict[str, T]]:
    """Return a reader of a mapping from names to values of one kind."""

    def read_named(where: str, raw: Any) -> dict[str, T]:
        """Read each value, and each name if names have a reader."""
        values = {}
        for name, value in mapping(where, raw).items():
            place = below(where, name)
            values[read_name(place, name) if read_name else str(name)] = read(place, value)
        return values

    return read_named


def list_of(read: Reader[T]) -> Reader[tuple[T, ...]]:
    """Return a reader of a list of values of one kind."""

    def read_list(where: str, raw: Any) -> tuple[T, ...]:
        """Read each item, named by its place in the list."""
        if not isinstance(raw, list | tuple):
            raise InvalidInput(f"{where}: needs a list, got {short(raw)}")
        return tuple(read(f"{where}[{i}]", item) for i, item in enumerate(raw))

    return read_list


def one_or_list_of(read: Reader[T]) -> Reader[tuple[T, ...]]:
    """Return a reader of one value of a kind, or of a list of such values."""
    return lambda where, raw: list_of(read)(where, raw if isinstance(raw, list) else [raw])


def distinct(what: str, valid: Collection[str]) -> Reader[tuple[str, ...]]:
    """Return a reader of one valid name, or of a list of different ones."""

    def read(where: str, raw: Any) -> tuple[str, ...]:
        names = one_or_list_of(one_of(what, valid))(where, raw)
        check_distinct(where, what, names, valid)
        return names

    return read


def check_distinct(where: str, what: str, names: Sequence[str], valid: Collection[str]) -> None:
    """Raise RobotFileError for unknown and repeated names, and for an empty list."""
    for name in names:
        check_name(where, what, name, valid)
    if not names or len(set(names)) < len(names):
        raise RobotFileError(f"{where}: needs at least one {what}, and each once, got {list(names)}")


def entries(read: Reader[T]) -> Reader[tuple[T, ...]]:
    """Return a reader of a list with at least one entry."""

    def read_entries(where: str, raw: Any) -> tuple[T, ...]:
        """Read a list; refuse an empty one."""
        if not isinstance(raw, list) or not raw:
            raise InvalidInput(f"{where}: needs a list with at least one entry, got {raw!r}")
        return list_of(read)(where, raw)

    return read_entries


# ------------------------------------------------------------------ texts and numbers


def anything(where: str, raw: Any) -> Any:
    """Read any value."""
    return raw


def or_null(read: Reader[T]) -> Reader[T | None]:
    """Return a reader of null, or else by `read`."""
    return lambda where, raw: None if raw is None else read(where, raw)


def truth(where: str, raw: Any) -> bool:
    """Read true or false."""
    if not isinstance(raw, bool):
        raise InvalidInput(f"{where}: needs true or false, got {short(raw)}")
    return raw


def text_or_empty(where: str, raw: Any) -> str:
    """Read a text."""
    if not isinstance(raw, str):
        raise InvalidInput(f"{where}: needs a text, got {short(raw)}")
    return raw


def text(where: str, raw: Any) -> str:
    """Read a text that is not empty."""
    if not isinstance(raw, str) or not raw:
        raise InvalidInput(f"{where}: needs a text, got {raw!r}")
    return raw


def one_of(what: str, valid: Collection[str]) -> Reader[str]:
    """Return a reader of a name out of the valid ones."""

    def read_name(where: str, raw: Any) -> str:
        """Return the name; refuse others, with the nearest valid ones."""
        if not isinstance(raw, str) or raw not in valid:
            raise InvalidInput(f"{where}: {choose_from(what, raw, valid)}")
        return raw

    return read_name


def integer(where: str, raw: Any) -> int:
    """Read a whole number."""
    if not isinstance(raw, int) or isinstance(raw, bool):
        raise InvalidInput(f"{where}: needs a whole number, got {raw!r}")
    return raw


def _restrict(read: Reader[T], is_valid: Callable[[T], bool], complaint: str) -> Reader[T]:
    """Return a reader that refuses values that are not valid, with a complaint."""

    def read_valid(where: str, raw: Any) -> T:
        """Read a value; refuse one that is not valid."""
        value = read(where, raw)
        if not is_valid(value):
            raise InvalidInput(f"{where}: {complaint}, got {raw!r}")
        return value

    return read_valid


def number(where: str, raw: Any) -> float:
    """Read a finite number of at most LARGEST_NUMBER.

    A text is read, too: YAML 1.1 reads 1e5 as one.
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


whole = _restrict(integer, lambda value: value >= 0, "must not be negative")
positive = _restrict(number, lambda value: value > 0, "must be greater than zero")
not_negative = _restrict(number, lambda value: value >= 0, "must not be negative")


def vector3(where: str, raw: Any) -> tuple[float, float, float]:
    """Read three finite numbers."""
    vector = list_of(number)(where, raw)
    if len(vector) != 3:
        raise InvalidInput(f"{where}: needs three numbers, got {raw!r}")
    return vector[0], vector[1], vector[2]
