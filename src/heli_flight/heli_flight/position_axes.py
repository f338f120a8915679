# SPDX-License-Identifier: Apache-2.0
"""The axes of the position loop around an attitude loop as flown: what its gains are judged with.

The loop's acceleration comes from the aircraft's equations about its trim in the mean wind. For
analysis: whatever flies does not import this module, as python-control takes seconds to import.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from heli_core.linear import WIND, held_late, with_delay_line
from heli_core.rows import INPUT_NAMES, STATE_NAMES
from heli_core.ticks import TICK_S
from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.trim import MovingModel, TrimPoint, linearize_moving, trim
from heli_dynamics_sim.wind import mean_speed
from heli_inner_hinf.controller_state import Actuation
from heli_inner_hinf.loops import POSITIONS, Loop, Model, sampled_plant
from heli_outer_pd.analysis import Axis, Sampled, drifting, modelled_heave_damping_per_s
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.state import OuterParams

NAMES = ("forward", "right", "down")
_COMMANDS = (("theta_ref", -1.0), ("phi_ref", 1.0))
# Errors of the navigation with RTK in the hover test's world, as flown: rms and correlation time.
_POSITION_ERROR = drifting(0.012, 1.5)
_SPEED_ERROR = drifting(0.008, 0.5)
_NO_GUSTS: tuple[tuple[Sampled, ...], ...] = ((), (), ())


@dataclass(frozen=True)
class PositionAxes:
    """What the axes are made of.

    Attributes
    ----------
    config : PlantConfig
    attitude : Loop
        As flown.
    moved : Model
        What the attitude loop was designed for, about the trim in the mean wind.
    at : TrimPoint
        In the mean wind.
    moving : MovingModel
        The aircraft about it, with the accelerations of its place.
    lags_s : (2,) array
        Lag of pitch and roll behind their commands at low frequency.
    params : OuterParams
    period_ticks : int
        Of the controller.
    """

    config: PlantConfig
    attitude: Loop
    moved: Model
    at: TrimPoint
    moving: MovingModel
    lags_s: np.ndarray
    params: OuterParams
    period_ticks: int

    def axes(
        self, actuation: Actuation, gusts: Sequence[tuple[Sampled, ...]] = _NO_GUSTS
    ) -> tuple[Axis, ...]:
        """Forward, right, down, with an actuation and in gusts, of each axis its own."""
        nine, inputs = len(STATE_NAMES), len(INPUT_NAMES)
        A, B, E = self.moving.A[nine:], self.moving.B[nine:, :inputs], self.moving.E[nine:]
        flown = replace(self.attitude, plant=sampled_plant(self.moved, actuation))
        blocks = [_tilted(flown, A, B, E, i, self.params.g) for i in range(2)]
        blocks.append(_lifted(actuation, E[2, 2]))
        heave = modelled_heave_damping_per_s(self.params)
        modelled = [
            (self.lags_s[0], 0.0),
            (self.lags_s[1], 0.0),
            (self.params.collective_lag_s, heave),
        ]
        level = self.params.tilt_standing_s, 0.0
        of_law = level, level, (0.0, self.params.collective_prediction_s)
        errors = _POSITION_ERROR, _SPEED_ERROR
        axes = tuple(
            Axis(blocks[i], *modelled[i], gusts[i], *errors, self.period_ticks, *of_law[i])
            for i in range(len(of_law))
        )
        return (*axes[:2], replace(axes[2], has_lead=False))


def position_axes(
    plant: Mapping[str, Any], outer: Mapping[str, Any], attitude: Loop, model: Model
) -> PositionAxes:
    """The parts of the three axes around an attitude loop as flown.

    Parameters
    ----------
    plant, outer : mapping
        Parameters of the plant (aircraft, wind, start) and of the outer loop; of the latter's gains
        nothing is used but what it makes of the tilt.
    attitude : Loop
        As flown.
    model : Model
        What the attitude loop was designed for.

    Raises
    ------
    PlantConfigError, TrimError
    """
    config = PlantConfig.from_parameters(plant)
    nine, inputs = len(STATE_NAMES), len(INPUT_NAMES)
    wind_mps = mean_speed(-float(config.pos_ned_m[2]), config.wind) * downwind(config)
    at = trim(config.helicopter, wind_mps, 0.0)
    moving = linearize_moving(config.helicopter, at)
    moved = replace(model, A=moving.A[:nine], B=moving.B[:nine, :inputs], E=moving.E[:nine])
    lags_s, kernel = attitude_lags_s(attitude), outer_params(outer)
    return PositionAxes(config, attitude, moved, at, moving, lags_s, kernel, outer["period_ticks"])


def downwind(config: PlantConfig) -> np.ndarray:
    """Direction (3,) in which the mean wind blows, in the heading frame."""
    off_nose = config.wind.towards_rad - config.psi
    return np.array([np.cos(off_nose), np.sin(off_nose), 0.0])


def attitude_lags_s(attitude: Loop) -> np.ndarray:
    """Lag (2,), s, of pitch and roll of a sampled loop behind their commands: -T'/T at z = 1."""
    closed = attitude.closed
    labels, inputs = closed.state_labels, closed.input_labels
    lags = []
    for command, _ in _COMMANDS:
        row = np.eye(closed.nstates)[labels.index(command.removesuffix("_ref"))]
        once = np.linalg.solve(
            np.eye(closed.nstates) - closed.A, closed.B[:, inputs.index(command)]
        )
        twice = np.linalg.solve(np.eye(closed.nstates) - closed.A, once)
        lags.append(closed.dt * (row @ twice) / (row @ once))
    return np.array(lags)


def _tilted(
    flown: Loop, A: np.ndarray, B: np.ndarray, E: np.ndarray, axis: int, g: float
) -> Sampled:
    """Commanded acceleration and air -> acceleration, and what the tilt explains of it.

    Of pitch (0) or roll (1).
    """
    closed = flown.closed
    labels, inputs = closed.state_labels, closed.input_labels
    command, sign = _COMMANDS[axis]
    C = np.zeros((2, closed.nstates))
    C[0, [labels.index(name) for name in STATE_NAMES]] = A[axis]
    C[0, [labels.index(name) for name in POSITIONS]] = B[axis]
    C[1, labels.index(command.removesuffix("_ref"))] = sign * g
    columns = closed.B[:, [inputs.index(command), inputs.index(WIND[axis])]]
    D = np.array([[0.0, E[axis, axis]], [0.0, 0.0]])
    return Sampled(closed.A, columns * [sign / g, 1.0], C, D)


def _lifted(actuation: Actuation, damping_per_s: float) -> Sampled:
    """The same of the collective: transport delay, servo, unit static gain."""
    w, zeta = actuation.servo_radps, actuation.servo_damping
    servo = np.array([[0.0, 1.0], [-(w**2), -2.0 * zeta * w]]), np.array([[0.0], [w**2]])
    A, B = with_delay_line(held_late(*servo, TICK_S, actuation.delay_s))
    C = np.eye(1, len(A))
    return Sampled(A, np.hstack([B, 0.0 * B]), C, np.array([[0.0, damping_per_s]]))
