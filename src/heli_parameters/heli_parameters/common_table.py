# SPDX-License-Identifier: Apache-2.0
"""Parameters that every managed node of the graph has; values in `config/common.yaml`. No ROS."""

from collections.abc import Iterable

from heli_math.origin import LATITUDE_DEG, LONGITUDE_DEG
from heli_math.ticks import RATES_HZ
from heli_parameters.parameters import Parameter


def _origin(name: str, description: str, unit: str, lower: float, upper: float) -> Parameter:
    return Parameter(
        f"origin.{name}", "double", description, unit, lower=lower, upper=upper, read_only=True
    )


COMMON_TABLE: tuple[Parameter, ...] = (
    Parameter("autostart", "bool", "Configure and activate itself when started", read_only=True),
    Parameter(
        "lockstep",
        "bool",
        "Act on the set of messages of a tick instead of on arrival",
        read_only=True,
    ),
    Parameter(
        "start_time_s",
        "double",
        "Message stamp of tick 0",
        unit="s",
        lower=1.0,
        upper=1e9,
        read_only=True,
    ),
    Parameter(
        "rate_hz",
        "int",
        "Ticks a second: IMU, observer and inner loop; what is counted in ticks stays of 10 ms",
        unit="Hz",
        choices=RATES_HZ,
        read_only=True,
    ),
    Parameter("peers", "string[]", "Nodes that take part in the flight", read_only=True),
    Parameter("unrecorded", "string[]", "Topics for which no recorder is awaited", read_only=True),
    Parameter(
        "connect_timeout_s",
        "double",
        "Wall time to wait for peers to connect",
        unit="s",
        lower=0.1,
        upper=3600.0,
        read_only=True,
    ),
    Parameter(
        "peer_timeout_s",
        "double",
        "Wall time that lockstep waits for a silent peer",
        unit="s",
        lower=0.01,
        upper=3600.0,
        read_only=True,
    ),
    Parameter(
        "link_faults",
        "string[]",
        "Messages to this node that are lost, late, exchanged or repeated, a mapping each; or none",
        read_only=True,
    ),
    Parameter(
        "link_seed",
        "int",
        "Seed of what happens on links; of a flight that of the plant",
        lower=0,
        upper=2**63 - 1,
        read_only=True,
    ),
    _origin("latitude_deg", "Latitude of the NED origin", "deg", -LATITUDE_DEG, LATITUDE_DEG),
    _origin("longitude_deg", "Longitude of the NED origin", "deg", -LONGITUDE_DEG, LONGITUDE_DEG),
    _origin("altitude_m", "Altitude of the NED origin", "m", -500.0, 9000.0),
)


def with_common(table: Iterable[Parameter]) -> tuple[Parameter, ...]:
    """A node's table with the common rows in front; the node's own row wins where both have one."""
    own = tuple(table)
    names = {row.name for row in own}
    return tuple(row for row in COMMON_TABLE if row.name not in names) + own
