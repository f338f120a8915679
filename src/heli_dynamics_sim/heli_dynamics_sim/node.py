# SPDX-License-Identifier: Apache-2.0
"""Node `plant`: the simulated helicopter; owns the clock, takes actuators, sends sensors."""

import math
import os
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
from rclpy.duration import Duration
from std_srvs.srv import Trigger

from heli_core.errors import ParameterError, PlantConfigError
from heli_core.faults import NONE, begun
from heli_core.jit import direct
from heli_core.rows import ACTUATOR, JOINTS, MEAS, PLANT
from heli_core.sensors import PLACES, SENSORS
from heli_dynamics_sim import plant
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.config import message_variances
from heli_dynamics_sim.faults import CLEAR_FAULTS, FAULTS, FaultLog, acting
from heli_dynamics_sim.noise import NOISE, NoiseStreams, one_by_one
from heli_dynamics_sim.parameters import TABLE
from heli_dynamics_sim.sensors import periods
from heli_dynamics_sim.servo import Fallback, FallbackNumbers
from heli_dynamics_sim.wind import injected_gust
from heli_msgs_bridge import signatures, topics
from heli_msgs_bridge.diagnostics import FACT_GPS_LATENCY, Level, NodeState
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import FIX_STATUS
from heli_msgs_bridge.lifecycle_node import NodeSpec, NodeStartError
from heli_msgs_bridge.lockstep import Arrived, Demand, RealTime
from heli_msgs_bridge.messages import (
    ClockEncoder,
    encode_joint,
    encode_text,
    encode_transforms,
    fixed_to_base,
)
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.sources import others_in_words
from heli_msgs_bridge.tick_node import Input, Send, TickCore, TickNode
from heli_msgs_bridge.topics import in_namespace

# -------------------------------------------------------------------------------------------------
# What the node `plant` has while it is configured, and while time runs.
# -------------------------------------------------------------------------------------------------


@dataclass(kw_only=True)
class ConfiguredPlant(TickCore):
    """What the plant has while it is configured.

    Attributes
    ----------
    config : PlantConfig
        Swapped when the gusts change.
    state : PlantState
    noise : iterator of (NOISE.size,) array
        One row a tick.
    n_ticks : int
        Length of the flight.
    u : (4,) array
        Command in force, -1..1; in real time by `fallback`.
    send : dict
        Per topic what sends a row.
    send_clock : callable
        Sends the bytes of a clock message; None: another node does.
    begun : bool
        Whether tick 0 has been sent.
    alone : bool
        Whether it was sent without anybody who commands.
    wall_s : float
        Wall time that has been flown, up to the last pause.
    over : str
        How the flight ended, if it did.
    fault_log : FaultLog
        What came and went in flight.
    describe : list of callable
        Send what the aircraft looks like, latched.
    send_joint : callable
        Sends the bytes of the joint that turns.
    turned_rad : float
        How far it has turned, 0 to 2 pi.
    truth_sums : sums.SumWriter or None
        Of the ground truth that is sent, for who scores the flight.
    periods : tuple of int
        Ticks from sample to sample, of each of `SENSORS`.
    measure, advance : callable
        Compiled, for numbers of these types.
    """

    config: plant.PlantConfig
    state: plant.PlantState
    noise: Iterator[np.ndarray]
    n_ticks: int
    u: np.ndarray
    fallback: Fallback
    send: dict[str, Send]
    send_clock: Callable[[bytes], None] | None
    send_joint: Callable[[bytes], None]
    turned_rad: float = 0.0
    y: np.ndarray = field(default_factory=lambda: np.zeros(MEAS.size))
    joints: np.ndarray = field(default_factory=lambda: np.zeros(JOINTS.size))
    gust: np.ndarray = field(default_factory=lambda: np.zeros(3))
    begun: bool = False
    alone: bool = False
    wall_s: float = 0.0
    over: str = ""
    fault_log: FaultLog = field(default_factory=FaultLog)
    describe: list[Callable[[], None]] = field(default_factory=list)
    truth_sums: signatures.ChecksumWriter | None = None
    periods: tuple[int, ...] = field(init=False)
    measure: Callable[..., None] = field(init=False)
    advance: Callable[..., None] = field(init=False)

    def __post_init__(self) -> None:
        self.fly(self.config)

    def fly(self, config: plant.PlantConfig) -> None:
        """Fly these numbers from now on."""
        k, state = config.params, self.state
        self.config, self.periods = config, periods(k.sensors)
        self.measure = direct(plant.measure, state, 0, np.zeros(NOISE.size), k, self.y)
        self.advance = direct(plant.advance, state, self.u, k)


@dataclass
class ActivePlant:
    """What the plant has while time runs: wall time (s) of flight time 0 without pauses."""

    zero_s: float


# -------------------------------------------------------------------------------------------------
# The aircraft as URDF, its size, mass and inertia those of its parameters. No ROS.
#
# One joint turns, that which `rotor_speed` names: robot_state_publisher moves the blades by
# `joint_states`. All others are fixed; the tilt of the disc is in the scene's markers.
# -------------------------------------------------------------------------------------------------

BASE, AIRFRAME = "base_link", "airframe"
BLADES, (TURNING,) = "main_rotor_blades", topics.ROTOR_SPEED_NAMES
"""The link that turns, and its joint: clockwise seen from above is positive."""
_BODY, _DARK, _DISC = "body", "dark", "disc"
_RGBA = {_BODY: "0.16 0.38 0.65 1", _DARK: "0.15 0.15 0.17 1", _DISC: "0.55 0.6 0.65 0.35"}
# How things are drawn of which the parameters say nothing: thickness, m, and parts of their length.
_THIN_M, _SLENDER = 0.01, 0.06

Point = tuple[float, float, float]


def mounts(aircraft: HelicopterParameters) -> dict[str, Point]:
    """Frames that are fixed to base_link, and where: forward, left, up of the c.g., m.

    The simulated sensors measure at the c.g.
    """
    return {
        AIRFRAME: (0.0, 0.0, 0.0),
        "main_rotor": (0.0, 0.0, aircraft.hub_height_m),
        "tail_rotor": (-aircraft.tail_arm_m, 0.0, aircraft.tail_height_m),
        "imu_link": (0.0, 0.0, 0.0),
        "imu2_link": (0.0, 0.0, 0.0),
        "gps_link": (0.0, 0.0, 0.0),
    }


def _text(values: Sequence[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _draw(
    link: Xml.Element,
    kind: str,
    size: dict[str, str],
    colour: str,
    at: Point = (0.0, 0.0, 0.0),
    rpy: Point = (0.0, 0.0, 0.0),
) -> None:
    visual = Xml.SubElement(link, "visual")
    Xml.SubElement(visual, "origin", xyz=_text(at), rpy=_text(rpy))
    Xml.SubElement(Xml.SubElement(visual, "geometry"), kind, size)
    Xml.SubElement(visual, "material", name=colour)


def _box(link: Xml.Element, size_m: Point, colour: str, at: Point = (0.0, 0.0, 0.0)) -> None:
    _draw(link, "box", {"size": _text(size_m)}, colour, at)


def _disc(link: Xml.Element, radius_m: float, rpy: Point = (0.0, 0.0, 0.0)) -> None:
    size = {"radius": _text([radius_m]), "length": _text([_THIN_M])}
    _draw(link, "cylinder", size, _DISC, rpy=rpy)


def _airframe(link: Xml.Element, a: HelicopterParameters) -> None:
    """Mass and inertia about the c.g.; body between the skids, mast, boom, fins, skids."""
    inertial = Xml.SubElement(link, "inertial")
    Xml.SubElement(inertial, "mass", value=f"{a.mass_kg:.6g}")
    moments = (a.inertia_xx_kgm2, a.inertia_yy_kgm2, a.inertia_zz_kgm2)
    products = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    diagonal = dict(zip(("ixx", "iyy", "izz"), (f"{m:.6g}" for m in moments), strict=True))
    Xml.SubElement(inertial, "inertia", diagonal | products)
    length, width = 2.0 * a.gear_half_length_m, a.gear_half_width_m
    slim = _SLENDER * length
    _box(link, (length, width, a.gear_height_m), _BODY)
    mast = {"radius": _text([0.5 * slim]), "length": _text([a.hub_height_m])}
    _draw(link, "cylinder", mast, _DARK, (0.0, 0.0, 0.5 * a.hub_height_m))
    _box(link, (a.tail_arm_m, slim, slim), _BODY, (-0.5 * a.tail_arm_m, 0.0, 0.0))
    edge = math.sqrt(a.vfin_area_m2)
    _box(link, (edge, _THIN_M, edge), _BODY, (-a.vfin_arm_m, 0.0, a.vfin_height_m))
    edge = math.sqrt(a.hfin_area_m2)
    _box(link, (edge, edge, _THIN_M), _BODY, (-a.hfin_arm_m, 0.0, 0.0))
    for side in (1.0, -1.0):
        at = (0.0, side * a.gear_half_width_m, -a.gear_height_m + 0.5 * _THIN_M)
        _box(link, (length, _THIN_M, _THIN_M), _DARK, at)


def robot_description(
    aircraft: HelicopterParameters, name: str, frame: Callable[[str], str] = str
) -> str:
    """URDF of an aircraft.

    Parameters
    ----------
    aircraft : HelicopterParameters
    name : str
        Of the robot.
    frame : callable
        Makes a link's name out of its frame's, so that both are the same in a namespace too.

    Returns
    -------
    str
        XML: `base_link` at the c.g., FLU, what is fixed to it, and the blades.
    """
    robot = Xml.Element("robot", name=name)
    for colour, rgba in _RGBA.items():
        Xml.SubElement(Xml.SubElement(robot, "material", name=colour), "color", rgba=rgba)
    Xml.SubElement(robot, "link", name=frame(BASE))
    for child, at in mounts(aircraft).items():
        link = Xml.SubElement(robot, "link", name=frame(child))
        joint = Xml.SubElement(robot, "joint", name=f"{frame(child)}_mount", type="fixed")
        Xml.SubElement(joint, "parent", link=frame(BASE))
        Xml.SubElement(joint, "child", link=frame(child))
        Xml.SubElement(joint, "origin", xyz=_text(at), rpy="0 0 0")
        if child == AIRFRAME:
            _airframe(link, aircraft)
        elif child == "main_rotor":
            _disc(link, aircraft.main_radius_m)
        elif child == "tail_rotor":
            _disc(link, aircraft.tail_radius_m, (0.5 * math.pi, 0.0, 0.0))
    joint = Xml.SubElement(robot, "joint", name=TURNING, type="continuous")
    Xml.SubElement(joint, "parent", link=frame("main_rotor"))
    Xml.SubElement(joint, "child", link=frame(BLADES))
    Xml.SubElement(joint, "axis", xyz="0 0 -1")
    span_m = 2.0 * aircraft.main_radius_m
    _box(
        Xml.SubElement(robot, "link", name=frame(BLADES)),
        (span_m, 0.5 * _SLENDER * span_m, _THIN_M),
        _DARK,
    )
    Xml.indent(robot)
    return Xml.tostring(robot, encoding="unicode", xml_declaration=True)


# -------------------------------------------------------------------------------------------------
# Node.
# -------------------------------------------------------------------------------------------------

# Real time: so many ticks are made up for at once; a longer hold-up shifts the clock instead.
_CATCH_UP_TICKS = 10
_ACKNOWLEDGE_S = 3.5
_NO_COMMAND = "no message on 'actuators' from inner_loop: going on with the last command"
_FALLS_BACK = "no message on 'actuators' from inner_loop: the trim is held, rates are damped"
WORLD_CLOCK = "world_clock"
"""Name of the node that sends the clock of several aircraft."""
_NO_CLOCK = f"no message on '/clock' from {WORLD_CLOCK}: going on without the other aircraft"
_FLYING = "flying"
_ENCODE_CLOCK = ClockEncoder().encode
_NOTHING = np.full(3, np.nan)
_SAMPLES = tuple(
    (row.topic, slice(at.first, at.first + at.numbers), at.valid, np.full(at.numbers, np.nan))
    for row, at in ((row, PLACES[row.name]) for row in SENSORS)
)
"""Of each sensor its topic, its places in the measurement row, its flag, and what says nothing."""


class PlantNode(TickNode[ConfiguredPlant, ActivePlant]):
    """Active means: time runs. Deactivated, it stands still, and goes on when activated again.

    Ends its process when the flight is over. Another flight begins after clean-up, at tick 0.
    """

    SPEC = NodeSpec("plant", "heli_dynamics_sim", TABLE, "plant.yaml")

    def configure(self) -> ConfiguredPlant:
        """Build the aircraft in its trim, its outputs and the input."""
        self.tick = 0
        config = plant.PlantConfig.from_parameters(self.values)
        state = plant.initial_state(config, self.values["seed"])
        trim = state.commands[-1].copy() if len(state.commands) else np.zeros(ACTUATOR.size)
        truth_sums = self._make_sums()
        core = ConfiguredPlant(
            config=config,
            state=state,
            noise=one_by_one(NoiseStreams(self.values["seed"])),
            n_ticks=max(1, self.rate.ticks_in(self.values["duration_s"])),
            u=trim,
            fallback=Fallback(FallbackNumbers.from_parameters(self.values), trim),
            send=self._make_senders(config, truth_sums),
            send_clock=None if self._in_a_world else self.create_topic_publisher(topics.CLOCK),
            send_joint=self.create_topic_publisher(topics.JOINT_STATES),
            pace=self.listen(self._inputs(), leads=True),
            truth_sums=truth_sums,
        )
        self._warm_up(core)
        self.create_guarded_service(Trigger, CLEAR_FAULTS, self._clear_faults)
        self._describe(core)
        return core

    def _describe(self, core: ConfiguredPlant) -> None:
        """Make what RViz wants: the aircraft's shape, and where its parts and sensors are fixed."""
        namespace, helicopter = self.get_namespace(), core.config.helicopter
        name = Path(self.values["aircraft_file"]).stem
        shape = robot_description(helicopter, name, lambda frame: in_namespace(frame, namespace))
        fixed = fixed_to_base(mounts(helicopter), namespace)
        described = {
            topics.ROBOT_DESCRIPTION: encode_text(shape),
            topics.TF_STATIC: encode_transforms(fixed, self.start_ns),
        }
        for topic, raw in described.items():
            if topics.installed(topic):
                core.describe.append(partial(self.create_topic_publisher(topic), raw))

    @property
    def _in_a_world(self) -> bool:
        """Whether the clock is that of several aircraft."""
        return bool(self.values["clock"] == "world")

    def _inputs(self) -> tuple[Input, ...]:
        """Commands; in a world, in lockstep, its clock: nobody runs ahead of the others."""
        commands = Input(topics.ACTUATORS, Demand())
        follows = self._in_a_world and self.values["lockstep"]
        return (commands, Input(topics.CLOCK, Demand())) if follows else (commands,)

    def expected_listeners(self, topic: str) -> set[str]:
        """In a world its clock, too, must hear how far this aircraft is."""
        world = {WORLD_CLOCK} if self._in_a_world and topic == topics.TRUTH_ODOM else set()
        return super().expected_listeners(topic) | world

    def _make_sums(self) -> signatures.ChecksumWriter | None:
        """Where the sums of the ground truth go, if anybody wants them."""
        if not (path := os.environ.get(signatures.SUMS_VARIABLE)):
            return None
        written = signatures.ChecksumWriter(Path(path))
        self.at_end(written.close)
        return written

    def _make_senders(
        self, config: plant.PlantConfig, truth_sums: signatures.ChecksumWriter | None
    ) -> dict[str, Send]:
        v = self.values
        origin = datum(v["origin.latitude_deg"], v["origin.longitude_deg"], v["origin.altitude_m"])
        status = FIX_STATUS[v["sensors.gps.augmentation"]]
        sines = (topics.EXCITATION_WIND,) if config.wind.sines.on else ()
        second = (topics.IMU2,) if config.sensors.imu2 else ()
        truth = (topics.TRUTH_ODOM, topics.TRUTH_WIND, topics.TRUTH_ROTOR)
        variances = message_variances(v)
        varied = {
            topics.IMU: variances["imu"],
            topics.GPS_FIX: variances["gps"],
            topics.GPS_VELOCITY: variances["gps_velocity"],
            **{row.topic: variances[row.name] for row in SENSORS},
        }
        names = (*varied, *truth, *second, *sines)
        varied[topics.IMU2] = variances["imu"]
        places = {topics.GPS_FIX: origin}
        return {
            name: self.create_sender(
                name,
                varied.get(name, ()),
                places.get(name),
                status,
                truth_sums.add if truth_sums is not None and name == topics.TRUTH_ODOM else None,
            )
            for name in names
        }

    def _warm_up(self, core: ConfiguredPlant) -> None:
        """Load the compiled plant before the first tick, on a state of its own."""
        k = core.config.params
        spare = plant.initial_state(core.config, self.values["seed"])
        core.measure(spare, 0, np.zeros(NOISE.size), k, core.y)
        injected_gust(spare.x, 0.0, k.wind.sines, core.gust)
        core.advance(spare, core.u, k)

    def awaited_links(self) -> dict[str, set[str]]:
        """The whole graph: once time runs, lockstep does not wait long for who still compiles."""
        peers = set(self.values["peers"])
        rows = [r for r in topics.TABLE if peers.intersection(r.source) and not r.optional]
        return {r.name: peers.intersection(r.sinks).difference(r.source) for r in rows if r.sinks}

    def engage(self) -> ActivePlant:
        """Time begins, or goes on."""
        if self.core.over:
            raise NodeStartError(f"{self.core.over}: clean up and configure for another flight")
        first = self.core.send_clock is not None and not self.core.begun
        # A ROS domain has one time: of two clocks nobody could say which one is followed.
        if first and (others := others_in_words(self, topics.CLOCK)):
            raise NodeStartError(
                f"{others} sends {topics.CLOCK}, too: fly with 'clock: world' and one "
                f"{WORLD_CLOCK} for all, or set ROS_DOMAIN_ID to a free one"
            )
        if not self.values["lockstep"]:
            self.create_wall_timer(self.rate.tick_s, self._keep_pace)
        return ActivePlant(time.monotonic() - self.core.wall_s)

    def begin(self) -> None:
        """Tick 0 is measured and sent; after a pause, the tick that was sent last still holds."""
        begun, self.core.begun = self.core.begun, True
        super().begin()
        if not begun and self.missing.intersection(topics.BY_NAME[topics.ACTUATORS].source):
            self.core.alone = True
            self.core.pace.go_without([topics.ACTUATORS])
        if not begun:
            for describe in self.core.describe:
                describe()
            self._send_tick()

    def disengage(self) -> None:
        """Time stands still; the command of the present tick may still come."""
        self.core.wall_s = time.monotonic() - self.run.zero_s
        self.core.pace.pause()

    def step(self, tick: int, arrived: Arrived) -> None:
        """Lockstep: the command of this tick has come, is lost, or is not waited for; go on."""
        core, (_, u) = self.core, arrived.get(topics.ACTUATORS, (0, None))
        if self.links.has(topics.ACTUATORS) or core.alone:
            u = core.fallback.after(u, core.y[MEAS.rate])
        core.u[:] = core.u if u is None else u
        self._go_on(tick)

    def _go_on(self, tick: int) -> None:
        """Integrate from tick to tick + 1 and send that one, or end the flight."""
        core = self.core
        if tick + 1 >= core.n_ticks:
            self._end(Level.OK, f"flight over after {self.rate.seconds(core.n_ticks):g} s")
            return
        core.advance(core.state, core.u, core.config.params)
        self.tick = tick + 1
        self._send_tick()

    def _send_tick(self) -> None:
        """Measure the present tick and send sensors, truth and clock."""
        core, tick = self.core, self.tick
        k, y, x, send = core.config.params, core.y, core.state.x, core.send
        core.measure(core.state, tick, next(core.noise), k, y)
        stamp_ns = self.stamp_ns(tick)
        gps = k.sensors.gps
        # Who has nothing to say says so, by NaN: in lockstep silence would be waited for.
        for (topic, sample, valid, nothing), period in zip(_SAMPLES, core.periods, strict=True):
            if tick % period == 0:
                send[topic](y[sample] if y[valid] else nothing, stamp_ns)
        if tick % gps.period == 0:
            # Stamped with its time of validity, earlier than now; without a fix STATUS_NO_FIX.
            fix_ns = self.stamp_ns(tick - gps.latency)
            fixed = y[MEAS.gps_valid]
            send[topics.GPS_FIX](y[MEAS.gps_pos] if fixed else _NOTHING, fix_ns)
            send[topics.GPS_VELOCITY](y[MEAS.gps_vel] if fixed else _NOTHING, fix_ns)
        if k.sensors.imu2:
            send[topics.IMU2](y[MEAS.imu2], stamp_ns)
        # Last of the sensors: in real time it triggers the observer, which then has the others.
        send[topics.IMU](y[MEAS.imu], stamp_ns)
        send[topics.TRUTH_ODOM](x[PLANT.rigid], stamp_ns)
        send[topics.TRUTH_WIND](y[MEAS.wind], stamp_ns)
        if k.wind.sines.on:
            injected_gust(x, tick * self.rate.tick_s, k.wind.sines, core.gust)
            send[topics.EXCITATION_WIND](core.gust, stamp_ns)
        core.joints[JOINTS.rotor], core.joints[JOINTS.servo] = x[PLANT.rotor], x[PLANT.servo]
        send[topics.TRUTH_ROTOR](core.joints, stamp_ns)
        self._turn(float(x[PLANT.omega]), stamp_ns)
        if core.send_clock is not None:
            core.send_clock(_ENCODE_CLOCK(stamp_ns))
        fault = acting(core.config.faults, self.rate.seconds(tick))
        if core.state.flags[0] != plant.PlantStatus.OK:
            self._end(Level.ERROR, plant.PlantStatus(int(core.state.flags[0])).sentence)
        elif self.has_news(fault or _FLYING):
            level = Level.WARN if fault else Level.OK
            self.warn_or_ok(level, fault or self.silence() or _FLYING, self._facts_now())

    def _turn(self, speed_radps: float, stamp_ns: int) -> None:
        """Turn the main rotor on by a tick, and tell now and then how it stands."""
        core = self.core
        if self.tick % self.rate.every(topics.KNOWN[topics.JOINT_STATES].every_ticks) == 0:
            core.send_joint(encode_joint(TURNING, core.turned_rad, speed_radps, stamp_ns))
        core.turned_rad = math.fmod(core.turned_rad + speed_radps * self.rate.tick_s, math.tau)

    def _facts_now(self) -> dict[str, Any]:
        elapsed, flown = time.monotonic() - self.run.zero_s, self.tick * self.rate.tick_s
        factor = flown / elapsed if elapsed > 0.0 else 0.0
        return {
            "flown_s": f"{flown:.2f}",
            "wall_s": f"{elapsed:.3f}",
            "real_time_factor": f"{factor:.3f}",
            FACT_GPS_LATENCY: self.core.config.params.sensors.gps.latency * self.rate.tick_ns,
            **self.core.fallback.facts(),
            **self.core.fault_log.facts(self.core.config.faults, flown),
        }

    def _end(self, level: Level, message: str) -> None:
        """Say how the flight ended; a plant that started itself ends when everybody has heard it.

        Under a supervisor it stays until it is stopped: Fast DDS keeps sent data in the sender's
        shared memory, and acknowledgements may take a heartbeat (3 s).
        """
        self.core.over = message
        self.core.pace.stop()
        if self.core.truth_sums is not None:
            self.core.truth_sums.close()
        facts = {**self._facts_now(), "over": "true"}
        self.report(level, message, facts, NodeState.FINISHED)
        self.exit_code = int(level > Level.OK)
        if not self.values["autostart"]:
            return
        limit = Duration(seconds=_ACKNOWLEDGE_S)
        for publisher in self.outputs.values():
            publisher.wait_for_all_acked(limit)
        self.finished = True

    def prepared(self, name: str, value: Any) -> Any:
        """Faults without a beginning begin at the next tick, which who sends them does not know."""
        if name == FAULTS and isinstance(value, Sequence):
            now_s = self._next_s if self.configured else 0.0
            try:
                return list(begun(map(str, value), now_s))
            except ParameterError as error:
                raise PlantConfigError.like(error) from None
        return value

    @property
    def _next_s(self) -> float:
        """Flight time of the tick that is not yet measured."""
        return self.rate.seconds(self.tick + self.core.begun)

    def _clear_faults(self, request: Any, response: Any) -> Any:
        """All faults end between this tick and the next, gusts among them."""
        ended = FaultLog.cleared(self.core.config.faults, self._next_s)
        done = self.change(FAULTS, [NONE])
        response.success, response.message = done.successful, done.reason or ended
        return response

    def validate(self, values: Mapping[str, Any], changed: Collection[str]) -> plant.PlantConfig:
        """The changed wind and faults; what does not fit together raises."""
        if self.configured:
            return self.core.config.in_flight(values)
        return plant.PlantConfig.from_parameters(values)

    def apply(self, judged: plant.PlantConfig, changed: Collection[str]) -> None:
        """Swap gusts and faults between two ticks; turbulence and mean wind go on."""
        if self.configured:
            if FAULTS in changed and self.core.begun:
                self.core.fault_log.change(self.core.config.faults, judged.faults, self._next_s)
            self.core.fly(judged)

    def silence(self) -> str:
        """Sentence about a missing command, or a clock that stands still."""
        silent = self.core.pace.silent
        if topics.ACTUATORS in silent:
            holds = self.values["lockstep"] and not self.core.alone
            return _NO_COMMAND if holds else _FALLS_BACK
        return _NO_CLOCK if topics.CLOCK in silent else ""

    # --- real time ---------------------------------------------------------------------------

    def _take_command(self) -> None:
        pace = self.core.pace
        assert isinstance(pace, RealTime)
        _, u = self.links.through(self.tick, pace.collect()).get(topics.ACTUATORS, (0, None))
        if u is not None:
            self.core.fallback.hear(u)
            pace.silent.clear()

    def _command(self, made_up: int) -> None:
        """What is flown for the present tick."""
        core = self.core
        core.u[:] = core.fallback.step(core.y[MEAS.rate], made_up)
        if core.fallback.acting:
            core.pace.silent.add(topics.ACTUATORS)

    def _keep_pace(self) -> None:
        """Bring the flight to the wall clock's time."""
        run, core = self.run, self.core
        if core.over:
            return
        now_s = time.monotonic()
        self._take_command()
        due = int((now_s - run.zero_s) / self.rate.tick_s)
        if due - self.tick > self.rate.of(_CATCH_UP_TICKS):
            late_s = (due - self.tick) * self.rate.tick_s
            self.get_logger().warning(f"{late_s:.2f} s behind the wall clock: time is shifted")
            run.zero_s += late_s
            due = self.tick + 1
        first = self.tick
        while self.tick < due and not core.over:
            self._command(self.tick - first)
            self._go_on(self.tick)


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_dynamics_sim plant`."""
    return run(PlantNode, args)


if __name__ == "__main__":
    sys.exit(main())
