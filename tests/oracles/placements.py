"""Where frames are, by pinocchio alone."""

import numpy as np
import pinocchio as pin


def placements(model: pin.Model, frames: tuple[str, ...], q: np.ndarray | None = None) -> list[pin.SE3]:
    """Placements of links or other frames in the base, at pinocchio's neutral configuration by default."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model) if q is None else q)
    bodies = {frame.name: k for k, frame in enumerate(model.frames)}  # links come after their joints
    return [data.oMf[bodies[name]].copy() for name in frames]
