# SPDX-License-Identifier: Apache-2.0
"""The live page of a flight that another autopilot flies: what it is sent is that flight."""

import asyncio
import json

import aiohttp
import numpy as np
import pytest
from rich.console import Console

from heli_core.rcl_yaml import ParameterError
from heli_dynamics_sim.plant import PlantStatus
from heli_flight.ardupilot.live import FlightPage
from heli_flight.ardupilot.physics import Physics
from heli_flight.ardupilot.server import ArduPilotOrder, fly
from heli_flight.ardupilot.session import Vehicle
from heli_flight.graph.live import LiveOrder
from support.sitl_client import SitlClient, h3_120

RATE_HZ = 400
LIFTS = h3_120(0.0, 0.0, 0.9, 0.0)


class Flight:
    """A vehicle whose page is served, and shown only when a test says so."""

    def __init__(self):
        order = ArduPilotOrder(seed=1, live=LiveOrder(port=0))
        settings = order.resolved()
        servos = order.servos(settings)
        self.shown = FlightPage(order.live, settings)
        self.shown.page.start()
        self.vehicle = Vehicle(
            lambda rate: (Physics(settings, rate, servos), None),
            lambda line: None,
            watch=self.shown.watch,
        )
        self.start()

    def start(self):
        answer = self.vehicle.answer
        self.client = SitlClient(lambda data: answer(data, ("127.0.0.1", 1), 1), RATE_HZ)

    def frames(self, seconds):
        """Positions told at whole ticks of 10 ms, ENU, m; the last one is shown."""
        told = []
        for i in range(round(seconds * RATE_HZ)):
            if i % (RATE_HZ // 100) == 0 and self.client.state:
                north, east, down = self.client.state["position"]
                told.append((east, north, -down))
            self.client.frame(LIFTS)
        return np.array(told)


@pytest.fixture
def flight():
    flight = Flight()
    yield flight
    flight.shown.close()


async def of_kind(connection, kind):
    while True:
        message = json.loads((await connection.receive(120.0)).data)
        if message["type"] == kind:
            return message


def watched(flight, look):
    """Run `look(connection)` in a browser of the page."""

    async def use():
        async with aiohttp.ClientSession() as session:
            async with session.ws_connect(f"{flight.shown.page.url}ws") as connection:
                assert not (await of_kind(connection, "hello"))["commands"]
                return await look(connection)

    return asyncio.run(use())


def test_the_pages_stream_has_the_positions_of_the_flight(flight):
    home = None

    async def look(connection):
        nonlocal home
        states, told = [], []
        for i in range(5):
            places = flight.frames(0.5)
            flight.shown.show(float(i))
            states.append(await of_kind(connection, "state"))
            told.append(places[-1])
        return states, np.array(told)

    states, told = watched(flight, look)
    home = flight.vehicle.flights[-1].physics.home_ned_m[[1, 0, 2]] * (1.0, 1.0, -1.0)
    np.testing.assert_allclose([one["truth"]["p"] for one in states], told + home, atol=1e-4)
    assert [one["t"] for one in states] == pytest.approx([0.49, 0.99, 1.49, 1.99, 2.49])
    assert {one["mode"] for one in states} == {"ArduPilot"}
    assert not any(one["alarms"] for one in states) and states[-1]["nav"] is None
    assert told[-1, 2] > told[0, 2] + 0.1


def test_frames_that_nobody_fetches_are_dropped_and_none_is_waited_for(flight):
    async def look(connection):
        flight.frames(1.0)
        flight.shown.show(0.0)
        return await of_kind(connection, "state")

    assert watched(flight, look)["t"] == pytest.approx(0.99)
    assert flight.vehicle.flights[-1].physics.tick == RATE_HZ


def test_an_ardupilot_that_was_started_again_is_another_flight(flight):
    async def look(connection):
        flight.frames(0.5)
        flight.shown.show(0.0)
        await of_kind(connection, "state")
        flight.start()
        flight.frames(0.2)
        flight.shown.show(1.0)
        hello = await of_kind(connection, "hello")
        return hello, await of_kind(connection, "state")

    hello, state = watched(flight, look)
    assert hello["history"] == [] and state["t"] == pytest.approx(0.19)


def test_a_helicopter_that_is_lost_is_shown_as_lost(flight):
    async def look(connection):
        flight.frames(0.1)
        flight.vehicle.flights[-1].physics.status = PlantStatus.HIT_GROUND
        flight.frames(0.1)
        flight.shown.show(0.0)
        return await of_kind(connection, "state")

    assert watched(flight, look)["end"] == {"kind": "lost", "text": PlantStatus.HIT_GROUND.sentence}


def test_who_looks_to_the_end_sees_it_and_is_known_to_what_follows(flight):
    async def look(connection):
        flight.frames(0.5)
        flight.shown.show(0.0)
        await of_kind(connection, "state")
        closing = asyncio.get_running_loop().run_in_executor(None, flight.shown.close)
        state = await of_kind(connection, "state")
        await connection.close()
        await closing
        return state

    assert watched(flight, look)["end"]["kind"] == "over"
    assert flight.shown.view.facts == {"page": flight.shown.page.url, "viewers": "1"}


def test_a_page_shows_one_vehicle():
    with pytest.raises(ParameterError, match="--vehicles"):
        fly(ArduPilotOrder(vehicles=2, live=LiveOrder(port=0)), Console(quiet=True))
