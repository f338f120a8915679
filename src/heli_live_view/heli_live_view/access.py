# SPDX-License-Identifier: Apache-2.0
"""Who may reach the page, and who may command: loopback sockets and a token of this run. No ROS."""

import errno
import hmac
import secrets
import socket
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

# -------------------------------------------------------------------------------------------------
# Who may command: a token of this run, claimed by the first browser that shows it. No ROS.
# -------------------------------------------------------------------------------------------------

TOKEN_BYTES = 24
TOKEN_VARIABLE = "HELI_LIVE_TOKEN"
"""Environment variable by which the hover test hands the token over; never by topic or file."""
_TRIES, _WINDOW_S = 5, 30.0

VIEW_ONLY = "view only: start with --allow-commands (parameter allow_commands) to command"
RECORDED = "a record cannot be commanded: its flight is over"
WRONG = "wrong token"
TAKEN = "the token is in use by another browser"
SLOW_DOWN = "too many wrong tokens: wait half a minute"


def new_token() -> str:
    """A token that cannot be guessed (192 random bits), fit for a URL."""
    return secrets.token_urlsafe(TOKEN_BYTES)


class Access:
    """Judges tokens.

    Parameters
    ----------
    token : str
        What must be shown; empty: nobody may command.
    why : str
        Why nobody may command without a token.
    """

    def __init__(self, token: str, why: str = VIEW_ONLY) -> None:
        self._token, self._why = token.encode(), why
        self._owner: str | None = None
        self._wrong_s: deque[float] = deque(maxlen=_TRIES)

    @property
    def enabled(self) -> bool:
        """Whether commands are allowed at all."""
        return bool(self._token)

    def refusal(self, token: object, browser: str, now_s: float) -> str:
        """Why this browser may not command with this token; empty if it may.

        Parameters
        ----------
        token : object
            As received; anything but the right text is wrong.
        browser : str
            Identity of the browser; the first one with the right token owns it for this run.
        now_s : float
            Steady time, for the limit on wrong tries.
        """
        if not self.enabled:
            return self._why
        while self._wrong_s and now_s - self._wrong_s[0] > _WINDOW_S:
            self._wrong_s.popleft()
        token_bytes = token.encode("utf-8", "surrogatepass") if isinstance(token, str) else b""
        right = hmac.compare_digest(token_bytes, self._token)
        if right and self._owner is None:
            # Others who guess keep nobody out who knows it.
            self._owner = browser
        if len(self._wrong_s) >= _TRIES and browser != self._owner:
            return SLOW_DOWN
        if not right:
            self._wrong_s.append(now_s)
            return WRONG
        return "" if browser == self._owner else TAKEN


# -------------------------------------------------------------------------------------------------
# Listening sockets on this machine only. No ROS.
# -------------------------------------------------------------------------------------------------

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


@dataclass(frozen=True)
class BrowserCommand:
    """A command of a browser that may command.

    Attributes
    ----------
    name : str
    args : dict
        As received, not yet judged.
    reply : callable
        `(ok, sentence)`, from any thread, once.
    """

    name: str
    args: dict[str, Any]
    reply: Callable[[bool, str], None]
