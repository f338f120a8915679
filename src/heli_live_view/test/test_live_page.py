# SPDX-License-Identifier: Apache-2.0
"""The page's server alone: who owns the token, who is slow, what is refused. No ROS."""

import asyncio
import contextlib
import json
import re
import socket
from pathlib import Path
from urllib.parse import urlsplit

import aiohttp
import pytest

from heli_live_view.access import RECORDED, TAKEN, VIEW_ONLY, Access, PortError
from heli_live_view.server import PageServer

COMMAND = {"type": "command", "id": 7, "token": "secret", "name": "gust", "args": {"x": 1}}


@pytest.fixture
def serve(tmp_path):
    (tmp_path / "index.html").write_text("<p>page</p>")
    servers, commands = [], []

    def start(token="secret", obey=True):
        def on_command(command):
            commands.append((command.name, command.args))
            if obey:
                command.reply(True, "done")

        server = PageServer(tmp_path, 0, Access(token), lambda: '{"type":"hello"}', on_command)
        server.start()
        servers.append(server)
        return server, commands

    yield start
    for server in servers:
        server.stop()


async def answer(connection, request):
    text = request if isinstance(request, str) else json.dumps(request)
    await connection.send_str(text)
    while True:
        message = json.loads((await connection.receive(120.0)).data)
        if message["type"] == "answer":
            return message


def browser():
    # Cookies of addresses, as browsers keep them.
    return aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True))


def test_the_first_browser_owns_the_token_over_reloads(serve):
    server, commands = serve()

    async def use():
        async with browser() as first, browser() as second:
            for session in (first, second):
                await session.get(server.url)
            async with first.ws_connect(f"{server.url}ws") as connection:
                got = await answer(connection, COMMAND)
                assert got == {"type": "answer", "id": 7, "ok": True, "text": "done"}
            async with second.ws_connect(f"{server.url}ws") as connection:
                assert (await answer(connection, COMMAND))["text"] == TAKEN
            async with first.ws_connect(f"{server.url}ws") as connection:
                assert (await answer(connection, {**COMMAND, "type": "auth"}))["ok"]

    asyncio.run(use())
    assert commands == [("gust", {"x": 1})]


def test_view_only_refuses_every_command(serve):
    server, commands = serve(token="")

    async def use():
        async with browser() as session, session.ws_connect(f"{server.url}ws") as connection:
            assert (await answer(connection, COMMAND))["text"] == VIEW_ONLY

    asyncio.run(use())
    assert commands == []


@pytest.mark.parametrize(
    "text", ["", "gust", "[]", "null", '{"type":"state"}', "[" * 3000, '{"type":"command"}']
)
def test_what_is_not_understood_is_answered(serve, text):
    server, commands = serve()

    async def use():
        async with browser() as session, session.ws_connect(f"{server.url}ws") as connection:
            assert not (await answer(connection, text))["ok"]
            assert (await answer(connection, COMMAND))["ok"]

    asyncio.run(use())
    assert len(commands) == 1


def test_requests_are_bounded_in_size_and_number(serve):
    server, commands = serve(obey=False)

    async def use():
        async with browser() as session, session.ws_connect(f"{server.url}ws") as connection:
            for _ in range(9):
                await connection.send_str(json.dumps(COMMAND))
            assert "too many" in json.loads((await _second(connection)).data)["text"]
            await connection.send_str("x" * 5000)
            while (await connection.receive(120.0)).type == aiohttp.WSMsgType.TEXT:
                continue
            assert connection.close_code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG

    asyncio.run(use())
    assert len(commands) == 8


async def _second(connection):
    await connection.receive(120.0)
    return await connection.receive(120.0)


def test_a_browser_that_reads_nothing_holds_up_nobody(serve):
    server, _ = serve()
    place = urlsplit(server.url)
    deaf = socket.create_connection((place.hostname, place.port))
    deaf.sendall(
        f"GET /ws HTTP/1.1\r\nHost: {place.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n".encode()
    )
    state = json.dumps({"type": "state", "filling": "x" * 100_000})

    async def use():
        async with browser() as session, session.ws_connect(f"{server.url}ws") as connection:
            await connection.receive(120.0)
            for i in range(300):  # 30 MB, far more than sockets hold
                server.send_state(state)
                server.send(json.dumps({"type": "event", "text": i}))
                while json.loads((await connection.receive(120.0)).data).get("text") != i:
                    continue

    asyncio.run(use())
    server.stop()
    server._thread.join(50.0)
    assert not server._thread.is_alive(), "aiohttp waits a minute for such a browser"
    assert not asyncio.all_tasks(server._loop), "left to the garbage collector"
    deaf.close()
    server.send_state("{}")  # nobody is there any more: nothing happens


def half_a_request(server):
    place = urlsplit(server.url)
    connection = socket.create_connection((place.hostname, place.port), timeout=280.0)
    connection.sendall(b"GET / HTTP/1.1\r\nHo")
    return connection


def test_half_a_request_is_given_up(serve, monkeypatch):
    """Who watches is none: a WebSocket stays."""
    monkeypatch.setattr("heli_live_view.server._REQUEST_LIMIT_S", 0.2)
    server, _ = serve()

    async def use():
        async with browser() as session, session.ws_connect(f"{server.url}ws") as connection:
            with half_a_request(server) as half:
                assert await asyncio.to_thread(half.recv, 1) == b"", "closed"
            assert (await answer(connection, COMMAND))["ok"]

    asyncio.run(use())


def test_connections_are_bounded_and_free_again(serve, monkeypatch):
    monkeypatch.setattr("heli_live_view.server._MAX_CONNECTIONS", 4)
    server, _ = serve()

    async def use():
        async with browser() as session, session.ws_connect(f"{server.url}ws") as connection:
            await connection.receive(120.0)
            halves = [half_a_request(server) for _ in range(3)]
            with half_a_request(server) as beyond, contextlib.suppress(ConnectionResetError):
                assert await asyncio.to_thread(beyond.recv, 1) == b"", "refused at once"
            assert (await answer(connection, COMMAND))["ok"], "who is there stays"
            halves[0].close()
            while True:  # until the server has noticed
                with contextlib.suppress(aiohttp.ClientConnectionError):
                    async with session.get(server.url) as page:
                        assert page.status == 200
                        break
            for half in halves:
                half.close()

    asyncio.run(use())


def test_a_port_in_use_is_named(serve, tmp_path):
    server, _ = serve()
    with pytest.raises(PortError, match=rf"port: port {server.port} .* in use .* --live-port"):
        PageServer(tmp_path, server.port, Access(""), str, print)


WEB = Path(__file__).resolve().parents[1] / "web"


def policy_of(text):
    parts = [part.split() for part in text.split(";") if part.strip()]
    return {name: sources for name, *sources in parts}


def test_every_answer_forbids_to_send_elsewhere(serve):
    server, _ = serve()
    host = urlsplit(server.url).netloc

    async def use():
        async with browser() as session:
            for path in ("", "no_such_file"):
                async with session.get(f"{server.url}{path}") as answered:
                    policy = policy_of(answered.headers["Content-Security-Policy"])
                    assert policy["connect-src"] == ["'self'", f"ws://{host}"]
                    assert policy["script-src"] == policy["style-src"] == ["'self'"]
                    for name in ("default-src", "form-action", "base-uri", "frame-ancestors"):
                        assert policy[name] == ["'none'"], name
                    assert answered.headers["Referrer-Policy"] == "no-referrer"

    asyncio.run(use())


def test_the_page_itself_forbids_it_too_and_loads_nothing_foreign():
    text = (WEB / "index.html").read_text(encoding="utf-8")
    (meta,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]+)"', text)
    policy = policy_of(meta)
    assert policy["default-src"] == policy["form-action"] == policy["base-uri"] == ["'none'"]
    assert policy["connect-src"] == policy["script-src"] == policy["style-src"] == ["'self'"]
    assert "unsafe" not in meta and not re.search(r"\son\w+=|<style|style=", text)
    addresses = re.findall(r'(?:src|href|action)="([^"]+)"', text)
    assert addresses and all((WEB / address).is_file() for address in addresses)
    for script in WEB.glob("*.js"):
        code = script.read_text(encoding="utf-8")
        assert not re.search(r"https?://|fetch\(|sendBeacon|XMLHttpRequest|window\.open", code)


class Place:
    """Where one browser is: the least that a watcher must be."""

    def __init__(self):
        self.runs, self.at = False, 0

    def ask(self, wish):
        if not isinstance(wish.get("at"), int):
            raise ValueError("at: not allowed")
        self.at = wish["at"]

    def text(self):
        return json.dumps({"type": "state", "at": self.at})


async def state_of(connection, at):
    while True:
        message = json.loads((await connection.receive(120.0)).data)
        if message["type"] == "state" and message["at"] == at:
            return


def test_each_browser_of_a_replay_has_its_own_time_and_needs_no_token(tmp_path):
    report = tmp_path / "elsewhere" / "report.html"
    report.parent.mkdir()
    report.write_text("<script>1</script>")
    (tmp_path / "web").mkdir()
    (tmp_path / "web/index.html").write_text("<p>page</p>")
    server = PageServer(
        tmp_path / "web", 0, Access("", RECORDED), lambda: '{"type":"hello"}', print, Place,
        {"report.html": report},
    )  # fmt: skip
    server.start()

    async def use():
        async with browser() as session, browser() as other:
            first = await session.ws_connect(f"{server.url}ws")
            second = await other.ws_connect(f"{server.url}ws")
            for connection, at in ((first, 5), (second, 9)):
                await state_of(connection, 0)
                await connection.send_str(json.dumps({"type": "replay", "id": 1, "at": at}))
                await state_of(connection, at)
            assert server.viewers == 2 and server.came.is_set()
            assert (await answer(first, {"type": "replay", "at": "x"}))["text"] == "at: not allowed"
            assert (await answer(first, COMMAND))["text"] == RECORDED
            await refused_as_ever(session)

    async def refused_as_ever(session):
        port = urlsplit(server.url).port
        for host in (f"rebound.example:{port}", "rebound.example"):
            async with session.get(server.url, headers={"Host": host}) as page:
                assert page.status == 403
        with pytest.raises(aiohttp.WSServerHandshakeError):
            await session.ws_connect(f"{server.url}ws", headers={"Origin": "http://other.example"})
        # What a flight's folder holds runs in an origin of its own and can send nothing.
        async with session.get(f"{server.url}report.html") as page:
            policy = policy_of(page.headers["Content-Security-Policy"])
            assert page.status == 200 and await page.text() == "<script>1</script>"
            assert "allow-same-origin" not in policy["sandbox"] and "connect-src" not in policy
            assert policy["default-src"] == policy["form-action"] == ["'none'"]
        for path in ("result.json", "elsewhere/report.html", "%2e%2e/elsewhere/report.html"):
            async with session.get(f"{server.url}{path}") as page:
                assert page.status == 404

    try:
        asyncio.run(use())
    finally:
        server.stop()


def test_a_live_flight_cannot_be_wound(serve):
    server, _ = serve()

    async def use():
        async with browser() as session, session.ws_connect(f"{server.url}ws") as connection:
            reply = await answer(connection, {"type": "replay", "at": 3.0})
            assert not reply["ok"] and "not a replay" in reply["text"]

    asyncio.run(use())
