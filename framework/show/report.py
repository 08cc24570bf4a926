"""Report a plan on one page: scene, figures, law, certificate, and the call that repeats the plan."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Iterable
from dataclasses import fields
from datetime import date
from html import escape
from importlib.metadata import version
from typing import Any

import numpy as np

from framework.errors import point
from framework.numerics.output import package_versions
from framework.planning.plan_facts import Fact, certificate_facts, motion_facts
from framework.planning.request import Request
from framework.planning.result import CrossingPlan
from framework.planning.saved import robot_name_or_file
from framework.show.captions import (
    describe_film,
    describe_flexibility,
    display_name,
    explain_crossing,
    why_singular,
    wrench_kind,
)
from framework.show.film import Film, film_plan
from framework.show.page import FILM_LEAD, scene_part, whole_page
from framework.show.plots import plan_drawings
from framework.show.scene import film_documents
from framework.show.style import page_figure, use_style

PROOF = (
    "The torques are functions of time known on the nodes of their series, which would leave out 1e-3 of an "
    "unbounded torque or more. The loops stay closed between the nodes, too."
)
CROSSED = (
    "At each crossing t_s · W_p, with the inertia of all bodies, is zero but for rounding, as a finite "
    "torque needs: condition (8) in the paper of Briot and Arakelian, 2010."
)
SMALL_DISPLACEMENTS = "Forces were taken on the undeformed robot (small displacements)."
SETTLED = "Forces and deflections were computed in turn, until one more time changed them no more."
ADVANCES = "The platform advances along the path all the time (s′ > 0)."
OVERSHOOTS = "The law overshoots the ends of the path a little: s′ changes sign."
COMPUTED = (
    "All of it was computed from the law when this page was written: numbers near 1e-15 are rounding, and "
    "not the same twice."
)
CONDITION = (
    "{1.alpha:.6g} s″ {1.beta:+.6g} s′² {1.delta:+.6g} s′ {1.gamma:+.6g} = t_s · W_p = 0 at t = {0:.6g} s"
)
MOTOR = "gear ratio {0.gear_ratio:g}, rotor inertia {0.rotor_inertia:g} kg m²"


def report_page(plan: CrossingPlan, *, name: str = "") -> str:
    """Return the report of a plan (HTML) in one file; `name` is the scene's title."""
    film = film_plan(plan, name=name)
    count = len(plan.crossings)
    through = f"through {'a' if count == 1 else count} Type 2 singularit{'y' if count == 1 else 'ies'}"
    heading = f"{display_name(plan.robot.name)}: {through if count else 'a motion without a singularity'}"
    installed = ", ".join(map(" ".join, (package_versions() | {"meshcat": version("meshcat")}).items()))
    source = f"{plan.robot.name} is {plan.robot.description.file.name}"
    written = f"<p>{escape(source)}; written on {date.today()} with {escape(installed)}.</p>"
    call = escape(python_call(plan))
    paragraphs = [f"<p>{_mark_indices(describe_film(film))}</p>"]
    if film.has_measure and not film.instants:
        least = np.abs(film.g).min()
        paragraphs.append(f"<p>The measure of singularity |g| is {least:.3g} or more on its frames.</p>")
    for instant in film.instants:
        sentence = _mark_indices(f"{why_singular(film.robot)} {explain_crossing(film, instant)}")
        paragraphs.append(f"<p><b>At t = {instant.time:.4g} s:</b> {sentence}</p>")
    contents = {
        "What happens": "".join(paragraphs) + _table_html(motion_facts(plan)),
        "Figures": _figures_html(plan, film),
        "The law": _law_html(plan),
        "The certificate": _certificate_html(plan),
        "Parameters": _parameters_html(plan),
        "How to reproduce it": f'<pre tabindex="0">from framework import *\n\nplan = {call}</pre>{written}',
    }
    sections = [f"<section><h2>{title}</h2>\n{content}</section>" for title, content in contents.items()]
    body = "\n".join(['<div class="report">', scene_part(heading, FILM_LEAD), *sections, "</div>"])
    return whole_page(heading, body, film_documents([film]))


def _mark_indices(text: str) -> str:
    """Convert plain text to HTML, with the indices of t_s and W_p below the line."""
    return re.sub(r"\b(t|W)_([sp])\b", r"\1<sub>\2</sub>", escape(text))


def _table_html(rows: Iterable[Fact]) -> str:
    """Return a table (HTML) of facts, a row each."""
    lines = []
    for row in rows:
        cells = "".join(f"<td>{_mark_indices(cell)}</td>" for cell in row)
        lines.append(f"<tr>{cells}</tr>")
    return '<div class="wide" tabindex="0"><table>' + "\n".join(lines) + "</table></div>"


def _law_html(plan: CrossingPlan) -> str:
    """Return the law's formula and coefficients."""
    values = ",\n ".join(map(repr, plan.law.coefficients.tolist()))
    formula = (
        f"It is a polynomial of degree {plan.law.degree}: s(t) = Σ c<sub>k</sub> T<sub>k</sub>(2 t / T − 1), "
        f"with Chebyshev polynomials T<sub>k</sub> and T = {plan.duration:g} s."
    )
    if plan.is_chain:
        formula = (
            f"It is {plan.reason}, whose path is their motion: s(t) = t / T with T = {plan.duration:g} s."
        )
    if plan.optimality is not None:
        specification = plan.optimality.specification
        formula = (
            f"It was optimised for {display_name(specification.goal)} and takes {plan.duration:g} s: "
            f"s = φ(σ), φ′ proportional to (σ (1 − σ))<sup>{specification.smoothness}</sup>, φ(1) = 1, and "
            f"(dσ/dt)² = Σ c<sub>k</sub> B<sub>k</sub>(ξ(σ)), with ξ and the functions B<sub>k</sub> "
            f"(B-splines, or Chebyshev polynomials on one cell) as plan.json has them."
        )
    return (
        f"<p>s(t) leads from the start of the path (s = 0) to its end (s = 1). {formula} c<sub>k</sub>:</p>"
        f'<pre tabindex="0">[{values}]</pre>'
    )


def _certificate_html(plan: CrossingPlan) -> str:
    """Return the proof, condition (8) at each crossing, and the certificate's numbers."""
    conditions = [
        Fact("condition (8)", CONDITION.format(crossing.time, crossing.condition))
        for crossing in plan.crossings
        if crossing.condition is not None
    ]
    sentences = [PROOF, CROSSED] if plan.crossings else [PROOF]
    if plan.robot.n_e:
        sentences.append(SMALL_DISPLACEMENTS if plan.geometry == "rigid" else SETTLED)
    sentences += [ADVANCES if plan.certificate.monotone else OVERSHOOTS, COMPUTED]
    return f"<p>{_mark_indices(' '.join(sentences))}</p>" + _table_html(conditions + certificate_facts(plan))


def _parameters_html(plan: CrossingPlan) -> str:
    """Return the table of robot, path, options, motors and springs."""
    robot = plan.robot
    description = plan.robot.description
    options = given_options(plan)
    options.pop("wrenches", None)  # the facts of the motion have them
    requested = []
    for key, value in options.items():
        text = " ".join(map(repr, value)) or "none" if isinstance(value, tuple) else str(value)
        requested.append(f"{key} {text}")
    rows = [
        Fact("robot", f"{robot.name} ({description.file.name})"),
        Fact("flexibility", f"{robot.flexibility}, {plan.geometry} geometry"),
        Fact("platform", f"{description.platform.frame}: {', '.join(robot.axis_names)}"),
        Fact("path", repr(plan.path)),
        Fact("duration", f"{plan.duration:g}", "s"),
        Fact("asked for", ", ".join(requested)),
        Fact("law", f"{plan.law.kind}: {plan.reason}"),
        Fact("gravity", point(description.gravity), "m/s²"),
        Fact("mass", f"{robot.mass:.6g}", "kg in moving parts"),
    ]
    for actuator in description.actuators:
        motor = MOTOR.format(actuator)
        if actuator.torque_limit is not None:
            motor += f", torque limit {actuator.torque_limit:g}"
        if actuator.speed_limit is not None:
            motor += f", speed limit {actuator.speed_limit:g} rad/s"
        rows.append(Fact(f"motor {actuator.joint}", motor))
    slides = robot.sliding[robot.elastic]
    for name, stiffness, slide in zip(robot.elastic_names, robot.stiffness, slides, strict=True):
        rows.append(Fact(f"spring {name}", f"{stiffness:g}", "N/m" if slide else "N m/rad"))
    for line in description.line_springs:
        numbers = f"{line.stiffness:g} N/m from {line.rest:g} m, damping {line.damping:g} N s/m"
        rows.append(Fact(f"spring {line.label}", numbers))
    return _table_html(rows)


def _figures_html(plan: CrossingPlan, film: Film) -> str:
    """Return the figures with their captions."""
    figures = []
    drawings = plan_drawings(plan, film)
    # captions of the figures, in their order
    where = "at the singular instant" if film.instants else "halfway"
    locus = ", singular locus (purple)" if plan.robot.platform.translations.all() else ""
    dashed = " Dashed: the singular instants." if plan.crossings else ""
    captions = {"robot": f"The robot {where}: path (green), t_s (double arrow), W_p (magenta){locus}."}
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
    captions["torques"] = f"Motor torques, with {describe_flexibility(film)}.{dashed}"
    captions["law"] = f"The law s(t) and its derivatives.{dashed}"
    if len(plan.robot.passive):
        vanishes = ": 0 at the singular instants, condition (8)" if plan.crossings else ""
        captions["singularity"] = "Measure of singularity along the path, 0 where singular."
        captions["wrench"] = f"The {wrench_kind(plan.robot)} t_s that the motion asks for{vanishes}."
    if plan.optimality is not None:
        captions["phase_plane"] = (
            "The phase plane: speed and acceleration along the path, and what the motors' limits allow."
        )
    for number, (name, caption) in enumerate(captions.items(), 1):
        with use_style():
            drawing = page_figure(drawings[name]().figure)
        data = b64encode(drawing).decode("ascii")
        figures.append(
            f'<figure><img alt="{escape(caption)}" src="data:image/svg+xml;base64,{data}">'
            f"<figcaption><b>Figure {number}.</b> {_mark_indices(caption)}</figcaption></figure>"
        )
    return f'<div class="figures">{"".join(figures)}</div>'


# ------------------------------------------------------------------ how to repeat the plan


def python_call(plan: CrossingPlan) -> str:
    """Return the call of `plan_crossing` that repeats a plan."""
    loaded = robot_name_or_file(plan.robot)
    parameters = dict(plan.robot.description.parameters)
    stated = f", parameters={parameters!r}" * bool(parameters)
    robot = f"load_robot({loaded!r}, flexibility={plan.robot.flexibility!r}{stated})"
    options = [f"{key}={value!r}" for key, value in given_options(plan).items()]
    return "plan_crossing(\n    " + ",\n    ".join([robot, repr(plan.path), *options]) + ",\n)"


def given_options(plan: CrossingPlan) -> dict[str, Any]:
    """Return the options of `plan_crossing` that differ from their defaults.

    Options whose default depends on the robot are always included.
    """
    always = ("smoothness", "geometry") if plan.robot.n_e else ("smoothness",)
    options = {}
    for field in fields(Request):
        value = getattr(plan.request, field.name)
        if field.name != "path" and (field.name in always or value != field.default):
            options[field.name] = value
    return options
