"""What tests of pages ask for: films, and where things stand on the screen."""

from functools import cache
from typing import Any

import numpy as np

import robots
from framework import NoAnswer, ParallelRobot
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import FrameStack
from framework.planning.scenes import scene_request
from framework.show.film import Film, film_motion

# From the scene graph, not from the data: position and axes of every node as three.js has them.
NODES = """(view) => view.nodes.map((node) => {
  view.robot.updateMatrixWorld(true);
  const toRobot = view.robot.matrixWorld.clone().invert();
  return toRobot.multiply(node.matrixWorld).toArray();
})"""
ON_SCREEN = 2e-6  # lengths of the robot: what singles leave of a closed loop
BETWEEN = 2e-4  # lengths: what is left half-way between two frames, turned and shifted straight


def film_anew(name: str, scene_name: str | None = None, flexibility: str = "rigid", **changed: Any) -> Film:
    """A scene of the robot, or the first that can be filmed, with some of its options changed."""
    robot = robots.load(name, flexibility=flexibility)
    for one in [scene_name] if scene_name else robot.description.scenes:
        try:
            return film_motion(robot, scene_request(robot, one, **changed), name=one)
        except NoAnswer:
            if scene_name:
                raise
    raise AssertionError(f"{name}: no scene can be filmed")


_film_once = cache(film_anew)


def filmed(name: str, scene_name: str | None = None, flexibility: str = "rigid", **changed: Any) -> Film:
    """The same, made once for all tests of a process where no option is changed."""
    film = film_anew if changed else _film_once
    return film(name, scene_name, flexibility, **changed)


def nodes_at(tab, t: float, film: int = 0) -> np.ndarray:
    """Placements (njoints, 4, 4) of the robot's nodes on the screen at time t."""
    tab.evaluate("t => { crossing.clock.pause(); crossing.clock.seek(t); }", t)
    return placements(tab, f"crossing.films[{film}].view")


def placements(tab, view: str) -> np.ndarray:
    columns = tab.evaluate(f"({NODES})({view})")
    return np.array(columns).reshape(-1, 4, 4).transpose(0, 2, 1)


def gap(robot: ParallelRobot, nodes: np.ndarray) -> float:
    """Largest loop equation, in lengths of the robot and radians, of the bodies where the screen has them."""
    frames = [robot.model.frames[frame] for frame in robot.frames]
    poses = np.array([nodes[frame.parentJoint] @ frame.placement.homogeneous for frame in frames])
    still = np.zeros((1, robot.model.nv, 6)), np.zeros((len(frames), robot.model.nv))
    stack = FrameStack(poses[None, :, :3].swapaxes(2, 3), *still, np.empty((1, 0)))
    residual = np.abs(loop_equations(robot.rows, stack).residual[0])
    return float((residual / np.where(robot.rows.rotation, 1.0, robot.length)).max())
