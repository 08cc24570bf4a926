from framework.files.mjcf import mjcf_text
from framework.files.trajectory_file import joint_trajectory

__all__ = [
    "joint_trajectory",
    "mjcf_text",
]
