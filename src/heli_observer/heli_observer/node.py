# SPDX-License-Identifier: Apache-2.0
"""Node `observer`: sensors and flown actuators to odometry and rotor state, 100 Hz."""

import sys
from collections.abc import Sequence

import numpy as np

from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.lockstep import Demand
from heli_msgs_bridge.managed_node import NodeSpec, run
from heli_msgs_bridge.messages import Encoder
from heli_msgs_bridge.tick_node import Arrived, Input, TickNode
from heli_observer import layout as L
from heli_observer.observer import ObserverConfig, ObserverStatus, initial_state, observe, status
from heli_observer.parameter_table import NODE_NAME, TABLE

_LEVELS = {ObserverStatus.OK: Level.OK, ObserverStatus.NOT_FINITE: Level.ERROR}


class ObserverNode(TickNode):
    """Active means: the navigation solution is published."""

    SPEC = NodeSpec(NODE_NAME, "heli_observer", TABLE, f"{NODE_NAME}.yaml")

    def setup(self) -> None:
        """Build the filter, its outputs and inputs."""
        v = self.values
        self.config = ObserverConfig.from_parameters(v)
        self._y, self._out = np.zeros(L.N_MEAS), np.zeros(L.N_NAV)
        self._u = np.full(4, np.nan)
        self._encode_odom = Encoder(topics.ODOM).encode
        self._encode_rotor = Encoder(topics.ROTOR_STATE).encode
        self._send_odom = self.create_output(topics.ODOM)
        self._send_rotor = self.create_output(topics.ROTOR_STATE)
        self._warm_up()
        self.state = initial_state(self.config)
        gps = Demand(v["schedule.gps_period_ticks"], v["schedule.gps_latency_ticks"])
        origin = datum(v["origin.latitude_deg"], v["origin.longitude_deg"], v["origin.altitude_m"])
        self.listen(
            (
                Input(topics.IMU, Demand(v["schedule.imu_period_ticks"])),
                Input(topics.MAG, Demand(v["schedule.mag_period_ticks"])),
                Input(topics.BARO, Demand(v["schedule.baro_period_ticks"])),
                Input(topics.GPS_FIX, gps),
                Input(topics.GPS_VELOCITY, gps),
                Input(topics.ACTUATORS, Demand(lag_ticks=1, first_tick=1)),
            ),
            origin,
        )

    def _warm_up(self) -> None:
        """Load the compiled filter before the first tick, on a state of its own."""
        state = initial_state(self.config)
        self._y[:] = np.nan
        observe(state, 0, self._y, self._u, self.config.kernel, self._out)
        status(state, self.config.kernel)

    def engage(self) -> None:
        """Begin with a new alignment."""
        self.state = initial_state(self.config)
        super().engage()

    def step(self, tick: int, arrived: Arrived) -> None:
        """One tick of the filter."""
        self._fill_measurements(arrived)
        _, u = arrived.get(topics.ACTUATORS, (0, None))
        if u is None:
            # Not a number: the reduced-order observer goes on with the command before.
            self._u[:] = np.nan
        else:
            self._u[:] = u
        observe(self.state, tick, self._y, self._u, self.config.kernel, self._out)
        stamp_ns = self.stamp_ns(tick)
        self._send_odom(self._encode_odom(self._out, stamp_ns))
        self._send_rotor(self._encode_rotor(self._out[13:16], stamp_ns))
        self._tell()

    def _fill_measurements(self, arrived: Arrived) -> None:
        y = self._y
        y[:] = 0.0
        _, imu = arrived.get(topics.IMU, (0, None))
        y[0:6] = np.nan if imu is None else imu
        _, mag = arrived.get(topics.MAG, (0, None))
        if mag is not None:
            y[6:9], y[16] = mag, 1.0
        _, baro = arrived.get(topics.BARO, (0, None))
        if baro is not None:
            y[9], y[17] = baro[0], 1.0
        stamp, fix = arrived.get(topics.GPS_FIX, (0, None))
        if fix is not None:
            _, velocity = arrived.get(topics.GPS_VELOCITY, (0, None))
            y[10:13] = fix
            y[13:16] = np.nan if velocity is None else velocity
            y[18], y[19] = 1.0, stamp

    def _tell(self) -> None:
        named = ObserverStatus(status(self.state, self.config.kernel))
        if self.tick % 100 == 0 or named.sentence != self._message:
            facts = {
                "status": named.name,
                "sigma_position_m": np.round(self._out[22:25], 3).tolist(),
                "sigma_velocity_mps": np.round(self._out[25:28], 3).tolist(),
                "sigma_attitude_deg": np.round(np.degrees(self._out[28:31]), 3).tolist(),
                "refused_messages": len(self.refused),
            }
            self.warn_or_ok(_LEVELS.get(named, Level.WARN), named.sentence, facts)


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_observer observer`."""
    return run(ObserverNode, args)


if __name__ == "__main__":
    sys.exit(main())
