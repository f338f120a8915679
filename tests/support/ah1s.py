# SPDX-License-Identifier: Apache-2.0
"""JSBSim's AH-1S: it takes off and hovers on a simple feedback, is excited, or flown by our loops.

JSBSim (https://jsbsim.sourceforge.net, LGPL) and its helicopter (T. Kreitler, GPL) are not part of
this stack: `pip install jsbsim` has both. Which module imports this one imports jsbsim. Body axes
FRD, NED, SI, rad. Sticks are those of this stack, -1 to 1: d_lat to the right, d_lon, d_ped as the
simulator has them, and d_col = 1 - 2 of its collective, so that more of it is less thrust.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jsbsim
import numpy as np
from scipy.signal import chirp

from heli_analysis.identification import AperiodicRecord
from heli_core.jit import direct, njit
from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_core.rows import ACTUATOR, MEAS, PLANT, TRUTH
from heli_core.ticks import TICK_S
from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.faults import spoil_sensors
from heli_dynamics_sim.noise import NOISE, NoiseStreams
from heli_dynamics_sim.plant import PlantStatus, initial_state
from heli_dynamics_sim.sensors import read_baro, read_gps, read_mag, spoil_imu

M_PER_FT, KG_PER_SLUG, N_PER_LB = 0.3048, 14.593903, 4.4482216
STEPS = 4  # of JSBSim in a tick
SPIN_UP_S, CLIMB_MPS = 10.0, 2.0
WIND_S = 10.0
"""In which the wind comes up, from where it has its height on."""
CENTRE = np.array([0.22, -0.18, 0.39, 0.0])  # of the sticks in hover, about
ON_GROUND = np.array([0.0, 0.0, 0.35, 1.0])
SENSOR_RATE_RADPS, SENSOR_SPEED_MPS, SENSOR_FORCE_MPS2 = 5e-4, 0.01, 0.02
"""White noise of a record that is identified from."""
LEAST_HEIGHT_M, MOST_TILT_RAD, MOST_AWAY_M = 3.0, math.radians(60.0), 300.0
"""Of a flight by our loops; beyond it is lost."""
SETTLE_S = 120.0
"""From the start of the rotor to the hand-over to our loops: then it is at rest in the wind, as the
observer takes for granted of a flight that begins in the air."""
_SEMI_MAJOR_M, _ECCENTRICITY_2 = 6378137.0, 6.69437999e-3  # WGS 84
_SERVOS = ("aileron", "elevator", "rudder", "collective")
_MILSPEC, _STILL = 3, 0


@dataclass(frozen=True)
class Air:
    """The air that JSBSim has.

    Attributes
    ----------
    wind_ned_mps : (3,) tuple
        Steady, where it blows towards.
    w20_mps : float
        Wind at 20 ft by which its turbulence (MIL-F-8785C, `ttMilspec`) is strong; 0: none.
    seed : int
        Of the turbulence.
    """

    wind_ned_mps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    w20_mps: float = 0.0
    seed: int = 1


STILL = Air()


class Ah1s:
    """The helicopter, with its RPM governor on, a tick at a time."""

    def __init__(self, air: Air = STILL) -> None:
        fdm = jsbsim.FGFDMExec(str(Path(jsbsim.__file__).parent))
        fdm.set_debug_level(0)
        fdm.load_model("ah1s")
        fdm.set_dt(TICK_S / STEPS)
        fdm["ic/h-agl-ft"] = 6.3
        fdm["simulation/randomseed"] = fdm["atmosphere/randomseed"] = air.seed
        fdm.run_ic()
        fdm["fcs/adj/collective-profile"], fdm["fcs/adj/center-sensitivity"] = 0.0, 1.0
        fdm["fcs/rpm-governor-active-norm"] = 1.0
        self._fdm, self._air = fdm, air
        self._lat_rad = fdm["position/lat-geod-rad"]
        self._lon_rad = fdm["position/long-gc-rad"]
        self._ground_m = fdm["position/h-sl-ft"] * M_PER_FT - self.height_m

    @property
    def height_m(self) -> float:
        """Above the ground."""
        return float(self._fdm["position/h-agl-ft"]) * M_PER_FT

    @property
    def mass_kg(self) -> float:
        """As a scale would say it."""
        return float(self._fdm["inertia/mass-slugs"]) * KG_PER_SLUG

    @property
    def pos_ned_m(self) -> np.ndarray:
        """(3,) from where it stood, on the ground."""
        fdm = self._fdm
        s = 1.0 - _ECCENTRICITY_2 * math.sin(self._lat_rad) ** 2
        north = _SEMI_MAJOR_M * (1.0 - _ECCENTRICITY_2) / s**1.5
        east = _SEMI_MAJOR_M / math.sqrt(s) * math.cos(self._lat_rad)
        return np.array(
            [
                north * (fdm["position/lat-geod-rad"] - self._lat_rad),
                east * (fdm["position/long-gc-rad"] - self._lon_rad),
                self._ground_m - fdm["position/h-sl-ft"] * M_PER_FT,
            ]
        )

    @property
    def attitude_rad(self) -> np.ndarray:
        """(3,) phi, theta, psi within +-pi."""
        phi, theta, psi = (self._fdm[f"attitude/{name}-rad"] for name in ("phi", "theta", "psi"))
        return np.array([phi, theta, (psi + np.pi) % (2.0 * np.pi) - np.pi])

    @property
    def rate_body_radps(self) -> np.ndarray:
        """(3,)."""
        return np.array([self._fdm[f"velocities/{name}-rad_sec"] for name in "pqr"])

    @property
    def vel_body_mps(self) -> np.ndarray:
        """(3,) over ground."""
        return np.array([self._fdm[f"velocities/{name}-fps"] for name in "uvw"]) * M_PER_FT

    @property
    def force_body_mps2(self) -> np.ndarray:
        """(3,) specific force: what ideal accelerometers at the mass centre read."""
        fdm = self._fdm
        felt = [fdm[f"forces/fb{axis}-total-lbs"] for axis in "xyz"]  # weight is not in it
        return np.array(felt) * N_PER_LB / self.mass_kg

    @property
    def air_ned_mps(self) -> np.ndarray:
        """(3,) velocity of the air, turbulence included."""
        names = ("north", "east", "down")
        return (
            np.array([self._fdm[f"atmosphere/total-wind-{name}-fps"] for name in names]) * M_PER_FT
        )

    @property
    def rotor_radps(self) -> float:
        """Speed of the main rotor."""
        return float(self._fdm["propulsion/engine/rotor-rpm"]) * 2.0 * np.pi / 60.0

    def blow(self, share: float) -> None:
        """So much of the steady wind."""
        wind = np.array(self._air.wind_ned_mps) * share / M_PER_FT
        for name, value in zip(("north", "east", "down"), wind, strict=True):
            self._fdm[f"atmosphere/wind-{name}-fps"] = value

    def shake(self) -> None:
        """Turbulence from here on."""
        w20 = self._air.w20_mps
        if w20 > 0.0:
            self._fdm["atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"] = w20 / M_PER_FT
            self._fdm["atmosphere/turbulence/milspec/severity"] = 3.0
        self._fdm["atmosphere/turb-type"] = _MILSPEC if w20 > 0.0 else _STILL

    def advance(self, u: np.ndarray) -> None:
        """A tick with the sticks u (4,)."""
        sticks = *u[ACTUATOR.attitude], 0.5 * (1.0 - u[ACTUATOR.col])
        for name, value in zip(_SERVOS, sticks, strict=True):
            self._fdm[f"fcs/{name}-cmd-norm"] = value
        for _ in range(STEPS):
            self._fdm.run()


class Hold:
    """The simple feedback: up to a height, then level, at rest, its nose to the north."""

    def __init__(self, aircraft: Ah1s, height_m: float) -> None:
        self._aircraft, self._height_m = aircraft, height_m
        self._speed_sum, self._yaw, self._lift = np.zeros(2), CENTRE[2], 0.0
        self._time_s = 0.0

    def sticks(self) -> np.ndarray:
        """(4,) of this tick."""
        t, self._time_s = self._time_s, self._time_s + TICK_S
        if t < SPIN_UP_S:
            return ON_GROUND.copy()
        aircraft = self._aircraft
        (phi, theta, psi), (p, q, r) = aircraft.attitude_rad, aircraft.rate_body_radps
        vel = aircraft.vel_body_mps
        wanted = min(2.0 + CLIMB_MPS * (t - SPIN_UP_S), self._height_m)
        high = wanted - aircraft.height_m
        self._speed_sum += 0.002 * vel[:2] * TICK_S
        self._yaw += 0.1 * psi * TICK_S
        self._lift += 0.01 * high * TICK_S
        theta_c = np.clip(0.03 * vel[0] + self._speed_sum[0], -0.2, 0.2)
        phi_c = np.clip(-0.03 * vel[1] - self._speed_sum[1], -0.2, 0.2)
        raised = np.clip(0.5 + 0.05 * high + 0.1 * vel[2] + self._lift, 0.0, 1.0)
        return np.array(
            [
                CENTRE[0] - (phi - phi_c) - 0.5 * p,
                CENTRE[1] + (theta - theta_c) + q,
                1.5 * psi + r + self._yaw,
                1.0 - 2.0 * raised,
            ]
        )


def hovering(height_m: float, steady_s: float, air: Air = STILL) -> tuple[Ah1s, Hold]:
    """The helicopter after so long from the start of its rotor: at rest at a height."""
    aircraft = Ah1s(air)
    hold = Hold(aircraft, height_m)
    up_s = SPIN_UP_S + (height_m - 2.0) / CLIMB_MPS
    for k in range(round(steady_s / TICK_S)):
        aircraft.blow(min(max((k * TICK_S - up_s) / WIND_S, 0.0), 1.0))
        aircraft.advance(hold.sticks())
    return aircraft, hold


# -------------------------------------------------------------------------------------------------
# Records that it is identified from.
# -------------------------------------------------------------------------------------------------

RECORD_HEIGHT_M, RECORD_STEADY_S = 100.0, 80.0
AMPLITUDE = np.array([0.10, 0.06, 0.08, 0.04])
CHIRP_S, DOUBLET_S = 80.0, 20.0


def chirps() -> np.ndarray:
    """(n, 4): one on each stick in its turn."""
    t = np.arange(round(CHIRP_S / TICK_S)) * TICK_S
    fade = np.clip(np.minimum(t, t[::-1]) / 3.0, 0.0, 1.0)
    one = fade * chirp(t, 0.1, CHIRP_S, 4.0, method="logarithmic", phi=-90.0)
    return np.kron(np.diag(AMPLITUDE), one[:, None])


def doublets() -> np.ndarray:
    """(n, 4): one a second long on each stick in its turn."""
    t = np.arange(round(DOUBLET_S / TICK_S)) * TICK_S
    one = np.where((t >= 8.0) & (t < 9.0), np.sign(8.5 - t), 0.0)
    return np.kron(np.diag(0.7 * AMPLITUDE), one[:, None])


@dataclass(frozen=True)
class Hovered:
    """What instruments say of a hover with something added to the sticks.

    Attributes
    ----------
    record : AperiodicRecord
    force_body_mps2 : (N, 3) array
    mass_kg, rotor_radps : float
        Of the scale, and the rotor's mean speed.
    """

    record: AperiodicRecord
    force_body_mps2: np.ndarray
    mass_kg: float
    rotor_radps: float


def hovered(added: np.ndarray, seed: int) -> Hovered:
    """A flight in hover with `added` (n, 4) on the sticks, in still air, at 100 m."""
    aircraft, hold = hovering(RECORD_HEIGHT_M, RECORD_STEADY_S)
    rows = np.empty((added.shape[0], 16))
    for k, extra in enumerate(added):
        u = hold.sticks() + extra
        rows[k] = (
            *u, *aircraft.rate_body_radps, *aircraft.vel_body_mps, *aircraft.attitude_rad[:2],
            *aircraft.force_body_mps2, aircraft.rotor_radps,
        )  # fmt: skip
        aircraft.advance(u)
    rng = np.random.default_rng(seed)
    noise = [SENSOR_RATE_RADPS, SENSOR_SPEED_MPS, SENSOR_FORCE_MPS2]
    rates, vel, force = (
        rows[:, part] + sigma * rng.standard_normal((len(rows), 3))
        for part, sigma in zip((slice(4, 7), slice(7, 10), slice(12, 15)), noise, strict=True)
    )
    record = AperiodicRecord(rows[:, :4], added, rates, vel, rows[:, 10:12])
    return Hovered(record, force, aircraft.mass_kg, float(rows[:, 15].mean()))


# -------------------------------------------------------------------------------------------------
# The plant of a flight by our loops.
# -------------------------------------------------------------------------------------------------


@njit
def _read(state, tick, noise_row, k, force, y):
    """The packaged sensors on what state.x (42,) and force (3,) say, into y (31,)."""
    x, aircraft, air = state.x, k.aircraft, state.air
    for i in range(3):
        y[i] = force[i]
    spoil_imu(state.sensors, tick, x, aircraft.main.speed, noise_row, k.sensors.imu, y)
    read_mag(state.sensors, tick, x, air, noise_row, aircraft, k.sensors.mag, y)
    read_baro(state.sensors, tick, x, air, noise_row, aircraft, k.sensors.baro, y)
    read_gps(state.sensors, tick, x, noise_row, k.sensors.gps, y)
    spoil_sensors(state.faults, tick, noise_row, k.faults, y)


class Ah1sPlant:
    """It as `heli.fly(plant=...)` flies it, with the packaged sensors, from hover at its start.

    Parameters
    ----------
    air : Air
    gain : (4,) sequence
        Of each stick about its trim: what a margin is measured with.
    further_ticks : (4,) sequence of int
        Transport delay of each stick: likewise.
    settle_s : float
        From the start of the rotor to the hand-over.

    Attributes
    ----------
    status : PlantStatus
    speed_at_start_mps : float
        Over ground, at the hand-over.
    rotor_share : list of float
        Speed of the rotor over the governed one, at each tick.
    """

    def __init__(
        self,
        air: Air = STILL,
        gain: Sequence[float] = (1.0, 1.0, 1.0, 1.0),
        further_ticks: Sequence[int] = (0, 0, 0, 0),
        settle_s: float = SETTLE_S,
    ) -> None:
        self._air, self._gain = air, np.asarray(gain, float)
        self._ticks, self._settle_s = tuple(further_ticks), settle_s

    def reset(self, rng, tick_s, nodes):
        """Take off, come to rest at the height of the flight's start, and shake from there on."""
        values = nodes["plant"]
        config = PlantConfig.from_parameters(values)
        self._start = np.asarray(config.pos_ned_m, float)
        self._k, self._state = config.params, initial_state(config, int(values["seed"]))
        self._streams = NoiseStreams(int(values["seed"]))
        self._governed = float(nodes["outer_loop"]["rotor.omega"])
        self._aircraft, hold = hovering(-self._start[2], self._settle_s, self._air)
        self.speed_at_start_mps = float(np.linalg.norm(self._aircraft.vel_body_mps))
        self._origin = self._start - self._aircraft.pos_ned_m
        self._aircraft.shake()
        self._trim = hold.sticks()
        longest = 1 + max(self._ticks)
        self._sent = deque([self._trim] * longest, longest)
        self._force, self._row = np.zeros(3), np.zeros(NOISE.size)
        self.status, self.rotor_share = PlantStatus.OK, []
        y = np.zeros(MEAS.size)
        self._sense = direct(_read, self._state, 0, self._row, self._k, self._force, y)

    def measure(self, tick, y, truth):
        """Fill the measurement row y (31,) and truth (19,)."""
        aircraft, x = self._aircraft, self._state.x
        attitude, vel = aircraft.attitude_rad, aircraft.vel_body_mps
        x[PLANT.pos], x[PLANT.vel] = aircraft.pos_ned_m + self._origin, vel
        x[PLANT.quat], x[PLANT.rate] = quat_from_euler(*attitude), aircraft.rate_body_radps
        self._force[:] = aircraft.force_body_mps2
        self._row[:] = self._streams.rows(1)[0]
        self._sense(self._state, tick, self._row, self._k, self._force, y)
        y[MEAS.rotor], y[MEAS.rotor_valid] = aircraft.rotor_radps, float(tick % 2 == 0)
        truth[TRUTH.pos], truth[TRUTH.quat] = x[PLANT.pos], x[PLANT.quat]
        truth[TRUTH.vel] = quat_to_R_nb(x[PLANT.quat]) @ vel
        truth[TRUTH.rate], truth[TRUTH.rotor] = x[PLANT.rate], 0.0
        truth[TRUTH.wind] = y[MEAS.wind] = aircraft.air_ned_mps
        self.rotor_share.append(aircraft.rotor_radps / self._governed)

    def step(self, tick, u):
        """Go on to the next tick with the sticks u (4,)."""
        self._sent.append(np.array(u))
        late = np.array([self._sent[-1 - ticks][i] for i, ticks in enumerate(self._ticks)])
        self._aircraft.advance(self._trim + self._gain * (late - self._trim))
        away = self._state.x[PLANT.pos] - self._start
        if self._aircraft.height_m < LEAST_HEIGHT_M:
            self.status = PlantStatus.HIT_GROUND
        elif np.abs(self._aircraft.attitude_rad[:2]).max() > MOST_TILT_RAD:
            self.status = PlantStatus.ROLLED_OVER
        elif np.linalg.norm(away) > MOST_AWAY_M:
            self.status = PlantStatus.FLEW_AWAY
