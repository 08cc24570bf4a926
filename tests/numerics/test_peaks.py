"""Peaks of functions of time, against closed forms."""

import numpy as np

from framework.numerics.peaks import peak_sizes


def test_peaks_are_those_of_the_closed_form_however_they_lie_to_the_samples():
    """A wave of one component has its largest size 1 between samples; the other grows to an end."""
    generator = np.random.default_rng(0)
    for _ in range(50):
        frequency, phase, duration = generator.uniform(3.0, 30.0), generator.uniform(0.0, 6.0), 1.7
        edges = np.array([0.0, *np.sort(generator.uniform(0.1, 1.6, 2)), duration])
        # 41 coefficients resolve 30 rad/s on a panel of 1.7 s
        peaks = peak_sizes(
            lambda t, f=frequency, p=phase: np.stack([np.sin(f * t + p), -np.exp(t)], axis=1), edges, 41
        )
        assert np.abs(peaks - [1.0, np.exp(duration)]).max() < 1e-12
