# SPDX-License-Identifier: Apache-2.0
"""Node `plant`: the simulated helicopter; owns the clock, takes actuators, sends sensors."""

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration

from heli_dynamics_sim import plant
from heli_dynamics_sim.noise import NOISE, NoiseStreams
from heli_dynamics_sim.parameter_table import TABLE
from heli_dynamics_sim.wind import injected_gust
from heli_math.rows import ACTUATOR, JOINTS, MEAS, PLANT
from heli_math.ticks import TICK_S, seconds, ticks_in
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.lockstep import Demand
from heli_msgs_bridge.managed_node import NodeSpec, run
from heli_msgs_bridge.messages import CHANNELS, ClockEncoder, Encoder
from heli_msgs_bridge.tick_node import Arrived, Input, TickNode

# Real time: so many ticks are made up for at once; a longer hold-up shifts the clock instead.
_CATCH_UP_TICKS = 10
_ACKNOWLEDGE_S = 3.5
# Real time: age of the last command (wall time) after which it is called missing.
_REAL_TIME_SILENCE_S = 0.5
_NO_COMMAND = "no message on 'actuators' from inner_loop: going on with the last command"


class PlantNode(TickNode):
    """Active means: time runs. Ends its process when the flight is over."""

    SPEC = NodeSpec("plant", "heli_dynamics_sim", TABLE, "plant.yaml")
    config: plant.PlantConfig | None = None

    def setup(self) -> None:
        """Build the aircraft in its trim, its outputs and the input."""
        v = self.values
        self.config = plant.PlantConfig.from_parameters(v)
        self.state = plant.initial_state(self.config, v["seed"])
        self._noise = NoiseStreams(v["seed"])
        self._n_ticks = max(1, ticks_in(v["duration_s"]))
        self._y = np.zeros(MEAS.size)
        self._joints = np.zeros(JOINTS.size)
        self._gust = np.zeros(3)
        commands = self.state.commands
        self._u = commands[-1].copy() if len(commands) else np.zeros(ACTUATOR.size)
        self._over = ""
        self._make_outputs()
        self._warm_up()
        self.listen((Input(topics.ACTUATORS, Demand()),))

    def _make_outputs(self) -> None:
        v = self.values
        origin = datum(v["origin.latitude_deg"], v["origin.longitude_deg"], v["origin.altitude_m"])
        imu = (
            v["sensors.imu.gyro_noise_density"] ** 2 / TICK_S,
            v["sensors.imu.accel_noise_density"] ** 2 / TICK_S,
        )
        fix = (v["sensors.gps.white_m"] ** 2 + v["sensors.gps.drift_m"] ** 2,)
        variances = {
            topics.IMU: imu,
            topics.MAG: (v["sensors.mag.white_t"] ** 2,),
            topics.BARO: (v["sensors.baro.white_pa"] ** 2,),
            topics.GPS_FIX: fix,
            topics.GPS_VELOCITY: (v["sensors.gps.velocity_mps"] ** 2,),
        }
        names = [*variances, topics.TRUTH_ODOM, topics.TRUTH_WIND, topics.TRUTH_ROTOR]
        if self.config.wind.sines.on:
            names.append(topics.EXCITATION_WIND)
        self._channel: dict[str, tuple[Any, Any]] = {}
        for name in names:
            place = origin if name == topics.GPS_FIX else None
            encoder = Encoder(name, variances.get(name, ()), place)
            self._channel[name] = (encoder.encode, self.create_output(name))
        self._clock_encode = ClockEncoder().encode
        self._clock_send = self.create_output(topics.CLOCK)

    def _warm_up(self) -> None:
        """Load the compiled plant before the first tick, on a state of its own."""
        k = self.config.kernel
        spare = plant.initial_state(self.config, self.values["seed"])
        plant.measure(spare, 0, np.zeros(NOISE.size), k, self._y)
        injected_gust(spare.x, 0.0, k.wind.sines, self._gust)
        plant.status(spare, k)
        plant.advance(spare, self._u, k)
        for name, (encode, _) in self._channel.items():
            row = np.zeros(CHANNELS[name].size)
            if name == topics.TRUTH_ODOM:
                row[PLANT.qw] = 1.0
            encode(row, self.start_ns)

    def engage(self) -> None:
        """Time begins: tick 0 is measured and sent."""
        super().engage()
        self._zero_s = time.monotonic()
        self._real_timer = None
        if not self.lockstep:
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._real_timer = self.create_timer(TICK_S, self._keep_pace, clock=steady)
        self.tick = 0
        self._send_tick()

    def disengage(self) -> None:
        """Time stands still."""
        super().disengage()
        if self._real_timer is not None:
            self.destroy_timer(self._real_timer)
            self._real_timer = None

    def step(self, tick: int, arrived: Arrived) -> None:
        """Lockstep: the command of this tick has come, go on to the next."""
        _, u = arrived.get(topics.ACTUATORS, (0, None))
        if u is not None:
            self._u[:] = u
        self._go_on(tick)

    def _go_on(self, tick: int) -> None:
        """Integrate from tick to tick + 1 and send that one, or end the flight."""
        if self._over:
            return
        if tick + 1 >= self._n_ticks:
            self._end(Level.OK, f"flight over after {seconds(self._n_ticks):g} s")
            return
        plant.advance(self.state, self._u, self.config.kernel)
        self.tick = tick + 1
        self._send_tick()

    def _send_tick(self) -> None:
        """Measure the present tick and send sensors, truth and clock."""
        k, y, tick = self.config.kernel, self._y, self.tick
        plant.measure(self.state, tick, self._noise.row(), k, y)
        stamp_ns = self.stamp_ns(tick)
        if y[MEAS.mag_valid]:
            self._send(topics.MAG, y[MEAS.mag], stamp_ns)
        if y[MEAS.baro_valid]:
            self._send(topics.BARO, y[[MEAS.baro]], stamp_ns)
        if y[MEAS.gps_valid]:
            # Stamped with its time of validity, which is earlier than now.
            fix_ns = self.stamp_ns(int(y[MEAS.gps_tick]))
            self._send(topics.GPS_FIX, y[MEAS.gps_pos], fix_ns)
            self._send(topics.GPS_VELOCITY, y[MEAS.gps_vel], fix_ns)
        # Last of the sensors: in real time it triggers the observer, which then has the others.
        self._send(topics.IMU, y[MEAS.imu], stamp_ns)
        x = self.state.x
        self._send(topics.TRUTH_ODOM, x[PLANT.rigid], stamp_ns)
        self._send(topics.TRUTH_WIND, y[MEAS.wind], stamp_ns)
        if k.wind.sines.on:
            injected_gust(x, tick * TICK_S, k.wind.sines, self._gust)
            self._send(topics.EXCITATION_WIND, self._gust, stamp_ns)
        self._joints[JOINTS.rotor], self._joints[JOINTS.servo] = x[PLANT.rotor], x[PLANT.servo]
        self._send(topics.TRUTH_ROTOR, self._joints, stamp_ns)
        self._clock_send(self._clock_encode(stamp_ns))
        status = plant.PlantStatus(plant.status(self.state, k))
        if status != plant.PlantStatus.OK:
            self._end(Level.ERROR, status.sentence)
        else:
            message = self.silence() or "flying"
            self.warn_or_ok(Level.OK, message, self._facts_now())

    def _send(self, topic: str, row: np.ndarray, stamp_ns: int) -> None:
        encode, send = self._channel[topic]
        send(encode(row, stamp_ns))

    def _facts_now(self) -> dict[str, Any]:
        elapsed = time.monotonic() - self._zero_s
        flown = self.tick * TICK_S
        factor = flown / elapsed if elapsed > 0.0 else 0.0
        return {
            "flown_s": f"{flown:.2f}",
            "wall_s": f"{elapsed:.3f}",
            "real_time_factor": f"{factor:.3f}",
        }

    def _end(self, level: Level, message: str) -> None:
        """Say how the flight ended; a plant that started itself ends when everybody has heard it.

        Under a supervisor it stays until it is stopped: Fast DDS keeps sent data in the sender's
        shared memory, and acknowledgements may take a heartbeat (3 s).
        """
        self._over = message
        self.report(level, message, {**self._facts_now(), "over": "true"})
        if not self.values["autostart"]:
            return
        limit = Duration(seconds=_ACKNOWLEDGE_S)
        for publisher in self.outputs.values():
            publisher.wait_for_all_acked(limit)
        self.finished = True

    def judge_change(self, changes: Mapping[str, Any]) -> None:
        """Build the changed wind; gusts whose numbers do not fit together raise."""
        values = {**self.values, **changes}
        if self.config is None:
            plant.PlantConfig.from_parameters(values)
        else:
            self.config.with_wind(values)

    def apply_change(self, changes: Mapping[str, Any]) -> None:
        """Swap the gusts between two ticks; turbulence and mean wind go on."""
        if self.config is not None:
            self.config = self.config.with_wind(self.values)

    def silence(self) -> str:
        """Sentence about a missing command."""
        return _NO_COMMAND if self.silent else ""

    def _look_for_silence(self) -> None:
        """Lockstep: a bounded wait for the command, then slowly on with the last one."""
        if not (self.lockstep and self.active) or self._over:
            return
        waited_s = time.monotonic() - self._progress_s
        if waited_s < self.values["peer_timeout_s"] and not self.silent:
            return
        if waited_s < TICK_S:
            return
        if not self.silent:
            self.get_logger().warning(_NO_COMMAND)
        self.silent.add(topics.ACTUATORS)
        self._progress_s = time.monotonic()
        self.assembler.start(self.tick + 1)
        self._go_on(self.tick)

    # --- real time ---------------------------------------------------------------------------

    def _take_in_real_time(self, topic: str, tick: int, value: Any) -> None:
        if self.active and value is not None and self.assembler.keep_newest(topic, tick, value):
            self._u[:] = value
            self._progress_s = time.monotonic()
            self.silent.clear()

    def _keep_pace(self) -> None:
        """Bring the flight to the wall clock's time."""
        if self._over or not self.active:
            return
        now = time.monotonic()
        if now - self._progress_s > _REAL_TIME_SILENCE_S:
            self.silent.add(topics.ACTUATORS)
        due = int((now - self._zero_s) / TICK_S)
        if due - self.tick > _CATCH_UP_TICKS:
            late_s = (due - self.tick) * TICK_S
            self.get_logger().warning(f"{late_s:.2f} s behind the wall clock: time is shifted")
            self._zero_s += late_s
            due = self.tick + 1
        while self.tick < due and not self._over:
            self._go_on(self.tick)


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_dynamics_sim plant`."""
    return run(PlantNode, args)


if __name__ == "__main__":
    sys.exit(main())
