# SPDX-License-Identifier: Apache-2.0
"""The table is complete and reachable, guards and refusals say why, the README shows it."""

import re
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heli_outer_pd import (
    TABLE,
    Command,
    Fact,
    Guard,
    Phase,
    Refusal,
    RefusalCause,
    Refused,
    Transition,
    allowed,
    command_named,
    decide,
)
from heli_outer_pd.modes import FLYING, GUIDED, LANDING, ON_GROUND, TAKING_OFF
from support.mode_diagram import diagram

PACKAGE = Path(__file__).resolve().parents[1]
AIRBORNE = set(Phase) - set(ON_GROUND)


def rows(phase, event):
    return [row for row in TABLE if row.event == event and phase in row.sources]


@pytest.mark.parametrize(("phase", "command"), list(product(Phase, Command)))
def test_each_pair_of_phase_and_command_stands_in_the_table_once(phase, command):
    (row,) = rows(phase, command)
    decision = decide(phase, command)
    assert decision == row.target if isinstance(row, Transition) else isinstance(decision, Refusal)


@pytest.mark.parametrize(("phase", "fact"), list(product(Phase, Fact)))
def test_a_fact_has_one_meaning_or_none(phase, fact):
    meanings = rows(phase, fact)
    assert len(meanings) <= 1
    assert decide(phase, fact) == (meanings[0].target if meanings else None)
    # What is measured cannot be refused.
    assert decide(phase, fact, set(Guard)) == decide(phase, fact)


def reachable(start, events):
    reached, new = set(), {start}
    while new:
        reached |= new
        decisions = {decide(phase, event) for phase, event in product(new, events)}
        new = {phase for phase in decisions if isinstance(phase, Phase)} - reached
    return reached


@pytest.mark.parametrize("start", [Phase.STANDING, Phase.HOVER])
def test_every_phase_is_reached_from_either_start_and_left_again(start):
    assert reachable(start, [*Command, *Fact]) == set(Phase)
    for phase in Phase:
        assert start in reachable(phase, [*Command, *Fact])


def test_every_fact_leads_somewhere_and_every_guard_stops_something():
    for fact in Fact:
        assert any(decide(phase, fact) for phase in Phase)
    for guard in Guard:
        stopped = [
            decision
            for phase, command in product(Phase, Command)
            if isinstance(decision := decide(phase, command, {guard}), Refusal)
            and decision.cause == guard
        ]
        assert stopped
        assert all(refusal.allowed for refusal in stopped)


def test_the_air_is_reached_over_the_climb_alone_and_the_ground_over_the_landing_alone():
    """A second way up or down would be one that nobody has flown."""
    for row in TABLE:
        if not isinstance(row, Transition):
            continue
        for source in row.sources:
            if Phase.MANUAL in (source, row.target):
                continue
            if source.on_ground and row.target in AIRBORNE:
                assert (source, row.target) == (Phase.LIFTING, Phase.CLIMBING)
            if source in AIRBORNE and row.target.on_ground:
                assert row.target == Phase.SETTLING
                assert row.event in (Fact.TOUCHED_DOWN, Fact.STUCK, Fact.TIPPING)


def test_by_hand_it_goes_from_the_ground_to_the_ground():
    """From the skids it is taken by hand alone, and by hand it is given back when it stands."""
    by_hand = {row.sources: row for row in TABLE if getattr(row, "target", None) == Phase.MANUAL}
    assert {source for sources in by_hand for source in sources if source.on_ground} == {
        Phase.STANDING
    }
    assert all(Guard.STICKS in row.guards for row in by_hand.values())
    assert decide(Phase.MANUAL, Fact.IDLE) == Phase.STANDING
    assert not any(
        decision.on_ground
        for command in Command
        if isinstance(decision := decide(Phase.MANUAL, command), Phase)
    )


LEVEL = (Command.LAND, Command.ATTITUDE)
"""What is flown without a position, too."""


def test_what_takes_over_from_a_pilot_asks_for_navigation_and_for_what_it_can_hold():
    for row in TABLE:
        if (
            isinstance(row, Transition)
            and isinstance(row.event, Command)
            and (Phase.MANUAL in row.sources and row.target != Phase.MANUAL)
        ):
            known = Guard.LEVEL if row.event in LEVEL else Guard.NAVIGATION
            assert set(row.guards) >= {known, Guard.ENVELOPE, Guard.CLEAR}


@pytest.mark.parametrize("phase", [Phase.CLIMBING, *FLYING])
def test_without_a_position_it_lands_and_is_steered_and_holds_no_place(phase):
    """Of what leads into the air or stays there; without attitude and altitude the hand alone."""
    lost, blind = {Guard.NAVIGATION}, {Guard.NAVIGATION, Guard.LEVEL}
    for command in (Command.LAND, Command.MANUAL):
        assert isinstance(decide(phase, command, lost), Phase)
    if phase != Phase.CLIMBING:
        assert decide(phase, Command.ATTITUDE, lost) == Phase.ATTITUDE
    for command in (Command.HOLD, Command.GOTO, Command.FOLLOW, Command.VELOCITY):
        assert isinstance(decide(phase, command, lost), Refusal)
    assert decide(phase, Command.LAND, blind).cause == Guard.LEVEL
    assert decide(phase, Command.MANUAL, blind) == Phase.MANUAL
    assert isinstance(decide(Phase.STANDING, Command.TAKEOFF, lost), Refusal)


def test_a_position_that_is_found_again_is_held_or_landed_from():
    for phase in (Phase.CLIMBING, *GUIDED):
        assert decide(phase, Fact.FOUND) == Phase.HOVER
    for phase in (Phase.HALTING, Phase.DESCENDING):
        assert decide(phase, Fact.FOUND) == Phase.HALTING
        assert decide(phase, Fact.BLIND) is None, "a landing goes on"
    assert decide(Phase.TRAJECTORY, Fact.BLIND) == decide(Phase.VELOCITY, Fact.BLIND) == Phase.HOVER


def test_what_is_lost_for_long_lands_unless_a_pilot_has_it():
    for phase in (Phase.CLIMBING, Phase.HOVER):
        assert decide(phase, Fact.BLIND_LONG) == Phase.HALTING
    for phase in (Phase.ATTITUDE, Phase.MANUAL):
        assert decide(phase, Fact.BLIND_LONG) is None


def test_who_falls_silent_is_held():
    for phase in (Phase.VELOCITY, Phase.ATTITUDE, Phase.MANUAL):
        assert decide(phase, Fact.SILENT) == Phase.HOVER


def test_who_leaves_the_fence_is_held_and_leads_no_further():
    for phase in (Phase.TRAJECTORY, Phase.VELOCITY, Phase.ATTITUDE, Phase.MANUAL):
        assert decide(phase, Fact.FENCED) == Phase.HOVER
    for phase in (*LANDING, *TAKING_OFF, Phase.HOVER):
        assert decide(phase, Fact.FENCED) is None, "it lands, climbs or holds already"
    for phase, command in product(FLYING, set(Command) - {Command.HOLD, Command.LAND}):
        assert isinstance(decide(phase, command, {Guard.FENCE}), Refusal)
    for phase, command in product(FLYING, (Command.HOLD, Command.LAND)):
        assert isinstance(decide(phase, command, {Guard.FENCE}), Phase)


def test_a_landing_is_possible_wherever_it_flies():
    for phase in (Phase.CLIMBING, *FLYING):
        assert decide(phase, Command.LAND) == Phase.HALTING
    assert not any(isinstance(decide(phase, Command.LAND), Phase) for phase in LANDING)


def test_modes_are_what_people_call_the_phases():
    assert {phase.mode for phase in TAKING_OFF} == {"takeoff"}
    assert {phase.mode for phase in LANDING} == {"land"}
    assert Phase.HOVER.mode == "hover"
    assert {phase.mode for phase in Phase} == {
        "standing", "takeoff", "hover", "trajectory", "land", "velocity", "attitude", "manual",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("phase", "command", "fails", "sentence"),
    [
        (Phase.HOVER, Command.TAKEOFF, (),
         "takeoff: the aircraft is in the air already; allowed: land, hold, goto, follow, "
         "velocity, attitude, manual"),
        (Phase.STANDING, Command.LAND, (),
         "land: the aircraft has landed already; allowed: takeoff, manual"),
        (Phase.STANDING, Command.GOTO, (),
         "goto: the aircraft is on the ground: take off first; allowed: takeoff, manual"),
        (Phase.STANDING, Command.TAKEOFF, (Guard.NAVIGATION,),
         "takeoff: not in standing now: there is no position estimate; allowed: manual"),
        (Phase.DESCENDING, Command.HOLD, (Guard.CLEAR,),
         "hold: not in land now: the ground is too near; allowed: manual"),
        (Phase.MANUAL, Command.HOLD, (Guard.ENVELOPE,),
         "hold: not in manual now: the aircraft is outside the envelope: its tilt is more than the "
         "controller may command; allowed: land, goto, follow, velocity, attitude, manual"),
        (Phase.HOVER, Command.MANUAL, (Guard.STICKS,),
         "manual: not in hover now: no sticks are heard; allowed: land, hold, goto, follow, "
         "velocity, attitude"),
    ],
)  # fmt: skip
def test_a_refusal_is_a_sentence(phase, command, fails, sentence):
    assert decide(phase, command, fails).sentence == sentence


@pytest.mark.parametrize("row", [row for row in TABLE if isinstance(row, Refused)], ids=str)
def test_what_is_refused_names_what_is_allowed(row):
    for phase in row.sources:
        decision = decide(phase, row.event)
        assert decision.cause == row.cause and row.cause.value in decision.sentence
        assert decision.allowed == allowed(phase)
        assert row.event.value not in decision.allowed


def test_a_command_has_its_own_name_and_that_of_its_mode():
    assert command_named("hover") == command_named("hold") == Command.HOLD
    assert command_named("trajectory") == Command.FOLLOW
    names = "takeoff, land, hold, hover, goto, follow, trajectory, velocity, attitude, manual"
    misspelt, empty = command_named("hoover"), command_named("")
    assert misspelt.allowed == empty.allowed == tuple(names.split(", "))
    assert misspelt.cause == empty.cause == RefusalCause.UNKNOWN_MODE
    assert "'hoover'" in misspelt.asked and "mean hover?" in misspelt.reason
    assert "''" in empty.asked and "mean" not in empty.reason


EVENTS = st.one_of(st.sampled_from(list(Command)), st.sampled_from(list(Fact)))


@given(
    st.sampled_from([Phase.STANDING, Phase.HOVER]),
    st.lists(st.tuples(EVENTS, st.sets(st.sampled_from(list(Guard)))), max_size=60),
)
def test_a_flight_in_which_what_is_refused_never_came_is_the_same(start, story):
    """A refused command changes nothing: neither now nor later."""
    obeyed, phase = [], start
    for event, fails in story:
        decision = decide(phase, event, fails)
        if isinstance(decision, Phase):
            phase = decision
            obeyed.append((event, fails))
    again = start
    for event, fails in obeyed:
        again = decide(again, event, fails)
    assert again is phase


def test_the_document_draws_the_table():
    text = (PACKAGE.parents[1] / "docs/packages/modes.md").read_text(encoding="utf-8")
    (drawn,) = re.findall(r"```mermaid\n(.*?)```", text, re.DOTALL)
    assert drawn == diagram()
