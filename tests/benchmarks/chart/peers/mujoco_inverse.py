"""MuJoCo's inverse dynamics of a planned motion of the 5R, and the force in its loop.

`mj_inverse` with the loop as an equality is no help: MuJoCo's loops are soft, and their force follows from
the gap between the tips, which is zero on a planned motion. So the tree is left open, and the force of the
loop f (2,) [N] is found from statics, with the Jacobians of MuJoCo at the two tips. With r the
`qfrc_inverse` of the tree, springs included,

    r - J' f = 0 on every joint without a motor,        J = J_left_tip - J_right_tip  (2, nv)

and r - J' f on the motors' joints is the torque. With springs these are six equations for two unknowns, of
full rank even at the singularity, and what they leave is a second proof. Rigid robots have two, of rank one
at the singularity.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from framework.numerics.arrays import Array
from tests.benchmarks.chart.peers.five_bar import GEAR_RATIO, SIDES, FiveBar
from tests.benchmarks.chart.peers.mujoco_five_bar import NEGLIGIBLE, model_of


class InverseDynamics(NamedTuple):
    """MuJoCo's forces on a motion, at T instants."""

    torque: Array  # (T, 2) [N m], motor side
    imbalance: Array  # (T,) what the loop's force leaves of the other joints' equations [N m, N]
    gap: Array  # (T,) distance between the two tips [m]


class Tree:
    """The open tree; `joints` are those of the robot under test, in its order."""

    def __init__(self, robot: FiveBar, joints: list[str], least_mass: float = NEGLIGIBLE) -> None:
        self.model = model_of(robot, least_mass=least_mass)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)
        self.columns = [self.model.joint(name).id for name in joints]  # of MuJoCo, in the order of `joints`
        self.motors = [joints.index(f"{side}_motor") for side in SIDES]
        self.others = [k for k in range(len(joints)) if k not in self.motors]
        if sorted(self.columns) != list(range(self.model.nv)):
            raise ValueError(f"MuJoCo's 5R has {self.model.nv} joints, not {joints}")

    def equation(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, float]:
        """r (nv,), J (2, nv) and the gap [m] at one instant, in the order of the joints."""
        model, data, columns = self.model, self.data, self.columns
        data.qpos[columns], data.qvel[columns], data.qacc[columns] = q, v, a
        mujoco.mj_inverse(model, data)
        slopes = np.zeros((2, 3, model.nv))
        for slope, side in zip(slopes, SIDES, strict=True):
            mujoco.mj_jacSite(model, data, slope, None, model.site(f"{side}_tip").id)
        gap = data.site("left_tip").xpos - data.site("right_tip").xpos
        jacobian = (slopes[0] - slopes[1])[:2, columns]
        return data.qfrc_inverse[columns].copy(), jacobian, float(np.linalg.norm(gap))

    def inverse(self, q: Array, v: Array, a: Array) -> InverseDynamics:
        """Along a motion: q, v, a (T, nv) in the order of the joints."""
        torque, imbalance, gaps = [], [], []
        for instant in zip(q, v, a, strict=True):
            r, jacobian, gap = self.equation(*instant)
            force = np.linalg.lstsq(jacobian[:, self.others].T, r[self.others], rcond=None)[0]
            left = r - jacobian.T @ force
            torque.append(left[self.motors] / GEAR_RATIO)
            imbalance.append(np.abs(left[self.others]).max())
            gaps.append(gap)
        return InverseDynamics(np.array(torque), np.array(imbalance), np.array(gaps))

    def imbalance(self, q: Array, v: Array, a: Array, torque: Array) -> Array:
        """What torques (T, 2) leave of all joints' equations, whatever the loop's force: (T,) [N m, N].

        It needs no quotient that is 0/0 at the singularity: r - S' tau must be of the form J' f, and J keeps
        its rank there.
        """
        left = []
        for q_t, v_t, a_t, torque_t in zip(q, v, a, torque, strict=True):
            r, jacobian, _ = self.equation(q_t, v_t, a_t)
            r[self.motors] -= GEAR_RATIO * torque_t
            force = np.linalg.lstsq(jacobian.T, r, rcond=None)[0]
            left.append(np.abs(r - jacobian.T @ force).max())
        return np.array(left)
