"""`crossing robustness STUDY --replay K`: one run of a study once more, held against what was written."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from framework.cli.arguments import flag_of
from framework.cli.parser import Report
from framework.control.run_monitor import Run
from framework.control.study_setup import FILE, load_study, versions
from framework.errors import InvalidInput
from framework.fields import Table, list_of, mapping, named, read_table, required, text, whole
from framework.model.documents import naming

_STUDY: Table = {"controller": required(text), "failures": required(list_of(mapping))}
_RUNS: Table = {
    "runs": required(whole),
    "versions": required(named(text)),
    "studies": required(list_of(lambda where, study: read_table(where, study, _STUDY, others=None))),
}
OF_A_REPLAY = (
    "robot",
    "robot_file",
    "replay",
    "controller",
    "json",
    "warnings",
    "refusal",
    "progress",
    "parser",
)


REPORT = """\
{robot}: run {run}, {controller}: {verdict}; {agreement}
  tracking error    {tracking_error:.3g} robot lengths or rad, at the end {end_error:.3g}
  peak torque       {peak_torque:.6g} N m
  payload           {payload:.6g} of the model's"""


def replayed(options: argparse.Namespace) -> Report:
    """Run number --replay of the study in the folder ROBOT.

    Raises:
        InvalidInput: options beside it that the study has already; no such study, controller or run.
    """
    plain = vars(options.parser.parse_args([options.robot]))
    for key, value in vars(options).items():
        if key not in OF_A_REPLAY and value != plain[key]:
            raise InvalidInput(f"{flag_of(key)}: the study in {options.robot} has its own; leave it out")
    setup, saved = load_study(options.robot, robot_file=options.robot_file)
    with naming(Path(options.robot) / FILE, InvalidInput):
        stated = read_table("", saved, _RUNS, others=None)
    failures = {study["controller"]: list(study["failures"]) for study in stated["studies"]}
    runs, then = stated["runs"], stated["versions"]
    names = options.controller or list(failures)
    if len(names) != 1 or names[0] not in failures:
        raise InvalidInput(
            f"--controller: give one of this study: {', '.join(map(str, failures))}; got "
            f"{' '.join(options.controller or ()) or 'none'}"
        )
    name, number = names[0], options.replay
    if number >= runs:
        raise InvalidInput(f"--replay: the study has the runs 0 to {runs - 1}, got {number}")
    run, seed = setup.run(name, number), [setup.seed, number]
    written = [failure for failure in failures[name] if failure.get("seed") == seed]
    document = {
        "robot": setup.plan.robot.name,
        "controller": name,
        "run": number,
        "passed": run.passed[0],
        "why": run.why[0],
        "tracking_error": run.tracking_error[0],
        "end_error": run.end_error[0],
        "peak_torque": run.peak_torque.max(),
        "payload": run.payload[0],
        "as_written": written == _failures(run, seed),
        "versions": {"then": then, "now": versions()},
    }
    return document, _text(document)


def _failures(run: Run, seed: list[int]) -> list[dict[str, Any]]:
    """Return the entry of a run among the study's failures, as robustness.json has it."""
    if run.passed[0]:
        return []
    return [{"seed": seed, "why": run.why[0], "tracking_error": run.tracking_error[0]}]


def _text(document: dict[str, Any]) -> str:
    then, now = document["versions"]["then"], document["versions"]["now"]
    others = [
        f"{library} {then.get(library)} then, {now[library]} now"
        for library in now
        if then.get(library) != now[library]
    ]
    agreement = "as in the study"
    if not document["as_written"]:
        agreement = f"otherwise than in the study, with {', '.join(others) or 'the same versions'}"
    return REPORT.format_map(document | {"verdict": document["why"] or "passed", "agreement": agreement})
