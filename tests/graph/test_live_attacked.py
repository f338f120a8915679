# SPDX-License-Identifier: Apache-2.0
"""`--live --allow-commands` while another user of the machine does to its page what he can."""

import asyncio
import contextlib
import json
import os
import socket
import subprocess
import sys
from urllib.parse import urlsplit

import aiohttp
import pytest

from heli_core.command_line import executable
from heli_live_view.server import RequestRefusal
from support.live_watcher import read_until, watching

SECONDS, LIMIT_S = 100, 400.0
"""Of flight, in lockstep: seconds of wall time. In real time a tenth of it."""
GUST = {"amplitude_mps": 2.0, "from_deg": 0.0, "duration_s": 1.0}
UPGRADE = (
    "GET /ws HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
)
NONE_OF_HTTP = (
    b"\x00" * 4096, b"GET " + b"a" * 100_000, b"POST / HTTP/9.9\r\n\r\n", os.urandom(2048),
    b"GET / HTTP/1.1\r\nHost: x\r\nContent-Length: -1\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 20_000,
)  # fmt: skip
FRAMES = (
    b"\x81\x7f" + (1 << 62).to_bytes(8, "big"),  # a text of 4 EB that is not masked
    b"\x81\xff" + (1 << 62).to_bytes(8, "big") + b"mask",
    b"\xff\xff" * 100, b"\x83\x80mask", b"\x89\xfe\xff\xffmask", os.urandom(512),
)  # fmt: skip
TEXTS = (
    "", "[" * 4000, "null", '{"type": "command"}', '{"type": "command", "token": NaN}',
    '{"type":"replay","at":NaN}', "\ud800".encode("utf-8", "replace").decode(),
)  # fmt: skip
OUT_OF_RANGE = (
    ("gust", {**GUST, "amplitude_mps": float("nan")}), ("gust", {**GUST, "duration_s": 1e300}),
    ("gust", {**GUST, "from_deg": float("inf")}), ("gust", {"amplitude_mps": [[[]]]}), ("gust", {}),
    ("reference", {"p": [float("nan")] * 3, "yaw_deg": 0.0}), ("reference", {"p": "up"}),
    ("reference", {"p": [1e9, 0.0, -1e9], "yaw_deg": 1e99}), ("mode", {"mode": {}}),
    ("fault", {"what": "imu", "kind": "bias", "value": [float("nan")]}), ("fault", {"what": 1}),
    ("no such command", {}),
)  # fmt: skip


def sent(place, *parts, wait=False):
    """Open a connection, send, and look no further; the socket, half open."""
    one = socket.create_connection((place.hostname, place.port), timeout=10.0)
    with contextlib.suppress(OSError):
        for part in parts:
            one.sendall(part)
        while wait and one.recv(65536):
            continue
    return one


def flood(url):
    """Once round; the sockets that stay half open."""
    place = urlsplit(url)
    upgrade = UPGRADE.format(host=place.netloc).encode()
    for raw in NONE_OF_HTTP:
        sent(place, raw).close()
    for raw in FRAMES:
        sent(place, upgrade, raw).close()
    return [sent(place, b"GET / HT") for _ in range(20)] + [sent(place) for _ in range(20)]


async def attack(url):
    """Once round through a WebSocket that obeys the protocol, and a page of elsewhere."""
    async with aiohttp.ClientSession() as session:
        elsewhere = {"Origin": "http://elsewhere.example"}
        with contextlib.suppress(aiohttp.ClientError):
            await session.ws_connect(f"{url}ws", headers=elsewhere)
        with contextlib.suppress(aiohttp.ClientError):
            await session.get(url, headers={"Host": "rebound.example"})
        with contextlib.suppress(aiohttp.ClientError, ConnectionError):
            async with session.ws_connect(f"{url}ws") as connection:
                for text in TEXTS:
                    await connection.send_str(text)
                for token in (None, "", "guess", 7, [], "x" * 3000):
                    request = {"type": "command", "token": token, "name": "gust", "args": GUST}
                    await connection.send_str(json.dumps(request))
                await connection.send_bytes(b"\x00" * 4000)
                await connection.send_str("x" * 5000)


def named(watcher):
    """What the live view has said that it turns away."""
    said = (event["text"] for event in watcher.events if event["source"] == "live_view")
    return {text.removeprefix("refused: ") for text in said}


async def attacked(url, token, begin, wanted):
    """The user's browser among them: what it was answered, in turn, until all that is wanted was
    named and the flight is over."""
    answers, held = [], []
    try:
        async with watching(url) as watcher:
            begin()
            await watcher.until_state(lambda s: (s["t"] or 0.0) > 0.5)
            while watcher.last["mode"] != "over" or not named(watcher) >= wanted:
                # More than the server takes, which gives up those that say nothing.
                held = held[-40:] + await asyncio.to_thread(flood, url)
                await attack(url)
                for name, args in OUT_OF_RANGE if len(answers) < 50 else ():
                    refused = await watcher.command(token, name, **args)
                    assert not refused["ok"], (name, args, refused)
                    answers.append(refused["text"])
                legal = await watcher.command(token, "gust", **GUST)
                answers.append((legal["ok"], legal["text"]))
                await watcher.until_state(lambda s: True)
    finally:
        for one in held:
            one.close()
    return answers


def fly(out, env, *words):
    return subprocess.Popen(
        [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--world", "paper",
         "--out", str(out), *words],
        env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


@pytest.mark.slow
def test_a_flight_in_lockstep_is_the_same_to_the_last_bit(tmp_path, ros_env, living):
    words = ["--duration", str(SECONDS)]
    plain = fly(tmp_path / "plain", ros_env, *words)
    assert plain.communicate(timeout=LIMIT_S)[0] and plain.returncode == 0
    program, flights = executable("heli_live_view", "live_view"), []
    with open(tmp_path / "view.log", "w") as log:
        view = subprocess.Popen(
            [sys.executable, str(program), "--ros-args", "-p", "port:=0", "-p", "foxglove:=false",
             "-p", "allow_commands:=true"],
            env=ros_env, stdout=subprocess.PIPE, stderr=log, text=True,
        )  # fmt: skip
    try:
        printed = read_until(view.stdout, ["live view", "command token"])

        def begin():
            flights.append(fly(tmp_path / "attacked", ros_env, *words))

        url, token = printed["live view"], printed["command token"]
        wanted = set(RequestRefusal) - {RequestRefusal.FLOODS}
        answers = asyncio.run(attacked(url, token, begin, wanted))
        output, _ = flights[0].communicate(timeout=LIMIT_S)
        assert flights[0].returncode == 0, output
        view.terminate()
        assert view.wait(timeout=50.0) == 0
    finally:
        view.kill()
    truth = [(tmp_path / name / "truth.sums").read_bytes() for name in ("plain", "attacked")]
    assert truth[0] == truth[1] and len(truth[0]) == 8 * 100 * SECONDS
    # The user is answered every time: that commands need a flight in real time.
    assert any("lockstep" in text for _, text in filter(is_pair, answers)), answers
    assert (tmp_path / "view.log").stat().st_size < 20_000
    assert living() == []


def is_pair(answer):
    return isinstance(answer, tuple)


@pytest.mark.slow
def test_a_legal_command_is_obeyed_meanwhile(tmp_path, ros_env, living):
    out = tmp_path / "flight"
    flight = fly(
        out,
        ros_env,
        "--live",
        "--allow-commands",
        "--live-port",
        "0",
        "--duration",
        str(SECONDS // 10),
    )
    try:
        printed = read_until(flight.stdout, ["live view", "command token"])
        url, token = printed["live view"], printed["command token"]
        answers = asyncio.run(attacked(url, token, lambda: None, set()))
        rest, _ = flight.communicate(timeout=LIMIT_S)
    finally:
        flight.kill()
    assert flight.returncode in (0, 1), rest
    assert any(ok for ok, _ in filter(is_pair, answers)), answers
    facts = json.loads((out / "result.json").read_text())
    assert not facts["lost"]
    assert living() == []
