# SPDX-License-Identifier: Apache-2.0
"""The graph's topics for Foxglove: a WebSocket server on 127.0.0.1, messages passed through as CDR.

https://docs.foxglove.dev/docs/sdk; protocol: https://github.com/foxglove/ws-protocol. View only:
clients can neither publish nor call. No ROS.
"""

from collections.abc import Mapping

import foxglove
from rosbags.typesys import Stores, get_typestore

from heli_live_view.ports import LOOPBACK, listen, port_error
from heli_msgs_bridge.cdr import stamp_of

STATE = "/live_state"
"""The page's state rows as JSON, for plots of what no message holds ready (Euler angles, deg)."""
_PARAMETER, _OPTION = "foxglove_port", "--foxglove-port"


class FoxgloveServer:
    """A channel per topic, with its ROS 2 message definition.

    Parameters
    ----------
    port : int
        On 127.0.0.1; 0 for any free one.
    types : mapping
        Full topic name to type, `package/msg/Name`.

    Raises
    ------
    PortError
        The port cannot be bound.

    Attributes
    ----------
    url : str
    """

    def __init__(self, port: int, types: Mapping[str, str]) -> None:
        if port:
            listen(port, _PARAMETER, _OPTION).close()
        # Channels live as long as their context is held.
        self._context = context = foxglove.Context()
        store = get_typestore(Stores.ROS2_JAZZY)
        self._channels = {}
        for name, kind in types.items():
            text, _ = store.generate_msgdef(kind, ros_version=2)
            schema = foxglove.Schema(name=kind, encoding="ros2msg", data=text.encode())
            self._channels[name] = foxglove.Channel(
                name, schema=schema, message_encoding="cdr", context=context
            )
        self._state = foxglove.Channel(STATE, message_encoding="json", context=context)
        try:
            self._server = foxglove.start_server(
                name="heli-hover",
                host=LOOPBACK,
                port=port,
                capabilities=[foxglove.websocket.Capability.Time],
                supported_encodings=["cdr"],
                context=context,
                message_backlog_size=256,
            )
        except RuntimeError as error:
            raise port_error(port, _PARAMETER, _OPTION, f"cannot be bound: {error}") from error
        self.port = self._server.port
        self.url = f"ws://{LOOPBACK}:{self.port}"
        self._newest_ns = 0

    def is_watched(self, name: str) -> bool:
        """True if a client subscribes to the topic."""
        return self._channels[name].has_sinks()

    def log(self, name: str, raw: bytes) -> None:
        """Pass a serialised message on; its log time never goes back (late fixes, latched ones)."""
        self._channels[name].base.log(raw, max(stamp_of(raw), self._newest_ns))

    def log_unstamped(self, name: str, raw: bytes) -> None:
        """Pass a serialised message without a stamp on, at the present simulation time."""
        self._channels[name].base.log(raw, self._newest_ns)

    def log_state(self, text: str) -> None:
        """Pass a state row (JSON text) on."""
        if self._state.has_sinks():
            self._state.base.log(text.encode(), self._newest_ns)

    def set_time(self, stamp_ns: int) -> None:
        """Tell clients the simulation time."""
        self._newest_ns = stamp_ns
        self._server.broadcast_time(stamp_ns)

    def stop(self) -> None:
        """End the server; clients see the connection close."""
        self._server.stop()
