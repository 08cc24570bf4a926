"""What one would program first. Each of these is right in the middle of the workspace and fails in its way.

Nothing here is used outside the tests and the notebook on failures.
"""

from collections.abc import Callable, Sequence

import numpy as np

from tests.oracles.planar import BASES, END, LENGTH, PAYLOAD, START, load_torque, on_line


def torque_at(law, t: float) -> tuple[float, float]:
    """Load torques [N m] of the 5R on scene C, by the formula A^-T W_p at one instant."""
    push = PAYLOAD * float(law(t, 2))
    with np.errstate(all="ignore"):
        x, y = (np.float64(c) for c in on_line(float(law(t))))
        return load_torque(x, y, tuple(np.float64(push * (END[k] - START[k])) for k in range(2)))


def peak_torque(law, samples: int) -> float:
    """Largest load torque [N m] over equidistant samples of a motion: what a table or a figure shows."""
    values = [torque_at(law, t) for t in np.linspace(0.0, law.duration, samples)]
    return float(np.nanmax(np.abs(values)))


def newton_cranks(x: Sequence[float], guess: Sequence[float]) -> np.ndarray:
    """Crank angles (2,) [rad] of the 5R at x, by Newton's method from a guess, on whichever branch."""
    angles = np.array(guess, dtype=float)
    for _ in range(50):
        arms = np.array(x) - np.array([[b, 0.0] for b in BASES])
        cranks = LENGTH * np.column_stack([np.cos(angles), np.sin(angles)])
        rods = arms - cranks
        error = np.sum(rods**2, axis=1) - LENGTH**2
        slope = 2 * (rods[:, 0] * cranks[:, 1] - rods[:, 1] * cranks[:, 0])
        step = -error / slope
        angles += step
        if np.abs(step).max() < 1e-14:
            break
    return np.angle(np.exp(1j * angles))


def newton_platform(cranks: Sequence[float], guess: Sequence[float]) -> np.ndarray:
    """Payload (2,) [m] of the 5R for given cranks, by Newton's method: forward kinematics."""
    elbows = np.array([[b, 0.0] for b in BASES])
    elbows = elbows + LENGTH * np.column_stack([np.cos(cranks), np.sin(cranks)])
    x = np.array(guess, dtype=float)
    for _ in range(50):
        rods = x - elbows
        error = np.sum(rods**2, axis=1) - LENGTH**2
        step = np.linalg.lstsq(2 * rods, -error, rcond=1e-12)[0]
        x = x + step
        if np.abs(step).max() < 1e-15:
            break
    return x


def newton(
    residual: Callable[[np.ndarray], np.ndarray],
    slope: Callable[[np.ndarray], np.ndarray],
    guess: Sequence[float],
    steps: int = 200,
) -> np.ndarray:
    """Newton's method, ended when it no longer moves or after so many steps."""
    x = np.array(guess, dtype=float)
    for _ in range(steps):
        step = np.linalg.lstsq(slope(x), -residual(x))[0]
        x = x + step
        if np.abs(step).max() < 1e-15:
            break
    return x
