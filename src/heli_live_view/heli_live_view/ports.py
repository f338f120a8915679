# SPDX-License-Identifier: Apache-2.0
"""Listening sockets on this machine only. No ROS."""

import errno
import socket

LOOPBACK = "127.0.0.1"


class PortError(OSError):
    """A port cannot be bound; the message names port, parameter, option and what to do."""


def port_error(port: int, parameter: str, option: str, why: str) -> PortError:
    """The sentence about a port that cannot be bound; parameter: empty for none."""
    ways = f"the parameter {parameter} or {option}" if parameter else option
    return PortError(
        f"{parameter or option}: port {port} on {LOOPBACK} {why}; choose another with {ways} "
        "(0: any free one)"
    )


def listen(port: int, parameter: str, option: str) -> socket.socket:
    """Bind a TCP port on 127.0.0.1.

    Parameters
    ----------
    port : int
        0 for any free one.
    parameter, option : str
        What the user may change, for the error; parameter: empty for none.

    Raises
    ------
    PortError
        The port is in use or not allowed.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    # Left-over connections of an earlier run do not block the port; another listener does.
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((LOOPBACK, port))
        sock.listen(64)
    except OSError as error:
        sock.close()
        in_use = error.errno == errno.EADDRINUSE
        why = "is in use by another program" if in_use else f"cannot be bound: {error.strerror}"
        raise port_error(port, parameter, option, why) from error
    sock.setblocking(False)
    return sock
