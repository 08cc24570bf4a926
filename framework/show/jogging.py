"""A robot moved by hand: the replies to its page, and the server that sends them.

The server is bound to 127.0.0.1, on a port that the system chooses. It refuses requests that name another
host or come from a page of another origin, so that a web site open in the same browser gets nothing.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np

from framework.dynamics.platform_wrench import action_lines, hold_at
from framework.errors import InvalidInput, NoAnswer, NotAssembled
from framework.kinematics.continuation.forward_kinematics import motors_are_free
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import joint_poses, platform_frame_twists, platform_positions
from framework.numerics.arrays import Array
from framework.numerics.interruption import interruptible
from framework.numerics.output import Document, plain, select_fields
from framework.show.captions import describe_catalogue_entry, wrench_kind, wrench_unit
from framework.show.scene import (
    encode_each,
    encode_floats,
    encode_locus,
    force_edges,
    page_robot_document,
    why_no_figure,
)
from framework.show.sight import robot_sight
from framework.singularity.drawn_locus import locus_curves
from framework.singularity.jogging import (
    CLASSES,
    JoggedPose,
    describe_jogged_pose,
    drag_platform,
    loose_motion,
    move_motor,
    move_platform,
)

HELD_WRENCH = 10.0  # [N, or N m on a platform that only turns] push along t_s that the motors withstand


def hand_document(robot: ParallelRobot) -> Document:
    """Return the page's document of a robot at its reference, with sliders."""
    reference = robot.reference
    start = describe_jogged_pose(robot, reference.q)
    lines = None  # of action of the motors' forces
    with suppress(NotAssembled):
        hold = hold_at(robot, reference.q, np.zeros(robot.n))
        lines = action_lines(robot, hold.motor_speed[None])
    poses = joint_poses(robot, reference.q[None])
    platform = platform_positions(robot, poses)
    # `wrench_kind` is "force along" or "torque about": the second word leads to t_s
    document: Document = plain(
        page_robot_document(robot, poses, robot_sight(robot))
        | {
            "kind": "hand",
            "about": describe_catalogue_entry(robot),
            "push": f"{HELD_WRENCH:g} {wrench_unit(robot)} {wrench_kind(robot).split()[1]} t_s",
            "flat": robot.n == 2,
            "lines": lines is not None,
            "no_figure": why_no_figure(robot) if len(robot.passive) else "",
            "drag": len(robot.platform.sliding) > 0,
            "poses": encode_floats(poses),
            "locus": encode_locus(
                robot, locus_curves(robot, reference.q, reference.x), platform, max_distance=1.2
            ),
            "free_motors": motors_are_free(robot),
            "sliders": _sliders(robot, start),
            "start": _pose_document(robot, start),
        }
    )
    return document


def move_by_hand(robot: ParallelRobot, movement: Document) -> Document:
    """Return the page's document of the pose after one movement.

    Args:
        movement: {q, part: platform or motor, index, value} of a slider, or {q, part: drag, place} with the
            place [m] of the platform's origin in the base.

    Raises:
        InvalidInput: the movement lacks an entry, or has a wrong one.
    """
    try:
        q = np.array(movement["q"], dtype=float)
        part = movement["part"]
        if part == "drag":
            place = np.array(movement["place"], dtype=float)
        else:
            index = int(movement["index"])
            value = float(movement["value"])
    except (KeyError, TypeError, OverflowError, ValueError):
        raise InvalidInput("a movement needs q, part, and index and value or place") from None
    if part == "drag":
        pose = drag_platform(robot, q, place)
    elif part == "platform":
        pose = move_platform(robot, q, index, value)
    elif part == "motor":
        pose = move_motor(robot, q, index, value)
    else:
        raise InvalidInput(f"part: needs platform, motor or drag, got {part!r}")
    return _pose_document(robot, pose)


def _describe_pose(pose: JoggedPose) -> str:
    """Describe in one or two sentences how near a pose is to a singularity."""
    is_near = pose.level == "near"
    if not is_near and pose.level != "singular":
        return "The motors hold the platform. Lead it to where g is 0: the purple curve, where one is drawn."
    if pose.kind == "type_1":
        state, preposition = ("nearly stretched", "near") if is_near else ("stretched", "on")
        end = f"It is {preposition} its end, a Type 1 singularity, and follows no further."
        return f"A leg is {state} or folded. {end}"
    if pose.kind == "type_2":
        if is_near:
            return "Near a Type 2 singularity. The arrow is the motion that becomes uncontrolled there."
        return "On a Type 2 singularity. Locked motors do not resist the arrow, the uncontrolled motion."
    name, meaning = CLASSES[pose.kind]
    return f"Near a {name}. There {meaning}." if is_near else f"On a {name}. Here {meaning}."


def _describe_hold(robot: ParallelRobot, pose: JoggedPose) -> Document:
    """Return the motors' torques against a push along t_s, their forces, and lines of action.

    Torques exist off the singularity only, and for a platform that either shifts or turns: a push on one
    that does both has no single unit. `sides` (n_a, 3) are the forces of motors with torques of 1 N m, and
    `lines` (n_a, 2, 3) the lines of these forces: a point and the direction. What does not exist is None.
    """
    document: Document = dict.fromkeys(("torques", "sides", "lines"))
    try:
        hold = hold_at(robot, pose.q, HELD_WRENCH * pose.twist)
    except NotAssembled:  # a Type 1 singularity: the platform does not determine the motors
        return document
    speeds = hold.motor_speed[None]  # (1, n_a, n) for unit twists: its rows are the motors' wrenches
    if pose.g is not None:
        has_one_unit = len(set(robot.platform.translations)) == 1
        if has_one_unit and pose.level != "singular" and hold.torque is not None:
            document["torques"] = np.abs(hold.torque)
        sides = force_edges(robot, speeds, np.ones(robot.n_a))
        document["sides"] = None if sides is None else sides[0]
    lines = action_lines(robot, speeds) if pose.kind == "type_2" else None
    if lines is not None:
        document["lines"] = np.stack([lines.point[0], lines.direction[0]], axis=1)
    return document


def _wobble_document(robot: ParallelRobot, pose: JoggedPose) -> Document | None:
    """Return the platform's motion along t_s with closed loops; None off the locus."""
    on_locus = pose.kind == "type_2" and pose.level == "singular"
    loose = loose_motion(robot, pose) if on_locus else None
    if loose is None:
        return None
    poses = joint_poses(robot, loose.q)
    places = platform_positions(robot, poses)
    slides = robot.sliding[robot.actuated]
    platform = " with ".join(_list_motions(loose.shift, loose.turn))
    largest = loose.motors[slides].max(initial=0.0), loose.motors[~slides].max(initial=0.0)
    motors = " or ".join(_list_motions(*largest))
    words = f"It wobbles: {platform} of the platform to either side take no more than {motors} of a motor."
    return encode_each(poses=poses, places=places) | {"count": len(places), "words": words}


def _list_motions(shift: float, turn: float) -> list[str]:
    """Return a shift [m] and a turn [rad] in words; leave out zeros."""
    motions = {f"{1e3 * shift:.3g} mm": shift, f"{turn:.2g} rad": turn}
    return [words for words, motion in motions.items() if motion]


def _pose_document(robot: ParallelRobot, pose: JoggedPose) -> Document:
    """Return a pose for the page: bodies, platform, motors, measures and sentences."""
    poses = joint_poses(robot, pose.q[None])
    twist = platform_frame_twists(robot, pose.q[None], pose.twist[None])[0]
    document: Document = plain(
        _describe_hold(robot, pose)
        | {
            "q": pose.q,
            "poses": encode_floats(poses),
            "origin": platform_positions(robot, poses)[0],
            "platform": pose.x,
            "motor": pose.motors,
            **select_fields(pose, "g", "smallest", "level", "kind", "verdict", "stopped"),
            "words": _describe_pose(pose),
            "t_s": [twist[:3], twist[3:]],  # linear and angular part
            "wobble": _wobble_document(robot, pose),
        }
    )
    return document


def _sliders(robot: ParallelRobot, start: JoggedPose) -> dict[str, list[Document]]:
    """Return names, units and ranges of the sliders."""

    def sliders(names: Sequence[str], units: list[str], values: Array, turn: float) -> list[Document]:
        """Return sliders that reach 0.8 robot lengths [m] or `turn` [rad] to both sides of values (n,)."""
        reach = np.where(np.array(units) == "m", 0.8 * robot.length, turn)
        rows = zip(names, units, values - reach, values + reach, strict=True)
        return [{"name": name, "unit": unit, "low": low, "high": high} for name, unit, low, high in rows]

    turns_freely = np.sum(~robot.translations) > 1  # a rotation vector is regular below half a turn only
    return {
        "platform": sliders(robot.axis_names, robot.axis_units, start.x, 1.5 if turns_freely else np.pi),
        "motor": sliders(robot.actuator_names, robot.motor_joint_units, start.motors, np.pi),
    }


# ------------------------------------------------------------------ the server


MAX_REQUEST_BYTES = 65536

Answer = Callable[[Document], Document]


class PageServer(ThreadingHTTPServer):
    """A server of one page, which replies at /api/move by one function."""

    daemon_threads = True

    def __init__(self, page: str, answer: Answer | None = None, *, port: int = 0) -> None:
        """Listen on a port, a free one for 0; `answer` replies to the messages of the page.

        Raises:
            InvalidInput: the port is taken, or not for this user.
        """
        try:
            super().__init__(("127.0.0.1", port), _Handler)
        except OSError as error:
            raise InvalidInput(f"port {port}: {error.strerror or error}").advising({"port": None}) from None
        self.page = page.encode("utf-8")
        self.answer = answer
        self.one_at_a_time = threading.Lock()

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.server_port}/"

    def serve_until_interrupted(self) -> None:
        """Serve until Ctrl-C or SIGTERM, then close."""
        with self, interruptible(), suppress(KeyboardInterrupt):
            self.serve_forever(poll_interval=0.1)


class _Handler(BaseHTTPRequestHandler):
    """Replies to the requests of one page."""

    server: PageServer
    timeout = 10.0  # [s] for a request to arrive

    def do_GET(self) -> None:
        """Send the page at /."""
        if not self._is_allowed():
            self._send(403, "text/plain", b"only for this machine\n")
        elif self.path.split("?")[0] == "/":
            self._send(200, "text/html; charset=utf-8", self.server.page)
        else:
            self._send(404, "text/plain", b"no such page\n")

    def do_POST(self) -> None:
        """Reply to a message of the page at /api/move."""
        if not self._is_allowed():
            self._send_json(403, {"error": "only for this machine"})
        elif self.path != "/api/move" or self.server.answer is None:
            self._send_json(404, {"error": "no such service"})
        else:
            self._answer(self.server.answer)

    def _answer(self, answer: Answer) -> None:
        """Read one JSON object; send the reply, or the error with status 400."""
        try:
            size = int(self.headers.get("Content-Length", ""))
            if not 0 <= size <= MAX_REQUEST_BYTES:
                raise InvalidInput(f"a request has at most {MAX_REQUEST_BYTES} bytes")
            message = json.loads(self.rfile.read(size))
            if not isinstance(message, dict):
                raise InvalidInput("a request is one JSON object")
            with self.server.one_at_a_time:
                reply = answer(message)
        except (ValueError, RecursionError, NoAnswer) as error:  # InvalidInput is a ValueError
            self._send_json(400, {"error": str(error)})
        else:
            self._send_json(200, reply)

    def _is_allowed(self) -> bool:
        """Return whether a request comes from this machine, and from no other site."""
        hosts = [f"{name}:{self.server.server_port}" for name in ("127.0.0.1", "localhost")]
        origins = [None, *(f"http://{host}" for host in hosts)]  # None: typed into the browser
        return self.headers.get("Host") in hosts and self.headers.get("Origin") in origins

    def _send_json(self, status: int, document: Document) -> None:
        """Send a JSON document."""
        self._send(status, "application/json", json.dumps(document, allow_nan=False).encode())

    def _send(self, status: int, kind: str, content: bytes) -> None:
        """Send one reply, which no cache may store."""
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        try:
            self.wfile.write(content)
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True  # the reader closed the page meanwhile

    def log_message(self, format: str, *args: object) -> None:
        """Write no log: the terminal is the command's."""
