"""Write files for other programs: a robot for a simulator, a plan for a controller.

Open `mjcf` first, which writes a MuJoCo model. `trajectory_file` writes the message for ros2_control.
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
