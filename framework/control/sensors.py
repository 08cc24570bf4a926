"""The control loop of all runs: tolerances, torque limits, known delay, and sensors by name.

Sensors are named by kind:

    motors    encoders of the motors
    links     encoders behind the springs of the drives: motor's joint plus deflections of its drive; a
              drive without a spring of its own has this encoder on its motor's joint
    elbows    encoders on all passive hinges and slides; elbows:JOINT is that of one of them
    platform  the pose of the platform
    imu       accelerations of the platform, means of the last period
    joints    all joints and the platform with their rates: the whole state
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, check_choice, choose_from
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import single_columns
from framework.numerics.arrays import Array, IntArray
from framework.numerics.fields import CheckedNumbers, NotNegative, Positive

SENSORS = ("motors", "joints", "links", "elbows", "platform", "imu")
STATE = "joints"  # the sensor of the whole state
LEAST_NOISE = 1e-6  # [rad, robot lengths] that encoders have at least, in filters
PLATFORM_NOISE = 2e-5  # [robot lengths, rad] of a measured pose, at least
MAX_DELAYED = 200  # sampling periods of a known delay: each adds the torques of all motors to the state
IMU_NOISE = 0.05  # [m/s^2, rad/s^2] of measured accelerations


@dataclass(frozen=True)
class ControlLoop(CheckedNumbers):
    """Tolerances, torque limits and sensors of all runs.

    A run passes if the platform always stays within `tolerance` of the plan and ends within `end` of the end
    of the path.
    """

    tolerance: Positive = 2.5e-3  # [robot lengths, rad]
    end: Positive = 2.5e-3  # [robot lengths, rad]
    # (n_a,) largest motor torques [N m, N]; None: those of the plan, or 10 times its peaks
    limit: tuple[float, ...] | None = None
    sensors: str = "motors"  # names of sensors between blanks, see the header
    delay: NotNegative = 0.0  # [s] from measurement to torque, known, rounded to sampling periods
    # counts a turn of encoders, and a robot length of those of slides; 0: without steps
    counts: NotNegative = 0.0  # of the motors, motor side
    link_counts: NotNegative = 0.0  # of links and elbows

    def __post_init__(self) -> None:
        """Check tolerances, delay and counts, and that there are sensors."""
        super().__post_init__()
        for name in str(self.sensors).split() or [""]:
            check_choice("sensors", name.partition(":")[0] if name.startswith("elbows:") else name, SENSORS)

    def delayed_periods(self, period: float) -> int:
        """Return the known delay in sampling periods.

        Raises:
            InvalidInput: more than MAX_DELAYED.
        """
        count = round(self.delay / period)
        if count > MAX_DELAYED:
            raise InvalidInput(
                f"delay: {self.delay:g} s are {count} periods of {period:g} s, at most {MAX_DELAYED} are "
                f"known; take a longer period"
            )
        return count


class LoopSensors(NamedTuple):
    """Encoders that read S q, of joints or sums of a joint and its deflections, and other sensors."""

    S: Array  # (s, nv)
    columns: IntArray  # (s,) joints whose noise is that of the encoders
    step: Array  # (s,) between two readings [rad, m], joint side; 0 without steps
    platform: bool
    imu: bool
    state: bool  # the whole state is measured

    @property
    def see_platform(self) -> bool:
        """Whether readings depend on the motion of the platform."""
        return self.platform or self.imu or self.state


def sensors_of(robot: ParallelRobot, loop: ControlLoop) -> LoopSensors:
    """Return the sensors that the loop names.

    Raises:
        InvalidInput: a joint that is no passive hinge or slide; elbows of a robot without these.
    """
    single = single_columns(robot.model)
    excluded = {*robot.actuated.tolist(), *robot.elastic.tolist(), *robot.structure.idle.tolist()}
    passive = [column for column in range(robot.nv) if column in single and column not in excluded]
    by_name = {robot.coordinates.name_of(column): column for column in passive}
    unit = np.eye(robot.nv)
    link_step = _turns(robot) / loop.link_counts if loop.link_counts else np.zeros(robot.nv)
    # rows of S, columns and steps of each kind
    encoders: list[tuple[Array, IntArray, Array]] = [(unit[:0], np.arange(0), np.zeros(0))]
    names = loop.sensors.split()
    for name in names:
        kind, _, joint = name.partition(":")
        if kind == "motors":
            encoders.append((unit[robot.actuated], robot.actuated, motor_step(robot, loop)))
        elif kind == "links":
            S, columns = _link_rows(robot)
            encoders.append((S, columns, link_step[columns]))
        elif kind in ("elbows", STATE):
            columns = np.arange(robot.nv) if kind == STATE else np.array(passive, dtype=np.intp)
            if joint:
                if joint not in by_name:
                    raise InvalidInput(f"sensors: {choose_from('passive joint', joint, by_name)}")
                columns = np.array([by_name[joint]])
            if not len(columns):
                raise InvalidInput(f"sensors: {robot.name} has no passive hinges or slides for elbows")
            encoders.append((unit[columns], columns, link_step[columns]))
    S, columns, step = (np.concatenate(part) for part in zip(*encoders, strict=True))
    state = STATE in names
    return LoopSensors(S, columns, step, state or "platform" in names, "imu" in names, state)


def _link_rows(robot: ParallelRobot) -> tuple[Array, IntArray]:
    """Return rows (n_a, nv) that add deflections of drives to the motors' joints, and their last joints."""
    rows = np.eye(robot.nv)[robot.actuated]
    last = robot.actuated.copy()
    for spring in robot.description.springs:
        columns = [
            robot.elastic_names.index(name) for name in spring.coordinates if name in robot.elastic_names
        ]
        is_own = spring.part == "joint" and spring.after in robot.actuator_names and len(columns) == 1
        if is_own:  # moves as the motor's own joint does
            motor = robot.actuator_names.index(spring.after)
            last[motor] = robot.elastic[columns[0]]
            rows[motor, last[motor]] = 1.0
    return rows, last


def motor_step(robot: ParallelRobot, loop: ControlLoop) -> Array:
    """Return the steps (n_a,) of the motors' encoders [rad, m], joint side; 0 without steps."""
    counts = loop.counts * robot.gear_ratio
    return _turns(robot)[robot.actuated] / counts if loop.counts else np.zeros(robot.n_a)


def _turns(robot: ParallelRobot) -> Array:
    """Return the turn of each joint (nv,): 2 pi, or a robot length of slides."""
    return np.where(robot.sliding, robot.column_scale, 2 * np.pi)
