# SPDX-License-Identifier: Apache-2.0
"""What a parameter file states, and whether a flight flies it."""

import pytest

from heli_core.errors import ParameterCause
from heli_core.rcl_yaml import ParameterError
from heli_flight.layers import ONE_PROCESS, REAL_TIME
from heli_flight.settings import resolve

NODES = ("plant", "observer", "inner_loop", "outer_loop")


@pytest.fixture
def flown(tmp_path):
    """Settings of a flight with a parameter file of this text."""

    def resolved(text, **options):
        path = tmp_path / "params.yaml"
        path.write_text(text)
        return resolve(params=[path], **options)

    return resolved


def stated(settings):
    return [(one.section, one.key, one.where.rsplit(":", 1)[1]) for one in settings.not_flown]


def test_what_stands_under_the_wildcard_goes_where_it_is_known(flown):
    text = "/**: {ros__parameters: {origin: {latitude_deg: 50.0}, peer_timeout_s: 60.0, seed: 7}}\n"
    settings = flown(text + "observer: {ros__parameters: {peer_timeout_s: 5.0}}\n")
    waits = [settings.nodes[name]["peer_timeout_s"] for name in NODES]
    assert waits == [60.0, 5.0, 60.0, 60.0], "a section that is named is stronger"
    assert {settings.nodes[name]["origin.latitude_deg"] for name in NODES} == {50.0}
    assert settings.recorder["origin.latitude_deg"] == 50.0 and settings.seed == 7
    assert settings.not_flown == ()


def test_what_no_section_knows_is_refused_under_the_wildcard_too(flown):
    with pytest.raises(ParameterError) as refused:
        flown("/**: {ros__parameters: {peer_timeout: 60.0}}\n")
    error = refused.value
    assert (error.cause, error.meant) == (ParameterCause.UNKNOWN_KEY, "peer_timeout_s")


def test_a_name_that_a_section_says_twice_is_refused(flown):
    with pytest.raises(ParameterError) as refused:
        flown("plant: {ros__parameters: {wind: {towards_deg: 3.0}, wind.towards_deg: 5.0}}\n")
    assert (refused.value.cause, refused.value.key) == (ParameterCause.TWICE, "wind.towards_deg")


def test_what_the_scenario_decides_is_named(flown):
    text = (
        "plant:\n  ros__parameters:\n    initial:\n      psi_deg: 40.0\n"
        "      pos_ned_m: [1.0, 2.0, -5.0]\n    lockstep: false\n    wind.towards_deg: 30.0\n"
        "/heli1/inner_loop: {ros__parameters: {trim: {d_col: 0.1}}}\n"
    )
    whole = [("heli1/inner_loop", "", "8"), ("plant", "initial.psi_deg", "4"),
             ("plant", "initial.pos_ned_m", "5"), ("plant", "lockstep", "6")]  # fmt: skip
    settings = flown(text)
    assert stated(settings) == whole
    assert [one.sentence for one in settings.not_flown] == list(settings.remarks)
    # Who chooses the mode has decided what is in lockstep.
    assert stated(flown(text, mode=ONE_PROCESS)) == whole[:-1]
    assert stated(flown(text, mode=REAL_TIME)) == whole[:-1]
    assert settings.not_flown[1].flown == 0.0


def test_what_a_flight_has_written_is_flown_again_without_a_word(flown):
    """All parameters stand there, those of another scenario, too."""
    text = "flight: {ros__parameters: {commit: unknown}}\n"
    settings = flown(text + "plant: {ros__parameters: {initial.psi_deg: 40.0, lockstep: false}}\n")
    assert settings.not_flown == () and settings.remarks == ()
