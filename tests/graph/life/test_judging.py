# SPDX-License-Identifier: Apache-2.0
"""A synthesis runs beside the flight: no tick waits for it, the answer of the service does."""

import os
import threading

import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from heli_core.beside import Beside
from heli_inner_hinf.design import judged_design
from heli_msgs_bridge.services import ros_value

FLYING = ("outer_loop", "inner_loop", "observer", "plant")
DEACTIVATE, CLEANUP = 4, 2
LIMIT_S = 120.0


class Held:
    """Syntheses that wait until they are let go."""

    def __init__(self, synthesise):
        self._synthesise, self._free = synthesise, threading.Semaphore(0)
        self.begun, self.thread = 0, None

    def __call__(self, values):
        self.begun, self.thread = self.begun + 1, threading.current_thread()
        assert self._free.acquire(timeout=LIMIT_S), "nobody let it go"
        return self._synthesise(values)

    def let_go(self, count=1):
        for _ in range(count):
            self._free.release()


GAMMA = "output.gamma"


@pytest.fixture
def held(monkeypatch):
    """Hold syntheses up from the call on."""

    def hold():
        made = Held(judged_design)
        monkeypatch.setattr(Beside, "call", lambda beside, function, values: made(values))
        return made

    return hold


def ask(crew, kind=SetParameters, **values):
    """A call that is under way: its future."""
    service = {SetParameters: "set_parameters"}.get(kind, "set_parameters_atomically")
    client = crew.client.create_client(kind, f"/inner_loop/{service}")
    crew.spin_until(client.service_is_ready)
    rows = [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]
    return client.call_async(kind.Request(parameters=rows))


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_flight_goes_on_while_a_law_is_judged(crew, held, lockstep):
    """It is swapped in when it is judged; one that is refused leaves everything as it was."""
    one = crew(*FLYING, lockstep=lockstep, duration_s=600.0, peer_timeout_s=60.0)
    one.bring_up()
    one.fly(30)
    inner, synthesis = one.nodes["inner_loop"], held()
    flown = inner.core.design.config
    for gamma, accepted in ((5.0, True), (0.5, False)):
        before, begun = inner.core.design.config, synthesis.begun
        answer = ask(one, output__gamma=gamma)
        one.spin_until(lambda begun=begun: synthesis.begun > begun)
        assert synthesis.thread is not threading.current_thread()
        flown_tick = inner.core.flown_tick
        one.spin_until(lambda tick=flown_tick: inner.core.flown_tick >= tick + 30)
        assert not answer.done()
        assert inner.core.design.config is before and inner.values[GAMMA] != gamma
        synthesis.let_go()
        one.spin_until(answer.done)
        (result,) = answer.result().results
        assert result.successful == accepted and ("infeasible" in result.reason) == (not accepted)
        # By the node's own steps: in real time the plant may be ahead of it.
        flown_tick = inner.core.flown_tick
        one.spin_until(lambda tick=flown_tick: inner.core.flown_tick >= tick + 5)
        assert (inner.core.design.config is not before) == accepted
    assert inner.core.design.config.output.gamma == inner.values[GAMMA] == 5.0 != flown.output.gamma
    assert inner.get_parameter(GAMMA).value == 5.0


def test_orders_are_carried_out_one_after_the_other(crew, held):
    """Each is judged on what the one before has made, and answered in its turn: once, and only
    where it is refused each of its parameters alone."""
    one = crew("inner_loop")
    assert one.change("inner_loop", 1)
    synthesis = held()
    first = ask(one, SetParametersAtomically, output__gamma=5.0, gamma=0.08)
    second, third = ask(one, output__gamma=0.5, gamma=0.07), ask(one, gamma=0.09)
    one.spin_until(lambda: synthesis.begun)
    synthesis.let_go()
    one.spin_until(first.done)
    assert first.result().result.successful and not third.done()
    synthesis.let_go(4)
    one.spin_until(third.done)
    assert [result.successful for result in second.result().results] == [False, True]
    assert third.result().results[0].successful
    node = one.nodes["inner_loop"]
    assert node.values["gamma"] == 0.09 and node.values[GAMMA] == 5.0
    assert synthesis.begun == 5


def test_what_does_not_change_is_not_judged_and_many_are_judged_once(crew, held):
    """As `ros2 param load` asks: all parameters of a node at once, most as they are."""
    one = crew("inner_loop")
    node = one.nodes["inner_loop"]
    assert one.change("inner_loop", 1)
    synthesis, before, revision = held(), node.core.design.config, node.revision
    free = {row.name for row in node.SPEC.full_table() if not row.read_only}
    dump = {name: ros_value(node.values[name]) for name in sorted(free)}
    rows = [Parameter(name, value=value).to_parameter_msg() for name, value in dump.items()]
    for kind, service in (
        (SetParameters, "set_parameters"),
        (SetParametersAtomically, "set_parameters_atomically"),
    ):
        answer = one.call(kind, f"/inner_loop/{service}", kind.Request(parameters=rows))
        results = answer.results if kind is SetParameters else [answer.result]
        assert all(result.successful for result in results)
    assert len(rows) > 20 and synthesis.begun == 0 and node.revision == revision
    assert node.core.design.config is before
    dump |= {GAMMA: 5.0, "gamma": 0.08}
    rows = [Parameter(name, value=value).to_parameter_msg() for name, value in dump.items()]
    synthesis.let_go()
    request = SetParameters.Request(parameters=rows)
    results = one.call(SetParameters, "/inner_loop/set_parameters", request).results
    assert all(result.successful for result in results) and synthesis.begun == 1
    assert node.values[GAMMA] == 5.0 and node.values["gamma"] == 0.08


def test_a_node_that_has_changed_meanwhile_judges_again(crew, held):
    """Configured anew while the synthesis ran: what was judged was of another stage."""
    one = crew("inner_loop")
    node = one.nodes["inner_loop"]
    assert one.change("inner_loop", 1)
    synthesis = held()
    answer = ask(one, output__gamma=5.0)
    one.spin_until(lambda: synthesis.begun)
    assert one.change("inner_loop", CLEANUP)
    synthesis.let_go(2)
    one.spin_until(answer.done)
    assert answer.result().results[0].successful and node.values[GAMMA] == 5.0
    synthesis.let_go()
    assert one.change("inner_loop", 1) and node.core.design.config.output.gamma == 5.0


def test_a_law_is_worked_out_in_another_process(crew):
    """Which ends with the node; what it has made is what this one would have made."""
    one = crew("inner_loop")
    node = one.nodes["inner_loop"]
    assert one.change("inner_loop", 1) and node._beside.pid is None
    assert one.set("inner_loop", output__gamma=5.0)[0].successful
    other, config = node._beside.pid, node.core.design.take() and node.core.design.config
    assert other not in (None, os.getpid())
    here = judged_design(node.values)
    assert config.summary() == here.summary()
    for mine, theirs in zip(config.params.law, here.params.law, strict=True):
        assert np.array_equal(mine, theirs)
    one.leave("inner_loop")
    assert not os.path.exists(f"/proc/{other}")


def test_an_infeasible_law_is_refused_in_every_state_and_the_node_lives(crew):
    """By `param set` before configuration; from a file at configuration, until it is mended."""
    one = crew("inner_loop")
    node = one.nodes["inner_loop"]
    packaged = node.values[GAMMA]
    (refused,) = one.set("inner_loop", output__gamma=0.5)
    assert not refused.successful and "infeasible" in refused.reason
    assert node.values[GAMMA] == node.get_parameter(GAMMA).value == packaged
    assert one.change("inner_loop", 1) and one.change("inner_loop", CLEANUP)
    one.leave("inner_loop")
    one = crew("inner_loop", output__gamma=0.5)
    node = one.nodes["inner_loop"]
    assert not one.change("inner_loop", 1) and "infeasible" in node.failure
    assert one.set("inner_loop", output__gamma=5.0)[0].successful
    assert one.change("inner_loop", 1) and node.core.design.config.output.gamma == 5.0
