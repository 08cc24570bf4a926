"""How long the next collocation step is to be.

Steps grow and shrink with what they leave unresolved. Where the loops lose rank in passing (a singularity of
the closures) short steps cannot be solved at all, but a long one may, with its nodes on both sides: where
steps get much shorter than they usually are, a few longer ones are tried before going on with short ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MUCH = 8.0  # times shorter than the usual step
OVER = (2.0, 1.4, 0.9)  # of the usual step: what is tried to step over a singularity
LENIENT = 1e3  # times the tolerance that such a step may leave unresolved, since no shorter one does better
FAILED = 0.25  # of its length is tried next when a step was not solved


@dataclass
class Pace:
    """The length [s] that is wanted next, and what it is based on."""

    length: float
    longest: float
    usual: float = 0.0  # of the steps before
    short: float = 0.0  # to go on with when stepping over does not help; 0: nothing is being stepped over
    tried: int = 0  # how many of `OVER`

    @property
    def leniency(self) -> float:
        """Factor on the tolerance for the next step."""
        return LENIENT if self.short else 1.0

    def fitted(self, left: float) -> float:
        """The next length such that the last step but one is not followed by a tiny one."""
        count = max(1, int(np.ceil(left / self.length - 1e-9)))
        return left / count if count <= 2 else self.length

    def taken(self, length: float, factor: float) -> None:
        """A step counts; the next may be longer by this factor."""
        self.length = min(self.longest, length * factor)
        self.usual, self.short, self.tried = max(length, 0.5 * self.usual), 0.0, 0

    def refused(self, length: float, factor: float, left: float) -> None:
        """A step does not count; the next is to be shorter by this factor, or over what is in the way."""
        shorter = self.short or length * min(factor, 0.7)
        if self.tried < len(OVER) and (self.short or shorter < self.usual / MUCH):
            self.length, self.short = min(OVER[self.tried] * self.usual, left), shorter
            self.tried += 1
        else:
            self.length, self.short = shorter, 0.0
