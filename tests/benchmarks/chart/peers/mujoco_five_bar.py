"""The 5R in MuJoCo: the open tree as joints and sites, the loop as a soft equality or not at all.

E. Todorov, T. Erez, Y. Tassa, "MuJoCo: a physics engine for model-based control", IEEE/RSJ IROS 2012,
DOI 10.1109/IROS.2012.6386109; the page "Computation" of its documentation. What MuJoCo asks for:

- every moving body has mass: where the 5R has none, `least_mass` stands in, 1e-12 kg for inverse dynamics,
  which never divides by it; a forward run does, and there it is a choice between error and stiffness;
- the rotor is the armature of the motor's joint, gear ratio squared times the rotor's inertia;
- a spring is the stiffness of a joint of its own, behind the motor or along the rod;
- the payload is one half on each tip. While the tips coincide that is the same robot, and both legs have
  mass to accelerate.
"""

from typing import Any

import mujoco

from tests.benchmarks.chart.peers.five_bar import GEAR_RATIO, SIDES, FiveBar

NEGLIGIBLE = 1e-12  # [kg]
SHAPELESS = 1e-14  # moment of inertia of what has none [kg m^2]: MuJoCo refuses less than 1e-15
HARD = "0.9999 0.9999 0.001 0.5 2"  # solimp: the hardest loop that MuJoCo allows
SHORT = 2.0  # solref: time constant of the loop, in steps; MuJoCo raises shorter ones to it


def model_of(
    robot: FiveBar, *, least_mass: float = NEGLIGIBLE, step: float = 1e-3, integrator: str = "RK4"
) -> Any:
    """The MuJoCo model (MjModel); joints are named as in the catalogue's robot.

    The loop is as hard as MuJoCo allows for this step [s].
    """
    loop = f'solref="{SHORT * step!r} 1" solimp="{HARD}"'
    legs = "".join(_leg(robot, leg, max(robot.link_mass, least_mass)) for leg in range(2))
    tips = "".join(f'<framepos objtype="site" objname="{side}_tip"/>' for side in SIDES)
    motors = "".join(f'<motor joint="{side}_motor" gear="{GEAR_RATIO!r}"/>' for side in SIDES)
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco>
          <compiler angle="radian"/>
          <option timestep="{step!r}" gravity="0 0 -9.81" integrator="{integrator}"/>
          <worldbody>{legs}</worldbody>
          <equality><connect site1="left_tip" site2="right_tip" {loop}/></equality>
          <actuator>{motors}</actuator>
          <sensor>{tips}</sensor>
        </mujoco>"""
    )


def _leg(robot: FiveBar, leg: int, mass: float) -> str:
    side = SIDES[leg]
    bar = max(robot.link_mass * robot.length**2 / 12, SHAPELESS)
    link = _inertial(robot.length / 2, mass, bar)
    drive, rod = "", ""
    if robot.drive_stiffness is not None:
        drive = f'<joint name="{side}_drive" axis="0 0 1" stiffness="{robot.drive_stiffness!r}"/>'
    if robot.rod_stiffness is not None:
        rod = f'<joint name="{side}_rod" type="slide" axis="1 0 0" stiffness="{robot.rod_stiffness!r}"/>'
    return f"""
      <body pos="{robot.bases[leg]!r} 0 0">
        <joint name="{side}_motor" axis="0 0 1" armature="{robot.rotor_inertia!r}"/>{drive}{link}
        <body pos="{robot.length!r} 0 0"><joint name="{side}_elbow" axis="0 0 1"/>{link}
          <body pos="{robot.length!r} 0 0">{rod}{_inertial(0.0, robot.payload / 2, SHAPELESS)}
            <site name="{side}_tip"/>
          </body>
        </body>
      </body>"""


def _inertial(along: float, mass: float, inertia: float) -> str:
    moments = f"{SHAPELESS!r} {max(inertia, SHAPELESS)!r} {max(inertia, SHAPELESS)!r}"
    return f'<inertial pos="{along!r} 0 0" mass="{mass!r}" diaginertia="{moments}"/>'
