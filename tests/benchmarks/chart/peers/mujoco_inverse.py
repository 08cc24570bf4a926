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

from framework.numerics import Array
from tests.benchmarks.chart.bare import newton_in_stacks, solve_each
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
        self.sites = [self.model.site(f"{side}_tip").id for side in SIDES]
        self.columns = [self.model.joint(name).id for name in joints]  # of MuJoCo, in the order of `joints`
        if sorted(self.columns) != list(range(self.model.nv)):
            raise ValueError(f"MuJoCo's 5R has {self.model.nv} joints, not {joints}")
        self.order = np.argsort(self.columns)  # of `joints`, in MuJoCo's order
        self.motors = [joints.index(f"{side}_motor") for side in SIDES]
        self.others = [k for k in range(len(joints)) if k not in self.motors]

    def equations(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """r (T, nv) and J (T, 2, nv) along a motion, in the order of the joints."""
        model, data, (one, other) = self.model, self.data, self.sites
        forces, slopes = np.empty_like(q), np.empty((len(q), 2, 3, model.nv))
        states = (array[:, self.order] for array in (q, v, a))
        for pose, rate, acceleration, force, slope in zip(*states, forces, slopes, strict=True):
            data.qpos[:], data.qvel[:], data.qacc[:] = pose, rate, acceleration
            mujoco.mj_inverse(model, data)
            mujoco.mj_jacSite(model, data, slope[0], None, one)
            mujoco.mj_jacSite(model, data, slope[1], None, other)
            force[:] = data.qfrc_inverse
        return forces[:, self.columns], (slopes[:, 0] - slopes[:, 1])[:, :2, self.columns]

    def inverse(self, q: Array, v: Array, a: Array) -> InverseDynamics:
        """Along a motion: q, v, a (T, nv) in the order of the joints."""
        left = []
        for r, jacobian in zip(*self.equations(q, v, a), strict=True):
            force = np.linalg.lstsq(jacobian[:, self.others].T, r[self.others], rcond=None)[0]
            left.append(r - jacobian.T @ force)
        torque, imbalance = np.array(left)[:, self.motors], np.array(left)[:, self.others]
        first, second = self._tips(q)[0].swapaxes(0, 1)
        gap = np.linalg.norm(first - second, axis=1)
        return InverseDynamics(torque / GEAR_RATIO, np.abs(imbalance).max(axis=1), gap)

    def torques(self, q: Array, v: Array, a: Array) -> Array:
        """Motor torques (T, 2) [N m] along a motion, with one stacked solve for the forces of the loop."""
        r, jacobians = self.equations(q, v, a)
        back = jacobians.transpose(0, 2, 1)
        loop = solve_each(back[:, self.others], r[:, self.others])
        return np.asarray((r[:, self.motors] - np.matvec(back[:, self.motors], loop)) / GEAR_RATIO)

    def motion(self, x: Array, dx: Array, ddx: Array, guess: Array) -> tuple[Array, Array, Array]:
        """Joints (T, nv), rates and accelerations under x(t), x', x" (T, 2), by Newton's method from guesses.

        The rows of tips that stay together, and of the platform, are MuJoCo's Jacobians at the tips; poses
        are solved in stacks.
        """

        def evaluate(q: Array) -> tuple[Array, Array]:
            places, slopes = self._tips(q)
            one, other = slopes[:, 0], slopes[:, 1]  # (T, 2, nv)
            residuals = np.hstack([places[:, 0] - places[:, 1], places[:, 0] - x])
            return residuals, np.hstack([one - other, one])

        q, matrices = newton_in_stacks(evaluate, guess)
        still = np.zeros_like(x)
        v = solve_each(matrices, np.hstack([still, dx]))
        first, second = self._drifts(q, v).swapaxes(0, 1)
        return q, v, solve_each(matrices, np.hstack([second - first, ddx - first]))

    def _tips(self, q: Array) -> tuple[Array, Array]:
        """Places (T, 2, 2) of the two tips at poses (T, nv), and their derivatives (T, 2, 2, nv)."""
        model, data, (one, other) = self.model, self.data, self.sites
        places, slopes = np.empty((len(q), 2, 3)), np.empty((len(q), 2, 3, model.nv))
        for pose, place, slope in zip(q[:, self.order], places, slopes, strict=True):
            data.qpos[:] = pose
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, slope[0], None, one)
            mujoco.mj_jacSite(model, data, slope[1], None, other)
            place[:] = data.site_xpos[self.sites]
        return places[..., :2], slopes[:, :, :2, self.columns]

    def _drifts(self, q: Array, v: Array) -> Array:
        """Accelerations (T, 2, 2) of the two tips without accelerations of the joints."""
        model, data = self.model, self.data
        rates = np.empty((len(q), 2, 3, model.nv))
        for pose, velocity, rate in zip(q[:, self.order], v[:, self.order], rates, strict=True):
            data.qpos[:], data.qvel[:] = pose, velocity
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            for site, slope in zip(self.sites, rate, strict=True):
                mujoco.mj_jacDot(model, data, slope, None, data.site_xpos[site], model.site_bodyid[site])
        return np.matvec(rates[:, :, :2], v[:, self.order][:, None])

    def imbalance(self, q: Array, v: Array, a: Array, torque: Array) -> Array:
        """What torques (T, 2) leave of all joints' equations, whatever the loop's force: (T,) [N m, N].

        It needs no quotient that is 0/0 at the singularity: r - S' tau must be of the form J' f, and J keeps
        its rank there.
        """
        left = []
        for r, jacobian, motor in zip(*self.equations(q, v, a), torque, strict=True):
            r[self.motors] -= GEAR_RATIO * motor
            force = np.linalg.lstsq(jacobian.T, r, rcond=None)[0]
            left.append(np.abs(r - jacobian.T @ force).max())
        return np.array(left)
