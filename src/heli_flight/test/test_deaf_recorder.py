# SPDX-License-Identifier: Apache-2.0
"""A recorder that no longer answers costs the rest of its bag, and the flight says so."""

import io
import json
from types import SimpleNamespace

import pytest
from rich.console import Console

from heli_flight.graph import flight as outcomes
from heli_flight.graph.bag_record import BagFlight
from heli_flight.graph.lifecycle import BringUpError, NodeStatus
from heli_flight.graph.supervisor import Supervisor
from heli_flight.loop import simulate
from heli_flight.replay import ended
from heli_flight.report.first_screen import verdict_of
from heli_flight.result import print_table, write_result
from heli_flight.settings import resolve
from heli_msgs_bridge.diagnostics import FACT_STATE, NodeState

WHY = "recorder: no answer to 'deactivate' in 10 s"
SENTENCE = f"{WHY}; what it did not hear is not in the bag"


class Up:
    """What closing a bag needs of the supervisor."""

    def __init__(self, refuses=""):
        self.statuses, self.refuses, self.limits_s = {}, refuses, []

    def transition(self, names, transition_id, limit_s, check):
        assert names == ["recorder"]
        if self.refuses:
            raise BringUpError(self.refuses)

    def wait_until(self, done, limit_s, check):
        assert not done()
        self.statuses["recorder"] = NodeStatus(0, "", 1.0, {FACT_STATE: "inactive"})
        assert self._has_last_word()

    _has_last_word = Supervisor._has_last_word


def test_one_that_answers_has_the_last_word():
    up = Up()
    Supervisor.close_bag(up, 10.0)
    assert up.statuses["recorder"].state == NodeState.INACTIVE


@pytest.fixture(scope="module")
def flown():
    settings = resolve(overrides={"scenario": {"duration_s": 20.0}}, world="paper")
    return settings, simulate(settings).record


def test_of_one_that_does_not_the_flight_is_partial(flown, monkeypatch, tmp_path):
    up = Up(WHY)
    Supervisor.close_bag(up, 10.0)
    settings, record = flown
    monkeypatch.setattr(outcomes, "flight_from_bag", lambda *_: BagFlight(record, (), ()))
    monkeypatch.setattr(outcomes, "foreign_truth", lambda *_: "")
    result, _, _ = outcomes.outcome(settings, tmp_path, up.statuses, [], 1.0)
    assert result.partial(settings.gps) == result.unheard == SENTENCE
    assert not any("recorder" in note for note in result.notes)
    assert not result.judged(settings.gps) and result.exit_code(settings.gps) == 1
    printed = io.StringIO()
    print_table(result, settings, Console(file=printed, width=200))
    assert f"PARTIAL: {SENTENCE}" in printed.getvalue()
    write_result(result, settings, tmp_path, {})
    result_json = json.loads((tmp_path / "result.json").read_text())
    assert (result_json["partial"], result_json["exit_code"]) == (SENTENCE, 1)
    assert ended(result_json, "") == f"Partial: {SENTENCE}"
    # Of what is in the bag no stretch decides anything, so none is judged.
    mark, tone, said = verdict_of(SimpleNamespace(result=result, settings=settings))
    assert (mark, tone) == ("✗", "bad") and SENTENCE in said
