"""The eye of the needle: the force along t_s that motors can give, and the force that a motion needs.

The band that the motors reach closes to a point at the singular instant, whatever their limit: a motion
passes only through that point, t_s . W = 0, condition (8) of Briot and Arakelian 2010.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from framework.dynamics.motor_limits import motor_limits
from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.show.captions import describe_motors
from framework.show.film import Film
from framework.show.style import ALARM, BAND, GOOD, LOCUS, draw_dashed, ensure_axes, legend_above

SHOWN_PATH_SHARE = 0.3  # of the path, shown on either side of a singular point
# colour, dash and mark of a motion at its singular instant, and its verdict
THREADS, MISSES = (GOOD, "-", "o", "threads the eye"), (ALARM, "--", "X", "misses the eye")


def plot_eyes(films: Sequence[Film], limit: Array, ax: Axes | None = None) -> Axes:
    """Plot motions along one path in one eye: over s, with one band of the motors.

    The force of each is along t_s of the first film's singular instant, rotors included.

    Args:
        films: of one robot and one path with a singular instant each.
        limit: torque limits (n_a,) [N m], motor side.

    Raises:
        InvalidInput: a film has no singular instant, or there are several robots or paths.
    """
    _check_one_path(films)
    first = films[0]
    ax = ensure_axes(ax)
    twist = twist_at_singularity(films)
    s = first.law(first.time)
    reach = first.motors.reach(twist, limit)
    motors = describe_motors(first.robot, limit, peak_torque(films))
    ax.fill_between(s, -reach, reach, **BAND, label=f"what {motors} can give")
    low = max(0.0, first.instants[0].s - SHOWN_PATH_SHARE)
    high = min(1.0, first.instants[0].s + SHOWN_PATH_SHARE)
    top = max(_draw_demand(ax, film, twist, (low, high)) for film in films)
    draw_dashed(ax, first.instants[0].s, LOCUS, 0.8)
    ax.set(xlim=(low, high), ylim=(-1.25 * top, 1.25 * top))
    kind, unit = ("force along", "N") if np.any(twist[first.robot.translations]) else ("torque about", "N m")
    ax.set(xlabel="position on the path  $s$  (dashed: singular)")
    ax.set_ylabel(rf"{kind} $\mathbf{{t}}_s$  [{unit}]")
    legend_above(ax)
    return ax


def _draw_demand(ax: Axes, film: Film, twist: Array, s_range: tuple[float, float]) -> float:
    """Draw the force along t_s that a film asks for; return its peak within `s_range`."""
    s, demand, s_singular = film.law(film.time), film.motors.force_along(twist), film.instants[0].s
    color, dash, dot, verdict = THREADS if film.proved else MISSES
    label = f"{film.name or 'the motion'} asks: {verdict}"
    ax.plot(s, demand, dash, color=color, linewidth=1.6, label=label)
    ax.plot([s_singular], [np.interp(s_singular, s, demand)], dot, color=color, markersize=5, zorder=4)
    return float(np.abs(demand[(s_range[0] <= s) & (s <= s_range[1])]).max())


def _check_one_path(films: Sequence[Film]) -> None:
    """Refuse films of different robots or paths, or without a singularity."""
    first = films[0]
    for film in films:
        if not film.instants or film.robot.name != first.robot.name or film.path != first.path:
            raise InvalidInput(
                "one eye is for motions of one robot along one path, through a singularity each"
            )


def twist_at_singularity(films: Sequence[Film]) -> Array:
    """Return t_s (n,) at the first film's singular instant, for all films."""
    first = films[0]
    return first.t_s[first.frame_at(first.instants[0].time)]


def peak_torque(films: Sequence[Film]) -> float:
    """Return the largest torque of the proved films, 0 without any."""
    return max((float(np.abs(film.torque).max()) for film in films if film.proved), default=0.0)


def limit_for_picture(robot: ParallelRobot, torque: Array) -> Array:
    """Return the torque limits (n_a,) [N m] of a picture of torques (T, n_a).

    They are the file's, or for other motors 1.5 times the largest torque.
    """
    largest = 1.5 * float(np.abs(torque[np.isfinite(torque)]).max(initial=0.0)) or 1.0
    limits = motor_limits(robot, "torque_limit", None)
    return np.where(np.isfinite(limits), limits, largest)
