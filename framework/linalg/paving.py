"""Proof that equations have no other solutions in a box than the known ones: bisection and linear bounds.

In a box c + D xi, |xi_j| <= 1, D diagonal, equations F have the values F(c) + J D xi + e with |e_k| <= b_k, b
from bounds on their second derivatives. Combined with weights they bound each coordinate by all others, which
shrinks the box or shows it empty (Hansen and Sengupta 1981; Neumaier 1990, chapter 5; the weights here are
the inverse of J D where that is larger than b, by singular values). A box within a region in which a known
solution is the only one is done; what is left is halved.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray

MOST_BOXES = 60_000
CHUNK = 4096
SMALLEST = 1e-6  # radius: a solution that is single is known before
LEAST = 1e-9  # radius: a side that shrinks to nothing may still have another that is halved
SHRUNK = 0.5  # of the volume: a box that shrinks by more is looked at again before it is halved
TOLD = 1e-6  # of a coordinate in a row: less says nothing about it
GAMMA = 1e-14  # a hundred units of rounding, of sums of products
UP = 1.0 + 1e-9  # more than rounding takes from sums of some hundred numbers


class Linearised(NamedTuple):
    """m equations in B boxes about points c."""

    values: Array  # (B, m) at c
    slopes: Array  # (B, m, n)
    bends: Array  # (B, m) bounds on what else there is in the box, rounding too


class Known(NamedTuple):
    """Solutions, each alone in a box about it."""

    points: Array  # (k, n)
    radii: Array  # (k,)
    period: Array  # (n,) of the coordinates, inf for those on a line


def has_no_others(
    equations: Callable[[Array, Array], Linearised],
    centers: Array,
    radii: Array,
    known: Known,
    most: int = MOST_BOXES,
) -> bool:
    """Whether boxes (B, n) are shown to hold no solutions but the known ones; False if it is not known."""
    seen = 0
    while len(centers):
        seen += len(centers)
        if seen > most:
            return False
        left = []
        for start in range(0, len(centers), CHUNK):
            c, r = centers[start : start + CHUNK], radii[start : start + CHUNK]
            at, to = _shrunk(equations(c, r), c, r)
            keep = ~np.any(to < 0, axis=1)
            keep[keep] = ~_is_within(at[keep], to[keep], known)
            small = np.prod(to[keep] / r[keep], axis=1) < SHRUNK
            left.append((at[keep][small], to[keep][small]))
            left += _halves(at[keep][~small], to[keep][~small])
        centers, radii = (np.concatenate(part) for part in zip(*left, strict=True))
        if len(radii) and radii.max(axis=1).min() < SMALLEST:
            return False
    return True


def _shrunk(lines: Linearised, c: Array, r: Array) -> tuple[Array, Array]:
    """Boxes (B, n) that hold all solutions in those about c; radii below 0 where there are none."""
    scale = 1.0 / lines.bends
    F, J = lines.values * scale, lines.slopes * r[:, None] * scale[:, :, None]
    U, values, V = np.linalg.svd(J, full_matrices=False)
    weights = np.swapaxes(V, 1, 2) * (values / (values**2 + 1.0))[:, None] @ np.swapaxes(U, 1, 2)
    rows = np.concatenate(
        [
            weights,
            np.swapaxes(U, 1, 2),
            np.broadcast_to(np.eye(F.shape[1]), (len(F), F.shape[1], F.shape[1])),
        ],
        axis=1,
    )
    G, off = rows @ J, (rows @ F[:, :, None])[:, :, 0]
    size = 1.0 + GAMMA * (np.abs(F) + np.abs(J).sum(axis=2))
    rest = UP * (np.abs(rows) @ size[:, :, None])[:, :, 0]
    empty = (np.abs(off) > UP * (np.abs(G).sum(axis=2) + rest)).any(axis=1)
    n = r.shape[1]
    own = np.einsum("bjj->bj", G[:, :n])
    others = UP * (np.abs(G[:, :n]).sum(axis=2) - np.abs(own) + rest[:, :n])
    told = own > TOLD
    low, high = (
        np.where(told, (sign * others - off[:, :n]) / np.where(told, own, 1.0), sign) for sign in (-1, 1)
    )
    low, high = np.maximum(low - 1e-9, -1.0), np.minimum(high + 1e-9, 1.0)
    empty |= (low > high).any(axis=1)
    radii = np.where(empty[:, None], -1.0, np.maximum(UP * 0.5 * (high - low) * r, LEAST))
    return c + 0.5 * (low + high) * r, radii


def _is_within(c: Array, r: Array, known: Known) -> BoolArray:
    """Which boxes (B, n) are within the region of a known solution."""
    off = np.abs(c[:, None] - known.points)
    turns = np.where(np.isfinite(known.period), known.period, 1.0)
    wrapped = np.abs(off - turns * np.round(off / turns))
    off = np.where(np.isfinite(known.period), wrapped, off)
    inside = np.all(off + r[:, None] < known.radii[:, None], axis=2)
    return np.asarray(np.any(inside, axis=1))


def _halves(c: Array, r: Array) -> list[tuple[Array, Array]]:
    """Boxes (B, n) cut across their longest side."""
    if not len(c):
        return []
    rows, side = np.arange(len(c)), np.argmax(r, axis=1)
    r = r.copy()
    r[rows, side] *= 0.5
    found = []
    for sign in (-1, 1):
        at = c.copy()
        at[rows, side] += sign * r[rows, side]
        found.append((at, r * UP))
    return found
