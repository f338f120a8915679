# SPDX-License-Identifier: Apache-2.0
"""The whole identification in one process, against the linearised truth: A, B, servos and norms
within 5 %, E within 10 %, and the hover test inside the paper's figures with what was found."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from heli_analysis.identification import relative_air_w
from heli_core.command_line import config_folder
from heli_core.rotations import euler_angles, quat_to_R_nb
from heli_flight import loop as closed_loop
from heli_flight.result import Result
from heli_flight.scoring import score
from heli_flight.settings import resolve
from heli_studies.identify import (
    YAML,
    IdentifyOrder,
    experiment_of_record,
    layers,
    misses,
    settings_of,
)
from heli_studies.identify_report import execute


def identified(tmp_path, seed, **options):
    outcome = execute(IdentifyOrder(seed=seed, one_process=True, **options), tmp_path / "found")
    return outcome, tmp_path / "found" / YAML


def lines(rows):
    return [f"{row.name}: {row.value:.5g} for {row.truth:.5g}" for row in rows]


@pytest.fixture(scope="module")
def outcome_and_file(identified_once):
    outcome, folder = identified_once
    return outcome, folder / YAML


def test_a_b_servos_and_norms_are_within_their_targets(outcome_and_file):
    outcome, _ = outcome_and_file
    judged = [row for row in outcome.rows if row.met is not None]
    assert len([row for row in judged if row.group in "AB"]) >= 15
    assert lines(row for row in misses(outcome.rows) if row.group != "E") == []
    assert outcome.identification.ab.delay_ticks == 1


def test_every_entry_of_e_that_matters_is_within_its_target(outcome_and_file):
    outcome, _ = outcome_and_file
    assert lines(row for row in misses(outcome.rows) if row.group == "E") == []


def test_hover_test_flies_inside_the_papers_figures_with_identified_numbers(outcome_and_file):
    _, file = outcome_and_file
    settings = resolve(seed=2, params=[file])
    for node, key in (("inner_loop", "model.A"), ("observer", "K"), ("outer_loop", "rotor.K_col")):
        assert np.any(settings.nodes[node][key] != resolve().nodes[node][key])
    flight = closed_loop.simulate(settings)
    result = Result(score(flight.record, settings.scenario), flight.sentence, 60.0, 1.0)
    assert result.exit_code("standalone") == 0, [s.as_dict() for s in result.outside()]


@pytest.mark.parametrize("kind", ["actuators", "gusts"])
def test_the_excited_aircraft_stays_near_trim_and_reference(kind):
    """What heli_flight's README promises of the experiments: 5 deg, 0.5 m."""
    settings = settings_of(IdentifyOrder(seed=1, one_process=True), kind)
    record = closed_loop.simulate(settings).record
    excited = slice(800, None)  # 8 s: start of the sines in both scenarios
    phi, theta = euler_angles(record.truth_q_nb)[excited, :2].T
    trim = settings.nodes["inner_loop"]["trim.x"]
    for angle, at in ((phi, trim[0]), (theta, trim[1])):
        assert 0.2 < np.degrees(np.abs(angle - at).max()) < 5.0
    error = (record.nav_pos_ned_m - record.reference[:, :3])[excited]
    assert 0.05 < np.linalg.norm(error, axis=1).max() < 0.5


@pytest.mark.slow
def test_no_number_comes_from_the_simulators_inside(outcome_and_file):
    """The truth may be wrong in any way: what is written for the nodes stays the same."""
    from heli_studies.identify import identify

    outcome, _ = outcome_and_file
    found_numbers = outcome.identification
    blind = replace(
        outcome.settings,
        nodes={
            **outcome.settings.nodes,
            "plant": {"aircraft_file": "none.yaml", "delay_ticks": 9},
            "inner_loop": {
                **outcome.settings.nodes["inner_loop"],
                "model.A": np.zeros((9, 9)),
                "model.B": np.zeros((9, 3)),
                "model.E": np.zeros((9, 3)),
            },
        },
    )
    again = identify(found_numbers.actuators, found_numbers.gusts, found_numbers.a_priori, blind)
    np.testing.assert_array_equal(again.design.observer.K, found_numbers.design.observer.K)
    for node, values in found_numbers.design.values.items():
        assert "plant" not in node
        for key, value in values.items():
            np.testing.assert_array_equal(again.design.values[node][key], value)


def test_the_rotor_tells_the_vertical_air_with_its_turbulence(outcome_and_file):
    """Where the kink of the climb power lies: E(r,w) hangs on it."""
    identification = outcome_and_file[0].identification
    settings = settings_of(IdentifyOrder(seed=1, one_process=True), "gusts")
    record = closed_loop.simulate(settings).record
    part = slice(3000, 19000)
    relative = (record.wind_ned_mps - record.truth_vel_ned_mps)[part]
    turned = [quat_to_R_nb(q).T @ v for q, v in zip(record.truth_q_nb[part], relative, strict=True)]
    true = np.array(turned)[:, 2]
    found_w = relative_air_w(
        experiment_of_record(record, identification.a_priori), identification.ab,
        identification.collective,
    )  # fmt: skip
    assert (found_w - (true - true.mean())).std() < 0.1 < 0.4 < true.std()


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(2, 12))
def test_other_seeds_meet_the_targets_too(tmp_path, seed):
    """Within the target and the flight's own two sigma; seeds 1 to 20 miss the bare target once,
    E(p,w) by 10.03 % on seed 9, of 27 numbers each."""
    outcome, file = identified(tmp_path, seed)
    beyond = [
        row
        for row in misses(outcome.rows)
        if abs(row.deviation) > row.target + 2.0 * row.sigma / abs(row.truth) or np.isnan(row.sigma)
    ]
    assert lines(beyond) == []
    settings = resolve(seed=seed, params=[file])
    flight = closed_loop.simulate(settings)
    result = Result(score(flight.record, settings.scenario), flight.sentence, 60.0, 1.0)
    assert result.exit_code("standalone") == 0


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["xcell60", "logo600"])
def test_other_aircraft_are_identified_and_hover_with_it(tmp_path, name):
    """Entries as above; the norms, which hang on E(r,w) alone, within 10 %."""
    wanted = IdentifyOrder(seed=1, one_process=True, aircraft=f"{name}.yaml")
    outcome = execute(wanted, tmp_path / "found")
    beyond = [
        row
        for row in misses(outcome.rows)
        if not abs(row.deviation) < max(0.1, row.target + 2.0 * row.sigma / abs(row.truth))
    ]
    assert lines(beyond) == []
    settings = resolve(seed=1, params=[*layers(wanted), tmp_path / "found" / YAML])
    flight = closed_loop.simulate(settings)
    result = Result(score(flight.record, settings.scenario), flight.sentence, 60.0, 1.0)
    assert result.exit_code("standalone") == 0


@pytest.mark.nightly
def test_packaged_experiments_are_what_their_script_writes(tmp_path):
    script = Path(__file__).resolve().parents[2] / "scripts/write_identify_scenarios.py"
    subprocess.run([sys.executable, script, tmp_path], check=True, stdout=subprocess.DEVNULL)
    packaged = config_folder("heli_flight") / "scenarios"
    written = sorted(tmp_path.glob("*.yaml"))
    assert [f.name for f in written] == ["identify_actuators.yaml", "identify_gusts.yaml"]
    for file in written:
        assert file.read_text() == (packaged / file.name).read_text(), file.name
