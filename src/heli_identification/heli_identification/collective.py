# SPDX-License-Identifier: Apache-2.0
"""The collective's gain K_col for the altitude law's thrust map, from the specific force in z."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from heli_identification.actuators import IdentifiedAB
from heli_identification.errors import Cause, IdentificationError
from heli_identification.experiment import CHANNELS, Array, Experiment
from heli_identification.places import AIR
from heli_identification.response import SERVOS, transfer
from heli_identification.spectra import GUST, INPUTS, VEL, U, hann_amplitudes, spectra_of
from heli_math.linear_systems import held, with_servos
from heli_math.rows import ACTUATOR
from heli_math.ticks import TICK_S

_COL, _GUST_W = CHANNELS.index("col"), CHANNELS.index("w")
_LEAST_LINES = 4
_LARGEST_ERROR = 0.2


@dataclass(frozen=True)
class RotorGeometry:
    """Main rotor as ruler, scale and tachometer give it, SI; lift slope of the blade in 1/rad."""

    rho: float
    omega: float
    radius: float
    lift_slope: float
    blades: float
    chord: float

    def thrust_per_pitch(self, thrust_n: float) -> float:
        """dT/dtheta, N/rad, in hover: blade element with momentum theory's inflow.

        T = s (2/3 Omega R theta - v_i), v_i^2 = T / (2 rho pi R^2), s = rho Omega R^2 C_la b c / 4
        (Cai, Chen, Lee, Unmanned Rotorcraft Systems, 2011, ch. 6).
        """
        slope = self.rho * self.omega * self.lift_slope * self.radius**2
        slope *= self.blades * self.chord / 4.0
        disk = 2.0 * self.rho * np.pi * self.radius**2
        inflow = np.sqrt(thrust_n / disk)
        return float(slope * self.omega * self.radius / 1.5 / (1.0 + slope / (2.0 * disk * inflow)))


@dataclass(frozen=True)
class IdentifiedCollective:
    """The collective's effect.

    Attributes
    ----------
    force_per_collective, force_per_collective_sigma : float
        Specific force along body z per unit of d_col, m/s2; negative thrust is up.
    force_per_w, force_per_w_sigma : float
        Specific force along body z per m/s of vertical air velocity relative to the aircraft, 1/s.
    K_col, K_col_sigma : float
        Blade pitch per unit of d_col, rad, that makes the thrust map give that force.
    """

    force_per_collective: float
    force_per_collective_sigma: float
    force_per_w: float
    force_per_w_sigma: float
    K_col: float
    K_col_sigma: float


def fit_collective(
    experiment: Experiment,
    identified: IdentifiedAB,
    mass_kg: float,
    gravity_mps2: float,
    rotor: RotorGeometry,
) -> IdentifiedCollective:
    """Fit the thrust's answer to the collective on its own lines.

    `f_z = c (servo of d_col) + k (gust - velocity)_w`, weighed by the noise beside each line; servo
    and delay as identified. Mass comes from a scale.

    Raises
    ------
    IdentificationError
        NO_EXCITATION or TOO_FEW_LINES of d_col, LOW_COHERENCE if the gain's sigma exceeds 20 %.
    """
    spectra = spectra_of(experiment)
    own = spectra.channel == _COL
    count = int(own.sum())
    if count < _LEAST_LINES:
        cause = Cause.NO_EXCITATION if count == 0 else Cause.TOO_FEW_LINES
        raise IdentificationError(
            cause, f"excitation_u.col has {count} lines, at least {_LEAST_LINES} are needed"
        )
    force = hann_amplitudes(experiment.steady().accel_body_mps2[:, 2:])[:, 0]
    servo = transfer(identified.fast, spectra.omega_radps, states=True)[:, SERVOS][:, ACTUATOR.col]
    command = U.start + ACTUATOR.col
    position = servo[:, command - INPUTS.start] * spectra.z[:, command]
    wind = (spectra.z[:, GUST] - spectra.z[:, VEL])[:, AIR.w]
    scatter = np.mean(np.abs(force[spectra.noise_bins][spectra.neighbours]) ** 2, axis=1)
    weight = 1.0 / np.sqrt(scatter[own])
    M = np.column_stack([position[own], wind[own]]) * weight[:, None]
    b = force[spectra.bins[own]] * weight
    M, b = np.vstack([M.real, M.imag]), np.concatenate([b.real, b.imag])
    values = np.linalg.lstsq(M, b, rcond=None)[0]
    spread = max(1.0, 2.0 * float(np.sum((b - M @ values) ** 2)) / (b.size - 2))
    sigma = np.sqrt(np.diag(np.linalg.inv(M.T @ M)) * 0.5 * spread)
    if not sigma[0] < _LARGEST_ERROR * abs(values[0]):
        raise IdentificationError(
            Cause.LOW_COHERENCE,
            f"accel_body_mps2.z answers excitation_u.col with {values[0]:.3g} +- {sigma[0]:.2g} "
            f"m/s2 per unit, at most {100.0 * _LARGEST_ERROR:.0f} % of uncertainty is allowed",
        )
    per_pitch = rotor.thrust_per_pitch(mass_kg * gravity_mps2) / mass_kg
    return IdentifiedCollective(
        force_per_collective=float(values[0]),
        force_per_collective_sigma=float(sigma[0]),
        force_per_w=float(values[1]),
        force_per_w_sigma=float(sigma[1]),
        K_col=float(-values[0] / per_pitch),
        K_col_sigma=float(sigma[0] / per_pitch),
    )


def relative_air_w(
    experiment: Experiment, identified: IdentifiedAB, collective: IdentifiedCollective
) -> Array:
    """Vertical air velocity relative to the aircraft (N,), m/s down, over the evaluated periods.

    The rotor is an anemometer: what the accelerometer shows beyond the collective's part is thrust
    by vertical air, turbulence included. The thrust per air velocity is found anew on the lines of
    the gust; the mean is taken for zero.

    Raises
    ------
    IdentificationError
        NO_EXCITATION or TOO_FEW_LINES of the gust's w.
    """
    spectra = spectra_of(experiment)
    own = spectra.channel == _GUST_W
    if int(own.sum()) < _LEAST_LINES:
        raise IdentificationError(
            Cause.NO_EXCITATION if not own.any() else Cause.TOO_FEW_LINES,
            f"gust_body_mps.w has {int(own.sum())} lines, at least {_LEAST_LINES} are needed",
        )
    steady = experiment.steady()
    position = _servo(steady.u[:, ACTUATOR.col], identified)
    rest = steady.accel_body_mps2[:, 2] - collective.force_per_collective * position
    force = hann_amplitudes(rest[:, None])[:, 0][spectra.bins[own]]
    wind = (spectra.z[own, GUST] - spectra.z[own, VEL])[:, AIR.w]
    per_w = float(np.real(np.vdot(wind, force)) / np.real(np.vdot(wind, wind)))
    return (rest - rest.mean()) / per_w


def _servo(command: Array, identified: IdentifiedAB) -> Array:
    """Servo positions (N,) of commands held over a tick after the delay; starts at rest."""
    servo = (identified.servo_radps, identified.servo_damping)
    Phi, column = held(*with_servos(np.zeros((0, 0)), np.zeros((0, 1)), *servo), TICK_S)
    # x(n + 1) = Phi x(n) + Gamma u(n), position = x_0, as a difference equation of second order
    Gamma = column[:, 0]
    denominator = np.array([1.0, -np.trace(Phi), np.linalg.det(Phi)])
    numerator = np.array([0.0, Gamma[0], Phi[0, 1] * Gamma[1] - Phi[1, 1] * Gamma[0]])
    moved = command - command[0]
    late = np.concatenate([np.zeros(identified.delay_ticks), moved])[: command.size]
    return np.asarray(lfilter(numerator, denominator, late) + command[0])
