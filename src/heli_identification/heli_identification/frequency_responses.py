# SPDX-License-Identifier: Apache-2.0
"""Measured frequency responses of p, q, r to each excited channel, free of the model's structure.

Each line belongs to one channel, but the feedback moves the other inputs at it too. Their part is
taken off with their own responses, interpolated between their own lines, in a few sweeps; the
interpolation only matters for what the feedback adds. Sources: Pintelon and Schoukens, System
Identification, 2nd ed., ch. 2 (multisines of interleaved lines); Tischler and Remple, Aircraft and
Rotorcraft System Identification, 2nd ed., ch. 9 (conditioning of several inputs).
"""

from dataclasses import dataclass

import numpy as np

from heli_identification.experiment import ACTUATORS, WIND, Array, Experiment
from heli_identification.response import FastModel, transfer
from heli_identification.spectra import (
    GUST,
    KINK_LINE,
    ComplexArray,
    IntArray,
    Spectra,
    U,
    Y,
    spectra_of,
)

CHANNELS = (*ACTUATORS, *WIND)
_SWEEPS = 12
_INPUTS = slice(U.start, GUST.stop)


@dataclass(frozen=True)
class FrequencyResponses:
    """Responses of p, q, r (rad/s) per unit of the channel that drives each line.

    Attributes
    ----------
    frequency_hz : (L,) array
    channel : (L,) array of int
        Index into `CHANNELS`: lat, lon, ped, col (as sent), u, v, w (m/s).
    H : (L, 3) complex array
        From the tick at which the command is sent to the rates read at ticks; delay included.
    sigma : (L, 3) array
        Standard deviation of each, as a complex number.
    coherence : (L, 3) array
        Share of the line in the power over one period, of what the other inputs leave.
    noise_covariance : (L, 3, 3) complex array
        Of p, q, r at each line, from the bins beside it.
    """

    frequency_hz: Array
    channel: IntArray
    H: ComplexArray
    sigma: Array
    coherence: Array
    noise_covariance: ComplexArray

    def of(self, channel: str) -> tuple[Array, ComplexArray, Array, Array]:
        """Frequency (n,) in Hz, H, sigma, coherence (n, 3) of a channel by its name."""
        own = self.channel == CHANNELS.index(channel)
        return self.frequency_hz[own], self.H[own], self.sigma[own], self.coherence[own]


def rate_response(model: FastModel, frequency_hz: Array) -> ComplexArray:
    """The fitted model's H (L, 3, 7) of all `CHANNELS`, to draw beside the measured."""
    omega = 2.0 * np.pi * np.asarray(frequency_hz, dtype=np.float64)
    return transfer(model, omega)[:, :, _INPUTS.start - 3 : _INPUTS.stop - 3]


def frequency_responses(
    experiment: Experiment, model: FastModel | None = None
) -> FrequencyResponses:
    """Frequency responses with coherence and noise.

    Parameters
    ----------
    experiment : Experiment
    model : FastModel, optional
        Takes off what channels do that are not excited and what the velocity over ground does, as
        the actuators in a flight with gusts. Without, these are taken for silent.

    Raises
    ------
    IdentificationError
        As `spectra_of`.
    """
    spectra = spectra_of(experiment)
    excited = sorted(set(spectra.channel.tolist()) - {KINK_LINE})
    left = _without_known(spectra.z, spectra.omega_radps, excited, model)
    noise = _without_known(spectra.noise_z, spectra.noise_omega_radps, excited, model)
    inputs = spectra.z[:, _INPUTS]
    lines = {c: np.flatnonzero(spectra.channel == c) for c in excited}
    H = {c: left[k] / inputs[k, c, None] for c, k in lines.items()}
    for _ in range(_SWEEPS):
        for c, k in lines.items():
            rest = left[k].copy()
            for other in excited:
                if other != c:
                    rest -= _between(H[other], spectra, lines[other], k) * inputs[k, other, None]
            H[c] = rest / inputs[k, c, None]
    count = spectra.omega_radps.size
    result = np.zeros((count, 3), dtype=np.complex128)
    sigma, coherence = np.zeros((count, 3)), np.zeros((count, 3))
    for c, k in lines.items():
        result[k] = H[c]
        own = noise[spectra.neighbours[k]]
        for other in excited:
            driven = spectra.noise_z[:, _INPUTS][spectra.neighbours[k], other]
            own = own - _between(H[other], spectra, lines[other], k)[:, None] * driven[:, :, None]
        scatter = np.mean(np.abs(own) ** 2, axis=1)
        power = np.abs(H[c] * inputs[k, c, None]) ** 2
        sigma[k] = np.sqrt(scatter) / np.abs(inputs[k, c, None])
        coherence[k] = power / (power + spectra.periods * scatter)
    keep = spectra.channel != KINK_LINE
    return FrequencyResponses(
        frequency_hz=spectra.omega_radps[keep] / (2.0 * np.pi),
        channel=spectra.channel[keep],
        H=result[keep],
        sigma=sigma[keep],
        coherence=coherence[keep],
        noise_covariance=spectra.noise_covariance()[keep][:, Y, Y],
    )


def _without_known(
    z: ComplexArray, omega: Array, excited: list[int], model: FastModel | None
) -> ComplexArray:
    """p, q, r at the bins, without what the model says of the inputs that are not excited."""
    if model is None:
        return z[:, Y].copy()
    G = transfer(model, omega)
    silent = [i for i in range(G.shape[2]) if i not in excited]
    return np.asarray(z[:, Y] - (G[:, :, silent] @ z[:, 3:][:, silent, None])[:, :, 0])


def _between(H: ComplexArray, spectra: Spectra, own: IntArray, at: IntArray) -> ComplexArray:
    """H (n, 3), known at the lines `own`, at the lines `at`: linear, held beyond the ends."""
    x, x_at = spectra.omega_radps[own], spectra.omega_radps[at]
    parts = [
        np.interp(x_at, x, H[:, i].real) + 1j * np.interp(x_at, x, H[:, i].imag) for i in range(3)
    ]
    return np.column_stack(parts)
