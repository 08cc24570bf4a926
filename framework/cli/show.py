"""`crossing show` and `crossing report`: pages of motions, of a robot to move by hand, and about a plan."""

from __future__ import annotations

import threading
import webbrowser
from argparse import Namespace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.console import tell
from framework.cli.parser import (
    Report,
    add_moved_robot,
    add_overwrite,
    add_path_and_motion,
    add_robot_or_plan,
    integer_between,
    not_empty,
)
from framework.errors import InvalidInput, NoAnswer
from framework.kinematics.parallel_robot import ParallelRobot
from framework.planning.options import TYPED
from framework.planning.saved import load_plan

if TYPE_CHECKING:
    from framework.show.film import Film


def add_show_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing show`."""
    add_robot_or_plan(parser)
    add_path_and_motion(parser, several=True)
    parser.add_argument(
        "--html",
        type=not_empty,
        metavar="FILE",
        help="write one file that plays offline, and end; without --scene, of the first scene that crosses",
    )
    parser.add_argument(
        "--picture",
        type=not_empty,
        metavar="FILE",
        help="write one picture of a film, and end: .png, .svg, .pdf, or .gif and .apng, which move",
    )
    add_overwrite(parser)
    parser.add_argument("--no-open", action="store_true", help="do not open the browser")
    parser.add_argument(
        "--port",
        type=integer_between(0, 65535),
        metavar="N",
        help="of the served page, such as 8000 (default: a free one)",
    )


def run_show(options: Namespace) -> Report:
    """Write a page or picture to a file, or serve the page until Ctrl-C."""
    from framework.show.page import film_page, hand_page

    if options.html is not None and options.picture is not None:
        raise InvalidInput("--picture: give either --picture or --html").advising({"picture": None})
    file = options.picture or options.html
    option = "--html" if options.picture is None else "--picture"
    if file is not None and options.port is not None:
        raise InvalidInput("--port: is of a served page, and a file is asked for").advising({"port": None})
    arguments.check_page(file, options, option)
    films = _make_films(options)
    if file is not None:
        filmed = films or [_film_first_crossing(options)]
        if options.picture is None:
            page: str | bytes = film_page(filmed)
        else:
            from framework.show.moving import film_picture

            options.progress.start("drawing the picture")
            page = film_picture(filmed, FilePath(file).suffix[1:])
        from framework.show.captions import describe_flexibility, display_name

        document, (written,) = arguments.write_page(FilePath(file), page, options, option)
        entries = []
        scenes = []
        for film in filmed:
            entries.append({"name": film.name, "flexibility": film.robot.flexibility, "proved": film.proved})
            scenes.append(f"{film.name or 'the motion asked for'} ({describe_flexibility(film)})")
        lines = [f"no scene given: filmed {filmed[0].name}"] if not films else []
        lines.append(f"{display_name(filmed[0].robot.name)}, {', '.join(scenes)}: {written}")
        return document | {"films": entries}, lines
    if films:
        return _serve_page(options, film_page(films), robot=None)
    robot = arguments.load(options)
    return _serve_page(options, hand_page(robot), robot)


def _make_films(options: Namespace) -> list[Film]:
    """Film the requested motions; return none if the robot is to be moved by hand."""
    from framework.show.captions import describe_saved_plan
    from framework.show.film import film_plan

    saved = arguments.saved_plan(options)
    if saved is not None:
        return [film_plan(saved, name=describe_saved_plan(saved, FilePath(options.robot).resolve().name))]
    if not any((options.scenes, options.start, options.end, options.via)):
        of_a_motion = (*TYPED, *arguments.WRENCH_OPTIONS)
        arguments.refuse_options(options, of_a_motion, "needs a motion; give --scene, or --from and --to")
        return []
    robot = arguments.load(options)
    return [_film_scene(options, robot, name) for name in options.scenes or [None]]


def _film_scene(options: Namespace, robot: ParallelRobot, scene: str | None) -> Film:
    """Film the motion of a scene, or of the options if None."""
    from framework.show.film import film_motion

    scene_options = Namespace(**{**vars(options), "scene": scene})
    name = "" if scene is None else f"Scene {scene}"
    return film_motion(robot, arguments.request(scene_options, robot), name=name)


def _film_first_crossing(options: Namespace) -> Film:
    """Film the first scene with a proved crossing, or else the first that can be filmed."""
    robot = arguments.load(options)
    films: list[Film] = []
    refusals: list[NoAnswer] = []
    for name in robot.description.scenes:
        try:
            films.append(_film_scene(options, robot, name))
        except NoAnswer as error:
            refusals.append(error)
            continue
        if films[-1].proved and films[-1].instants:
            return films[-1]
    if films:
        return films[0]
    none = InvalidInput(f"{robot.name} has no scenes: give --from, --to and --duration")
    raise next(iter(refusals), none)


def _serve_page(options: Namespace, page: str, robot: ParallelRobot | None) -> Report:
    """Serve a page on this machine until interrupted, and open the browser."""
    from framework.show.jogging import PageServer, move_by_hand

    reply = None if robot is None else lambda message: move_by_hand(robot, message)
    server = PageServer(page, reply, port=options.port or 0)
    options.progress.end()
    # with --json, stdout is for the one object at the end
    tell(f"{server.address}  (Ctrl-C ends)", aside=options.json)
    if not options.no_open:
        threading.Thread(target=webbrowser.open, args=(server.address,), daemon=True).start()
    server.serve_until_interrupted()
    return {"address": server.address, "ended": True}, ["ended"]


# ------------------------------------------------------------------ crossing report


def add_report_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing report`."""
    parser.add_argument("folder", metavar="DIR", help="folder of `crossing plan --out`")
    add_moved_robot(parser)
    parser.add_argument(
        "--html", type=not_empty, metavar="FILE", help="where to write it (default: DIR/report.html)"
    )
    add_overwrite(parser)


def run_report(options: Namespace) -> Report:
    """Read a plan, prove its torques again, and write the page."""
    from framework.show.captions import describe_saved_plan
    from framework.show.report import report_page

    options.progress.start("proving the plan anew, and drawing the page")
    folder = FilePath(options.folder)
    page_file = FilePath(options.html or folder / "report.html")
    arguments.check_page(page_file, options)
    plan = load_plan(folder, robot_file=options.robot_file)
    page = report_page(plan, name=describe_saved_plan(plan, folder.resolve().name))
    return arguments.write_page(page_file, page, options)
