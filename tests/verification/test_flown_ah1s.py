# SPDX-License-Identifier: Apache-2.0
"""Our outer and inner loop fly an AH-1S that nobody here modelled, JSBSim's, as identified.

Needs `pip install jsbsim`, and is skipped without it. No requirement is from the flights
(`support.ah1s_flights`); what is beyond them stands in docs/results/ah1s.json.
"""

import numpy as np
import pytest

pytest.importorskip("jsbsim")

from heli_core.errors import InfeasibleGammaError  # noqa: E402
from heli_dynamics_sim.plant import PlantStatus  # noqa: E402
from heli_inner_hinf.controller_state import STATE_FEEDBACK  # noqa: E402
from support.ah1s import STILL, Ah1sPlant, Air, hovering  # noqa: E402
from support.ah1s_flights import (  # noqa: E402
    COUPLING,
    EQ_17,
    HOVER_DOWN_M,
    HOVER_HEADING_DEG,
    HOVER_M,
    IN_WIND_M,
    OUTPUT,
    OVERSHOOT,
    away,
    climbed,
    comes_to_rest,
    diagonal,
    flown,
    handed_over_early,
    predicted_margins,
    stepped,
    went,
)
from support.ah1s_loops import designed, position_design  # noqa: E402

pytestmark = [pytest.mark.nightly, pytest.mark.timeout(1800)]
WAYS = [(OUTPUT, False), (OUTPUT, True), (EQ_17, False)]


def holds_its_place(facts):
    assert facts["lost"] == ""
    assert facts["horizontal_m"] < HOVER_M and facts["down_m"] < HOVER_DOWN_M
    assert facts["heading_deg"] < HOVER_HEADING_DEG


def test_it_hovers_in_still_air_where_the_simple_feedback_has_left_it():
    aircraft, _ = hovering(30.0, 120.0)
    assert aircraft.height_m == pytest.approx(30.0, abs=0.1)
    assert np.abs(aircraft.vel_body_mps).max() < 0.05


def test_a_flight_is_the_same_again_and_another_in_other_turbulence():
    air = diagonal(5.0, 5.0)
    first, again = (flown(air=air, duration_s=5.0) for _ in range(2))
    assert first.off_ned_m.tobytes() == again.off_ned_m.tobytes()
    other = flown(air=Air(air.wind_ned_mps, air.w20_mps, 2), duration_s=5.0)
    assert first.off_ned_m.tobytes() != other.off_ned_m.tobytes()


@pytest.mark.parametrize(("controller", "observer"), WAYS)
def test_it_holds_a_hover_of_a_minute(controller, observer):
    holds_its_place(away(flown(controller=controller, observer=observer)))


@pytest.mark.parametrize("observer", [False, True])
def test_it_stays_within_two_metres_in_5_mps_and_turbulence(observer):
    for seed in (1, 2, 3):
        facts = away(flown(observer=observer, air=diagonal(5.0, 5.0, seed)))
        assert facts["lost"] == "" and facts["horizontal_m"] < IN_WIND_M
        assert facts["down_m"] < HOVER_DOWN_M


def test_eq_17_is_not_lost_there_and_does_not_hold_the_heading():
    """Its gamma* is fifteen times HeLion's, so it is slow, and it has no integral action."""
    facts = away(flown(controller=EQ_17, air=diagonal(5.0, 5.0)))
    assert facts["lost"] == "" and facts["down_m"] < HOVER_DOWN_M
    assert facts["heading_deg"] > HOVER_HEADING_DEG


def test_handed_over_while_it_drifts_our_observer_shuts_the_fixes_out():
    """It takes for granted that a flight which begins in the air begins at rest."""
    known, estimated = (handed_over_early(observer=observer) for observer in (False, True))
    assert 0.2 < known["speed_mps"] < 0.6
    assert known["lost"] == "" and estimated["lost"] == PlantStatus.HIT_GROUND.sentence


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_commanded_step_is_damped_and_stays_in_its_axis(axis):
    for observer in (False, True):
        facts = stepped(axis, observer=observer)
        assert facts["lost"] == "" and facts["overshoot"] < OVERSHOOT
        assert facts["coupling"] < COUPLING


def test_it_climbs_10_m_and_goes_15_m_on_its_reference():
    for flight in (climbed(), climbed(observer=True), went(), went(observer=True)):
        facts = away(flight)
        assert facts["lost"] == "" and facts["horizontal_m"] < IN_WIND_M
        assert facts["down_m"] < HOVER_DOWN_M


def test_the_packaged_bound_of_eq_17_is_refused_by_name_for_it():
    with pytest.raises(InfeasibleGammaError) as refused:
        designed("hinf")
    assert refused.value.gamma_star > refused.value.gamma
    assert designed(*EQ_17).attitude.params.controller == STATE_FEEDBACK


def test_gain_far_beyond_what_the_model_says_does_not_come_to_rest():
    """And without it comes to rest."""
    assert comes_to_rest(OUTPUT)
    ped_db = predicted_margins()[2].gain_up_db
    assert not comes_to_rest(OUTPUT, (1.0, 1.0, 10.0 ** ((ped_db + 10.0) / 20.0), 1.0))


def test_a_plant_that_turns_over_is_lost():
    class Pushed(Ah1sPlant):
        def step(self, tick, u):
            super().step(tick, np.array([0.98, *u[1:]]))

    plant = Pushed(STILL)
    assert flown(plant=plant, duration_s=10.0).lost == PlantStatus.ROLLED_OVER.sentence


def test_the_gains_keep_their_floors_around_the_identified_loop():
    for report in position_design(*OUTPUT).reports:
        assert report.stable and report.disk_margin >= 0.6
