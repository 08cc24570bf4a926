"""The eye of the needle: the force along t_s that motors can give, and the force that a motion needs.

At the singular instant the band of forces that the motors reach closes to a point, whatever their limits. A
motion passes only through this point, t_s . W = 0: condition (8) of Briot and Arakelian, 2010.
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

SHOWN_PATH_SHARE = 0.3  # share of the path that is drawn on either side of the singular point
# colour and dash of a motion, mark at its singular instant, verdict
THREADS, MISSES = (GOOD, "-", "o", "threads the eye"), (ALARM, "--", "X", "misses the eye")


def plot_eyes(films: Sequence[Film], limit: Array, ax: Axes | None = None) -> Axes:
    """Plot over s the forces that motions along one path need, within the motors' band.

    All forces are along t_s at the first film's singular instant, and count the rotors.

    Args:
        films: of one robot and one path, each with a singular instant.
        limit: torque limits (n_a,) [N m], motor side.

    Raises:
        InvalidInput: a film has no singular instant, or there are several robots or paths.
    """
    _check_one_path(films)
    first = films[0]
    ax = ensure_axes(ax)
    twist = twist_at_singularity(films)
    s, s_singular = first.law(first.time), first.instants[0].s
    reach = first.motors.reach(twist, limit)
    motors = describe_motors(first.robot, limit, peak_torque(films))
    ax.fill_between(s, -reach, reach, **BAND, label=f"what {motors} can give")
    low, high = np.clip([s_singular - SHOWN_PATH_SHARE, s_singular + SHOWN_PATH_SHARE], 0.0, 1.0)
    top = max(_draw_demand(ax, film, twist, (low, high)) for film in films)
    draw_dashed(ax, s_singular, LOCUS, 0.8)
    ax.set(xlim=(low, high), ylim=(-1.25 * top, 1.25 * top))
    kind, unit = ("force along", "N") if np.any(twist[first.robot.translations]) else ("torque about", "N m")
    ax.set(xlabel="position on the path  $s$  (dashed: singular)")
    ax.set_ylabel(rf"{kind} $\mathbf{{t}}_s$  [{unit}]")
    legend_above(ax)
    return ax


def _draw_demand(ax: Axes, film: Film, twist: Array, s_range: tuple[float, float]) -> float:
    """Draw the force along t_s that a film needs; return its peak within `s_range`."""
    s, demand = film.law(film.time), film.motors.force_along(twist)  # (F,)
    s_singular = film.instants[0].s
    color, dash, dot, verdict = THREADS if film.proved else MISSES
    label = f"{film.name or 'the motion'} asks: {verdict}"
    ax.plot(s, demand, dash, color=color, linewidth=1.6, label=label)
    ax.plot(s_singular, np.interp(s_singular, s, demand), dot, color=color, markersize=5, zorder=4)
    low, high = s_range
    return float(np.abs(demand[(low <= s) & (s <= high)]).max())


def _check_one_path(films: Sequence[Film]) -> None:
    """Refuse films of several robots or paths, or without a singular instant."""
    first = films[0]
    for film in films:
        if not film.instants or film.robot.name != first.robot.name or film.path != first.path:
            raise InvalidInput(
                "one eye is for motions of one robot along one path, through a singularity each"
            )


def twist_at_singularity(films: Sequence[Film]) -> Array:
    """Return t_s (n,) at the singular instant of the first film."""
    first = films[0]
    return first.t_s[first.key_frame]


def peak_torque(films: Sequence[Film]) -> float:
    """Return the largest torque of the proved films; 0 if none is proved."""
    return max((float(np.abs(film.torque).max()) for film in films if film.proved), default=0.0)


def limit_for_picture(robot: ParallelRobot, torque: Array) -> Array:
    """Return the torque limits (n_a,) [N m] drawn beside torques (T, n_a).

    They are those of the robot file. A motor without one gets 1.5 times the largest finite torque.
    """
    peak = np.abs(torque[np.isfinite(torque)]).max(initial=0.0)
    limits = motor_limits(robot, "torque_limit", None)
    return np.where(np.isfinite(limits), limits, 1.5 * peak or 1.0)
