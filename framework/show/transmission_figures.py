"""Three pictures of a linkage as a transmission: inertia, limits, and the error of the static mapping."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from framework.atlas.transmission import LinkageTransmission, MappingError
from framework.numerics.arrays import IntArray
from framework.show.captions import display_name
from framework.show.style import CROSSING, legend_above, line_style

PARTS = {"carried": "carried body", "links": "cranks and rods", "rotors": "rotors"}
KNOWN = {
    "nothing_known": "nothing known",
    "constant_armature": "constant armature",
    "own_armature": "armature of the pose",
    "own_springs": "with springs and dampers",
}
SHOWN_POSTURES = 5  # at most, of polygons


def _panels(count: int) -> list[Axes]:
    """Return axes side by side."""
    drawing = Figure(figsize=(0.5 + 3.2 * count, 3.0), layout="constrained")
    return list(drawing.subplots(1, count, squeeze=False)[0])


def _line(result: LinkageTransmission, axis: int) -> IntArray:
    """Return the poses (k,) nearest to the line along an axis through the posture, in order."""
    others = np.delete(np.arange(result.robot.n), axis)
    off = np.abs(result.x[:, others] - result.posture[others]).sum(axis=1)
    line = np.flatnonzero(off <= off.min() + 1e-9)
    return line[np.argsort(result.x[line, axis])]


def plot_inertia(result: LinkageTransmission) -> Axes:
    """Plot the parts of the inertia about each axis, along the axis through the posture."""
    panels = _panels(result.robot.n)
    for k, (ax, name) in enumerate(zip(panels, result.robot.axis_names, strict=True)):
        line = _line(result, k)
        for j, (part, label) in enumerate(PARTS.items()):
            ax.semilogy(result.x[line, k], getattr(result, part)[line, k, k], label=label, **line_style(j))
        ax.set_xlabel(_axis_labels(result)[k])
        unit = "kg" if result.robot.translations[k] else "kg m²"
        ax.set_ylabel(f"inertia along {display_name(name)} [{unit}]")
    legend_above(panels[0])
    return panels[0]


def plot_limits(result: LinkageTransmission) -> Axes:
    """Plot torques and speeds that the motors allow: polygons of two axes, else curves."""
    panels = _panels(2)
    for ax, kind, word in zip(panels, ("wrenches", "speeds"), ("torque", "speed"), strict=True):
        ends = result.axis_limits(kind)
        if ends is None:
            ax.text(0.5, 0.5, f"no limits of {word}", ha="center", transform=ax.transAxes)
        elif result.robot.n == 2:
            _draw_polygons(result, ax, kind)
        else:
            for k, name in enumerate(result.robot.axis_names):
                line = _line(result, k)
                both = ax.plot(result.x[line, k], ends[line, :, k], **line_style(k))  # least and largest
                both[0].set_label(display_name(name))
            if kind == "speeds":  # without bound where the motors lose the platform: logarithmic above
                ax.set_yscale("symlog", linthresh=10 ** np.floor(np.log10(np.median(np.abs(ends)))))
            ax.set_xlabel(", ".join(_axis_labels(result)))
            ax.set_ylabel(f"{word} [{_units(result, kind)}]")
            legend_above(ax)
    return panels[0]


def _axis_labels(result: LinkageTransmission) -> list[str]:
    """Return the name and the unit of each axis of the platform."""
    units = zip(result.robot.axis_names, result.robot.axis_units, strict=True)
    return [f"{display_name(name)} [{unit}]" for name, unit in units]


def _units(result: LinkageTransmission, kind: str) -> str:
    """Return the units of torques or speeds of the platform's axes."""
    of_turns, of_slides = ("N m", "N") if kind == "wrenches" else ("rad/s", "m/s")
    return ", ".join(dict.fromkeys(of_slides if slides else of_turns for slides in result.robot.translations))


def _draw_polygons(result: LinkageTransmission, ax: Axes, kind: str) -> None:
    """Draw the polygons of the posture and of both ends of both axes."""
    units = ", ".join(dict.fromkeys(result.robot.axis_units))
    poses = [int(np.argmin(np.abs(result.x - result.posture).sum(axis=1)))]  # the posture's, then the ends'
    for axis in (0, 1):
        line = _line(result, axis)
        poses += [int(line[0]), int(line[-1])]
    for k, pose in enumerate([*dict.fromkeys(poses)][:SHOWN_POSTURES]):
        vertices = getattr(result.limits[pose], kind).vertices  # (v, 2), in any order
        arms = vertices - vertices.mean(axis=0)
        around = np.argsort(np.arctan2(arms[:, 1], arms[:, 0]))  # corners of a convex polygon, by their angle
        corners = vertices[np.append(around, around[0])]
        place = ", ".join(f"{value:.2g}" for value in result.x[pose])
        ax.plot(corners[:, 0], corners[:, 1], label=f"at {place} {units}", **line_style(k))
    word = "torque" if kind == "wrenches" else "speed"
    names = [f"{word} of {display_name(name)} [{_units(result, kind)}]" for name in result.robot.axis_names]
    ax.set(xlabel=names[0], ylabel=names[1])
    legend_above(ax, columns=2)


def plot_mapping(result: LinkageTransmission) -> Axes:
    """Plot the errors of the static mapping over frequency, on the axis of each sine."""
    panels = _panels(result.robot.n)
    for k, (ax, name) in enumerate(zip(panels, result.robot.axis_names, strict=True)):
        errors: list[MappingError] = [error for error in result.errors if error.axis == name]
        frequencies = [error.frequency for error in errors]
        known = list(KNOWN.items())[: None if result.springs.any() or result.damping.any() else -1]
        for j, (key, label) in enumerate(known):
            values = [getattr(error, key)[k] for error in errors]
            ax.loglog(frequencies, values, marker="o", ms=3, label=label, **line_style(j))
        carried = [error.carried[k] for error in errors]
        ax.loglog(frequencies, carried, color=CROSSING, linestyle=":", label="carried body needs")
        ax.set_xticks(frequencies, [f"{frequency:g}" for frequency in frequencies])
        ax.set_xticks([], minor=True)
        ax.set_xlabel(f"sine of {display_name(name)} [Hz]")
        ax.set_ylabel(f"error of the mapped torque [{'N' if result.robot.translations[k] else 'N m'}]")
    legend_above(panels[0], columns=2)
    return panels[0]
