"""The keys of plan.json, as tables: what `saved` writes and `restored` reads back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from framework.crossing.condition import Condition8
from framework.crossing.options import GOALS, OPTIONS
from framework.dynamics.certificate import Certificate
from framework.dynamics.inverse_dynamics import GEOMETRIES
from framework.errors import InvalidInput
from framework.fields import (
    Field,
    Reader,
    Table,
    anything,
    list_of,
    named,
    not_negative,
    number,
    one_of,
    optional,
    or_null,
    positive,
    read_table,
    record,
    required,
    table_of,
    text,
    text_or_empty,
    truth,
    whole,
)
from framework.model.description import FLEXIBILITIES
from framework.model.robot_keys import PATHS, one_path
from framework.motion.law import Law
from framework.motion.optimal_law import OptimalLaw

VERSION = 3  # of plan.json; before, an optimal law was one Chebyshev series
LAW_KINDS = (Law.kind, OptimalLaw.kind)


def _path(where: str, given: Any) -> tuple[str, tuple[tuple[float, ...], ...]]:
    return one_path(where, read_table(where, given, PATHS))


def _series(where: str, given: Any) -> tuple[float, ...]:
    """Read the coefficients of a law, of which even the slowest has two."""
    coefficients = list_of(number)(where, given)
    if len(coefficients) < 2:
        raise InvalidInput(f"{where}: needs at least two numbers, got {len(coefficients)}")
    return coefficients


_NUMBERS = required(list_of(number))
_KIND: Table = {"kind": optional(one_of("kind of law", LAW_KINDS), Law.kind)}
_ANY_LAW: Table = {**_KIND, "degree": required(whole), "domain": _NUMBERS}
_LAWS: Mapping[str, Table] = {
    Law.kind: {**_ANY_LAW, "chebyshev": required(_series)},
    OptimalLaw.kind: {
        **_ANY_LAW,
        "smoothness": required(whole),
        "squared_speed": required(_series),
        "cells": _NUMBERS,
        "turns": required(whole),
        "dense_at": _NUMBERS,
    },
}


def _law(where: str, given: Any) -> dict[str, Any]:
    kind = read_table(where, given, _KIND, others=None)["kind"]
    return read_table(where, given, _LAWS[kind])


def _mapping_of(table: Table) -> Reader[dict[str, Any]]:
    return record(table, lambda _, values: values)


_CROSSING: Table = {
    **dict.fromkeys(("s", "acceleration"), required(number)),
    **dict.fromkeys(("time", "speed"), required(positive)),
    "kind": required(text),
    "twist": _NUMBERS,
    "platform": _NUMBERS,
    "residual": required(not_negative),
    "condition": required(or_null(_mapping_of(dict.fromkeys(Condition8._fields, required(number))))),
    "loaded": optional(
        or_null(_mapping_of({"s": required(number), "distance": required(not_negative)})), None
    ),
}
_NEGLECTED: Table = {
    **dict.fromkeys(("effect", "motor"), required(text_or_empty)),
    **dict.fromkeys(("torque", "share"), required(or_null(not_negative))),
}
_CERTIFICATE = table_of(Certificate, {"int": whole, "float": not_negative, "bool": truth})
PLAN: Table = {
    "version": required(whole),
    "robot": required(text),
    "robot_file": required(text),
    "flexibility": required(one_of("flexibility", FLEXIBILITIES)),
    "geometry": required(one_of("geometry", GEOMETRIES)),
    "duration": required(positive),
    "request": required(  # options are checked as those of a call
        _mapping_of({"path": required(_path), **{name: Field(anything) for name in OPTIONS}})
    ),
    "law": required(_law),
    "crossings": required(list_of(_mapping_of(_CROSSING))),
    "peak_torque": required(named(not_negative)),
    "exceeded": required(named(text)),
    "neglected_friction": required(text_or_empty),
    "neglected": optional(list_of(_mapping_of(_NEGLECTED)), ()),
    "certificate": required(record(_CERTIFICATE, lambda _, values: Certificate(**values))),
    "reason": required(text_or_empty),
    "optimality": required(
        or_null(
            _mapping_of(
                {
                    "optimize": required(one_of("goal", GOALS)),
                    "reference": required(list_of(positive)),
                    "gap": required(not_negative),
                }
            )
        )
    ),
    "seconds": required(not_negative),
}
BESIDE_PLAN = ("bend", "fidelity")  # keys that commands add
