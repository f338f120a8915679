# SPDX-License-Identifier: Apache-2.0
"""Spectra of a flight against what is known without them, and the design's numbers beside them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from heli_core.ticks import TICK_S
from heli_dynamics_sim.config import PlantConfig
from heli_flight.flight_file import write_parameters
from heli_flight.loop import simulate
from heli_flight.record import write_record
from heli_flight.report.charts import flown_design
from heli_flight.report.data import Report
from heli_flight.report.spectra import (
    LEAST_SAMPLES,
    even,
    folded,
    loop_tables,
    rotor_lines,
    spectra_of,
    spectrum,
    spectrum_charts,
    spectrum_table,
)
from heli_flight.report.write import recorded, report_of
from heli_flight.result import Result
from heli_flight.scoring import Figures
from heli_flight.settings import resolve
from heli_inner_hinf.controller_state import Actuation, ObserverInput
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.tuning import loops_of, model_of
from heli_studies.design.position_search import position_loop

RATE_HZ = 100.0
SEED = 3
RESPONSE = Path(__file__).resolve().parents[3] / "docs/results/response.json"


def drifting(n, keep, sigma):
    """A first-order Gauss-Markov sequence, stationary from the start."""
    rng = np.random.default_rng(SEED)
    values = np.empty(n)
    values[0] = sigma * rng.normal()
    for k, step in enumerate(rng.normal(scale=sigma * np.sqrt(1.0 - keep**2), size=n - 1)):
        values[k + 1] = keep * values[k] + step
    return values


@pytest.mark.parametrize("n", [LEAST_SAMPLES, 1251, 3500, 60_000])
def test_the_area_below_a_density_is_the_variance(n):
    """Parseval: of noise that changes fast beside a window."""
    values = 7.0 + np.random.default_rng(n).normal(scale=0.3, size=n)
    estimate = spectrum(values, RATE_HZ)
    assert estimate.rms == pytest.approx(np.std(values), rel=1e-12)
    assert estimate.area_rms == pytest.approx(estimate.rms, rel=2.5 / np.sqrt(n) + 0.01)
    assert estimate.hertz[-1] == pytest.approx(0.5 * RATE_HZ, abs=estimate.step_hz)
    assert estimate.hertz[0] == estimate.step_hz


def test_a_drift_has_the_density_that_it_must_have():
    """One-sided density of a Gauss-Markov sequence, in closed form."""
    keep, sigma = 0.95, 0.4
    estimate = spectrum(drifting(400_000, keep, sigma), RATE_HZ)
    phase = 2.0 * np.pi * estimate.hertz / RATE_HZ
    exact = 2.0 / RATE_HZ * sigma**2 * (1.0 - keep**2)
    exact = exact / (1.0 + keep**2 - 2.0 * keep * np.cos(phase))
    # Each line scatters; a third of a decade of them must not be off.
    edges = np.geomspace(0.1, 45.0, 9)
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        some = (estimate.hertz >= low) & (estimate.hertz < high)
        assert some.sum() >= 4
        assert np.mean(estimate.density[some] / exact[some]) == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("hertz", [1.0, 7.3, 30.87])
def test_a_sine_has_its_power_at_its_frequency(hertz):
    time_s = np.arange(6000) / RATE_HZ
    estimate = spectrum(2.0 + 0.6 * np.sin(2.0 * np.pi * hertz * time_s), RATE_HZ)
    peak = estimate.hertz[np.argmax(estimate.density)]
    assert peak == pytest.approx(hertz, abs=0.51 * estimate.step_hz)
    near = np.abs(estimate.hertz - hertz) < 4.0 * estimate.step_hz
    assert estimate.density[near].sum() * estimate.step_hz == pytest.approx(0.6**2 / 2.0, rel=0.02)
    assert estimate.median_hz == pytest.approx(hertz, abs=1.1 * estimate.step_hz)
    assert estimate.below(hertz + 1.0) == pytest.approx(1.0, abs=0.01)
    assert estimate.below(hertz - 0.9) < 0.02


def test_where_a_sine_is_seen_in_samples():
    assert folded(30.8, 100.0) == pytest.approx(30.8)
    assert folded(61.7, 100.0) == pytest.approx(38.3)
    assert folded(130.0, 100.0) == pytest.approx(30.0)
    time_s = np.arange(6000) / RATE_HZ
    estimate = spectrum(np.sin(2.0 * np.pi * 61.7 * time_s), RATE_HZ)
    assert estimate.hertz[np.argmax(estimate.density)] == pytest.approx(38.3, abs=estimate.step_hz)


def test_samples_that_are_missing_are_filled_and_counted():
    time_s = np.arange(1000) / RATE_HZ
    values = np.column_stack([time_s, -2.0 * time_s])
    kept = np.ones(1000, bool)
    kept[[3, 500, 501]] = False
    rate_hz, samples, filled = even(time_s[kept], values[kept])
    assert (rate_hz, filled) == (pytest.approx(RATE_HZ), 3)
    np.testing.assert_allclose(samples, values, atol=1e-12)
    assert even(time_s[:100], values[:100]) is None
    values[700] = np.nan
    assert even(time_s, values) is None


@pytest.fixture(scope="module")
def honest():
    """A hover in the honest world, whose rotor shakes the IMU."""
    settings = resolve(world="honest", seed=SEED)
    record = simulate(settings).record
    return Report(record, settings, Result(Figures(), "", 60.0, 1.0), "one process")


def test_the_rotor_is_seen_where_it_is_simulated(honest):
    spectra = spectra_of(honest)
    assert (spectra.start_s, spectra.rate_hz) == (25.0, pytest.approx(RATE_HZ))
    force = next(s for s in spectra.signals if s.key == "spectrum_force")
    (turn, words), (blade, blades) = rotor_lines(honest)
    aircraft = PlantConfig.from_parameters(honest.settings.nodes["plant"]).helicopter
    assert turn == pytest.approx(aircraft.main_speed_radps / (2.0 * np.pi))
    assert blade == pytest.approx(aircraft.main_blades * turn)
    assert words.startswith("1 per revolution, ") and blades.endswith(f"{blade:.1f} Hz")
    down = force.spectra[2]
    # With the governor the rotor turns up to some parts in a hundred slower or faster.
    assert down.hertz[np.argmax(down.density)] == pytest.approx(turn, rel=0.03)
    high = down.hertz > turn + 3.0
    second = down.hertz[high][np.argmax(down.density[high])]
    assert second == pytest.approx(folded(blade, RATE_HZ), rel=0.05)
    charts = {chart.key: chart for chart in spectrum_charts(honest, spectra, None)}
    labels = [trace.label for trace in charts["spectrum_rate"].panels[0].traces]
    assert labels[:3] == ["p", "q", "r"] and len(labels) == 5
    assert labels[4].endswith(f" {folded(blade, RATE_HZ):.1f} Hz")
    still = replace(honest, settings=resolve(world="paper"))
    assert rotor_lines(still) == []


def test_charts_and_table_say_units_and_numbers(honest):
    spectra, design = spectra_of(honest), flown_design(honest.settings)
    charts = {chart.key: chart for chart in spectrum_charts(honest, spectra, design)}
    assert list(charts) == ["spectrum_force", "spectrum_rate", "spectrum_actuators",
                            "spectrum_attitude", "spectrum_position"]  # fmt: skip
    units = [chart.panels[0].y_label for chart in charts.values()]
    assert units == ["density, (m/s²)²/Hz", "density, (rad/s)²/Hz", "density, 1/Hz",
                     "density, (°)²/Hz", "density, (m)²/Hz"]  # fmt: skip
    assert all(chart.x_label == "frequency, Hz" and not chart.time for chart in charts.values())
    table = spectrum_table(spectra)
    row = next(row for row in table.rows if row[0] == "specific force, down, m/s²")
    inside = honest.record.time_s >= spectra.start_s
    assert float(row[1]) == pytest.approx(np.std(honest.record.imu[inside, 2]), rel=0.01)
    lines = charts["spectrum_attitude"].panels[0].traces
    for name, of in (("DRB", "rejection_radps"), ("crossover", "crossover_radps")):
        drawn = [trace.x[0] for trace in lines if trace.label == name]
        wanted = [getattr(numbers, of) / (2.0 * np.pi) for numbers in design.axes]
        assert drawn == pytest.approx(wanted)
    assert "attitude, roll, °" in {row[0] for row in table.rows}
    attitude, position = loop_tables(design)
    for of_loop in (attitude, position):
        assert "(DRB)" in of_loop.rows[0][0]
    assert attitude.head[1:] == ("roll", "pitch", "yaw") and position.head[1] == "forward"


def test_without_imu_or_time_there_is_less(honest):
    without = replace(honest, record=replace(honest.record, imu=None))
    assert [s.key for s in spectra_of(without).signals][0] == "spectrum_actuators"
    short = replace(honest, record=simulate(resolve(duration_s=1.0)).record)
    assert spectra_of(short).signals == () and spectrum_table(spectra_of(short)) is None
    assert spectrum_charts(short, spectra_of(short), None) == []


@pytest.mark.parametrize("laws", ["hinf_output", "hinf", "pid"])
def test_the_designs_rejection_is_what_sweeps_in_flight_gave(laws):
    """Flown: a sweep added to the measured attitude (docs/results/response.json)."""
    rows = [row for row in json.loads(RESPONSE.read_text())["found"]["rows"] if row["laws"] == laws]
    assert [row["axis"] for row in rows] == ["roll", "pitch", "yaw"]
    axes = flown_design(resolve("attitude", world="paper", laws=laws)).axes
    for row, numbers in zip(rows, axes, strict=True):
        flown = np.mean(row["rejection"]["bandwidth_radps"])
        assert numbers.rejection_radps == pytest.approx(flown, rel=0.05), row["axis"]
        # A sweep's windows flatten a narrow peak, by up to 0.6 dB (pid).
        flown = np.mean(row["rejection"]["peak_db"])
        assert numbers.peak_db == pytest.approx(flown, abs=0.7), row["axis"]
        assert numbers.peak_db == pytest.approx(row["linear_rejection"]["peak_db"], abs=0.15)
        by_phase = np.mean(row["flown"]["phase_radps"])
        assert numbers.phase_bandwidth_radps == pytest.approx(by_phase, rel=0.06), row["axis"]
        linear = row["linear"]["phase_radps"]
        assert numbers.phase_bandwidth_radps == pytest.approx(linear, rel=0.01), row["axis"]


@pytest.mark.slow
def test_the_position_loops_numbers_are_those_of_its_design(honest):
    """`heli design` has the same axes, and finds their crossovers by python-control."""
    design = flown_design(honest.settings)
    nodes = honest.settings.nodes
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    feed = ObserverInput.from_parameters(nodes["observer"])
    K = np.reshape(nodes["observer"]["K"], (3, 6))
    plant = PlantConfig.from_parameters(nodes["plant"])
    servos = plant.helicopter.servo_bandwidth_radps, plant.helicopter.servo_damping
    actuation = Actuation(*servos, TICK_S * plant.delay_ticks, TICK_S)
    attitude = loops_of(config, K, feed, actuation)[-1]
    of = nodes["plant"], nodes["outer_loop"], attitude, model_of(config)
    reports = position_loop(*of, actuation).reports(nodes["outer_loop"])
    for numbers, report in zip(design.position, reports, strict=True):
        assert numbers.crossover_radps == pytest.approx(report.crossover_radps, rel=0.01)
        # A displacement is answered below the crossover, and overshot near it.
        assert 0.0 < numbers.rejection_radps < numbers.crossover_radps
        assert 0.0 < numbers.peak_db < 12.0 and numbers.peak_radps > numbers.rejection_radps


def test_an_attitude_test_has_no_position_loop():
    design = flown_design(resolve("attitude", world="paper"))
    assert design.position == [] and len(loop_tables(design)) == 1


def test_a_flight_that_is_loaded_has_them_too(honest, tmp_path):
    write_parameters(honest.settings, tmp_path / "params.yaml")
    write_record(honest.record, tmp_path)
    text = report_of(recorded(tmp_path)).read_text(encoding="utf-8")
    assert '<section id="spectra">' in text and 'id="chart-spectrum_force"' in text
    assert "force, down, m/s²" in text and "(DRB), rad/s" in text
