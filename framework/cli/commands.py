"""The commands in the order of --help, their parser, and command lines to try instead of a refused one.

The parser imports the module of one command at most, so that --help is quick.
"""

from __future__ import annotations

import argparse
import math
import re
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple, NoReturn


class Command(NamedTuple):
    """A command: its texts in the help, and its module.

    All examples run in one folder, in the order of `COMMANDS`: later ones read files of earlier ones.
    """

    text: str  # of the list of commands, without a full stop
    examples: tuple[str, ...]  # command lines
    module: str  # in this package; has `add_NAME_options` and `run_NAME`
    details: str = ""  # follow the text in the command's own help
    required: tuple[str, ...] = ("ROBOT",)  # arguments in the line of usage


COMMANDS = {
    "robots": Command(
        "list the catalogue",
        ("crossing robots", "crossing robots --picture catalogue.png"),
        "robots",
        required=(),
    ),
    "check": Command(
        "mobility, rank, redundant rows, masses, closure error, mode",
        ("crossing check five_bar", "crossing check delta --flexibility flexible_joints"),
        "robots",
    ),
    "convert": Command(
        "write our robot file from another dialect: SDF, Gepetto's robot.yaml beside robot.urdf, "
        "URDF+ <loop>, ROS <constraint>, <loop_joint>, MJCF <equality>; --base LINK: of one part of it, "
        "such as a leg",
        (
            "crossing convert five_bar --out my",
            "crossing convert my/five_bar.urdf --close left_tip right_tip revolute --out 5r",
        ),
        "robots",
        "NAME_description and NAME_mj_description are robots of the package robot_descriptions, if it is "
        "installed: crossing convert cassie_mj_description --base left-hip-pitch --lock left-shin "
        "left-heel-spring --out leg.",
        required=("ROBOT", "--out DIR"),
    ),
    "locate": Command(
        "find the singular points on a path",
        ("crossing locate five_bar --scene C", "crossing locate five_bar --from 0.1 0.345 --to -0.05 0.195"),
        "locate",
        "Without a path: the singular pose nearest to the reference, and a line that crosses there. With "
        "--flexibility: the singular points of the undeformed robot, springs at rest, and the rate at "
        "which each deflection moves them along the path. How far the springs give, and so where the "
        "deformed robot is singular, depends on the motion: crossing plan tells.",
    ),
    "map": Command(
        "quantities over the workspace on one working mode, with the singular locus on top",
        ("crossing map five_bar --size 50", "crossing map five_bar --scene C --quantity g torque --out map"),
        "workspace_map",
        "Poses are reached from the reference by continuation, so the map never leaves its working mode; "
        "what is not reached has no value and a reason.",
    ),
    "pose": Command(
        "all joints of a pose, from its motors or from its platform, in the modes of the reference",
        ("crossing pose five_bar --motors 1.2 1.9", "crossing pose five_bar --platform 0.1 0.3 --all"),
        "pose",
    ),
    "plan": Command(
        "plan a motion through the singular points, with torques and proof",
        (
            "crossing plan five_bar --scene C --out move",
            "crossing plan five_bar --scene C --optimize time --torque-limit 0.165",
        ),
        "plan",
    ),
    "capacity": Command(
        "the largest multiple of a wrench that is crossed within the limits",
        (
            "crossing capacity five_bar --scene C --torque-limit 0.2 --wrench 0 -1",
            "crossing capacity five_bar --scene C --wrench 5 0 --torque-limit 0.2",
        ),
        "fidelity",
        "By bisection over plans, from one within all limits to one that is refused; what binds is why that "
        "is, and from where it is proved that no law is left. Without --duration each plan is the quickest "
        "within the limits.",
    ),
    "fidelity": Command(
        "the least model that is enough for a motion, with its evidence",
        (
            "crossing fidelity five_bar --scene C --tolerance 1%",
            "crossing fidelity five_bar --scene A --out fidelity_A",
        ),
        "fidelity",
        "All levels of fidelity, from kinematics to the inertia of the elastic motion, make one motion. The "
        "torques of each drive the full elastic simulation, without feedback unless the robot falls. Enough "
        "is what keeps platform (of the path's length) and torques (of the fullest level's peak) within the "
        "tolerance. Put the printed line into the scene, and `crossing plan --flexibility auto` uses it.",
    ),
    "simulate": Command(
        "drive the robot with the planned torques: tracking error, drift, energy",
        ("crossing simulate move", "crossing simulate five_bar --scene A --sensors --out run"),
        "simulate",
    ),
    "robustness": Command(
        "drive a planned crossing with a controller on many robots that differ from their model",
        (
            "crossing robustness five_bar --scene C --smoothness 4 --runs 20 --out study",
            "crossing robustness study --replay 17",
        ),
        "robustness",
    ),
    "transmission": Command(
        "a linkage as a transmission: inertia, limits, friction and backlash that a joint feels behind it, "
        "and the error of a static mapping of torques",
        (
            "crossing transmission five_bar --lower 0 .3 --upper .05 .35 --posture 0 .33",
            "crossing transmission humanoid_ankle --out ankle",
        ),
        "transmission",
    ),
    "show": Command(
        "play motions in the browser, side by side; without a motion, move the robot by hand. Ctrl-C ends it",
        ("crossing show five_bar --scene A B C", "crossing show move --html crossing.html"),
        "show",
    ),
    "report": Command(
        "write one HTML page about a plan: scene, figures, law, certificate, parameters, reproduction",
        ("crossing report move", "crossing report move --html report.html"),
        "show",
        required=("DIR",),
    ),
    "export": Command(
        "a robot as MuJoCo's MJCF, a plan as a trajectory for ros2_control, a scene as a lesson",
        (
            "crossing export five_bar --to mjcf --out five_bar.xml",
            "crossing export move --to ros2_control --out trajectory.yaml",
        ),
        "export",
        required=("ROBOT", "--to FORMAT", "--out FILE"),
    ),
    "excite": Command(
        "a periodic motion to record for identify, within limits: what it will show, and to how many digits",
        (
            "crossing excite five_bar --duration 5 --out excite.csv",
            "crossing excite five_bar_heavy --duration 5 --only payload --torque-limit 0.1",
        ),
        "identification",
        "The motion keeps clear of singularities of Type 1 and Type 2 and within the joints' ranges. It is "
        "checked by forward simulation: the parameters are identified from a simulated recording.",
    ),
    "calibrate": Command(
        "where joints are, from motor angles and measured poses or parts of poses, with standard deviations",
        (
            "crossing calibrate five_bar_heavy run/sensors.csv",
            "crossing calibrate five_bar_heavy run/sensors.csv --out calibrated",
        ),
        "identification",
        "What the data cannot see is named, with a measurement that would show it, and stays as in the file.",
        required=("ROBOT", "DATA"),
    ),
    "identify": Command(
        "masses, inertias, rotor inertias and friction from recorded motor angles and torques, with standard "
        "deviations",
        (
            "crossing identify five_bar_heavy run/sensors.csv",
            "crossing identify calibrated/five_bar_heavy.yaml run/sensors.csv --out twin",
        ),
        "identification",
        "A twin is written only if it predicts torques that were held out better than no torque, the file, "
        "friction alone and another payload do. What the data do not show stays as near to the robot file as "
        "bodies that can exist allow; --all names the combinations that torques depend on (base parameters).",
        required=("ROBOT", "DATA"),
    ),
    "completion": Command(
        "print what completes commands, options and files in a shell",
        ("crossing completion bash", "crossing completion fish"),
        "completion",
        'bash: eval "$(crossing completion bash)" in ~/.bashrc; zsh: write the output to a file '
        "_crossing in a folder of $fpath; fish: write it to ~/.config/fish/completions/crossing.fish.",
        required=("SHELL",),
    ),
}
VALUE_COUNTS = {None: 1.0, "?": 1.0, "+": math.inf, "*": math.inf}  # largest number of values by `nargs`
NEEDS_NO_FILE = re.compile(r"crossing \w+( five_bar( --.*)?)?")  # an example that runs in any folder
FIRST_EXAMPLES = ("crossing plan five_bar --scene C", "crossing show five_bar --scene C --html crossing.html")
VERSION = ("-V", "--version")
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


class Misuse(Exception):
    """A wrong command line.

    The remedy, where one is known, is `instead`, a command line to try, or `mend`, a function that returns
    the words to write in place of a wrong word.
    """

    def __init__(
        self,
        message: str,
        instead: str | None = None,
        *,
        mend: Callable[[str], list[str] | None] | None = None,
    ) -> None:
        """Store the message and the remedy."""
        super().__init__(message)
        self.instead = instead
        self.mend = mend


class _Help(argparse.HelpFormatter):
    """Format help; leave texts of several lines unchanged."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


class _Values(argparse._StoreAction):
    """Store the value of an option; join the lists of a repeated option."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        earlier = getattr(namespace, self.dest)
        if self.nargs in ("+", "*") and earlier is not self.default:
            values = [*earlier, *values]
        super().__call__(parser, namespace, values, option_string)


class OneLineParser(argparse.ArgumentParser):
    """A parser with grouped options, errors in one line, negative numbers with exponents."""

    def __init__(self, *, examples: Iterable[str] = (), **settings: Any) -> None:
        """Set up a parser without abbreviations, with examples at the end of its help."""
        self.examples = tuple(examples)
        epilog = "\n  ".join(["examples:", *self.examples])
        super().__init__(allow_abbrev=False, epilog=epilog, formatter_class=_Help, **settings)
        self.register("action", None, _Values)
        self._optionals.title = "output"  # of options without a topic, such as --out and --json
        # argparse takes -1e-3 and -1m for options; no option of ours begins like a number
        self._negative_number_matcher = re.compile(r"^-\.?\d")

    def topic(self, title: str) -> argparse._ArgumentGroup:
        """Return the option group of a title, made on first use.

        Options without a group come last, under `output`.
        """
        groups = [group for group in self._action_groups if group.title == title]
        return groups[0] if groups else self.add_argument_group(title)

    @property
    def option_actions(self) -> dict[str, argparse.Action]:
        """Options of this parser and its subparsers, by flag."""
        options = dict(self._option_string_actions)
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                for parser in action.choices.values():
                    options |= parser._option_string_actions
        return options

    def format_help(self) -> str:
        self._action_groups.sort(key=lambda group: group is self._optionals)
        return super().format_help()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments; refuse unknown ones with a hint."""
        # move --set with its values NAME=VALUE to the end
        others: list[str] = []
        moved: list[str] = []
        takes_values = False
        for word in args:
            is_value = takes_values and ("=" in word or moved[-1] == "--set") and not word.startswith("--")
            takes_values = word == "--set" or is_value
            (moved if takes_values else others).append(word)
        parsed, unknown = super().parse_known_args([*others, *moved], namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}{self._hint(unknown[0])}")
        return parsed, unknown

    def _hint(self, unknown: str) -> str:
        """Return a hint at options that resemble an unknown argument; empty without any."""
        from framework.errors import nearest

        options = [option[2:] for option in self._option_string_actions if option.startswith("--")]
        if not unknown.startswith("-"):
            may_be_scene = "scene" in options and not unknown[:1].isdigit()
            return f"; did you mean --scene {unknown}?" if may_be_scene else ""
        flag = unknown.partition("=")[0]
        similar = nearest(flag.lstrip("-").replace("_", "-"), options)
        meant = [f"--{name}" for name in similar if f"--{name}" != unknown]
        if meant:
            return f"; did you mean {' or '.join(meant)}?"
        takers = [name for name in COMMANDS if flag in parser_of([name]).option_actions]
        return f"; it is an option of crossing {', crossing '.join(takers[:3])}" if takers else ""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a value that is not among the choices; name the nearest one."""
        if action.choices is not None and value not in action.choices:
            from framework.errors import did_you_mean

            hint = did_you_mean(value, action.choices)
            listed = ", ".join(action.choices)
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{hint} (choose from {listed})")

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Parse a value; refuse numbers with units or commas, and say the plain numbers."""
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError as error:
            meant = _meant_numbers(action, arg_string)
            if action.type is not float or meant is None:
                raise
            how = "separate by spaces" if "," in arg_string else "without its unit"
            raise Misuse(
                f"{error}; {how}: {' '.join(meant)}", mend=lambda word: _meant_numbers(action, word)
            ) from None

    def error(self, message: str) -> NoReturn:
        """Raise `Misuse`; propose an example that needs no file if arguments are missing."""
        instead = None
        if "arguments are required" in message:
            instead = next(filter(NEEDS_NO_FILE.fullmatch, self.examples), None)
        raise Misuse(f"{message} (see `{self.prog} --help`)", instead)


def _meant_numbers(action: argparse.Action, text: str) -> list[str] | None:
    """Return the plain numbers of a text with units or commas; None for other texts.

    The units are those in the help of the option, such as [m, rad].
    """
    units = ",".join(re.findall(r"\[([^\]]+)\]", action.help or "")).split(",")
    numbers = []
    for part in [text] if action.nargs is None else text.split(","):
        number = part.strip()
        for unit in units:
            number = number.removesuffix(unit.strip()).strip()
        if number:
            numbers.append(number)
    return numbers if numbers and all(map(NUMBER.fullmatch, numbers)) else None


def spell_out_help(arguments: Sequence[str]) -> list[str]:
    """Write `help`, `help COMMAND`, or no argument at all, with --help."""
    if not arguments:
        return ["--help"]
    if arguments[0] == "help":
        return [*arguments[1:2], "--help"]
    return list(arguments)


def parser_of(arguments: Sequence[str], *, whole: bool = False) -> OneLineParser:
    """Return the parser of the command that the arguments begin with, or of all commands.

    Only the module of this command is imported; of a `whole` parser, those of all, with their options.
    """
    parser = OneLineParser(
        prog="crossing",
        usage="%(prog)s COMMAND [options], %(prog)s help COMMAND",
        description="Carry parallel robots through Type 2 singularities with finite motor torques. "
        "With --json every command answers in one JSON object, for programs.",
        examples=FIRST_EXAMPLES,
    )
    parser.set_defaults(json=False)
    version_text = ""
    if arguments and arguments[0] in VERSION:
        from importlib.metadata import version  # takes time to import

        version_text = f"crossing {version('parallel-singularity-crossing')}"
    parser.add_argument(*VERSION, action="version", version=version_text, help="say the version and end")
    commands = parser.add_subparsers(
        title="commands", prog="crossing", metavar="COMMAND", required=True, parser_class=OneLineParser
    )
    name = arguments[0] if arguments else ""
    if name in COMMANDS or whole:
        for each in COMMANDS if whole else [name]:
            _add_command(commands, each)
        return parser
    first = arguments[0] if arguments else "--help"
    meant = next((word for word in arguments if word in COMMANDS), None)
    if not first.startswith("-"):
        from framework.errors import choose_from

        raise Misuse(f"{choose_from('command', first, COMMANDS)} (see `crossing --help`)")
    if meant and first not in ("-h", "--help", *VERSION):
        index = arguments.index(meant)
        instead = shlex.join(["crossing", *arguments[index:], *arguments[:index]])
        raise Misuse(f"{first}: options stand behind the command", instead)
    for name, command in COMMANDS.items():
        commands.add_parser(name, help=command.text)
    return parser


def _add_command(commands: Any, name: str) -> None:
    """Add the parser of a command; its module declares the options and runs the command.

    `commands` are the subparsers of argparse.
    """
    command = COMMANDS[name]
    description = f"{command.text}. {command.details}".removesuffix(". ")
    parser = commands.add_parser(
        name,
        usage=" ".join(["%(prog)s", *command.required, "[options]"]),
        help=command.text,
        description=description,
        examples=command.examples,
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout, nothing else")
    module = import_module(f"framework.cli.{command.module}")
    parser.set_defaults(run=getattr(module, f"run_{name}"))
    getattr(module, f"add_{name}_options")(parser)


# ------------------------------------------------------------------ advice


def advise(error: BaseException, arguments: Sequence[str]) -> str | None:
    """Return the command line to try instead of `arguments`; None without a remedy."""
    if isinstance(error, Misuse):
        return error.instead if error.mend is None else _mend_words(error.mend, arguments)
    remedy: Mapping[str, Any] | None = getattr(error, "remedy", None)
    if not remedy or not arguments or arguments[0] not in COMMANDS:
        return None
    words = typed = [word for word in arguments if word != "--json"]
    options = parser_of(typed).option_actions
    if "reference" in remedy and "--reference" not in options:  # the command to paste a reference from
        robot = parser_of(typed).parse_args(typed).robot
        words, options = ["check", robot], parser_of(["check"]).option_actions
    for name, value in remedy.items():
        flag = f"--{name.replace('_', '-')}"
        if flag not in options:
            return None
        words = _remove_option(words, options[flag])
        if value is not None and value is not False:
            words += [flag, *_typed_words(value)]
    return None if sorted(words) == sorted(typed) else shlex.join(["crossing", *words])


def _mend_words(mend: Callable[[str], list[str] | None], arguments: Sequence[str]) -> str:
    """Replace the words, or values behind an option's `=`, that `mend` corrects."""
    words = ["crossing"]
    for word in arguments:
        flag, _, value = word.partition("=") if word.startswith("--") else ("", "", word)
        meant = mend(value)
        if meant is not None:
            words += [flag, *meant] if flag else meant
        elif word != "--json":
            words.append(word)
    return shlex.join(words)


def _remove_option(words: Sequence[str], option: argparse.Action) -> list[str]:
    """Remove an option and its values from the words of a command line."""
    count = option.nargs
    most = count if isinstance(count, int) else VALUE_COUNTS.get(count, 0.0)
    rest: list[str] = []
    values = 0.0  # number of values of the option that may still follow
    for word in words:
        flag, equals, _ = word.partition("=")
        if flag in option.option_strings:
            values = 0.0 if equals else most
        elif values and not word.startswith("--"):
            values -= 1
        else:
            values = 0.0
            rest.append(word)
    return rest


def _typed_words(value: Any) -> list[str]:
    """Return the value of an option as words of a command line; none for True."""
    if value is True:
        return []
    if isinstance(value, Mapping):
        distinct = set(value.values())
        if len(distinct) == 1:
            return _typed_words(distinct.pop())
        return [f"{key}={part:.6g}" for key, part in value.items()]
    if isinstance(value, list | tuple):
        return [word for part in value for word in _typed_words(part)]
    return [value if isinstance(value, str) else f"{value:.6g}"]
