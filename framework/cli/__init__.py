"""The command line: `crossing COMMAND`. Open `plan` first, then `arguments`.

This package parses and prints; it computes nothing. The report of a command is the document of --json, and
the lines of text.

What commands share
    commands            the list of commands, and the parser; the command line to try instead of a refused one
    console             run one command: report on stdout, errors in one line on stderr, progress; layout
    parser              the options that several commands share
    arguments           from options to the robot, the path and the request; files in the folder of --out

Commands
    robots              `robots`, `check`, `convert`: catalogue; what a file describes; other dialects
    locate, pose        singular points on a path; all joints of a pose
    workspace_map       `map`, and `map --study`
    plan                `plan`, and `plan --raw`
    fidelity            `fidelity` and `capacity`: the least model, and the largest wrench, for a motion
    simulate            the robot driven by the planned torques
    robustness          `robustness`, and `robustness STUDY --replay K`
    identification      `excite`, `calibrate`, `identify`: motions to record, geometry, parameters of torques
    transmission        a linkage as a transmission
    show, export        `show`, `report`: pages of motions and plans; files for other programs
    completion          what completes command lines in a shell

Exit codes: 0 done, 1 the answer is no (`check`: not assembled at its reference), 2 misuse or bad input
(`check`: A is not square, so that no other command takes the robot), 70 a fault of this program, 130 ended by
Ctrl-C, 143 by SIGTERM. All but 0 print one line on stderr, broken to the width of a terminal; where there is
a remedy, the line ends with the command to try. Ending a served page by a signal is no failure: 0. With
--json, stdout has one JSON object and nothing else.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from framework.cli.commands import parser_of, spell_out_help
from framework.numerics.interruption import Heard, Terminated, defer_signals, exit_code, interruptible


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code."""
    arguments = spell_out_help(sys.argv[1:] if arguments is None else arguments)
    with interruptible() as heard:
        try:
            return _run(arguments, heard)
        except KeyboardInterrupt as stop:
            return report_interruption(stop, arguments)


def report_interruption(stop: KeyboardInterrupt, arguments: Sequence[str]) -> int:
    """Report that a command was interrupted and return the exit code."""
    from framework.cli.console import report_refusal

    words = "terminated" if isinstance(stop, Terminated) else "interrupted"
    return report_refusal(stop, ": ".join([words, *map(str, stop.args)]), exit_code(stop), arguments)


def _run(arguments: Sequence[str], heard: Heard) -> int:
    """Parse and run; --help is answered without importing numpy and its users."""
    try:
        with defer_signals():  # a signal must not interrupt the import of compiled modules
            parser = parser_of(arguments)
        options = parser.parse_args(arguments)
        with defer_signals():
            from framework.cli.console import run
        return run(options, heard, arguments)
    except Exception as error:  # noqa: BLE001 - all other errors are faults of the program
        from framework.cli.console import report_failure

        return report_failure(error, heard, arguments)
