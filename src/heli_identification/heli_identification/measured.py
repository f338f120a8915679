# SPDX-License-Identifier: Apache-2.0
"""Measured frequency response of a rate to one input, at the input's own lines.

What all other inputs do there, by a fitted model, is taken off the measured rate first, as the
loops answer every line with all actuators.
"""

from dataclasses import dataclass

import numpy as np

from heli_identification.experiment import CHANNELS, RATES, Array
from heli_identification.response import FastModel, transfer
from heli_identification.spectra import ComplexArray, Spectra, U


@dataclass(frozen=True)
class MeasuredResponse:
    """Response of a rate (rad/s) to one channel at the channel's lines.

    Attributes
    ----------
    omega_radps : (L,) array
    value : (L,) complex array
        From the tick at which a command is sent to the rate read at ticks; delay included.
    sigma : (L,) array
        Standard deviation of |value|.
    coherence : (L,) array
        Share of the periodic part in the power of one period.
    """

    omega_radps: Array
    value: ComplexArray
    sigma: Array
    coherence: Array


def measured_response(
    spectra: Spectra, model: FastModel, rate: str, channel: str
) -> MeasuredResponse:
    """Response of a rate (`RATES`) to a channel (`CHANNELS`).

    Parameters
    ----------
    spectra : Spectra
    model : FastModel
        Tells what the other inputs do.
    rate, channel : str
    """
    row, index = RATES.index(rate), CHANNELS.index(channel)
    own = spectra.channel == index
    signal = U.start + index  # the gusts follow the actuators
    z = spectra.z[own]
    others = transfer(model, spectra.omega_radps[own])[:, row]
    others[:, signal - U.start] = 0.0
    left = z[:, row] - np.einsum("ls,ls->l", others, z[:, U.start :])
    drive = z[:, signal]
    noise = spectra.noise_covariance()[own][:, row, row].real
    power = np.abs(left) ** 2
    return MeasuredResponse(
        omega_radps=spectra.omega_radps[own],
        value=left / drive,
        sigma=np.sqrt(0.5 * noise) / np.abs(drive),
        coherence=power / (power + noise * spectra.periods),
    )
