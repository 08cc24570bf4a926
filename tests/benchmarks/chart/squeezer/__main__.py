"""Write the squeezer's angles at the end, and how far two programs agree on them: three minutes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.benchmarks.chart import published
from tests.benchmarks.chart.squeezer import descriptor, energy

mp = energy.mp

STEPS, PIECES = (100, 150), (25, 50)  # of the integrations, coarse and fine

HEAD = """\
# Andrews' squeezer: angles [rad] at {duration} s under {torque} N m, from rest at theta = 0, loops closed.
# Written by `python -m tests.benchmarks.chart.squeezer`: two programs in {digits} digits that share no line.
# descriptor.py, 7 angles and 6 multipliers, extrapolated: {steps[0]} and {steps[1]} steps differ by {first}.
# energy.py, one angle, time by quadrature: {pieces[0]} and {pieces[1]} pieces a unit differ by {second}.
# The two programs differ by {between}; what is printed below is the second one's.
# The angles of the test set (published.py) are off by {floor}: a floor for whoever is held against them.
"""


def main() -> None:
    coarse, fine = (descriptor.angles(steps) for steps in STEPS)
    wide, narrow = (energy.angles(pieces) for pieces in PIECES)
    printed = [mp.mpf(repr(published.ANGLES[name])) for name in descriptor.NAMES]

    def apart(one: list[Any], other: list[Any]) -> str:
        return mp.nstr(max(abs(a - b) for a, b in zip(one, other, strict=True)), 2)

    head = HEAD.format(
        duration=descriptor.DURATION,
        torque=descriptor.MOM,
        digits=descriptor.DIGITS,
        steps=STEPS,
        pieces=PIECES,
        first=apart(coarse, fine),
        second=apart(wide, narrow),
        between=apart(fine, narrow),
        floor=apart(printed, narrow),
    )
    lines = [f"{name} {mp.nstr(a, 22)}\n" for name, a in zip(descriptor.NAMES, narrow, strict=True)]
    Path(published.REFERENCE).write_text(head + "".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
