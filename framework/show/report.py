"""One page about a plan: scene, figures, law, certificate in words, and the command that repeats the plan."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Callable, Iterable, Sequence
from datetime import date
from html import escape
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from matplotlib.figure import Figure

from framework.crossing.result import Crossing, CrossingPlan
from framework.dynamics.result import Certificate
from framework.errors import point
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.frame_wrench import FrameWrench
from framework.show.captions import display_name, explain_crossing, parts, why, wrench_kind
from framework.show.film import Film, film_plan
from framework.show.page import FILM_LEAD, scene_part, whole_page
from framework.show.plots import plan_drawings
from framework.show.reproduction import command_line, given_options, python_call
from framework.show.scene import film_documents
from framework.show.style import figure_file, use_style

PROVEN_TORQUE = (
    "The torques are functions of time known on {0.nodes} nodes; what their series leaves out is "
    "{0.tail:.1e} of their size. An unbounded torque would leave 1e-3 of it or more."
)
PROVEN_LOOPS = "The loops stay closed to {0.max_closure_error:.1e} (m or rad), between the nodes too."
PROVEN_WRENCH = (
    "At each crossing t_s · W_p, with the inertia of all bodies, is zero to {:.1e} of its largest value "
    "along the motion, as a finite torque needs: condition (8) in the paper of Briot and Arakelian, 2010."
)
MOTOR = "gear ratio {0.gear_ratio:g}, rotor inertia {0.rotor_inertia:g} kg m²"
PACKAGES = ("parallel-singularity-crossing", "pin", "numpy", "scipy", "meshcat")


def report_page(plan: CrossingPlan, *, name: str = "", planned: Certificate | None = None) -> str:
    """Return the report of a plan, HTML, complete in one file.

    Args:
        name: what stands above the scene.
        planned: the certificate in plan.json, shown beside that of `plan`, which was computed from the law
            read back: what is mere rounding may differ in it.
    """
    film = film_plan(plan, name=name)
    heading = f"{display_name(plan.robot.name)}: {_describe_plan(plan)}"
    body = "\n".join(
        [
            '<div class="report">',
            scene_part(heading, FILM_LEAD),
            _section("What happens", _crossings(plan, film)),
            _section("Figures", figures_with_captions(plan, film, _mark_indices)),
            _section("The law", _law(plan)),
            _section(
                "The certificate, in words", _certificate(plan, film) + _both_certificates(plan, planned)
            ),
            _section("What is left out", _neglected_table(plan)),
            _section("Parameters", _parameters(plan)),
            _section("How to reproduce it", _reproduction(plan)),
            "</div>",
        ]
    )
    return whole_page(heading, body, film_documents([film]))


def _describe_plan(plan: CrossingPlan) -> str:
    """Return the number of singularities that a plan crosses, in words."""
    count = len(plan.crossings)
    if not count:
        return "a motion without a singularity"
    return f"through {'a' if count == 1 else count} Type 2 singularit{'y' if count == 1 else 'ies'}"


def _section(title: str, content: str) -> str:
    return f"<section><h2>{escape(title)}</h2>\n{content}</section>"


def _mark_indices(text: str) -> str:
    """Return a plain text as HTML, with the indices of t_s and W_p."""
    return re.sub(r"\b(t|W)_([sp])\b", r"\1<sub>\2</sub>", escape(text))


def _table(rows: Iterable[Sequence[str]], head: Sequence[str] = ()) -> str:
    """Return a table of plain texts as HTML."""
    cells = [[f"<th>{_mark_indices(cell)}</th>" for cell in head]] if head else []
    cells += [[f"<td>{escape(cell)}</td>" for cell in row] for row in rows]
    lines = [f"<tr>{''.join(row)}</tr>" for row in cells]
    return '<div class="wide" tabindex="0"><table>' + "\n".join(lines) + "</table></div>"


def _number(value: float) -> str:
    return f"{value + 0.0:.6g}"


def _crossings(plan: CrossingPlan, film: Film) -> str:
    """Return the HTML of the crossings: torques, explanations, warnings and table."""
    robot = plan.robot
    peaks = ", ".join(
        f"{display_name(joint)} {value:.4g} {unit}"
        for (joint, value), unit in zip(plan.peak_torque.items(), robot.torque_units, strict=True)
    )
    motion = (
        f"<p>The motion takes {plan.duration:g} s. Largest motor torques, with {escape(parts(film))}: "
        f"{escape(peaks)}.</p>"
    )
    for instant in film.instants:
        sentence = _mark_indices(f"{why(robot)} {explain_crossing(film, instant)}")
        motion += f"<p><b>At t = {instant.time:.4g} s:</b> {sentence}</p>"
    for joint, excess in plan.exceeded.items():
        motion += (
            f"<p><b>Warning:</b> {escape(display_name(joint))} exceeds its limits: {escape(excess)}.</p>"
        )
    if not plan.crossings:
        return f"{motion}<p>The path meets no singularity.</p>"
    loaded = any(point is not None for point in plan.loaded_points)
    head = (
        "t [s]",
        "s",
        *(["s, singular under loads"] if loaded else []),
        _with_units(robot),
        "t_s, direction without hold",
        "s′ [1/s]",
        "s″ [1/s²]",
        "|t_s · W_p|, of its peak",
    )
    rows = [
        (
            _number(crossing.time),
            f"{crossing.s:.12f}",
            *([f"{under.s:.9f}" if under is not None else "none found"] if loaded else []),
            point(crossing.platform),
            point(crossing.twist),
            _number(crossing.speed),
            _number(round(crossing.acceleration, 9)),
            f"{crossing.residual:.1e}",
        )
        for crossing, under in zip(plan.crossings, plan.loaded_points, strict=True)
    ]
    return motion + _table(rows, head)


def _with_units(robot: ParallelRobot) -> str:
    """Return the platform's coordinates with their units: x, y [m], rz [rad]."""
    named: dict[str, list[str]] = {"m": [], "rad": []}
    for name, unit in zip(robot.axis_names, robot.axis_units, strict=True):
        named[unit].append(name)
    return ", ".join(f"{', '.join(names)} [{unit}]" for unit, names in named.items() if names)


def _law(plan: CrossingPlan) -> str:
    """Return the HTML of the law: its formula and coefficients."""
    values = ",\n ".join(repr(float(value)) for value in plan.law.coefficients)
    if plan.optimality is not None:
        specification = plan.optimality.specification
        return (
            f"<p>s(t) leads from the start of the path (s = 0) to its end (s = 1). It was optimised for "
            f"{display_name(specification.goal)}: s = φ(σ), φ′ proportional to "
            f"(σ (1 − σ))<sup>{specification.smoothness}</sup>, φ(1) = 1, and (dσ/dt)² = Σ c<sub>k</sub> "
            f"B<sub>k</sub>(ξ(σ)), with ξ and the functions B<sub>k</sub> (B-splines, or Chebyshev "
            f"polynomials on one cell) as plan.json has them; it takes {plan.duration:g} s. "
            f"c<sub>k</sub>:</p>"
            f"<pre>[{values}]</pre>"
        )
    return (
        f"<p>s(t) leads from the start of the path (s = 0) to its end (s = 1): a polynomial of degree "
        f"{plan.law.degree}, s(t) = Σ c<sub>k</sub> T<sub>k</sub>(2 t / T − 1) with Chebyshev polynomials "
        f"T<sub>k</sub>, T = {plan.duration:g} s, and c<sub>k</sub>:</p><pre>[{values}]</pre>"
    )


def _certificate(plan: CrossingPlan, film: Film) -> str:
    """Return the HTML list of the certificate's proofs."""
    certificate = plan.certificate
    sentences = [PROVEN_TORQUE.format(certificate), PROVEN_LOOPS.format(certificate)]
    if plan.crossings:
        sentences.append(PROVEN_WRENCH.format(max(crossing.residual for crossing in plan.crossings)))
        sentences += [_condition(crossing) for crossing in plan.crossings]
    if plan.robot.n_e:
        crossed = "; the crossings are those of the deformed robot" if plan.crossings else ""
        sentences.append(
            "Forces were taken on the undeformed robot (small displacements)."
            if plan.geometry == "rigid"
            else f"Forces and deflections were computed in turn, {certificate.passes} "
            f"time{'s' * (certificate.passes != 1)}, until one more time would have changed "
            f"them by {certificate.change:.1e} of the largest{crossed}."
        )
    sentences.append(
        "The platform advances along the path all the time (s′ > 0)."
        if certificate.monotone
        else "The law overshoots the ends of the path a little: s′ changes sign."
    )
    if not plan.crossings and film.has_measure:
        sentences.append(
            f"The measure of singularity |g| is {np.abs(film.g).min():.3g} or more at {len(film.g)} instants "
            f"of the motion."
        )
    items = "".join(f"<li>{_mark_indices(text)}</li>" for text in sentences)
    return (
        f"<ul>{items}</ul><p>All of it was computed from the law when this page was "
        "written: numbers near 1e-15 are rounding, and not the same twice.</p>"
    )


_CERTIFIED = (
    ("{0.nodes:g}", "nodes of the series"),
    ("{0.tail:.1e}", "what the series leaves out"),
    ("{0.max_closure_error:.1e}", "loops open by [m, rad]"),
    ("{0.max_residual_torque:.1e}", "joints out of balance by [N m, N]"),
    ("{0.max_held_torque:.1e}", "idle joints held by [N m, N]"),
    ("{0.change:.1e}", "change of the deflections"),
    ("{0.end_speed:.1e}", "speed at the ends"),
)


def _both_certificates(plan: CrossingPlan, planned: Certificate | None) -> str:
    """Return the certificate's numbers in plan.json beside the recomputed ones."""
    if planned is None:
        return ""
    rows = [(text, *map(form.format, (planned, plan.certificate))) for form, text in _CERTIFIED]
    return _table(rows, ("", "plan.json", "computed anew"))


def _condition(crossing: Crossing) -> str:
    """Return condition (8) at a crossing, in numbers."""
    condition = crossing.condition
    if condition is None:
        return f"At t = {crossing.time:.6g} s nothing was asked of the law; condition (8) holds all the same."
    if condition.holds_anyway:
        return f"At t = {crossing.time:.6g} s condition (8) holds whatever s′ and s″ are."
    terms = (
        ("s″", condition.alpha),
        ("s′²", condition.beta),
        ("s′", condition.delta),
        ("", condition.gamma),
    )
    total = " + ".join(f"{value:.6g} {name}".strip() for name, value in terms if value).replace("+ -", "− ")
    instant = f"t = {crossing.time:.6g} s"
    return f"The law was made to meet condition (8) at {instant}: t_s · W_p = {total or '0'} = 0."


def _neglected_table(plan: CrossingPlan) -> str:
    """Return the table of effects that the torques leave out."""
    if not plan.neglected:
        return "<p>Nothing that the robot's file describes.</p>"
    units = dict(zip(plan.robot.actuator_names, plan.robot.torque_units, strict=True))
    rows = [
        (
            effect,
            "unknown" if torque is None else f"{torque:.2g} {units.get(motor, plan.robot.torque_units[0])}",
            display_name(motor),
            "" if share is None else f"{100 * share:.2g} %",
        )
        for effect, torque, motor, share in plan.neglected
    ]
    return (
        "<p>What the robot's file describes and the torques above do not include, and how much each by "
        "itself would change them at most, to first order.</p>"
        + _table(rows, ("left out", "worth", "at motor", "of the largest torque"))
    )


def _parameters(plan: CrossingPlan) -> str:
    """Return the HTML table of robot, path, options, motors and springs."""
    robot, description = plan.robot, plan.robot.description
    options, wrenches = given_options(plan), plan.dynamics.wrenches.entries
    options.pop("wrenches", None)
    rows = [
        ("robot", f"{robot.name} ({description.file.name})"),
        ("flexibility", f"{robot.flexibility}, {plan.geometry} geometry"),
        ("platform", f"{description.platform.frame}: {', '.join(robot.axis_names)}"),
        ("path", repr(plan.path)),
        ("duration", f"{plan.duration:g} s"),
        ("asked for", ", ".join(f"{key} {_plain(value)}" for key, value in options.items())),
        *((f"wrench of the world on {wrench.frame}", _wrench(wrench)) for wrench in wrenches),
        ("law", f"{plan.law.kind}: {plan.reason}"),
        ("gravity", f"{point(description.gravity)} m/s²"),
        ("mass", f"{robot.mass:.6g} kg in moving parts"),
    ]
    rows += [
        (
            f"motor {actuator.joint}",
            MOTOR.format(actuator)
            + ("" if actuator.torque_limit is None else f", torque limit {actuator.torque_limit:g}")
            + ("" if actuator.speed_limit is None else f", speed limit {actuator.speed_limit:g} rad/s"),
        )
        for actuator in description.actuators
    ]
    rows += [
        (f"spring {name}", f"{stiffness:g} {'N/m' if robot.sliding[column] else 'N m/rad'}")
        for name, stiffness, column in zip(robot.elastic_names, robot.stiffness, robot.elastic, strict=True)
    ]
    return _table(rows)


def _wrench(wrench: FrameWrench) -> str:
    """Return force and moment of a wrench of the world; of a table their largest sizes along the path."""
    axes = f"{'its frame' if wrench.turns else 'the base'}'s axes"
    if wrench.rows.ndim == 1:
        return f"force {point(wrench.rows[:3])} N, moment {point(wrench.rows[3:])} N m, {axes}"
    force, moment = (np.linalg.norm(part, axis=1).max() for part in np.split(wrench.rows[:, 1:], 2, axis=1))
    return (
        f"a table of {len(wrench.rows)} rows over s, force up to {_number(force)} N, moment up to "
        f"{_number(moment)} N m, {axes}"
    )


def _plain(value: object) -> str:
    return " ".join(map(repr, value)) or "none" if isinstance(value, tuple) else str(value)


def _reproduction(plan: CrossingPlan) -> str:
    """Return the HTML of the command that plans again, with versions of packages."""
    robot = plan.robot
    installed = []
    for package in PACKAGES:
        try:
            installed.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            installed.append(f"{package} (not installed)")
    line = command_line(plan, "again")
    again = python_call(plan) if line is None else f"{line}\ncrossing report again"
    return (
        f"<pre>{escape(again)}</pre>"
        f"<p>{escape(robot.name)} is {escape(robot.description.file.name)}; written on "
        f"{date.today()} with {escape(', '.join(installed))}.</p>"
    )


def figures_with_captions(plan: CrossingPlan, film: Film, marked: Callable[[str], str]) -> str:
    """Return the figures as HTML; `marked` makes HTML of a plain text."""
    figures, drawings = [], plan_drawings(plan, film)
    for number, (name, caption) in enumerate(_captions(plan, film).items(), 1):
        with use_style():
            drawing = drawings[name]().figure
            assert isinstance(drawing, Figure)
            data = b64encode(figure_file(drawing, "svg")).decode("ascii")
        figures.append(
            f'<figure><img alt="{escape(caption)}" src="data:image/svg+xml;base64,{data}">'
            f"<figcaption><b>Figure {number}.</b> {marked(caption)}</figcaption></figure>"
        )
    return f'<div class="figures">{"".join(figures)}</div>'


def _captions(plan: CrossingPlan, film: Film) -> dict[str, str]:
    """Return the captions of the figures, in their order."""
    where = "at the singular instant" if film.instants else "halfway"
    locus = ", singular locus (purple)" if plan.robot.platform.translations.all() else ""
    dashed = " Dashed: the singular instants." if plan.crossings else ""
    captions = {"robot": f"The robot {where}: path (green), t_s (black), W_p (magenta){locus}."}
    if plan.crossings:
        captions["eye"] = (
            "The eye of the needle: at the singular instant the motors give nothing along t_s. The motion "
            "asks for nothing there."
        )
        if np.any(plan.robot.rotor_inertia):
            captions["eye"] += (
                " It is drawn with the rotors of the motors, along the t_s of that instant; the figure of "
                "t_s · W_p has the bodies alone, and the t_s of each instant."
            )
    captions["torques"] = f"Motor torques, with {parts(film)}.{dashed}"
    captions["law"] = f"The law s(t) and its derivatives.{dashed}"
    if len(plan.robot.passive):
        vanishes = ": 0 at the singular instants, condition (8)" if plan.crossings else ""
        captions["singularity"] = "Measure of singularity along the path, 0 where singular."
        captions["wrench"] = f"The {wrench_kind(plan.robot)} t_s that the motion asks for{vanishes}."
    if plan.optimality is not None:
        captions["phase_plane"] = (
            "The phase plane: speed and acceleration along the path, and what the motors' limits allow."
        )
    return captions
