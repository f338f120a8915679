# SPDX-License-Identifier: Apache-2.0
"""One aircraft as MAVLink meets it: messages in become commands, states become messages out.

No sockets, no wall clock: whoever holds it hears for it (`hear`), has it fly a step of the position
controller (`fly`), and takes what it says (`take`). What follows what is the same table as in every
other flight (`heli_outer_pd.modes`); armed and OFFBOARD are all that is added here.
"""

import math
import struct
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from heli_core.rotations import euler_from_quat
from heli_core.rows import NAV
from heli_core.ticks import NS_PER_S
from heli_flight.mavlink.link import MessageSource, common
from heli_flight.mavlink.names import OFFERED, VehicleMode, mode_asked, mode_of, parameters
from heli_flight.mavlink.setpoints import (
    RELATIVE,
    Setpoint,
    SetpointError,
    place_ned_m,
    read_setpoint,
)
from heli_flight.mavlink.telemetry import BUILDERS, INTERVALS_NS, Message, Telemetry
from heli_flight.stepping import CommandLevel, SteppedFlight
from heli_outer_pd.goto import judge_height
from heli_outer_pd.modes import LANDING, Command, Guard, Phase, RefusalCause
from heli_outer_pd.reference import ReferenceRefused

DONE = common.MAV_RESULT_ACCEPTED
NOT_NOW = common.MAV_RESULT_TEMPORARILY_REJECTED
DENIED = common.MAV_RESULT_DENIED
UNSUPPORTED = common.MAV_RESULT_UNSUPPORTED
_DISARMS_AFTER_NS = 2 * NS_PER_S
_MOST_SAID = 256
"""Answers that wait to be sent; more are forgotten, the oldest first."""
_MOST_STATIONS = 16
_SAME_TEXT_NS = NS_PER_S
_TEXT_BYTES = 50
_LIST_PER_STEP = 5
_SAME_PLACE_M = 1e-3
_NOWHERE = 0x7FFFFFFF
_FTP_NAK, _FTP_UNKNOWN, _FTP_ANSWERS = 129, 7, (128, 129)
_FTP_HEAD = struct.Struct("<HBB")
"""Opcode and error (UnknownCommand) of https://mavlink.io/en/services/ftp.html."""
_SILENT = frozenset(
    {"HEARTBEAT", "REQUEST_DATA_STREAM", "SYSTEM_TIME", "STATUSTEXT", "COMMAND_ACK", "PING"}
)
_NEEDS = {
    Guard.NAVIGATION: "there is no position estimate yet",
    Guard.UPRIGHT: Guard.UPRIGHT.value,
}


class CommandAnswer(NamedTuple):
    """MAV_RESULT of a command, and why it is not done; empty if it is."""

    result: int
    why: str = ""


class Asked(NamedTuple):
    """A command, of COMMAND_LONG or COMMAND_INT.

    Attributes
    ----------
    params : tuple of float
        1 to 4.
    altitude_m : float
    lat_e7, lon_e7 : int or None
        1e-7 deg; None: as it is.
    frame : int or None
        MAV_FRAME; COMMAND_LONG has none.
    """

    command: int
    params: tuple[float, float, float, float]
    altitude_m: float
    lat_e7: int | None
    lon_e7: int | None
    frame: int | None


class Said(NamedTuple):
    """A message to be sent; port None: to all."""

    message: Message
    port: int | None


class MavlinkVehicle:
    """A flight that is commanded by MAVLink.

    Parameters
    ----------
    flight : SteppedFlight
    system : int
        Its system id.
    autopilot : int, optional
        MAV_AUTOPILOT that it says it is: MAV_AUTOPILOT_GENERIC, or MAV_AUTOPILOT_PX4 for stations
        that offer their buttons to firmware that they know.

    Attributes
    ----------
    telemetry : Telemetry
    unheard : Counter of str
        By type, messages that mean nothing here.
    """

    def __init__(
        self, flight: SteppedFlight, system: int, autopilot: int = common.MAV_AUTOPILOT_GENERIC
    ) -> None:
        self.flight, self.system = flight, system
        self.telemetry = Telemetry(flight, autopilot)
        self.unheard: Counter[str] = Counter()
        self._altitude_is_absolute = autopilot == common.MAV_AUTOPILOT_PX4
        self._parameters = parameters(flight.settings.nodes["outer_loop"], system)
        self._names = list(self._parameters)
        self._said: deque[Said] = deque(maxlen=_MOST_SAID)
        self._texts: dict[str, int] = {}
        self._text_id = 0
        self._intervals, self._due = dict(INTERVALS_NS), dict.fromkeys(INTERVALS_NS, 0)
        self._listing: dict[int, int] = {}
        self._setpoint: Setpoint | None = None
        self._followed: Setpoint | None = None
        self._answered: dict[MessageSource, tuple[Asked, CommandAnswer]] = {}
        self._told_phases, self._told_remarks = 1, 0
        self._told_armed, self._lost_told = False, False
        self._landed_ns: int | None = None

    # ---------------------------------------------------------------------------------------------
    # State.
    # ---------------------------------------------------------------------------------------------

    @property
    def armed(self) -> bool:
        """Whether a take-off is obeyed."""
        return self.telemetry.armed

    @property
    def mode(self) -> VehicleMode:
        """What it does, by name."""
        return mode_of(self._phase, self.telemetry.offboard)

    @property
    def lost(self) -> str:
        """Why the flight is over; empty while it flies."""
        return self.flight.sentence

    @property
    def _phase(self) -> Phase:
        return self.flight.phases.phase

    @property
    def _now_ns(self) -> int:
        return self.telemetry.now_ns

    def fly(self) -> None:
        """Fly a step of the position controller, and say what is due then."""
        self._follow()
        for _ in range(self.flight.loop.period_ticks):
            if self.lost:
                break
            self.flight.step(CommandLevel.GUIDANCE)
            self.telemetry.sense()
        self._disarm_when_landed()
        self._tell_changes()
        self._stream()

    def take(self) -> list[Said]:
        """What is to be sent, in order; once."""
        said = list(self._said)
        self._said.clear()
        return said

    def _say(self, message: Message | None, port: int | None = None) -> None:
        if message is not None:
            self._said.append(Said(message, port))

    def tell(self, text: str, severity: int = common.MAV_SEVERITY_INFO) -> None:
        """STATUSTEXT (253) to all, in pieces of 50 bytes; the same one once a second at most."""
        last_ns = self._texts.get(text)
        if last_ns is not None and self._now_ns - last_ns < _SAME_TEXT_NS:
            return
        if len(self._texts) > _MOST_SAID:
            self._texts.clear()
        self._texts[text] = self._now_ns
        data = text.encode("ascii", "replace")
        pieces = [data[i : i + _TEXT_BYTES] for i in range(0, len(data), _TEXT_BYTES)]
        # A text that is one piece has no id; a piece that is not full ends a longer one.
        number = 0
        if len(pieces) > 1:
            number = self._text_id = self._text_id % 0xFFFF + 1
            pieces += [b""] if len(pieces[-1]) == _TEXT_BYTES else []
        for i, piece in enumerate(pieces):
            self._say(common.MAVLink_statustext_message(severity, piece, number, i))

    def _stream(self) -> None:
        for kind, every_ns in self._intervals.items():
            if every_ns > 0 and self._now_ns >= self._due[kind]:
                self._due[kind] = max(self._due[kind] + every_ns, self._now_ns + 1)
                self._say(BUILDERS[kind](self.telemetry))
        for port, index in list(self._listing.items()):
            end = min(index + _LIST_PER_STEP, len(self._names))
            for i in range(index, end):
                self._say(self._value(i), port)
            if end == len(self._names):
                del self._listing[port]
            else:
                self._listing[port] = end

    def _tell_changes(self) -> None:
        phases = self.flight.phases
        for _, phase in phases.history[self._told_phases :]:
            self.tell(f"{phase.mode}: {phase.value}" if phase.mode != phase.value else phase.mode)
            self._say(self.telemetry.extended_state())
        self._told_phases = len(phases.history)
        for remark in phases.remarks[self._told_remarks :]:
            self.tell(remark, common.MAV_SEVERITY_WARNING)
        self._told_remarks = len(phases.remarks)
        if self.armed != self._told_armed:
            self._told_armed = self.armed
            self.tell("armed" if self.armed else "disarmed")
            self._say(self.telemetry.heartbeat())
        if self.lost and not self._lost_told:
            self._lost_told = True
            self.tell(f"LOST: {self.lost}", common.MAV_SEVERITY_EMERGENCY)

    def _disarm_when_landed(self) -> None:
        if self._phase != Phase.STANDING or not self.armed:
            self._landed_ns = None
            return
        landed = any(phase in LANDING for _, phase in self.flight.phases.history[-2:])
        if not landed:
            return
        if self._landed_ns is None:
            self._landed_ns = self._now_ns
        if self._now_ns - self._landed_ns >= _DISARMS_AFTER_NS:
            self.telemetry.armed = False

    # ---------------------------------------------------------------------------------------------
    # What is heard.
    # ---------------------------------------------------------------------------------------------

    def hear(self, message: Message, source: MessageSource) -> None:
        """Take a message that is for this vehicle; what it brings about is flown by `fly`."""
        kind = message.get_type()
        if (act := _HEARD.get(kind)) is not None:
            act(self, message, source)
        elif kind.startswith("MISSION_"):
            self._mission(message, source)
        elif kind not in _SILENT:
            self.unheard[kind] += 1

    def _on_command_long(self, m: Message, source: MessageSource) -> None:
        def degrees_e7(value: float) -> int | None:
            return round(value * 1e7) if math.isfinite(value) and abs(value) < 200.0 else None

        asked = Asked(
            m.command, (m.param1, m.param2, m.param3, m.param4), m.param7, degrees_e7(m.param5),
            degrees_e7(m.param6), None,
        )  # fmt: skip
        self._command(asked, source, m.confirmation > 0)

    def _on_command_int(self, m: Message, source: MessageSource) -> None:
        lat, lon = (None if value == _NOWHERE else int(value) for value in (m.x, m.y))
        params = m.param1, m.param2, m.param3, m.param4
        self._command(Asked(m.command, params, m.z, lat, lon, m.frame), source, False)

    def _command(self, asked: Asked, source: MessageSource, again: bool) -> None:
        before = self._answered.get(source)
        if again and before is not None and str(before[0]) == str(asked):
            answer = before[1]  # its answer was lost on the way
        else:
            answer = self._obey(asked, source)
            if len(self._answered) >= _MOST_STATIONS:
                self._answered.clear()
            self._answered[source] = asked, answer
        self._acknowledge(asked.command, answer, source)

    def _acknowledge(self, command: int, answer: CommandAnswer, source: MessageSource) -> None:
        self._say(
            common.MAVLink_command_ack_message(
                command, answer.result, 0, 0, source.system, source.component
            ),
            source.port,
        )
        if answer.why:
            self.tell(answer.why, common.MAV_SEVERITY_WARNING)

    def _obey(self, asked: Asked, source: MessageSource) -> CommandAnswer:
        act = _COMMANDS.get(asked.command)
        if act is None:
            return CommandAnswer(UNSUPPORTED, f"command {asked.command}: not supported")
        if self.lost:
            return CommandAnswer(DENIED, f"LOST: {self.lost}")
        try:
            return act(self, asked, source)
        except (ReferenceRefused, SetpointError) as error:
            return CommandAnswer(DENIED, str(error))

    # ---------------------------------------------------------------------------------------------
    # Commands that move it.
    # ---------------------------------------------------------------------------------------------

    def _pilot(
        self, command: Command, goal: tuple[np.ndarray, float] | None = None
    ) -> CommandAnswer:
        """What the phases say to a command; ReferenceRefused where there is no way."""
        why = self.flight.ask(
            lambda phases, now_ns, nav: phases.command(command, now_ns, nav, goal)
        )
        return self._ended_offboard(why)

    def _ended_offboard(self, why: str) -> CommandAnswer:
        if why:
            return CommandAnswer(NOT_NOW, why)
        self.telemetry.offboard = False
        return CommandAnswer(DONE)

    def _arm(self, asked: Asked, source: MessageSource) -> CommandAnswer:
        wanted = asked.params[0]
        if wanted not in (0.0, 1.0):
            return CommandAnswer(DENIED, f"arm: {wanted:g}; allowed: 1 (arm), 0 (disarm)")
        if wanted == 0.0:
            return self._disarm()
        failing = self.flight.phases.fails(self._now_ns, self.flight.loop.outer_s.nav)
        for guard, why in _NEEDS.items():
            if guard in failing:
                return CommandAnswer(NOT_NOW, f"arm: {why}")
        self.telemetry.armed = True
        return CommandAnswer(DONE)

    def _disarm(self) -> CommandAnswer:
        if self._phase == Phase.SPOOLING:
            self._pilot(Command.LAND)
        if self._phase != Phase.STANDING:
            return CommandAnswer(DENIED, "disarm: not before it stands; allowed: land")
        self.telemetry.armed = False
        return CommandAnswer(DONE)

    def _take_off(self, asked: Asked, source: MessageSource) -> CommandAnswer:
        if not self.armed:
            return CommandAnswer(NOT_NOW, f"takeoff: {RefusalCause.DISARMED.value}; allowed: arm")
        height = self._height(asked)
        if height is None:
            return self._pilot(Command.TAKEOFF)
        judge_height(height)
        return self._ended_offboard(
            self.flight.ask(lambda phases, now_ns, nav: phases.take_off(height, now_ns, nav))
        )

    def _height(self, asked: Asked) -> float | None:
        """Height of a take-off above where it stands, m; None: the parameter's."""
        altitude = asked.altitude_m
        if not math.isfinite(altitude):
            return None
        absolute = self._altitude_is_absolute if asked.frame is None else (
            asked.frame not in RELATIVE
        )  # fmt: skip
        if not absolute:
            return altitude
        return altitude - self.telemetry.datum.alt_m + float(self.telemetry.nav[NAV.pos][2])

    def _land(self, asked: Asked, source: MessageSource) -> CommandAnswer:
        return self._pilot(Command.LAND)

    def _reposition(self, asked: Asked, source: MessageSource) -> CommandAnswer:
        (speed, _, _, psi), altitude = asked.params, asked.altitude_m
        if math.isfinite(speed) and speed > 0.0:
            return CommandAnswer(
                DENIED, "go-to: its speed is the parameter GOTO_SPEED_MPS; allowed: -1"
            )
        home, nav = self.telemetry.home_ned_m(), self.telemetry.nav
        if home is None or not self.telemetry.knows():
            return CommandAnswer(NOT_NOW, "go-to: there is no position estimate")
        frame = common.MAV_FRAME_GLOBAL_INT if asked.frame is None else asked.frame
        lat, lon, alt_mm = self.telemetry.geodetic(nav[NAV.pos])
        lat = lat if asked.lat_e7 is None else asked.lat_e7
        lon = lon if asked.lon_e7 is None else asked.lon_e7
        stays = not math.isfinite(altitude)
        altitude, frame = (alt_mm * 1e-3, common.MAV_FRAME_GLOBAL_INT) if stays else (
            altitude, frame
        )  # fmt: skip
        goal = place_ned_m(lat, lon, altitude, frame, self.telemetry.datum, home)
        return self._pilot(Command.GOTO, (goal, self._heading(psi)))

    def _heading(self, psi_rad: float | None) -> float:
        """A heading, rad; None or none: that which it has."""
        if psi_rad is not None and math.isfinite(psi_rad):
            return math.remainder(psi_rad, math.tau)
        return float(euler_from_quat(self.telemetry.nav[NAV.quat])[2])

    # ---------------------------------------------------------------------------------------------
    # Modes.
    # ---------------------------------------------------------------------------------------------

    def _do_set_mode(self, asked: Asked, source: MessageSource) -> CommandAnswer:
        base, main, sub, _ = map(_whole, asked.params)
        return self._enter(base, main, sub)

    def _on_set_mode(self, m: Message, source: MessageSource) -> None:
        custom = m.custom_mode
        answer = self._enter(m.base_mode, custom >> 16 & 0xFF, custom >> 24 & 0xFF)
        self._acknowledge(common.MAVLINK_MSG_ID_SET_MODE, answer, source)

    def _enter(self, base: int, main: int, sub: int) -> CommandAnswer:
        mode = mode_asked(main, sub)
        if self.lost:
            return CommandAnswer(DENIED, f"LOST: {self.lost}")
        if not base & common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED or mode is None:
            names = ", ".join(offered.name for offered in OFFERED)
            return CommandAnswer(DENIED, f"mode {main}, {sub}: not offered; allowed: {names}")
        try:
            return self._enter_known(mode)
        except ReferenceRefused as error:
            return CommandAnswer(DENIED, str(error))

    def _enter_known(self, mode: VehicleMode) -> CommandAnswer:
        match mode:
            case VehicleMode.TAKEOFF:
                nowhere = Asked(
                    common.MAV_CMD_NAV_TAKEOFF, (math.nan,) * 4, math.nan, None, None, None
                )
                return self._take_off(nowhere, MessageSource(0, 0, 0))
            case VehicleMode.LAND:
                return self._pilot(Command.LAND)
            case VehicleMode.OFFBOARD:
                return self._begin_offboard()
        if self._phase == Phase.STANDING:
            return CommandAnswer(DONE)
        return self._pilot(Command.HOLD)

    def _begin_offboard(self) -> CommandAnswer:
        if self._setpoint is None or self._is_old(self._setpoint):
            return CommandAnswer(
                NOT_NOW, "OFFBOARD: no set-point is heard; allowed: send them first"
            )
        self._followed = None
        why = self._fly_setpoint(self._setpoint)
        if why:
            return CommandAnswer(NOT_NOW, why)
        self.telemetry.offboard = True
        return CommandAnswer(DONE)

    def _is_old(self, setpoint: Setpoint) -> bool:
        timeout_ns = self.flight.phases.numbers.sticks.timeout_ns
        return self._now_ns - setpoint.at_ns > timeout_ns

    def _on_setpoint(self, m: Message, source: MessageSource) -> None:
        home, nav = self.telemetry.home_ned_m(), self.telemetry.nav
        if home is None or not self.telemetry.knows():
            # A place is told from home, a velocity from the heading.
            why = f"set-point: {_NEEDS[Guard.NAVIGATION]}; it is dropped"
            self.tell(why, common.MAV_SEVERITY_WARNING)
            return
        try:
            self._setpoint = read_setpoint(
                m, self._now_ns, self._heading(None), nav[NAV.pos], self.telemetry.datum, home
            )
        except SetpointError as error:
            self.tell(str(error), common.MAV_SEVERITY_WARNING)

    def _follow(self) -> None:
        """Fly the newest set-point of mode OFFBOARD, or end it where none is heard any more."""
        if not self.telemetry.offboard or self.lost:
            return
        setpoint = self._setpoint
        if setpoint is None or self._is_old(setpoint):
            self.telemetry.offboard = False
            self.tell("OFFBOARD: set-points have stopped: holds", common.MAV_SEVERITY_WARNING)
            if self._phase in (Phase.TRAJECTORY, Phase.VELOCITY):
                self._pilot(Command.HOLD)
            return
        try:
            why = self._fly_setpoint(setpoint)
        except ReferenceRefused as error:
            why = str(error)
            self._followed = setpoint  # asked once
        if why:
            self.tell(why, common.MAV_SEVERITY_WARNING)

    def _fly_setpoint(self, setpoint: Setpoint) -> str:
        """Why it is not flown; empty if it is. ReferenceRefused where there is no way."""
        if setpoint.vel_ned_mps is not None:
            return self._fly_velocity(setpoint, setpoint.vel_ned_mps)
        assert setpoint.pos_ned_m is not None
        before = self._followed
        same = (
            before is not None
            and before.pos_ned_m is not None
            and before.psi_rad == setpoint.psi_rad
            and float(np.abs(before.pos_ned_m - setpoint.pos_ned_m).max()) < _SAME_PLACE_M
        )
        if same:
            return ""
        goal = setpoint.pos_ned_m, self._heading(setpoint.psi_rad)
        why = self.flight.ask(
            lambda phases, now_ns, nav: phases.command(Command.GOTO, now_ns, nav, goal)
        )
        self._followed = before if why else setpoint
        return why

    def _fly_velocity(self, setpoint: Setpoint, vel_ned_mps: np.ndarray) -> str:
        before, phases = self._followed, self.flight.phases
        if (
            before is not None
            and before.vel_ned_mps is not None
            and phases.phase == Phase.VELOCITY
            and np.array_equal(before.vel_ned_mps, vel_ned_mps)
            and before.yaw_rate_radps == setpoint.yaw_rate_radps
            and self._now_ns - phases.cruise_ns < phases.numbers.sticks.timeout_ns / 2
        ):
            return ""
        why = self.flight.ask(
            lambda phases, now_ns, nav: phases.velocity(
                vel_ned_mps, setpoint.yaw_rate_radps, now_ns, nav
            )
        )
        self._followed = before if why else setpoint
        return why

    # ---------------------------------------------------------------------------------------------
    # Requests.
    # ---------------------------------------------------------------------------------------------

    def _request(self, asked: Asked, source: MessageSource) -> CommandAnswer:
        kind = _whole(asked.params[0])
        if (build := BUILDERS.get(kind)) is None:
            return CommandAnswer(UNSUPPORTED, f"message {kind}: not sent")
        message = build(self.telemetry)
        if message is None:
            return CommandAnswer(NOT_NOW, f"message {kind}: there is no position estimate yet")
        self._say(message, source.port)
        return CommandAnswer(DONE)

    def _request_version(self, asked: Asked, source: MessageSource) -> CommandAnswer:
        self._say(self.telemetry.autopilot_version(), source.port)
        return CommandAnswer(DONE)

    def _set_interval(self, asked: Asked, source: MessageSource) -> CommandAnswer:
        kind, every_us = _whole(asked.params[0]), asked.params[1]
        if kind not in BUILDERS:
            return CommandAnswer(UNSUPPORTED, f"message {kind}: not sent")
        if not math.isfinite(every_us) or every_us < -1.0 or every_us > 1e9:
            return CommandAnswer(
                DENIED, f"message {kind}: interval {every_us:g} us; allowed: -1 to 1e9"
            )
        default_ns = INTERVALS_NS.get(kind, -1)
        self._intervals[kind] = default_ns if every_us == 0.0 else round(every_us * 1000.0)
        self._due[kind] = self._now_ns
        return CommandAnswer(DONE)

    def _get_interval(self, asked: Asked, source: MessageSource) -> CommandAnswer:
        kind = _whole(asked.params[0])
        every_ns = self._intervals.get(kind, -1)
        if kind not in BUILDERS:
            return CommandAnswer(UNSUPPORTED, f"message {kind}: not sent")
        every_us = every_ns // 1000 if every_ns > 0 else -1
        self._say(common.MAVLink_message_interval_message(kind, every_us), source.port)
        return CommandAnswer(DONE)

    def _on_timesync(self, m: Message, source: MessageSource) -> None:
        if m.tc1 == 0:
            self._say(common.MAVLink_timesync_message(self._now_ns, m.ts1), source.port)

    # ---------------------------------------------------------------------------------------------
    # Parameters, missions.
    # ---------------------------------------------------------------------------------------------

    def _value(self, index: int) -> Message:
        name = self._names[index]
        return common.MAVLink_param_value_message(
            name.encode(), self._parameters[name], common.MAV_PARAM_TYPE_REAL32, len(self._names),
            index,
        )  # fmt: skip

    def _index(self, param_id: Any) -> int | None:
        name = param_id if isinstance(param_id, str) else bytes(param_id).decode("ascii", "replace")
        return self._names.index(name) if name in self._parameters else None

    def _on_param_list(self, m: Message, source: MessageSource) -> None:
        if len(self._listing) < _MOST_STATIONS:
            self._listing.setdefault(source.port, 0)

    def _on_param_read(self, m: Message, source: MessageSource) -> None:
        index = m.param_index if m.param_index >= 0 else self._index(m.param_id)
        if index is not None and index < len(self._names):
            self._say(self._value(index), source.port)

    def _on_param_set(self, m: Message, source: MessageSource) -> None:
        """CommandAnswer with the value as it is: nothing is set."""
        index = self._index(m.param_id)
        if index is not None:
            self._say(self._value(index), source.port)
            why = f"{self._names[index]}: parameters are read only; allowed: --params before"
            self.tell(why, common.MAV_SEVERITY_WARNING)

    def _on_file(self, m: Message, source: MessageSource) -> None:
        """There are no files: each request has a NAK, so that nobody waits for one."""
        asked = bytes(m.payload)
        sequence, session, opcode = _FTP_HEAD.unpack_from(asked)
        if opcode in _FTP_ANSWERS:
            return
        head = bytes([session, _FTP_NAK, 1, opcode, 0, 0]) + bytes(4) + bytes([_FTP_UNKNOWN])
        answer = (sequence + 1 & 0xFFFF).to_bytes(2, "little") + head
        payload = answer.ljust(len(asked), b"\0")
        self._say(
            common.MAVLink_file_transfer_protocol_message(
                0, source.system, source.component, payload
            ),
            source.port,
        )

    def _mission(self, m: Message, source: MessageSource) -> None:
        """There is none: an empty list, and each item refused."""
        kind, mission = m.get_type(), getattr(m, "mission_type", 0)
        to = source.system, source.component
        result = {
            "MISSION_CLEAR_ALL": common.MAV_MISSION_ACCEPTED,
            "MISSION_COUNT": common.MAV_MISSION_UNSUPPORTED,
            "MISSION_WRITE_PARTIAL_LIST": common.MAV_MISSION_UNSUPPORTED,
            "MISSION_ITEM": common.MAV_MISSION_UNSUPPORTED,
            "MISSION_ITEM_INT": common.MAV_MISSION_UNSUPPORTED,
            "MISSION_REQUEST": common.MAV_MISSION_INVALID_SEQUENCE,
            "MISSION_REQUEST_INT": common.MAV_MISSION_INVALID_SEQUENCE,
        }.get(kind)
        if kind == "MISSION_REQUEST_LIST":
            self._say(common.MAVLink_mission_count_message(*to, 0, mission), source.port)
        elif result is not None:
            self._say(common.MAVLink_mission_ack_message(*to, result, mission), source.port)
            if result == common.MAV_MISSION_UNSUPPORTED:
                self.tell("missions are not flown", common.MAV_SEVERITY_WARNING)


def _whole(value: float) -> int:
    """A whole number of a command's parameter; -1 where it is none."""
    return int(value) if math.isfinite(value) and abs(value) < 2**31 else -1


_HEARD: dict[str, Callable[[MavlinkVehicle, Message, MessageSource], None]] = {
    "COMMAND_LONG": MavlinkVehicle._on_command_long,
    "COMMAND_INT": MavlinkVehicle._on_command_int,
    "SET_MODE": MavlinkVehicle._on_set_mode,
    "SET_POSITION_TARGET_LOCAL_NED": MavlinkVehicle._on_setpoint,
    "SET_POSITION_TARGET_GLOBAL_INT": MavlinkVehicle._on_setpoint,
    "PARAM_REQUEST_LIST": MavlinkVehicle._on_param_list,
    "PARAM_REQUEST_READ": MavlinkVehicle._on_param_read,
    "PARAM_SET": MavlinkVehicle._on_param_set,
    "TIMESYNC": MavlinkVehicle._on_timesync,
    "FILE_TRANSFER_PROTOCOL": MavlinkVehicle._on_file,
}
_COMMANDS: dict[int, Callable[[MavlinkVehicle, Asked, MessageSource], CommandAnswer]] = {
    common.MAV_CMD_COMPONENT_ARM_DISARM: MavlinkVehicle._arm,
    common.MAV_CMD_NAV_TAKEOFF: MavlinkVehicle._take_off,
    common.MAV_CMD_NAV_LAND: MavlinkVehicle._land,
    common.MAV_CMD_DO_REPOSITION: MavlinkVehicle._reposition,
    common.MAV_CMD_DO_SET_MODE: MavlinkVehicle._do_set_mode,
    common.MAV_CMD_REQUEST_MESSAGE: MavlinkVehicle._request,
    common.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: MavlinkVehicle._request_version,
    common.MAV_CMD_SET_MESSAGE_INTERVAL: MavlinkVehicle._set_interval,
    common.MAV_CMD_GET_MESSAGE_INTERVAL: MavlinkVehicle._get_interval,
}
