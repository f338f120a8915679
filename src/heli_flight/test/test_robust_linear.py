# SPDX-License-Identifier: Apache-2.0
"""Robustness on a linear aircraft, beside python-control's own loop of it."""

import json
from dataclasses import replace

import control
import numpy as np
import pytest
import yaml

from heli_core.rows import MEASURED
from heli_core.ticks import TICK_S
from heli_dynamics_sim.linear_aircraft import (
    DerivativeEntry,
    LinearAircraft,
    attitude_entries,
    find_linear,
    with_entries,
)
from heli_flight.cli.app import main
from heli_flight.settings import resolve
from heli_studies.published import settings_of
from heli_studies.robust import feedback_flown
from heli_studies.robust_linear import CertificateCause, as_dict, judged

NAME = "blade360"


def content(name=NAME):
    return yaml.safe_load(find_linear(name).read_text())


@pytest.mark.parametrize("name", ["blade360", "heli600", "helion_published", "xcell_tempest"])
def test_the_files_own_entries_are_varied_and_what_is_known_is_not(name):
    tree = content(name)
    entries = attitude_entries(tree)
    assert entries and all(entries.values())
    assert not {DerivativeEntry("A", "a_s", "q"), DerivativeEntry("A", "b_s", "p")} & set(entries)
    for place in entries:
        assert place.row in ("p", "q", "r", "a_s", "b_s") and place.column != "d_col"
        assert place.column not in ("u", "v", "w")
    same, plain = with_entries(tree, entries), LinearAircraft.from_yaml(name)
    np.testing.assert_array_equal(same.A, plain.A)
    np.testing.assert_array_equal(same.B, plain.B)
    assert same.states == plain.states


def test_an_entry_of_the_pedal_goes_through_the_gyro():
    tree = content()
    place = DerivativeEntry("B", "r", "d_ped")
    more, plain = with_entries(tree, {place: 2.0 * 91.3558}), LinearAircraft.from_yaml(NAME)
    np.testing.assert_allclose(more.A[5, 8], 2.0 * plain.A[5, 8])
    np.testing.assert_allclose(more.A[5, 5] + 2.0131, 2.0 * (plain.A[5, 5] + 2.0131))
    assert more.A[8, 5] == plain.A[8, 5] == -1.0


@pytest.fixture(scope="module")
def settings():
    return settings_of(NAME, "hinf_output", "paper")


@pytest.fixture(scope="module")
def found(settings):
    return judged(settings, samples=40)


def loop_poles(aircraft, settings, factors=(1.0, 1.0, 1.0)):
    """Poles of python-control's loop: hold, delay by z, the controller, a factor at each command.

    The servos of an aircraft without any are 1000 rad/s and fully damped.
    """
    A, B, _, _ = aircraft.nine()
    servo = control.ss(control.tf([1e6], [1.0, 2000.0, 1e6]))
    actuated = control.ss(A, B, np.eye(9)[list(MEASURED)], 0.0) * control.append(*[servo] * 3)
    delay_s = aircraft.delay_s + TICK_S * int(settings.nodes["plant"]["delay_ticks"])
    ticks = round(delay_s / TICK_S)
    assert ticks == pytest.approx(delay_s / TICK_S)
    late = control.ss(control.tf([1.0], [1.0, *[0.0] * ticks], TICK_S))
    plant = control.c2d(actuated, TICK_S) * control.append(*[late] * 3)
    law = feedback_flown(settings)
    scaled = np.diag(factors)
    controller = control.ss(law.A, law.B, scaled @ law.C, scaled @ law.D, TICK_S)
    return control.feedback(plant, controller, sign=1).poles()


@pytest.mark.slow
def test_a_gain_margin_is_where_python_controls_loop_becomes_unstable(settings, found):
    aircraft = LinearAircraft.from_yaml(NAME)
    growth = np.log(np.abs(loop_poles(aircraft, settings)).max()) / TICK_S
    assert found.growth_per_s == pytest.approx(growth, rel=1e-4)
    worst = int(np.argmin([channel.gain_up_db for channel in found.channels]))
    limit = 10.0 ** (found.channels[worst].gain_up_db / 20.0)
    for share, stable in ((0.98, True), (1.02, False)):
        factors = np.ones(3)
        factors[worst] = share * limit
        assert (np.abs(loop_poles(aircraft, settings, factors)).max() < 1.0) is np.bool_(stable)


@pytest.mark.slow
def test_the_poles_of_a_corner_are_those_of_a_file_that_says_so(settings, found, tmp_path):
    tree = content()
    for place, factor in found.corners.worst.items():
        assert factor in (0.7, 1.3)
        tree[place.matrix][place.row][place.column] *= factor
    file = tmp_path / "corner.yaml"
    file.write_text(yaml.safe_dump(tree))
    poles = loop_poles(LinearAircraft.from_yaml(file), settings)
    growth = np.log(np.abs(poles).max()) / TICK_S
    assert found.corners.growth_per_s == pytest.approx(growth, rel=1e-4)
    assert found.corners.growth_per_s > found.growth_per_s


@pytest.mark.slow
def test_a_controller_of_another_aircraft_is_judged_on_the_one_that_flies():
    """The packaged one, of helion: on the Blade 360 its loop is not stable, and has no margins."""
    told = settings_of(NAME, "hinf_output", "paper")
    foreign = replace(told, nodes={**told.nodes, "inner_loop": resolve().nodes["inner_loop"]})
    found = judged(foreign, samples=2)
    assert found.growth_per_s > 0.0 and not found.stable
    assert [disk.alpha for disk in found.disks.values()] == [0.0] * 3
    assert found.channels == [] and found.further_delay_s == 0.0


def test_a_box_that_is_too_large_has_unstable_aircraft(settings):
    wide = judged(settings, samples=40, size=0.95)
    assert wide.corners.unstable and wide.corners.growth_per_s > 0.0 and not wide.stable
    assert wide.corners.tried + wide.corners.refused == 40


@pytest.mark.slow
def test_the_certificate_is_not_applicable_and_says_so(found):
    told = as_dict(found)
    cause = CertificateCause.LINEAR_PLANT.name.lower()
    assert told["certificate"] == {"applies": False, "cause": cause}
    assert found.stable and told["box"]["corners"]["tried"] == 40
    assert set(told["channels"]) == {"d_lat", "d_lon", "d_ped"}
    json.dumps(told, allow_nan=False)


def refused(capsys, *words):
    code = main(["robust", *map(str, words)])
    out, err = capsys.readouterr()
    assert (code, len(err.splitlines())) == (2, 1), (out, err)
    return err


def test_bad_input_is_one_line(capsys, tmp_path):
    assert "nowhere" in refused(capsys, "--aircraft", "nowhere")
    assert "--fly" in refused(capsys, "--aircraft", NAME, "--fly")
    file = tmp_path / "linear.yaml"
    file.write_text(f"plant:\n  ros__parameters:\n    linear_model: {NAME}\n")
    assert "--fly" in refused(capsys, "--params", file, "--fly")


@pytest.mark.slow
def test_the_command_judges_the_law_of_a_file_on_its_linear_plant(capsys, tmp_path):
    design = tmp_path / "design"
    assert main(["design", "--aircraft", "heli600", "--out", str(design)]) == 0
    capsys.readouterr()
    out = tmp_path / "robust"
    words = ["--params", str(design / "design.yaml"), "--json", "--out", str(out)]
    assert main(["robust", *words]) == 0
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    assert row["aircraft"] == "heli600" and row["disk"]["input"]["alpha"] > 0.5
    assert json.loads((out / "robust.json").read_text())["rows"] == [row]
