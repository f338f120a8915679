# SPDX-License-Identifier: Apache-2.0
"""The live view beside a flying graph: states, history, commands, Foxglove, vanishing browsers."""

import asyncio
import json
import signal
import socket
import struct
import subprocess
import sys
from urllib.parse import urlsplit

import aiohttp
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from heli_core.command_line import executable
from heli_dynamics_sim.plant import PlantStatus
from heli_live_view import access
from support.live_watcher import LIMIT_S, read_until, watching

# Long enough for all that is asked and commanded, also on a loaded machine.
WATCHED_S = 40


async def vanish(url):
    """One browser breaks off without a word, another never reads what it is sent."""
    async with aiohttp.ClientSession() as session:
        connection = await session.ws_connect(f"{url}ws")
        connection._response.connection.transport.abort()
    place = urlsplit(url)
    deaf = socket.create_connection((place.hostname, place.port))
    deaf.sendall(
        f"GET /ws HTTP/1.1\r\nHost: {place.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n".encode()
    )
    return deaf


async def decode_foxglove(url, wanted):
    """One message of each wanted topic, decoded by the definition that the server advertises."""
    decoded, channels = {}, {}
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(url, protocols=["foxglove.sdk.v1"], max_msg_size=0) as connection,
        asyncio.timeout(LIMIT_S),
    ):
        while set(decoded) != set(wanted):
            message = await connection.receive()
            if message.type == aiohttp.WSMsgType.TEXT:
                content = json.loads(message.data)
                new = content.get("channels", []) if content["op"] == "advertise" else []
                channels |= {c["id"]: c for c in new if c["topic"] in wanted}
                subscriptions = [
                    {"id": c["id"], "channelId": c["id"]} for c in new if c["topic"] in wanted
                ]
                request = {"op": "subscribe", "subscriptions": subscriptions}
                await connection.send_str(json.dumps(request))
            elif message.data[0] == 1:
                channel = channels[struct.unpack_from("<I", message.data, 1)[0]]
                assert channel["encoding"] == "cdr" and channel["schemaEncoding"] == "ros2msg"
                store = get_typestore(Stores.EMPTY)
                store.register(get_types_from_msg(channel["schema"], channel["schemaName"]))
                decoded[channel["topic"]] = store.deserialize_cdr(
                    message.data[13:], channel["schemaName"]
                )
    return decoded


async def refusals(url):
    """Foreign pages are kept out; what is served carries its headers."""
    port = urlsplit(url).port
    async with aiohttp.ClientSession() as session:
        async with session.get(url) as page:
            assert page.status == 200 and page.content_type == "text/html"
            assert "default-src 'none'" in page.headers["Content-Security-Policy"]
            assert page.headers["X-Content-Type-Options"] == "nosniff"
        for path in ("no_such.js", "%2e%2e/package.xml", "..%2fpackage.xml"):
            async with session.get(f"{url}{path}") as page:
                assert page.status == 404
        async with session.get(url, headers={"Host": f"rebound.example:{port}"}) as page:
            assert page.status == 403
        with pytest.raises(aiohttp.WSServerHandshakeError):
            await session.ws_connect(f"{url}ws", headers={"Origin": "http://elsewhere.example"})


async def watch_flight(url, foxglove_url, token):
    async with watching(url) as watcher:
        assert watcher.hello["commands"] and watcher.hello["flight"]["realtime"]
        assert watcher.hello["flight"]["duration_s"] == WATCHED_S
        await watcher.until_state(
            lambda s: (s["t"] or 0.0) > 1.0 and s["mode"] == "hover" and not s["alarms"]
        )
        assert abs(watcher.last["truth"]["p"][2] - 10.0) < 1.0
        # Before anything is commanded: hover, gravity upwards.
        latest = await decode_foxglove(foxglove_url, {"/odom", "/imu/data_raw", "/scene", "/tf"})
        assert abs(latest["/odom"].pose.pose.position.z - 10.0) < 1.0
        assert 8.0 < latest["/imu/data_raw"].linear_acceleration.z < 12.0
        assert "rotor_disc" in {marker.ns for marker in latest["/scene"].markers}
        assert latest["/tf"].transforms[0].child_frame_id == "base_link"
        deaf = await vanish(url)
        await refusals(url)
        # Who does not read loses states: catch up with the flight before they are counted.
        await commands(watcher, url, token)
        before, begun = watcher.states, watcher.last["t"]
        await watcher.until_state(lambda s: s["t"] > begun + 2.0)
        assert 2 <= watcher.states - before <= 66, "30 states a second, fewer on loaded cores"
        async with watching(url) as late:
            times = [row["t"] for row in late.hello["history"]]
            assert times[0] < 1.0 and len(times) > times[-1]
            assert min(b - a for a, b in zip(times, times[1:], strict=False)) > 0.09
        await watcher.until_state(lambda s: s["mode"] == "over")
        assert watcher.last["end"]["kind"] == "over"
        deaf.close()
        return watcher


async def faults(watcher, token):
    """A fault begins by the plant's clock, is listed, refused in the plant's words, cleared."""
    answer = await watcher.command(token, "fault", what="baro", kind="bias", value=[20.0])
    assert answer["ok"] and answer["text"].startswith("baro bias ")
    await watcher.until_state(lambda s: s["faults"])
    (listed,) = watcher.last["faults"]
    began_s = float(listed.removeprefix("baro bias 20 from ").removesuffix(" s on"))
    assert 0.0 < began_s <= watcher.last["t"] + 0.1
    answer = await watcher.command(token, "fault", what="baro", kind="melts")
    assert not answer["ok"] and "melts" in answer["text"]
    answer = await watcher.command(token, "clear_faults")
    assert answer["ok"] and listed in answer["text"]
    await watcher.until_state(lambda s: not s["faults"])


async def commands(watcher, url, token):
    gust = {"amplitude_mps": 6.0, "from_deg": 90.0, "duration_s": 1.0}
    for wrong in ("", "guess"):
        answer = await watcher.command(wrong, "gust", **gust)
        assert not answer["ok"] and answer["text"] == access.WRONG
    east = watcher.last["wind_enu"][0]
    answer = await watcher.command(token, "gust", **gust)
    assert answer["ok"] and "6 m/s from 90 deg" in answer["text"]
    await watcher.until_state(lambda s: s["wind_enu"][0] < east - 4.5)
    async with watching(url) as other:
        answer = await other.ask(type="auth", token=token)
        assert not answer["ok"] and answer["text"] == access.TAKEN
    await faults(watcher, token)
    answer = await watcher.command(token, "reference", p=[0.0, 0.0, 1.0], yaw_deg=0.0)
    assert not answer["ok"] and "2 to 100 m" in answer["text"]
    answer = await watcher.command(token, "reference", p=[1.0, 0.5, 11.0], yaw_deg=10.0)
    assert answer["ok"], answer
    await watcher.until_state(lambda s: s["ref"]["p"] == [1.0, 0.5, 11.0])
    await watcher.until_state(lambda s: abs(s["nav"]["p"][2] - 11.0) < 0.3)
    assert (await watcher.command(token, "mode", mode="attitude"))["ok"]
    await watcher.until_state(lambda s: s["mode"] == "attitude" and s["alarms"])
    assert watcher.last["end"] is None
    assert [a["source"] for a in watcher.last["alarms"] if "nothing holds" in a["text"]] == ["mode"]
    assert {e["level"] for e in watcher.events if "nothing holds position" in e["text"]} == {1}
    assert not (await watcher.command(token, "reference", p=[0, 0, 10], yaw_deg=0))["ok"]
    assert (await watcher.command(token, "mode", mode="hover"))["ok"]
    await watcher.until_state(lambda s: s["mode"] == "hover")


@pytest.mark.slow
def test_a_flight_is_watched_and_commanded(tmp_path, ros_env, living):
    out = tmp_path / "flight"
    process = subprocess.Popen(
        [sys.executable, "-m", "heli_flight.cli.hover_test", "--live", "--allow-commands",
         "--live-port", "0", "--foxglove-port", "0", "--duration", str(WATCHED_S), "--gps", "rtk",
         "--world", "paper", "--no-report", "--out", str(out)],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        printed = read_until(process.stdout, ["live view", "Foxglove", "command token"])
        watcher = asyncio.run(
            watch_flight(printed["live view"], printed["Foxglove"], printed["command token"])
        )
        rest, _ = process.communicate(timeout=120.0)
    finally:
        process.kill()
    assert process.returncode in (0, 1), rest  # commanded about, it need not meet the paper's
    result = json.loads((out / "result.json").read_text())
    assert any(note.startswith("commands ") and ": 6;" in note for note in result["notes"])
    assert any("baro bias 20" in note for note in result["notes"])
    assert any(event["text"].endswith(f" {WATCHED_S} s") for event in watcher.events)
    secret = printed["command token"].encode()
    assert not [path for path in out.rglob("*") if path.is_file() and secret in path.read_bytes()]
    assert living() == []


async def watch_until_the_end(url, process, how):
    async with watching(url) as watcher:
        await watcher.until_state(lambda s: (s["t"] or 0.0) > 1.0)
        how(process)
        return (await watcher.until_state(lambda s: s["mode"] == "over"))["end"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["lost", "interrupted"])
def test_the_end_is_told_by_its_cause(tmp_path, ros_env, living, kind):
    """A flight that leaves the allowed distance is lost; one that gets Ctrl-C is interrupted."""
    file = tmp_path / "narrow.yaml"
    file.write_text(
        "/**/plant: {ros__parameters: {limits: {distance_m: 1.0}}}\n"
        "/**/scenario: {ros__parameters: {climb: {start_s: 2.0, end_s: 6.0}}}\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-m", "heli_flight.cli.hover_test", "--live", "--live-port", "0",
         "--foxglove-port", "0", "--gps", "rtk", "--no-report", "--out", str(tmp_path / "flight"),
         *(["--params", str(file)] if kind == "lost" else [])],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    stop = {"lost": lambda p: None, "interrupted": lambda p: p.send_signal(signal.SIGINT)}[kind]
    try:
        printed = read_until(process.stdout, ["live view"])
        end = asyncio.run(watch_until_the_end(printed["live view"], process, stop))
        rest, _ = process.communicate(timeout=120)
    finally:
        process.kill()
    assert end["kind"] == kind, rest
    cause = {"lost": PlantStatus.FLEW_AWAY.sentence, "interrupted": "stopped"}[kind]
    assert cause in end["text"]
    assert process.returncode == {"lost": 1, "interrupted": 130}[kind], rest
    assert living() == []


def test_a_port_in_use_ends_all_before_the_flight(tmp_path, hover_test):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = hover_test("--live", "--live-port", port, "--out", tmp_path / "x")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and f"port {port} on 127.0.0.1" in done.stderr
    assert "--live-port" in done.stderr
    assert not (tmp_path / "x").exists()


async def watch_in_lockstep(url, token, fly):
    """View before the graph exists, then a flight faster than the clock; commands are refused.

    The flight is far longer than anybody needs to be heard: 60 s of it were over within the second
    that a loaded machine took to bring a command to the graph.
    """
    async with watching(url) as watcher:
        empty = await watcher.until_state(lambda s: True)
        assert empty["t"] is None and empty["truth"] is None and empty["mode"] == "idle"
        assert not (await watcher.command(token, "gust"))["ok"]
        flight = fly()
        await watcher.until_state(lambda s: (s["t"] or 0.0) > 1.0)
        gust = {"amplitude_mps": 2.0, "from_deg": 0.0, "duration_s": 1.0}
        answer = await watcher.command(token, "gust", **gust)
        assert not answer["ok"] and "lockstep" in answer["text"]
        flight.send_signal(signal.SIGINT)
        await watcher.until_state(lambda s: s["mode"] == "over")
        return flight


@pytest.mark.slow
def test_a_flight_in_lockstep_is_watched_only(tmp_path, ros_env, living):
    program = executable("heli_live_view", "live_view")
    node = subprocess.Popen(
        [sys.executable, str(program), "--ros-args", "-p", "port:=0", "-p", "foxglove:=false",
         "-p", "allow_commands:=true"],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip

    def fly():
        return subprocess.Popen(
            [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report",
             "--duration", "3000", "--out", str(tmp_path / "flight")],
            env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip

    try:
        printed = read_until(node.stdout, ["live view", "command token"])
        flight = asyncio.run(watch_in_lockstep(printed["live view"], printed["command token"], fly))
        output, _ = flight.communicate(timeout=120.0)
        assert flight.returncode == 130, output
        node.terminate()
        # Whoever waits for browsers that are still connected takes a minute.
        assert node.wait(timeout=50.0) == 0
    finally:
        node.kill()
    assert living() == []
