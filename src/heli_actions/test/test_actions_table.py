# SPDX-License-Identifier: Apache-2.0
"""The table of goals: what follows from each event in each stage, spelled once more."""

import pytest

from heli_actions.goals import (
    HOLD,
    LAND,
    STANDING,
    Code,
    GoalEnd,
    GoalEvent,
    GoalStatus,
    Kind,
    Stage,
    row_of,
)
from heli_outer_pd.goals import GOALS
from heli_outer_pd.modes import Command, Phase

A, C, S = GoalStatus.ABORTED, GoalStatus.CANCELED, GoalStatus.SUCCEEDED
CANCELED = (C, Code.CANCELED)
ALWAYS = {
    "preempted": (A, Code.PREEMPTED),
    "silence": (A, Code.SILENT),
    "closed": (A, Code.CLOSED),
}
UNDER_WAY = {
    "done": (S, Code.DONE),
    "mode left": (A, Code.MODE_LEFT),
    "way replaced": (A, Code.REPLACED),
    "end not reached": (A, Code.NOT_REACHED),
}
UNANSWERED = {"unanswered": (A, Code.NO_ANSWER)}
EXPECTED = {
    "waiting": {"its turn": "asked", "cancel": CANCELED},
    "asked": {
        "granted": "flown", "refused": (A, Code.REFUSED), "cancel": "withdrawn", **UNANSWERED
    },
    "withdrawn": {"granted": ("holding", HOLD), "refused": CANCELED, **UNANSWERED},
    "flown": {"cancel": ("holding", HOLD), **UNDER_WAY},
    "holding": {"granted": CANCELED, "refused": "bound", **UNANSWERED},
    "breaking off": {"granted": CANCELED, "refused": "bound", **UNANSWERED},
    "bound": UNDER_WAY,
}  # fmt: skip
OF_A_KIND = {
    (Kind.TAKEOFF, "holding", "refused"): ("breaking off", LAND),
}


def transition(kind, stage, event):
    row = row_of(kind, stage, event)
    if row is None:
        return None
    if isinstance(row.target, GoalEnd):
        assert not row.asks
        return row.target.outcome, row.target.code
    return (row.target.value, row.asks) if row.asks else row.target.value


@pytest.mark.parametrize("kind", Kind)
@pytest.mark.parametrize("stage", Stage)
def test_every_event_in_every_stage(kind, stage):
    expected = ALWAYS | EXPECTED[stage.value]
    for event in GoalEvent:
        wanted = OF_A_KIND.get((kind, stage.value, event.value), expected.get(event.value))
        assert transition(kind, stage, event) == wanted, event


def test_every_stage_can_end_and_none_is_left_without_a_way_out():
    for stage in Stage:
        assert transition(Kind.GOTO, stage, GoalEvent.SILENT) == (A, Code.SILENT)


def test_kinds_are_commands_of_the_outer_loop():
    """heli_actions may not import heli_outer_pd."""
    assert {kind.value for kind in Kind} == {command.value for command in GOALS}
    assert {HOLD, LAND} <= {command.value for command in Command}
    assert STANDING == Phase.STANDING.mode
