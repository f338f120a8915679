# SPDX-License-Identifier: Apache-2.0
"""Before and after a live flight: who waits for a browser, and what who has watched gets then."""

import asyncio
import json
import re
import signal
import subprocess
import sys
import urllib.request

import aiohttp
import pytest

LIMIT_S = 120.0


@pytest.fixture
def start(tmp_path, ros_env, living):
    """Start a live flight; nothing of it is left at the end."""
    begun = []

    def run(*words):
        process = subprocess.Popen(
            [sys.executable, "-m", "heli_flight.start", "hover_test", "--live", "--live-port", "0",
             "--gps", "rtk", "--world", "paper", "--out", str(tmp_path / "flight"), *words],
            env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        begun.append(process)
        return process

    yield run
    for process in begun:
        process.kill()
        process.communicate()
    assert living() == []


def until(process, words):
    """Read up to the line that holds these words; returns all that was said."""
    printed = ""
    for line in process.stdout:
        printed += line
        if words in line:
            return printed
    pytest.fail(f"{printed}\n{process.stderr.read()}")


def address(printed):
    return next(line for line in printed.splitlines() if line.startswith("live view: ")).split()[-1]


async def messages(url):
    """All messages of a browser until the server goes away."""
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"{url}ws", max_msg_size=0) as connection,
    ):
        async for message in connection:
            yield json.loads(message.data)


async def flown(url):
    """Watch a flight to its end: greeting, first flight time, kinds of its end."""
    hello, first, ends = None, None, set()
    async for message in messages(url):
        if message["type"] == "hello":
            hello = message
        elif message["type"] == "state" and message["t"] is not None:
            first = message["t"] if first is None else first
            ends |= {message["end"]["kind"]} if message["end"] else set()
    return hello, first, ends


async def shown_after(url, act):
    """Greeting and first state of what is served after the flight; acts while it is open."""
    hello = None
    async for message in messages(url):
        if message["type"] == "hello":
            hello = message
        elif message["type"] == "state":
            await asyncio.to_thread(act)
            return hello["replay"], message
    raise AssertionError("nothing was shown")


async def watch(process, url, act):
    """From before the flight to its replay."""
    async with asyncio.timeout(LIMIT_S):
        answers = await flown(url)
        await asyncio.to_thread(until, process, "report and replay: http://127.0.0.1:")
        return *answers, *await shown_after(url, act)


@pytest.mark.slow
def test_a_flight_waits_for_its_first_browser_and_leaves_report_and_replay(start):
    process = start("--live-wait", "--duration", "4")
    printed = until(process, "waiting for a browser")
    assert "flown" not in printed
    url = address(printed)

    def read_report():
        with urllib.request.urlopen(f"{url}report.html") as page:
            assert b"Hover test in wind" in page.read()

    hello, first, ends, end, last = asyncio.run(watch(process, url, read_report))
    # Seen from its first moment on; before it, nothing had flown.
    assert first < 2.0 and ends == {"over"}
    assert hello["after"] is True and hello["history"] == []
    assert end["report"] == "report.html" and end["at_end"]
    assert " 4.00 s" in end["ended"]
    assert last["t"] == pytest.approx(3.99) and last["replay"]["runs"] is False
    # Once the browser has gone the command ends, with the flight's own code.
    _, err = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, err


@pytest.mark.slow
def test_ctrl_c_ends_the_waiting_and_leaves_nothing(start, tmp_path):
    process = start("--live-wait")
    until(process, "waiting for a browser")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "interrupted" and "Traceback" not in err
    assert not (tmp_path / "flight").exists()


@pytest.mark.slow
def test_without_a_browser_the_flight_begins_after_the_limit_and_nobody_is_waited_for(
    start, tmp_path
):
    file = tmp_path / "soon.yaml"
    file.write_text("/**/live_view: {ros__parameters: {viewer_limit_s: 0.5}}\n")
    process = start("--live-wait", "--duration", "2", "--params", str(file))
    out, err = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, err
    assert re.search(r"no browser .* 0\.5 s\b", out)
    assert out.count("http://") == 1, "the page of the flight, and none after it"
    assert (tmp_path / "flight/report.html").is_file()


@pytest.mark.slow
def test_ctrl_c_after_the_flight_changes_nothing_of_its_outcome(start, tmp_path):
    process = start("--duration", "3")

    def stop():
        process.send_signal(signal.SIGINT)
        process.wait(LIMIT_S)

    asyncio.run(watch(process, address(until(process, "live view: ")), stop))
    assert process.returncode == 0, process.stderr.read()
    assert json.loads((tmp_path / "flight/result.json").read_text())["exit_code"] == 0
