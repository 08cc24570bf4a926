"""URDF texts of small linkages, written where they are used."""

from collections.abc import Sequence

from framework import Mechanism

AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def words(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def joint(name, parent, at=(0, 0, 0), axis="z", kind="continuous", limit="", mass=None, centre=(0, 0, 0)):
    """A joint and the link `<name>_link` behind it, which may have a mass [kg] at a centre [m]."""
    body = ""
    if mass is not None:
        body = (
            f'<inertial><origin xyz="{words(centre)}"/><mass value="{mass}"/>'
            '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
        )
    limits = f'<limit {limit} effort="1" velocity="1"/>' if kind != "continuous" else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}_link"/>'
        f'<origin xyz="{words(at)}"/><axis xyz="{AXES[axis]}"/>{limits}</joint>'
        f'<link name="{name}_link">{body}</link>'
    )


def ball(name, parent, at=(0, 0, 0), mass=None, centre=(0, 0, 0)):
    """Three turns, name_x, name_y and name_z, and the link `<name>_z_link` behind them."""
    return (
        joint(f"{name}_x", parent, at, "x")
        + joint(f"{name}_y", f"{name}_x_link", axis="y")
        + joint(f"{name}_z", f"{name}_y_link", axis="z", mass=mass, centre=centre)
    )


def frame(name, parent, at, rpy=(0, 0, 0)):
    """An empty link fixed to another."""
    return (
        f'<joint name="{name}_at" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="{words(at)}" rpy="{words(rpy)}"/></joint><link name="{name}"/>'
    )


def linkage(folder, elements: str, robot_file: str) -> Mechanism:
    """The robot of some elements on the link `base`, and of a robot file without its first two lines."""
    urdf = f'<robot name="linkage"><link name="base"/>{elements}</robot>'
    (folder / "linkage.urdf").write_text(urdf)
    file = folder / "linkage.yaml"
    file.write_text(f"version: 1\nurdf: linkage.urdf\n{robot_file}")
    return Mechanism.from_file(file)
