"""The twin: which parameters of a robot its data determine, and their values.

Open `base_parameters` first: which combinations of masses, inertias and motor parameters torques depend on.
"""

from framework.identification.base_parameters import BaseParameters, base_parameters

__all__ = ["BaseParameters", "base_parameters"]
