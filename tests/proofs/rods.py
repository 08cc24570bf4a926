"""What a rod asks of a displacement, in the functions of `framework.proofs.study_quadric`."""

import numpy as np


def rod(base: np.ndarray, platform: np.ndarray, length: float) -> np.ndarray:
    """Return coefficients (17,) of a rod between points a of the base and b of the platform.

    |R b + p - a|^2 = l^2:    |p|^2 + 2 b . R'p - 2 a . p - 2 a . R b + |a|^2 + |b|^2 - l^2 = 0
    """
    constant = base @ base + platform @ platform - length**2
    return np.concatenate([[constant, 1.0], -2 * base, 2 * platform, -2 * np.outer(base, platform).ravel()])
