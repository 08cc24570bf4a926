"""MJCF as MuJoCo compiles it: what the readers of old did by themselves, or read wrongly."""

import sys
from pathlib import Path

import numpy as np
import pytest

from framework import Mechanism, MissingPackage, ParallelRobot, RobotFileError, assemble, dynamics_at
from framework.files.mjcf import mjcf_text
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import frames_at
from framework.kinematics.mechanism import velocity_columns
from framework.model.description import JointDynamics, RobotDescription
from framework.model.readers import read_any

SAID = {"platform": "one", "axes": ["x"], "motors": ["j"]}
BODIES = (
    '<body name="one"><joint name="j"/><geom size="0.1" mass="1"/></body>'
    '<body name="two"><joint name="k"/><geom size="0.1" mass="1"/></body>'
    '<body name="three"><joint name="l" type="slide"/><geom size="0.1" mass="1"/></body>'
)
LOOP = '<connect body1="one" anchor="0 0 0"/>'


def read(
    folder: Path, more: str = "", *, bodies: str = BODIES, equality: str = LOOP, **said
) -> RobotDescription:
    file = folder / "model.xml"
    file.write_text(
        f'<mujoco><compiler angle="radian"/>{more}<worldbody>{bodies}</worldbody>'
        f"<equality>{equality}</equality></mujoco>"
    )
    return read_any(file, **{**SAID, **said})


def test_armature_and_damping_of_motors_act_through_their_gears(tmp_path):
    motor = '<motor joint="j" gear="3" armature="0.5" damping="0.7"/>'
    two = (
        f"<actuator>{motor}{motor.replace('gear=', 'name=' + chr(34) + 'b' + chr(34) + ' gear=')}</actuator>"
    )
    joints = read(tmp_path, two).joints
    assert joints == {"j": JointDynamics(armature=2 * 9 * 0.5, damping=2 * 9 * 0.7)}


def test_what_acts_along_a_tendon_of_coupled_joints_acts_on_the_one_that_leads(tmp_path):
    """Length q_j + 2 q_k = 5 q_j + 0.4 with q_k = 2 q_j + 0.2: the square of 5, and the rest's place."""
    tendon = (
        '<tendon><fixed name="t" stiffness="3" damping="0.1" frictionloss="0.2" armature="0.01" '
        'springlength="1.4">'
        '<joint joint="j" coef="1"/><joint joint="k" coef="2"/></fixed></tendon>'
    )
    coupled = LOOP + '<joint joint1="k" joint2="j" polycoef="0.2 2 0 0 0"/>'
    description = read(tmp_path, tendon, equality=coupled)
    (name, acting), *others = description.joints.items()
    assert (name, others) == ("j", [])
    np.testing.assert_allclose(
        [acting.armature, acting.damping, acting.friction, acting.stiffness, acting.rest],
        [25 * 0.01, 25 * 0.1, 5 * 0.2, 25 * 3, (1.4 - 0.4) / 5],
    )


@pytest.mark.parametrize(
    ("flag", "gone"), [("damper", "damping"), ("spring", "stiffness"), ("frictionloss", "friction")]
)
def test_disabled_flags_disable(tmp_path, flag, gone):
    bodies = BODIES.replace(
        '<joint name="j"', '<joint name="j" damping="0.2" stiffness="3" frictionloss="0.1" armature="0.01"'
    )
    acting = read(tmp_path, f'<option><flag {flag}="disable"/></option>', bodies=bodies).joints["j"]
    values = {"damping": 0.2, "stiffness": 3.0, "friction": 0.1, "armature": 0.01, gone: 0.0}
    assert acting == JointDynamics(**values)


def test_a_muscle_is_called_one(tmp_path):
    muscle = '<actuator><muscle name="m" joint="j" lengthrange="0 1"/></actuator>'
    others = '<adhesion name="w" body="one" ctrlrange="0 1"/></actuator>'
    assert read(tmp_path, muscle.replace("</actuator>", others)).left_out == (
        "motor 'm': a muscle, or an actuator of another program",
        "motor 'w': no motor on a hinge or a slide",
    )


def test_disabled_gravity_is_none(tmp_path):
    assert read(tmp_path, '<option><flag gravity="disable"/></option>').gravity == (0, 0, 0)


def test_higher_powers_and_springs_of_balls_are_named(tmp_path):
    bodies = BODIES.replace('<joint name="j"', '<joint name="j" damping="0.2 0.5"')
    assert read(tmp_path, bodies=bodies).left_out == ("joint 'j' damping: higher powers 0.5 0",)


@pytest.mark.parametrize(
    ("equality", "ratio", "offset"),
    [
        ('<joint joint1="j" joint2="l" polycoef="0.1 2 0 0 0"/>', 2.0, 0.1),
        ('<joint joint1="j" joint2="l"/>', 1.0, 0.0),
        ('<tendon tendon1="both"/>', -1.5, 0.0),
        ('<tendon tendon1="both" polycoef="0.3 0 0 0 0"/>', -1.5, 0.3),
        ('<tendon tendon1="first" tendon2="second" polycoef="0.3 4 0 0 0"/>', 6.0, 0.3),
    ],
)
def test_linear_equalities_of_joints_and_tendons_are_couplings(tmp_path, equality, ratio, offset):
    tendons = (
        '<tendon><fixed name="both"><joint joint="j" coef="1"/><joint joint="l" coef="1.5"/></fixed>'
        '<fixed name="first"><joint joint="j" coef="1"/></fixed>'
        '<fixed name="second"><joint joint="l" coef="1.5"/></fixed></tendon>'
    )
    (coupling,) = read(tmp_path, tendons, equality=LOOP + equality).couplings
    assert (coupling.joint, coupling.of) == ("j", "l")
    assert (coupling.ratio, coupling.offset) == pytest.approx((ratio, offset))


def test_an_equality_of_one_joint_holds_it(tmp_path):
    robot = Mechanism.from_description(
        read(tmp_path, equality=LOOP + '<joint joint1="k" polycoef="0.2 0 0 0 0"/>')
    )
    assert robot.coordinates.names == ("j", "l")


@pytest.mark.parametrize(
    ("equality", "message"),
    [
        (
            '<tendon tendon1="all" tendon2="more" polycoef="0 1 2 0 0"/>',
            "couples j, k, m, l: only hinges and slides are coupled, and one of them must be in no product",
        ),
        (
            '<tendon tendon1="all" tendon2="same" polycoef="0.3 1 0 0 0"/>',
            "couples no joint: only hinges and",
        ),
    ],
)
def test_other_equalities_are_refused_by_the_joints_that_they_couple(tmp_path, equality, message):
    parts, more = (
        "".join(f'<joint joint="{name}" coef="{arm}"/>' for name, arm in arms.items())
        for arms in ({"j": 1, "k": 1, "l": 1}, {"j": 2, "k": 3, "l": 1, "m": 1})
    )
    lengths = {"all": parts, "same": parts, "more": more}
    tendons = "".join(f'<fixed name="{name}">{arms}</fixed>' for name, arms in lengths.items())
    bodies = BODIES + '<body name="four"><joint name="m"/><geom size="0.1" mass="1"/></body>'
    with pytest.raises(RobotFileError, match=message):
        read(tmp_path, f"<tendon>{tendons}</tendon>", bodies=bodies, equality=LOOP + equality)


def test_an_equality_that_is_always_true_is_dropped(tmp_path):
    """Two tendons along one joint, of the same length."""
    tendons = "".join(f'<fixed name="{name}"><joint joint="k" coef="2"/></fixed>' for name in "ab")
    equality = LOOP + '<tendon tendon1="a" tendon2="b" polycoef="0 1 0 0 0"/>'
    description = read(tmp_path, f"<tendon>{tendons}</tendon>", equality=equality)
    assert description.couplings == ()
    assert description.left_out == ()
    assert "k" in Mechanism.from_description(description).coordinates.names


MESH = '<asset><mesh name="m" file="nowhere.stl"/><texture name="t" type="2d" file="no.png"/></asset>'


def test_missing_meshes_that_weigh_nothing_and_textures_are_no_matter(tmp_path):
    drawn = BODIES.replace('mass="1"/></body>', 'mass="1"/><geom type="mesh" mesh="m" mass="0"/></body>', 1)
    assert read(tmp_path, MESH, bodies=drawn).left_out == ()


@pytest.mark.parametrize(
    "broken", ['<geom type="mesh" mesh="m"/>', '<inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/>']
)
def test_an_inertia_that_cannot_be_had_stops_what_moves_and_nothing_else(tmp_path, broken):
    at_rest = f'<body name="scenery">{broken}</body>'
    assert read(tmp_path, MESH, bodies=BODIES + at_rest).left_out == ()
    moving = f'<body name="arm"><joint name="m"/>{broken}</body>'
    with pytest.raises(RobotFileError, match="body 'arm': "):
        read(tmp_path, MESH, bodies=BODIES + moving)
    assert read(tmp_path, MESH, bodies=BODIES + moving, locked={"m": None}).left_out == ()


def test_bodies_without_mass_have_none_unless_the_file_bounds_it(tmp_path):
    bodies = BODIES.replace('<geom size="0.1" mass="1"/></body>', "</body>", 1)
    free, bound = (
        Mechanism.from_description(read(tmp_path, more, bodies=bodies)).model.inertias[1]
        for more in ("", '<compiler boundmass="0.25" boundinertia="0.01"/>')
    )
    assert (free.mass, np.abs(free.inertia).max()) == (0, 0)
    assert (bound.mass, bound.inertia[0, 0]) == (0.25, 0.01)


def test_nothing_is_written_where_the_program_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    read(tmp_path, bodies=BODIES.replace('mass="1"', 'mass="0"'))
    assert [path.name for path in tmp_path.iterdir()] == ["model.xml"]


def test_without_mujoco_one_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingPackage, match=r"pip install 'mujoco>=4.0'"):
        read(tmp_path)


RODS = (
    '<body name="one"><joint name="j" axis="0 1 0"/><geom size="0.1" mass="1"/>'
    '<site name="p" pos="0.3 0 0"/></body>'
    '<body name="two" pos="0 0 0.4"><joint name="k" axis="0 1 0"/><geom size="0.1" mass="1"/>'
    '<site name="q" pos="0.3 0 0"/><site name="r"/></body>'
)


def spatial(*sites: str) -> str:
    path = "".join(f"<site site={name!r}/>" for name in sites)
    return f'<tendon><spatial name="rod">{path}</spatial></tendon>'


@pytest.mark.parametrize(("offset", "length"), [(0.0, 0.4), (0.03, 0.43)])
def test_a_tendon_between_two_sites_that_is_held_is_a_rod(tmp_path, offset, length):
    """A parallelogram of cranks 0.3 m, 0.4 m apart: both turn equally if the rod is as long as the base."""
    held = f'<tendon tendon1="rod" polycoef="{offset} 0 0 0 0"/>'
    said = {"platform": "two", "platform_joints": ["k"], "axes": None}
    description = read(tmp_path, spatial("p", "q"), bodies=RODS, equality=held, **said)
    (closure,) = description.closures
    assert (closure.frames, closure.axes) == (("p", "q"), ("distance",))
    assert closure.length == pytest.approx(length, rel=1e-15)


def test_a_tendon_around_a_third_site_is_no_rod(tmp_path):
    with pytest.raises(RobotFileError, match="spatial tendon, which is only read between two sites"):
        read(tmp_path, spatial("p", "r", "q"), bodies=RODS, equality='<tendon tendon1="rod"/>')


CABLES = (
    '<body name="spool" pos="0.1 0.2 0"><joint name="m" axis="0 0 1" armature="0.02"/>'
    '<inertial pos="0 0 0" mass="0.1" diaginertia="1e-5 1e-5 1e-5"/></body>'
    '<body name="slide" pos="0 0.4 0"><joint name="n" type="slide" axis="0 1 0"/>'
    '<inertial pos="0 0 0" mass="0.3" diaginertia="1e-4 1e-4 1e-4"/></body>'
    '<body name="arm"><joint name="lift" axis="0 1 0"/>'
    '<inertial pos="0.1 0 0.1" mass="1" diaginertia="1e-2 2e-2 1e-2"/>'
    '<body name="hand" pos="0.3 0 0"><joint name="roll" axis="1 0 0"/>'
    '<inertial pos="0.02 0.05 0" mass="0.5" diaginertia="1e-3 2e-3 2e-3"/></body></body>'
)


def test_a_joint_that_follows_two_others_is_driven_as_mujoco_drives_it(tmp_path):
    """A spool and a slide follow lift and roll by cables; the witness is MuJoCo's inverse dynamics."""
    mujoco = pytest.importorskip("mujoco")
    cables = (
        '<tendon><fixed name="a"><joint joint="m" coef="2"/><joint joint="lift" coef="-3"/>'
        '<joint joint="roll" coef="1.4"/></fixed><fixed name="b"><joint joint="n" coef="-1"/>'
        '<joint joint="lift" coef="0.05"/><joint joint="roll" coef="0.08"/></fixed></tendon>'
    )
    motors = '<actuator><motor joint="m"/><motor joint="n"/></actuator>'
    held = '<tendon tendon1="a"/><tendon tendon1="b"/>'
    said = {"platform": "hand", "platform_joints": ["lift", "roll"], "axes": None, "motors": ["m", "n"]}
    description = read(tmp_path, cables + motors, bodies=CABLES, equality=held, **said)
    robot = ParallelRobot.from_description(description)
    # q = G y of the joints m, n, lift, roll: 2 m = 3 lift - 1.4 roll, n = 0.05 lift + 0.08 roll
    y, dy, ddy = np.array([0.4, -0.7]), np.array([0.9, 1.3]), np.array([-2.0, 3.0])
    joints = {"m": [1.5, -0.7], "n": [0.05, 0.08], "lift": [1, 0], "roll": [0, 1]}
    pose = assemble(robot, y)
    values = robot.reference_values(pose.q)
    assert [values[name] for name in joints] == pytest.approx(np.array(list(joints.values())) @ y, abs=1e-12)

    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY
    data = mujoco.MjData(model)
    matrix = np.zeros((model.nv, 2))
    for name, row in joints.items():
        matrix[model.joint(name).dofadr[0]] = row
    data.qpos[:], data.qvel[:], data.qacc[:] = matrix @ y, matrix @ dy, matrix @ ddy
    mujoco.mj_inverse(model, data)
    driven = [model.joint(name).dofadr[0] for name in ("m", "n")]
    expected = np.linalg.solve(matrix[driven].T, matrix.T @ data.qfrc_inverse)
    instant = dynamics_at(robot, pose.q, dx=dy, ddx=ddy)
    np.testing.assert_allclose(np.ravel(instant.torque), expected, rtol=1e-9)


BENT = '<joint joint1="n" joint2="lift" polycoef="0.02 -0.05 0.04 0.01 -0.03"/>'
SUMS = (
    '<tendon><fixed name="one"><joint joint="m" coef="2"/><joint joint="n" coef="0.5"/></fixed>'
    '<fixed name="two"><joint joint="lift" coef="3"/><joint joint="roll" coef="-1.4"/></fixed></tendon>'
)


def test_powers_of_a_joint_and_of_a_tendon_are_those_of_mujoco(tmp_path):
    """n = p(lift), 2 m + n / 2 = 0.1 + 0.7 w + 0.2 w^2, w = 3 lift - 1.4 roll: residual and derivatives."""
    mujoco = pytest.importorskip("mujoco")
    held = BENT + '<tendon tendon1="one" tendon2="two" polycoef="0.1 0.7 0.2 0 0"/>'
    said = {"platform": "hand", "platform_joints": ["lift", "roll"], "axes": None, "motors": ["m", "n"]}
    description = read(tmp_path, SUMS, bodies=CABLES, equality=held, **said)
    robot = ParallelRobot.from_description(description)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    data = mujoco.MjData(model)
    joints = ("m", "n", "lift", "roll")
    theirs = [model.joint(name).dofadr[0] for name in joints]
    q = np.random.default_rng(5).uniform(-0.8, 0.8, (1, 4))
    data.qpos[theirs] = q[0]
    mujoco.mj_forward(model, data)
    ours = velocity_columns(robot.model, joints)
    loops = loop_equations(robot.rows, frames_at(robot, q[:, np.argsort(ours)]))
    # MuJoCo's rows are those of the first joint or tendon, ours of the joint that follows: m = .../2
    sizes = {"n_of_lift": 1.0, "m_of_n": 2.0}
    scale = np.array([sizes[name.removesuffix(".q")] for name in robot.rows.names])
    rows = data.efc_J.reshape(data.nefc, model.nv)
    np.testing.assert_allclose(loops.residual[0] * scale, data.efc_pos, atol=1e-14)
    np.testing.assert_allclose(loops.jacobian[0][:, ours] * scale[:, None], rows[:, theirs], atol=1e-13)


def test_couplings_go_to_mujoco_and_come_back(tmp_path):
    cables = (
        '<tendon><fixed name="a"><joint joint="m" coef="1"/><joint joint="lift" coef="-3"/>'
        '<joint joint="roll" coef="1.4"/></fixed></tendon>'
    )
    said = {"platform": "hand", "platform_joints": ["lift", "roll"], "axes": None, "motors": ["m", "n"]}
    held = BENT + '<tendon tendon1="a" polycoef="0.3 0 0 0 0"/>'
    robot = ParallelRobot.from_description(read(tmp_path, cables, bodies=CABLES, equality=held, **said))
    (tmp_path / "again.xml").write_text(mjcf_text(robot))
    again = read_any(tmp_path / "again.xml", **said)
    assert again.couplings == robot.description.couplings
    assert sum(len(coupling.joints) for coupling in again.couplings) == 5


@pytest.mark.parametrize("hinges", [False, True])
def test_a_rod_goes_to_mujoco_and_comes_back(tmp_path, hinges):
    """MuJoCo holds the two sites at the length of the rod while one crank drives the other."""
    mujoco = pytest.importorskip("mujoco")
    said = {"platform": "two", "platform_joints": ["k"], "axes": None, "reference": {"j": 0.4, "k": 0.4}}
    held = '<tendon tendon1="rod" polycoef="0.02 0 0 0 0"/>'
    robot = ParallelRobot.from_description(
        read(tmp_path, spatial("p", "q"), bodies=RODS, equality=held, **said)
    )
    text = mjcf_text(robot, hinges=hinges)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.ten_length[0] == pytest.approx(0.42, abs=1e-9)
    assert np.abs(data.efc_pos).max() < 1e-9
    data.qfrc_applied[0] = 0.05  # [N m] on one crank, which takes the other along
    for _ in range(300):
        mujoco.mj_step(model, data)
    assert np.abs(data.qpos - model.key_qpos[0]).max() > 0.1
    assert data.ten_length[0] == pytest.approx(0.42, abs=1e-3)
    (tmp_path / "again.xml").write_text(text)
    del said["reference"]
    (closure,) = read_any(tmp_path / "again.xml", **(said | {"platform": "k_body", "motors": ["j"]})).closures
    assert closure.length == pytest.approx(0.42, abs=1e-12)


def test_cables_that_pull_are_named_where_there_is_no_loop(tmp_path):
    pull = f'{spatial("p", "q")}<actuator><motor name="winch" tendon="rod"/></actuator>'
    words = r"no loop in it; not read: motor 'winch': acts along a spatial tendon .*, which no option reads"
    with pytest.raises(RobotFileError, match=words):
        read(tmp_path, pull, bodies=RODS, equality="")
