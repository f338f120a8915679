# SPDX-License-Identifier: Apache-2.0
"""The page and its WebSocket on 127.0.0.1, served by a thread of its own. No ROS.

Nothing here may hold up the flight: the callers only hand over texts. Each browser has a slot for
the newest state (a slow one skips states) and a short queue for what must not be skipped.
"""

import asyncio
import contextlib
import json
import logging
import mimetypes
import secrets
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol

from aiohttp import WSMsgType, web

from heli_core import command_line
from heli_live_view.access import LOOPBACK, Access, BrowserCommand, listen

# -------------------------------------------------------------------------------------------------
# Page server.
# -------------------------------------------------------------------------------------------------

_LOG = logging.getLogger(__name__)
_HOSTS = (LOOPBACK, "localhost", "[::1]")
_COOKIE = "heli_live_view"
_MAX_REQUEST_BYTES = 4096
_MAX_WAITING = 256
_MAX_COMMANDS = 8
_HEARTBEAT_S = 10.0
# Whoever holds more than a browser needs shall not take the flight's descriptors and memory.
_MAX_CONNECTIONS = 64
_REQUEST_LIMIT_S = 10.0
"""How long a connection may be without a whole request."""
_ACCEPT_AGAIN_S = 0.1
_STOP_S = 1.0
_FRAME_S = 1.0 / 30.0
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "font-src 'self'; connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
_TYPES = {".js": "text/javascript", ".mjs": "text/javascript", ".wasm": "application/wasm"}
_REPORT_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "sandbox allow-scripts allow-downloads"
)
"""Of a flight's own page, which stands in one file: it gets an origin of its own, so that whatever
a foreign flight's folder holds can neither read this server nor send anything."""


class RequestRefusal(StrEnum):
    """What is turned away, and counted: the names are those of /diagnostics."""

    CONNECTIONS = "connections over the limit"
    REQUESTS = "requests that are none"
    HOSTS = "requests for other hosts"
    ORIGINS = "pages of other origins"
    FRAMES = "frames that are none or too long"
    TEXTS = "texts that are not understood"
    TOKENS = "commands without the token"
    FLOODS = "commands over the limit"


class _RequestErrors(logging.Handler):
    """What aiohttp would log of each request that is none: it is counted, and fills no disk."""

    def __init__(self, refused: "Counter[RequestRefusal]") -> None:
        super().__init__()
        self._refused = refused

    def emit(self, record: logging.LogRecord) -> None:
        """Count one."""
        self._refused[RequestRefusal.REQUESTS] += 1


_LIVE = "this is a flight, not a replay: there is nothing to wind"
_NOT_JSON = "not understood: expected a JSON object with type, id and token"


class Watcher(Protocol):
    """One browser's own way through what is shown, where each has one: a replay.

    Attributes
    ----------
    runs : bool
        Whether a new state is due 30 times a second; else only after a wish.
    """

    runs: bool

    def ask(self, wish: Mapping[str, Any]) -> None:
        """Take a wish; ValueError: it is refused, in a sentence."""

    def text(self) -> str:
        """The state that is to be sent now."""


class _Browser:
    """One WebSocket and what waits to be sent to it."""

    def __init__(
        self, socket: web.WebSocketResponse, identity: str, watcher: Watcher | None
    ) -> None:
        self.socket, self.identity, self.watcher = socket, identity, watcher
        self.state: str | Callable[[], str] | None = None
        self.waiting: deque[str] = deque(maxlen=_MAX_WAITING)
        self.news, self.asked = asyncio.Event(), asyncio.Event()
        self.running_commands = 0

    async def send_all(self) -> None:
        """Send what comes until the connection is gone."""
        while not self.socket.closed:
            await self.news.wait()
            self.news.clear()
            while self.waiting:
                await self.socket.send_str(self.waiting.popleft())
            if self.state is not None:
                state, self.state = self.state, None
                # Of a replay it is made only now: a slow browser skips states, not rows.
                await self.socket.send_str(state if isinstance(state, str) else state())

    async def watch(self) -> None:
        """Have states sent as the watcher goes on; at once after a wish."""
        watcher = self.watcher
        while watcher is not None:
            self.state = watcher.text
            self.news.set()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_FRAME_S if watcher.runs else None):
                    await self.asked.wait()
            self.asked.clear()


class PageServer:
    """Serves a folder at `/` and the live data at `/ws`.

    Parameters
    ----------
    folder : Path
        The page's files.
    port : int
        On 127.0.0.1; 0 for any free one.
    access : Access
        Judges tokens.
    hello : callable
        Makes the first message (JSON text) of a connection; called in the server's thread.
    on_command : callable
        Takes an admitted `BrowserCommand`; called in the server's thread.
    watch : callable, optional
        Makes the `Watcher` of a new connection; None: all see the same states, which are sent.
    beside : mapping, optional
        Files of elsewhere by the names under which they are served, each a page in one file.
    port_names : (str, str)
        Parameter and option by which the user names the port, for the error.

    Raises
    ------
    PortError
        The port cannot be bound.

    Attributes
    ----------
    url : str
        Where the page is.
    refused : Counter of RequestRefusal
        How often what was turned away.
    came : threading.Event
        Set as soon as a browser has been there.
    """

    def __init__(
        self,
        folder: Path,
        port: int,
        access: Access,
        hello: Callable[[], str],
        on_command: Callable[[BrowserCommand], None],
        watch: Callable[[], Watcher] | None = None,
        beside: Mapping[str, Path] | None = None,
        port_names: tuple[str, str] = ("port", "--live-port"),
    ) -> None:
        self._folder = folder.resolve()
        self._access, self._hello, self._on_command = access, hello, on_command
        self._watch, self._beside = watch, dict(beside or {})
        self._socket = listen(port, *port_names)
        self.port = self._socket.getsockname()[1]
        self.url = f"http://{LOOPBACK}:{self.port}/"
        self._browsers: set[_Browser] = set()
        self.refused: Counter[RequestRefusal] = Counter()
        self._loop = asyncio.new_event_loop()
        self._stopping = asyncio.Event()
        self.came = threading.Event()
        self._thread = threading.Thread(target=self._run, name="page_server", daemon=True)

    # --- from any thread ---------------------------------------------------------------------

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def stop(self) -> None:
        """Send what waits, say good-bye to the browsers, end the thread; harmless twice."""
        if self._thread.is_alive():
            self._call(self._stopping.set)
            self._thread.join(2.0 * _STOP_S)
        self._socket.close()

    @property
    def viewers(self) -> int:
        """Browsers that look now."""
        return len(self._browsers)

    def send_state(self, text: str) -> None:
        """Give a state to all browsers; one that has not taken the last one loses that."""
        self._call(self._put_state, text)

    def send(self, text: str) -> None:
        """Give a message that is not to be skipped to all browsers."""
        self._call(self._put, text)

    def _call(self, function: Callable[..., None], *args: Any) -> None:
        try:
            self._loop.call_soon_threadsafe(function, *args)
        except RuntimeError:
            _LOG.debug("the page server has ended")

    # --- in the server's thread --------------------------------------------------------------

    def _put_state(self, text: str) -> None:
        for browser in self._browsers:
            browser.state = text
            browser.news.set()

    def _put(self, text: str) -> None:
        for browser in self._browsers:
            browser.waiting.append(text)
            browser.news.set()

    def _run(self) -> None:
        # It ends what is still under way, such as to send to a browser that reads nothing.
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        app = web.Application(middlewares=[self._guard])
        app.router.add_get("/ws", self._on_socket)
        app.router.add_get("/{path:.*}", self._on_file)
        errors = logging.Logger("page_server")
        errors.addHandler(_RequestErrors(self.refused))
        runner = web.AppRunner(
            app, access_log=None, logger=errors, handle_signals=False, shutdown_timeout=_STOP_S,
            keepalive_timeout=_REQUEST_LIMIT_S,
        )  # fmt: skip
        await runner.setup()
        accepting = asyncio.ensure_future(self._accept(runner.server))
        await self._stopping.wait()
        accepting.cancel()
        # Callbacks that were handed over before the stop have run; let the last texts go out.
        for browser in list(self._browsers):
            browser.news.set()
        await asyncio.sleep(0.05)
        browsers = list(self._browsers)
        closing = [asyncio.ensure_future(b.socket.close(code=1001)) for b in browsers]
        if closing:
            # One that reads nothing does not say good-bye either.
            await asyncio.wait(closing, timeout=_STOP_S)
        await runner.cleanup()

    async def _accept(self, server: Any) -> None:
        """Hand connections to the server (aiohttp's), which has no bound of its own for them."""
        while True:
            try:
                connection, _ = await self._loop.sock_accept(self._socket)
            except OSError as error:
                _LOG.debug("a connection was not taken: %s", error)
                await asyncio.sleep(_ACCEPT_AGAIN_S)
                continue
            if len(server.connections) >= _MAX_CONNECTIONS:
                connection.close()
                self.refused[RequestRefusal.CONNECTIONS] += 1
                continue
            with contextlib.suppress(OSError):
                await self._loop.connect_accepted_socket(server, connection)

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        """Refuse foreign hosts (DNS rebinding) and put the headers on every answer."""
        host = request.headers.get("Host", "")
        if host.rpartition(":")[0] not in _HOSTS and host not in _HOSTS:
            self.refused[RequestRefusal.HOSTS] += 1
            response: web.StreamResponse = web.Response(status=403, text="not served to this host")
        else:
            try:
                response = await handler(request)
            except web.HTTPException as error:
                response = error
        if not response.prepared:
            policy = _REPORT_POLICY if request.match_info.get("path") in self._beside else _POLICY
            response.headers.update(_headers(host, policy))
        return response

    async def _on_file(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["path"] or "index.html"
        try:
            path = self._beside.get(name) or (self._folder / name).resolve()
            known = name in self._beside or path.is_relative_to(self._folder)
            known = known and path.is_file()
        except (OSError, ValueError):  # a name that no file can have
            known = False
        if not known:
            return web.Response(status=404, text="no such file")
        kind = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0]
        content = await asyncio.to_thread(path.read_bytes)
        response = web.Response(body=content, content_type=kind or "application/octet-stream")
        if kind and kind.startswith("text/"):
            response.charset = "utf-8"
        if _COOKIE not in request.cookies:
            identity = secrets.token_urlsafe(16)
            response.set_cookie(_COOKIE, identity, httponly=True, samesite="Strict", path="/")
        return response

    async def _on_socket(self, request: web.Request) -> web.StreamResponse:
        origin = request.headers.get("Origin")
        if origin is not None and origin != f"http://{request.headers.get('Host', '')}":
            self.refused[RequestRefusal.ORIGINS] += 1
            return web.Response(status=403, text="not served to this origin")
        socket = web.WebSocketResponse(
            heartbeat=_HEARTBEAT_S, compress=False, max_msg_size=_MAX_REQUEST_BYTES
        )
        await socket.prepare(request)
        identity = request.cookies.get(_COOKIE) or secrets.token_urlsafe(16)
        browser = _Browser(socket, identity, self._watch() if self._watch else None)
        browser.waiting.append(self._hello())
        browser.news.set()
        self._browsers.add(browser)
        self.came.set()
        sending = asyncio.gather(browser.send_all(), browser.watch())
        try:
            async for message in socket:
                if message.type == WSMsgType.TEXT:
                    self._take(browser, message.data)
                else:
                    self.refused[RequestRefusal.FRAMES] += 1
        finally:
            self._browsers.discard(browser)
            sending.cancel()
            results = await asyncio.gather(sending, return_exceptions=True)
            _LOG.debug("a browser went away: %s", results[0])
        return socket

    # --- requests ----------------------------------------------------------------------------

    def _take(self, browser: _Browser, text: str) -> None:
        try:
            request = json.loads(text)
        except (ValueError, RecursionError):
            request = None
        number = request.get("id") if isinstance(request, dict) else None
        number = number if isinstance(number, (int, str)) else None

        def reply(ok: bool, sentence: str) -> None:
            answer = {"type": "answer", "id": number, "ok": ok, "text": sentence}
            self._call(self._answer, browser, json.dumps(answer))

        kind = request.get("type") if isinstance(request, dict) else None
        if kind == "replay":
            self._wish(browser, request, reply)
            return
        if not isinstance(request, dict) or kind not in ("auth", "command"):
            self.refused[RequestRefusal.TEXTS] += 1
            reply(False, _NOT_JSON)
            return
        now_s = time.monotonic()
        refusal = self._access.refusal(request.get("token"), browser.identity, now_s)
        if refusal:
            self.refused[RequestRefusal.TOKENS] += 1
            reply(False, refusal)
        elif request["type"] == "auth":
            reply(True, "commands are allowed in this browser")
        else:
            self._admit(browser, request, reply)

    @staticmethod
    def _wish(
        browser: _Browser, request: Mapping[str, Any], reply: Callable[[bool, str], None]
    ) -> None:
        """Where a browser wants to be in a replay: its own affair, so it needs no token."""
        if browser.watcher is None:
            reply(False, _LIVE)
            return
        try:
            browser.watcher.ask(request)
        except ValueError as error:
            reply(False, str(error))
            return
        browser.asked.set()

    def _admit(
        self, browser: _Browser, request: dict[str, Any], reply: Callable[[bool, str], None]
    ) -> None:
        name, args = request.get("name"), request.get("args", {})
        if not isinstance(name, str) or not isinstance(args, dict):
            self.refused[RequestRefusal.TEXTS] += 1
            reply(False, "not understood: expected a name and args")
            return
        if browser.running_commands >= _MAX_COMMANDS:
            self.refused[RequestRefusal.FLOODS] += 1
            reply(False, "too many commands at once: wait for the answers")
            return
        browser.running_commands += 1

        def done(ok: bool, sentence: str) -> None:
            browser.running_commands -= 1
            reply(ok, sentence)

        self._on_command(BrowserCommand(name, args, done))

    def _answer(self, browser: _Browser, text: str) -> None:
        browser.waiting.append(text)
        browser.news.set()


def _headers(host: str, policy: str) -> dict[str, str]:
    """Security headers of every answer to a request for this (already accepted) host."""
    return {
        "Content-Security-Policy": policy.format(host=host if _is_plain(host) else LOOPBACK),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cache-Control": "no-store",
        "Server": "heli-hover",
    }


def _is_plain(host: str) -> bool:
    return host.replace(":", "").replace(".", "").replace("[", "").replace("]", "").isalnum()


# -------------------------------------------------------------------------------------------------
# Where the page's files are. No ROS.
# -------------------------------------------------------------------------------------------------


def web_folder() -> Path:
    """Folder with the page.

    Raises
    ------
    MissingFileError
        The page is not installed.
    """
    folder = command_line.share_folder("heli_live_view") / "web"
    if not (folder / "index.html").is_file():
        raise command_line.MissingFileError(f"the page is not installed: no {folder}/index.html")
    return folder
