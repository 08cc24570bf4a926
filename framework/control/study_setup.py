"""The set-up of a study, stored in robustness.json; with its seed it reproduces any run."""

from __future__ import annotations

import platform
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from framework.control.closed_loop import SENSORS, ControlLoop, Run, run_closed_loop, torque_limit
from framework.control.controllers import Controller, tuned_controller
from framework.control.reference import Reference, reference_of
from framework.control.variation import Spread, draw
from framework.errors import InvalidInput
from framework.model.documents import prefix_errors
from framework.numerics.fields import (
    Table,
    dataclass_of,
    list_of,
    mapping,
    not_negative,
    one_of,
    positive,
    read_table,
    required,
    whole,
)
from framework.numerics.output import package_versions
from framework.planning.result import CrossingPlan
from framework.planning.saved import plan_document, plan_from_document, read_document

FILE = "robustness.json"


@dataclass(frozen=True, eq=False)
class StudySetup:
    """A plan with its sampling, its control loop and the spread of robots."""

    plan: CrossingPlan  # as read from its own document
    period: float  # [s]
    loop: ControlLoop  # with torque limits as numbers
    spread: Spread
    seed: int

    @staticmethod
    def of(plan: CrossingPlan, *, period: float, loop: ControlLoop, spread: Spread, seed: int) -> StudySetup:
        """Make the set-up of a new study.

        The plan is written to a document and read back, so that its torques equal those of a later rerun to
        the last bit.

        Raises:
            InvalidInput: a plan that cannot be written to a document; an invalid period or limit.
        """
        plan = plan_from_document(plan_document(plan), Path(FILE))
        limit = tuple(map(float, torque_limit(reference_of(plan, period=period), loop)))
        return StudySetup(plan, period, replace(loop, limit=limit), spread, seed)

    @cached_property
    def reference(self) -> Reference:
        """The plan at the sampling instants of the controller."""
        return reference_of(self.plan, period=self.period)

    def controller(self, name: str) -> Controller:
        """Return the controller of a name with its default gains.

        Raises:
            InvalidInput: unknown name, or a robot that the controller cannot drive.
        """
        return tuned_controller(name, self.reference)

    def run(self, controller: str, *numbers: int, record: bool = False) -> Run:
        """Repeat runs of the study together.

        Args:
            controller: name of the controller.
            numbers: numbers of the runs, from 0.
            record: whether the result contains the torques of all periods.
        """
        variations = [draw(self.plan.robot, self.spread, (self.seed, number)) for number in numbers]
        return run_closed_loop(self.controller(controller), self.loop, self.spread, variations, record=record)

    def to_dict(self, folder: Path | None = None) -> dict[str, Any]:
        """Return the content of a robustness.json in `folder`, with the versions of libraries."""
        return {
            "seed": self.seed,
            "period": self.period,
            **asdict(self.loop),
            "spread": asdict(self.spread),
            "plan": plan_document(self.plan, folder),
            "versions": library_versions(),
        }


_STUDY: Table = {
    "seed": required(whole),
    "period": required(positive),
    "tolerance": required(positive),
    "end": required(positive),
    "limit": required(list_of(positive)),
    "sensors": required(one_of("sensors", SENSORS)),
    "spread": required(dataclass_of(Spread, dict.fromkeys(vars(Spread()), not_negative))),
    "plan": required(mapping),
}


def library_versions() -> dict[str, str]:
    """Return the versions on which the last bit of a run depends."""
    return {**package_versions(), "python": platform.python_version(), "machine": platform.machine()}


def load_study(folder: str | Path, *, robot_file: str | None = None) -> tuple[StudySetup, dict[str, Any]]:
    """Read the set-up of a study that `crossing robustness --out` wrote; return also its document.

    Args:
        robot_file: path of the robot's file, if it differs from the path in the document.

    Raises:
        InvalidInput: there is no robustness.json, the file is another document, or the robot has changed.
    """
    file = Path(folder) / FILE
    saved = read_document(file, "robustness")
    with prefix_errors(file, InvalidInput):
        stated = read_table("", saved, _STUDY, others=None)
        loop = ControlLoop(**{key: stated[key] for key in ("tolerance", "end", "limit", "sensors")})
    plan = plan_from_document(stated["plan"], file, robot_file=robot_file)
    return StudySetup(plan, stated["period"], loop, stated["spread"], stated["seed"]), saved
