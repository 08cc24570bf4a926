"""Figures of a plan. Each function draws on axes that it takes or makes, and returns them.

One of them is the eye of the needle, `plot_eyes`: the force along t_s that the motors can give, and the force
that a motion needs. At the singular instant the band of forces that the motors can give closes to a point,
whatever their limits. A motion passes only through this point, t_s . W = 0: condition (8) of Briot and
Arakelian, 2010.

A film has F frames. `ax` and `axes` are those to draw on; None makes new ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from framework.dynamics.finite_differences import FiniteDifferenceTorques
from framework.dynamics.platform_wrench import measure_at_rest, wrench_curves
from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import law_derivatives
from framework.moved_modules import renamed_names
from framework.numerics.arrays import Array
from framework.planning.optimal.limit_curves import LimitCurves, limit_curves
from framework.planning.request import specification_of
from framework.planning.result import CrossingPlan
from framework.show.captions import describe_motors, display_name, wrench_unit
from framework.show.drawing import plot_still
from framework.show.film import Film, cut_off_poles, film_plan, limit_for_picture, peak_torque
from framework.show.style import (
    ALARM,
    BAND,
    GOOD,
    LOCUS,
    Style,
    draw_dashed,
    draw_dot,
    ensure_axes,
    legend_above,
    line_style,
    new_figure,
    save_pages,
)
from framework.show.vibration_figures import path_vibrations, plot_vibrations
from framework.singularity.points_on_path import SearchedPath, search_path
from framework.tolerances import SAME_PLACE

CURVE_SAMPLES = 601
BEHIND_TEXT: Style = {"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 1.5}
LOADED: Style = {
    "marker": "D",
    "linestyle": "none",
    "color": ALARM,
    "markersize": 4,
    "markerfacecolor": "white",
    "zorder": 4,
}


def plot_law(plan: CrossingPlan, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Plot s(t) and its first two derivatives on three axes."""
    axes = new_figure(3, height=1.25) if axes is None else list(axes)
    times = _sample_times(plan)
    # by the names that the values have in a crossing
    labels = {"s": "$s$", "speed": "$s′$  [1/s]", "acceleration": "$s″$  [1/s$^2$]"}
    for order, (ax, (key, label)) in enumerate(zip(axes, labels.items(), strict=True)):
        ax.plot(times, plan.law(times, order), **line_style(0))
        ax.set_ylabel(label)
        _mark_crossings(plan, ax)
        for crossing in plan.crossings:
            draw_dot(ax, crossing.time, getattr(crossing, key), size=3)
    _label_time(plan, axes[-1])
    kind = "law" if plan.optimality is None else f"{plan.law.kind} law"
    title = plan.reason if plan.is_chain else f"{kind} of degree {plan.law.degree}"
    axes[0].set_title(title, loc="left")
    return axes


def plot_torques(plan: CrossingPlan, ax: Axes | None = None) -> Axes:
    """Plot the torque of each motor over time, with its limits."""
    ax, times = ensure_axes(ax), _sample_times(plan)
    draw_torques(ax, plan.robot, times, plan.torque(times))
    return _draw_limits(plan, ax, specification_of(plan.robot, plan.request).torque_limit)


def plot_speeds(plan: CrossingPlan, ax: Axes | None = None) -> Axes:
    """Plot the speed of each motor over time, motor side, with its limits."""
    ax, times = ensure_axes(ax), _sample_times(plan)
    _draw_motors(ax, plan.robot, times, plan.motor_angle(times, order=1), "speed", plan.robot.speed_units)
    return _draw_limits(plan, ax, specification_of(plan.robot, plan.request).speed_limit)


def _draw_limits(plan: CrossingPlan, ax: Axes, limits: Array) -> Axes:
    """Draw limits (n_a,) of the motors on both sides of zero, and the crossings."""
    limits = np.unique(limits[np.isfinite(limits)])
    for limit in [*limits, *-limits]:
        ax.axhline(limit, color="0.4", linewidth=0.6, linestyle=(0, (1, 2)))
    _mark_crossings(plan, ax)
    _label_time(plan, ax, dotted="limits" if len(limits) else "")
    return ax


def plot_singularity(plan: CrossingPlan, ax: Axes | None = None) -> Axes:
    """Plot the singularity measure g along the path, springs at rest and deflected."""
    ax = ensure_axes(ax)
    s = np.linspace(0.0, 1.0, CURVE_SAMPLES)
    searched = search_path(plan.robot, plan.path)
    g = measure_at_rest(searched, s)
    ax.plot(s, g, label="springs at rest" if plan.robot.n_e else None, **line_style(0))
    if plan.geometry == "deformed":
        times = _sample_times(plan)
        loaded_g = wrench_curves(plan.robot, plan.dynamics.motion(times)).g
        loaded_g *= np.sign(loaded_g[0] * g[0])  # the sign of g is arbitrary
        ax.plot(plan.law(times), loaded_g, label="as it deflects", **line_style(1))
        ax.legend(loc="upper left")
        if plan.crossings:
            _magnify(ax, plan, searched)
    ax.axhline(0.0, color="black", linewidth=0.5)
    # singular points of the loaded robot that are visibly off the crossings
    visible = [
        loaded.s
        for crossing, loaded in zip(plan.crossings, plan.loaded_points, strict=True)
        if loaded is not None and abs(loaded.s - crossing.s) > 5e-3  # half a marker
    ]
    if visible:
        ax.plot(visible, [0.0] * len(visible), **LOADED, label="singular under its loads")
        ax.legend(loc="upper left")
    for crossing in plan.crossings:
        draw_dot(ax, crossing.s, 0.0)
        rises = np.interp(crossing.s, s, np.gradient(g)) > 0
        offset: Style = {"textcoords": "offset points", "xytext": (5, -10 if rises else 5)}  # off the curve
        ax.annotate(f"$s$ = {crossing.s:.6f}", (crossing.s, 0.0), fontsize=7, **offset)
    ax.set(xlabel="path coordinate  $s$", ylabel="singularity measure  $g$")
    return ax


def _magnify(ax: Axes, plan: CrossingPlan, searched: SearchedPath) -> None:
    """Magnify in a corner the shift of the first crossing by the deflections."""
    crossing = plan.crossings[0]
    loaded = plan.loaded_points[0]  # the singular point with forces and springs counted, if found
    at_rest = min((point.s for point in searched.points), key=lambda s: abs(s - crossing.s))
    shift = abs(crossing.s - at_rest)
    if shift < SAME_PLACE:  # the deflections do not visibly move the locus
        return
    inset = ax.inset_axes((0.66, 0.19, 0.31, 0.34), facecolor="white", zorder=4)
    shown = [crossing.s, at_rest]
    # the shift by the loads is drawn if it is large enough to be seen, and small enough to fit in
    if loaded is not None and 0.1 * shift < abs(loaded.s - crossing.s) < 5.0 * shift:
        shown.append(loaded.s)
        mark = (1e6 * (loaded.s - at_rest), 0.0)
        inset.plot(*mark, **LOADED)
        below: Style = {"textcoords": "offset points", "xytext": (0, -8), "ha": "center", "fontsize": 5.5}
        inset.annotate("loaded", mark, **below)
    s = np.linspace(min(shown) - shift, max(shown) + shift, 5)
    times = crossing.time + (s - crossing.s) / crossing.speed
    _draw_upward(inset, s - at_rest, measure_at_rest(searched, s), crossing.speed, line_style(0))
    loaded_g = wrench_curves(plan.robot, plan.dynamics.motion(times)).g
    _draw_upward(inset, plan.law(times) - at_rest, loaded_g, crossing.speed, line_style(1))
    inset.axhline(0.0, color="black", linewidth=0.5)
    inset.set_xlabel(r"$10^6\,(s - s_\mathrm{rest})$", fontsize=6, labelpad=1)
    inset.set_ylabel(r"$10^6\,g$", fontsize=6, labelpad=1)
    inset.tick_params(labelsize=5.5, pad=1)


def _draw_upward(ax: Axes, shift: Array, g: Array, speed: float, style: Style) -> None:
    """Draw g over a shift in s, both in millionths, with the sign that rises in time."""
    upward = np.sign((g[-1] - g[0]) * speed)
    ax.plot(1e6 * shift, 1e6 * upward * g, **style)


def plot_wrench(plan: CrossingPlan, ax: Axes | None = None) -> Axes:
    """Plot t_s . W_p over time: condition (8) demands 0 at each crossing."""
    ax = ensure_axes(ax)
    times = _sample_times(plan)
    power = wrench_curves(plan.robot, plan.dynamics.motion(times)).power  # t_s . W_p
    ax.plot(times, power, **line_style(0))
    ax.axhline(0.0, color="black", linewidth=0.5)
    _label_time(plan, ax)
    bodies = "\nwithout rotors" if np.any(plan.robot.rotor_inertia) else ""  # unlike the eye
    ax.set_ylabel(rf"$\mathbf{{t}}_s \cdot \mathbf{{W}}_p$  [{wrench_unit(plan.robot)}]" + bodies)
    _mark_crossings(plan, ax)
    for crossing in plan.crossings:
        draw_dot(ax, crossing.time, 0.0)
    if plan.crossings:
        ax.lines[-1].set_label("0 here: condition (8)")
        legend_above(ax)
    return ax


def plot_phase_plane(
    plan: CrossingPlan, axes: Sequence[Axes] | None = None, *, beside: CrossingPlan | None = None
) -> list[Axes]:
    """Plot s' and s" over s on two axes: the plan's law, and the range within limits.

    The range of s" is that at the plan's own s'. By condition (8) it closes to a point at each crossing.

    Args:
        beside: another plan on the same path, to draw its law too.
    """
    axes = new_figure(2, height=1.9) if axes is None else list(axes)
    plans = [plan] if beside is None else [plan, beside]
    # s, s' and s" of each plan
    laws = [law_derivatives(each.law, np.linspace(0.0, each.duration, CURVE_SAMPLES)) for each in plans]
    tops = [1.5 * max(np.abs(law[order]).max() for law in laws) for order in (1, 2)]
    curves = limit_curves(plan)
    if curves.known:
        _draw_phase_limits(axes, curves, tops, plan.robot.torque_units[0])
    for k, (each, law) in enumerate(zip(plans, laws, strict=True)):
        for ax, values in zip(axes, law[1:], strict=True):
            ax.plot(law[0], values, label=f"{each.law.kind}, {each.duration:.3g} s", **line_style(k))
    for crossing in plan.crossings:
        for ax, value in zip(axes, (crossing.speed, crossing.acceleration), strict=True):
            draw_dashed(ax, crossing.s)
            draw_dot(ax, crossing.s, value)
    upper, lower = axes
    upper.set(xlim=(0.0, 1.0), ylim=(0.0, tops[0]), ylabel="$s′$  [1/s]")
    lower.set(xlim=(0.0, 1.0), ylim=(-tops[1], tops[1]), ylabel="$s″$  [1/s$^2$]")
    lower.set_xlabel("path coordinate  $s$" + "  (dashed: singular)" * bool(plan.crossings))
    legend_above(upper, columns=2)
    return axes


def _draw_phase_limits(axes: Sequence[Axes], curves: LimitCurves, tops: Sequence[float], unit: str) -> None:
    """Draw the ranges of s' and s" within the motors' limits.

    `tops` are the ends of the two axes, which also cut off infinite limits; `unit` is that of the torques.
    """
    upper, lower = axes
    limits = ", ".join(f"{limit:.3g}" for limit in np.unique(curves.torque_limit))
    highest = np.nan_to_num(curves.highest_speed, posinf=2 * tops[0])
    upper.fill_between(curves.s, 0.0, highest, label=f"within {limits} {unit}", **BAND)
    accelerations = [curves.lowest_acceleration, curves.highest_acceleration]
    lower.fill_between(curves.s, *np.clip(accelerations, -2 * tops[1], 2 * tops[1]), **BAND)
    least = np.nanmin(curves.highest_speed, initial=np.inf)  # NaN: not even at rest
    if tops[0] < least < np.inf:  # the limit is above the axes: say where
        text = f"$s′$ may be {least:.3g} 1/s everywhere"
        corner: Style = {"transform": upper.transAxes, "ha": "right", "va": "top", "bbox": BEHIND_TEXT}
        upper.text(0.98, 0.95, text, fontsize=7, **corner)


def plot_raw_torques(
    raw: FiniteDifferenceTorques, robot: ParallelRobot, poles: Sequence[float], ax: Axes | None = None
) -> Axes:
    """Plot torques of a raw sampling, with the instants [s] of unbounded torque."""
    ax = ensure_axes(ax)
    draw_torques(ax, robot, raw.time, raw.torque)
    if len(poles):
        top = cut_off_poles(raw.torque)
        ax.set_ylim(-top, top)
    for pole in poles:
        draw_dashed(ax, pole, ALARM, linewidth=0.8)
        place: Style = {"transform": ax.get_xaxis_transform(), "va": "top", "bbox": BEHIND_TEXT}
        ax.text(pole, 0.97, " no bound", color=ALARM, fontsize=7, **place)
    ax.set_xlabel("time  [s]   (raw sampling, proves nothing)")
    return ax


def plan_drawings(plan: CrossingPlan, film: Film) -> dict[str, Callable[[], Axes]]:
    """Return functions that draw the figures of a plan and its film, by name.

    Plans with crossings also have the eye, optimal laws the phase plane, robots with springs the vibrations
    (`plot_vibrations`). Each function returns one
    of its axes, which stands for the whole figure.
    """
    drawings: dict[str, Callable[[], Axes]] = {
        "robot": lambda: plot_still(film),
        "law": lambda: plot_law(plan)[0],
        "torques": lambda: plot_torques(plan),
        "singularity": lambda: plot_singularity(plan),
        "wrench": lambda: plot_wrench(plan),
    }
    if plan.crossings:
        # motors without a torque limit get one for this picture
        drawings["eye"] = lambda: plot_eyes([film], limit_for_picture([film], film.torque))
    if plan.optimality is not None:
        drawings["phase_plane"] = lambda: plot_phase_plane(plan)[0]
    if path_vibrations(plan) is not None:
        drawings["vibrations"] = lambda: plot_vibrations(plan)
    return drawings


def save_figures(plan: CrossingPlan, folder: Path) -> list[Path]:
    """Write the figures of a plan into a folder: figures.pdf, and a PNG of each."""
    return save_pages(plan_drawings(plan, film_plan(plan)), folder / "figures.pdf")


def save_figure(draw: Callable[[], Axes], stem: Path) -> list[Path]:
    """Draw one figure, and write `stem`.pdf and `stem`.png."""
    return save_pages({stem.name: draw}, stem.with_suffix(".pdf"))


def draw_torques(ax: Axes, robot: ParallelRobot, time: Array, torque: Array) -> None:
    """Draw the torques (T, n_a) of the motors over time, labelled."""
    _draw_motors(ax, robot, time, torque, "torque", robot.torque_units)


def _draw_motors(
    ax: Axes, robot: ParallelRobot, time: Array, values: Array, quantity: str, units: Sequence[str]
) -> None:
    """Draw values (T, n_a) of the motors over time, labelled, with the units of the motors."""
    for k, (joint, curve) in enumerate(zip(robot.actuator_names, values.T, strict=True)):
        ax.plot(time, curve, label=display_name(joint), **line_style(k))
    ax.set(xlabel="time  [s]", ylabel=f"motor {quantity}  [{', '.join(dict.fromkeys(units))}]")
    legend_above(ax, columns=3, columnspacing=1.2)


def _sample_times(plan: CrossingPlan) -> Array:
    """Return the times (T,) [s] of a plan's curves."""
    return np.linspace(0.0, plan.duration, CURVE_SAMPLES)


def _label_time(plan: CrossingPlan, ax: Axes, dotted: str = "") -> None:
    """Label the axis of time, with the meaning of dashed and of `dotted` lines."""
    meanings = ["dashed: singular"] if plan.crossings else []
    if dotted:
        meanings.append(f"dotted: {dotted}")
    gap = "\n" if dotted else "   "
    ax.set_xlabel(f"time  [s]{gap}({', '.join(meanings)})" if meanings else "time  [s]")


def _mark_crossings(plan: CrossingPlan, ax: Axes) -> None:
    """Draw a dashed line at each crossing of the plan."""
    for crossing in plan.crossings:
        draw_dashed(ax, crossing.time)


# ------------------------------------------------------------------ the eye of the needle


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
    first = films[0]
    for film in films:
        if not film.instants or film.robot.name != first.robot.name or film.path != first.path:
            raise InvalidInput(
                "one eye is for motions of one robot along one path, through a singularity each"
            )
    ax = ensure_axes(ax)
    twist = twist_at_singularity(films)
    s = first.law(first.time)  # (F,)
    s_singular = first.instants[0].s
    reach = first.motors.reach(twist, limit)
    motors = describe_motors(first.robot, limit, peak_torque(films))
    ax.fill_between(s, -reach, reach, **BAND, label=f"what {motors} can give")
    low, high = np.clip([s_singular - SHOWN_PATH_SHARE, s_singular + SHOWN_PATH_SHARE], 0.0, 1.0)
    top = max(_draw_demand(ax, film, twist, (low, high)) for film in films)
    draw_dashed(ax, s_singular, LOCUS, linewidth=0.8)
    ax.set(xlim=(low, high), ylim=(-1.25 * top, 1.25 * top))
    kind, unit = ("force along", "N") if np.any(twist[first.robot.translations]) else ("torque about", "N m")
    ax.set(xlabel="path coordinate  $s$  (dashed: singular)")
    ax.set_ylabel(rf"{kind} $\mathbf{{t}}_s$  [{unit}]")
    legend_above(ax)
    return ax


def _draw_demand(ax: Axes, film: Film, twist: Array, s_range: tuple[float, float]) -> float:
    """Draw the force along t_s = `twist` (n,) that a film needs over s; return its peak within `s_range`."""
    s = film.law(film.time)  # (F,)
    demand = film.motors.force_along(twist)  # (F,)
    s_singular = film.instants[0].s
    color, dash, dot, verdict = THREADS if film.proved else MISSES
    label = f"{film.name or 'the motion'} asks: {verdict}"
    ax.plot(s, demand, dash, color=color, linewidth=1.6, label=label)
    ax.plot(s_singular, np.interp(s_singular, s, demand), dot, color=color, markersize=5, zorder=4)
    low, high = s_range
    return float(np.abs(demand[(low <= s) & (s <= high)]).max())


def twist_at_singularity(films: Sequence[Film]) -> Array:
    """Return t_s (n,) at the singular instant of the first film."""
    first = films[0]
    return first.t_s[first.key_frame]


__getattr__ = renamed_names(__name__, {"save": "save_figure"})
