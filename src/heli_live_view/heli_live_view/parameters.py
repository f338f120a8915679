# SPDX-License-Identifier: Apache-2.0
"""The live view's parameters; their values stand in config/live_view.yaml. No ROS."""

from typing import Any

from heli_core.parameters import Parameter

NODE_NAME = "live_view"
SHOWN_TO_THE_END = "the flight is over"
"""What the node says in /diagnostics once its browsers have been told."""


def _row(name: str, kind: str, description: str, unit: str = "", **rest: Any) -> Parameter:
    return Parameter(name, kind, description, unit, read_only=True, **rest)


def _port(name: str, description: str) -> Parameter:
    return _row(name, "int", description, lower=0, upper=65535)


def _bound(name: str, description: str, unit: str) -> Parameter:
    return _row(
        f"bounds.{name}", "double", f"{description}; negative: the paper's", unit, lower=-1.0,
        upper=1e3,
    )  # fmt: skip


def _limit(name: str, description: str, unit: str, lower: float, upper: float) -> Parameter:
    return _row(f"command_limits.{name}", "double", description, unit, lower=lower, upper=upper)


TABLE: tuple[Parameter, ...] = (
    _port("port", "TCP port of the page on 127.0.0.1; 0 for any free one"),
    _port("foxglove_port", "TCP port for Foxglove on 127.0.0.1; 0 for any free one"),
    _row("foxglove", "bool", "Serve Foxglove as well; whoever reaches its port can read"),
    _row("allow_commands", "bool", "Let the holder of the printed token command the flight"),
    _row("stale_s", "double", "Wall time after which a silent value is blanked", "s",
         lower=0.05, upper=60.0),
    _row("viewer_limit_s", "double",
         "Longest that a flight waits for its first viewer, where it waits (--live-wait)", "s",
         lower=0.0, upper=86400.0),
    _row("stay_s", "double",
         "Longest that the page is served after the flight, with its report, while somebody looks",
         "s", lower=0.0, upper=86400.0),
    _row("nice", "int", "Priority: 0 as the nodes, up to 19 behind them", lower=0, upper=19),
    _row("flight.scenario", "string", "Name of the flight, for the page"),
    _row("flight.seed", "int", "Seed of the flight, for the page; -1: unknown", lower=-1,
         upper=2**31 - 1),
    _row("flight.duration_s", "double", "Length of the flight, for the page; 0: unknown", "s",
         lower=0.0, upper=86400.0),
    _row("flight.windows_s", "double[]",
         "Pairs of flight times whose largest errors are shown apart; 0, 0: none", "s",
         shape=(None, 2), lower=0.0, upper=86400.0),
    _row("flight.report", "bool", "A report follows, and the page will show it: for the page"),
    _row("aircraft.name", "string", "Name of the aircraft, for the page"),
    _row("aircraft.rotor_radius_m", "double", "Radius of the main rotor, for the pictures", "m",
         lower=0.01, upper=20.0),
    _bound("altitude_m", "Bound drawn around the altitude", "m"),
    _bound("v_z_mps", "Bound drawn around the vertical speed", "m/s"),
    _bound("v_x_mps", "Bound drawn around the forward speed", "m/s"),
    _bound("v_y_mps", "Bound drawn around the lateral speed", "m/s"),
    _bound("lateral_m", "Bound drawn around the lateral position", "m"),
    _bound("longitudinal_m", "Bound drawn around the longitudinal position", "m"),
    _bound("attitude_deg", "Bound drawn around roll and pitch", "deg"),
    _limit("altitude_min_m", "Lowest commanded altitude", "m", 1.0, 1e4),
    _limit("altitude_max_m", "Highest commanded altitude", "m", 1.0, 1e4),
    _limit("distance_m", "Largest horizontal distance of a commanded point from the start", "m",
           1.0, 1e4),
    _limit("speed_mps", "Horizontal speed of a commanded move", "m/s", 0.1, 5.0),
    _limit("climb_mps", "Vertical speed of a commanded move", "m/s", 0.1, 2.0),
    _limit("turn_dps", "Turn rate of a commanded move", "deg/s", 1.0, 45.0),
    _limit("gust_mps", "Strongest commanded gust", "m/s", 0.0, 15.0),
    _limit("gust_s", "Longest commanded gust", "s", 0.1, 60.0),
)  # fmt: skip
BOUNDS = {
    "altitude_m": "altitude",
    "v_z_mps": "v_z",
    "v_x_mps": "v_x",
    "v_y_mps": "v_y",
    "lateral_m": "lateral",
    "longitudinal_m": "longitudinal",
    "attitude_deg": "roll",
}
"""Bounds, as `bounds.<name>` and on the page, and the paper's metrics that they are of."""
COMMAND_LIMITS = tuple(row.name for row in TABLE if row.name.startswith("command_limits."))
