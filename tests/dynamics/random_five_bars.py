"""Random planar five-bars with elastic drives and rods, each with a straight path across its singular locus.

The lengths, a point of the locus (both rods on one line), the path through it, masses, duration and gravity
are drawn; closed forms of the inverse kinematics give the reference.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from framework import Line, NoAnswer, ParallelRobot, plan_crossing

DRIVE, ROD = 25000.0, 350000.0  # [N m/rad], [N/m], before they are scaled
SIDES = ("left", "right")


@dataclass(frozen=True)
class FiveBar:
    """All that makes the robot and its motion; springs `scale` times as stiff as those of the paper."""

    base: float  # half the distance of the motors [m]
    cranks: np.ndarray  # (2,) [m]
    rods: np.ndarray  # (2,) [m]
    masses: np.ndarray  # (2,) of a crank and of a rod [kg]
    payload: float  # [kg]
    inertia: float  # of the payload [kg m^2]
    gravity: tuple[float, float, float]
    start: np.ndarray  # (2,) [m]
    end: np.ndarray  # (2,) [m]
    duration: float  # [s]
    scale: float = 1.0

    @property
    def path(self) -> Line:
        return Line(self.start, self.end)

    def robot(self, folder: Path) -> ParallelRobot:
        """The robot with all its springs, by files in a folder."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "random_five_bar.urdf").write_text(_urdf(self))
        angles = _angles(self, self.start)
        assert angles is not None
        drives = [("drive", "joint", f"{side}_motor", {}) for side in SIDES]
        rods = [("flex", "link", f"{side}_end", {"motion": "x"}) for side in SIDES]
        springs = [
            {
                "name": f"{after.split('_')[0]}_{name}",
                "part": part,
                "after": after,
                "stiffness": self.scale * (DRIVE if part == "joint" else ROD),
                **motion,
            }
            for name, part, after, motion in drives + rods
        ]
        file = {
            "version": 1,
            "urdf": "random_five_bar.urdf",
            "gravity": list(self.gravity),
            "platform": {"frame": "left_tip", "axes": ["x", "y"]},
            "actuators": [
                {"joint": f"{side}_motor", "gear_ratio": 50, "rotor_inertia": 6.4e-6} for side in SIDES
            ],
            "closures": [{"name": "tip", "frames": ["left_tip", "right_tip"], "kind": "spherical"}],
            "springs": springs,
            "reference": {
                f"{side}_{joint}": float(angle)
                for side, pair in zip(SIDES, angles, strict=True)
                for joint, angle in zip(("motor", "elbow"), pair, strict=True)
            },
        }
        (folder / "random_five_bar.yaml").write_text(yaml.safe_dump(file))
        return ParallelRobot.from_file(folder / "random_five_bar.yaml", flexibility="flexible_links")


def five_bar(seed: int, softness: tuple[float, float], folder: Path, *, inertia: bool) -> FiveBar | None:
    """The five-bar of a seed, so stiff that small displacements are a share of it within `softness`.

    The share is in radians and robot lengths, drawn evenly in its logarithm. None if even the plan with small
    displacements does not exist.
    """
    rng = np.random.default_rng(seed)
    drawn = _drawn(rng, inertia)
    share = rng.uniform(0, 1)
    robot = drawn.robot(folder / "stiff")
    try:
        plan = plan_crossing(robot, drawn.path, duration=drawn.duration, geometry="rigid", law="polynomial")
    except NoAnswer:
        return None
    if not plan.crossings:
        return None
    size = np.array([1.0, 1.0, robot.length, robot.length])
    deflected = plan.dynamics.deflection(np.linspace(0.0, drawn.duration, 200)) / size
    soft = softness[0] ** (1 - share) * softness[1] ** share
    return replace(drawn, scale=float(np.abs(deflected).max() / soft))


def _drawn(rng: np.random.Generator, inertia: bool) -> FiveBar:
    while True:
        base, cranks, rods = rng.uniform(0.15, 0.3), rng.uniform(0.2, 0.4, 2), rng.uniform(0.2, 0.4, 2)
        payload, masses = rng.uniform(1, 10), rng.uniform(0.3, 1.5, 2)
        turning = payload * rng.uniform(0.05, 0.2) ** 2 if inertia else 0.0
        gravity = (0.0, -9.81, 0.0) if rng.uniform() < 0.3 else (0.0, 0.0, -9.81)
        middle, direction = np.zeros(2), rng.normal(size=2)
        direction *= rng.uniform(0.05, 0.12) / np.hypot(*direction)
        share, duration = 2 * rng.uniform(0.4, 0.6), rng.uniform(0.6, 1.6)
        drawn = FiveBar(base, cranks, rods, masses, payload, turning, gravity, middle, middle, duration)
        singular = _singular_point(rng, drawn)
        if singular is None:
            continue
        start, end = singular - share * direction, singular + (2 - share) * direction
        way = np.linspace(start, end, 21)
        if all(_angles(drawn, at) is not None for at in way):
            return replace(drawn, start=start, end=end)


def _singular_point(rng: np.random.Generator, robot: FiveBar) -> np.ndarray | None:
    """A tip with both rods on one line between elbows bent as `_angles` bends them."""
    reach = robot.rods.sum()
    for _ in range(200):
        angle = rng.uniform(0, 2 * np.pi)
        left = np.array([-robot.base, 0.0]) + robot.cranks[0] * np.array([np.cos(angle), np.sin(angle)])
        across = left - np.array([robot.base, 0.0])
        far = np.hypot(*across)
        cosine = (far**2 + robot.cranks[1] ** 2 - reach**2) / (2 * far * robot.cranks[1])
        if abs(cosine) > 0.95:
            continue
        angle = np.arctan2(across[1], across[0]) + rng.choice([-1, 1]) * np.arccos(cosine)
        right = np.array([robot.base, 0.0]) + robot.cranks[1] * np.array([np.cos(angle), np.sin(angle)])
        tip = left + (right - left) * robot.rods[0] / reach
        angles = _angles(robot, tip)
        if angles is not None and np.allclose(_elbows(robot, angles), [left, right], rtol=0, atol=1e-6):
            return tip
    return None


def _elbows(robot: FiveBar, angles: list[tuple[float, float]]) -> np.ndarray:
    feet = np.array([[-robot.base, 0.0], [robot.base, 0.0]])
    motors = np.array([motor for motor, _ in angles])
    return feet + robot.cranks[:, None] * np.stack([np.cos(motors), np.sin(motors)], axis=1)


def _angles(robot: FiveBar, tip: np.ndarray) -> list[tuple[float, float]] | None:
    """Motor and elbow of each side [rad], elbows bent outwards; None out of reach or close to stretched."""
    found = []
    for side, bend in enumerate((1.0, -1.0)):
        foot = np.array([-robot.base if side == 0 else robot.base, 0.0])
        crank, rod = robot.cranks[side], robot.rods[side]
        far = np.hypot(*(tip - foot))
        cosine = (crank**2 + far**2 - rod**2) / (2 * crank * far)
        if abs(cosine) > 0.98:
            return None
        motor = np.arctan2(*(tip - foot)[::-1]) + bend * np.arccos(cosine)
        along = tip - foot - crank * np.array([np.cos(motor), np.sin(motor)])
        elbow = (np.arctan2(along[1], along[0]) - motor + np.pi) % (2 * np.pi) - np.pi
        found.append((float(motor), float(elbow)))
    return found


def _urdf(robot: FiveBar) -> str:
    parts = ['<robot name="random_five_bar"><link name="base"/>']
    for k, side in enumerate(SIDES):
        x, crank, rod = (-robot.base, robot.base)[k], robot.cranks[k], robot.rods[k]
        parts += [
            _joint(f"{side}_motor", "continuous", "base", f"{side}_crank", x),
            _bar(f"{side}_crank", crank, robot.masses[0]),
            _joint(f"{side}_elbow", "continuous", f"{side}_crank", f"{side}_rod", crank),
            _bar(f"{side}_rod", rod, robot.masses[1]),
            _joint(f"{side}_end", "fixed", f"{side}_rod", f"{side}_tip", rod),
        ]
    parts += [_body("left_tip", 0.0, robot.payload, [robot.inertia] * 3), '<link name="right_tip"/></robot>']
    return "".join(parts)


def _joint(name: str, kind: str, parent: str, child: str, x: float) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/></joint>'
    )


def _bar(name: str, length: float, mass: float) -> str:
    about = mass * length**2 / 12
    return _body(name, length / 2, mass, [about / 50, about, about])


def _body(name: str, x: float, mass: float, inertia: list[float]) -> str:
    xx, yy, zz = inertia
    return (
        f'<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/><inertia ixx="{xx}" '
        f'ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/></inertial></link>'
    )
