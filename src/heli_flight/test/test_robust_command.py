# SPDX-License-Identifier: Apache-2.0
"""The proof for every aircraft of a set: its linear model, the loop as flown, and bad input."""

import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from heli_core.linear import with_servos
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import TICK_S
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.trim import linearize, trim
from heli_flight.cli.app import main
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.controller_state import Actuation
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import Assessment, judge
from heli_inner_hinf.robust.sampled_norm import HeldPlant, SampledLaw, sampled_norm
from heli_inner_hinf.robust.uncertain import Range
from heli_inner_hinf.robust.worst_case import UncertainFamily
from heli_studies.compare import margins_as_flown
from heli_studies.robust import (
    AircraftRanges,
    AircraftSet,
    Proof,
    aircraft_set,
    as_dict,
    disks_at_input,
    disks_at_output,
    exact,
    feedback_flown,
    growth_in_flight,
    linear,
    prove,
    read_ranges,
    uncertain_loop,
    wind_to_h,
)

NAMES = ("inertia_yy", "rotor_stiffness", "flapping")


@pytest.fixture(scope="module")
def settings() -> Settings:
    return resolve()


@pytest.fixture(scope="module")
def aircraft(settings: Settings) -> AircraftSet:
    nominal = HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])
    return aircraft_set(nominal, read_ranges([]).ranges)


def test_nine_states_are_those_of_the_linearisation(aircraft: AircraftSet) -> None:
    A, B = linear(aircraft.aircraft)
    nine = linearize(aircraft.aircraft, trim(aircraft.aircraft))
    np.testing.assert_allclose(A[:9, :9], nine.A, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(B[:9], nine.B, rtol=1e-6, atol=1e-7)
    # The air that comes is the motion that goes: in level hover E is the column of the velocity.
    np.testing.assert_allclose(A[:9, 9], -nine.E[:, 0], atol=0.03 * np.abs(nine.E).max())


def test_model_of_every_aircraft_is_that_of_each(aircraft: AircraftSet) -> None:
    """Corners, linearised anew: each row within its share of what typical motions do to it."""
    assert aircraft.residual < 0.01
    rng = np.random.default_rng(3)
    for _ in range(3):
        corner = rng.choice([-1.0, 1.0], len(aircraft.ranges))
        deltas = dict(zip((r.name for r in aircraft.ranges), corner.tolist(), strict=True))
        truth = np.hstack(aircraft.linear(deltas))
        error = np.abs(aircraft.model.at(deltas) - truth).max(axis=1)
        assert np.all(error <= 0.015 * np.abs(truth).max(axis=1))


@pytest.mark.slow
def test_worst_corner_is_found_where_the_signs_of_the_slopes_lead_to_another(
    settings: Settings, aircraft: AircraftSet
) -> None:
    """Three ticks of delay: mass, I_xx, stiffness, flapping up, I_yy, I_zz, servos down."""
    law = feedback_flown(settings)
    onset = UncertainFamily(uncertain_loop(aircraft, law, 3)).onset(3.0)
    assert onset.size < 1.1327
    up = {name for name, delta in onset.deltas.items() if delta > 0.9 * onset.size}
    down = {name for name, delta in onset.deltas.items() if delta < -0.9 * onset.size}
    assert up - {"flap_back"} == {"mass", "inertia_xx", "rotor_stiffness", "flapping"}
    assert down - {"flap_back"} == {"inertia_yy", "inertia_zz", "servo_speed"}
    assert exact(aircraft, {k: 1.001 * d for k, d in onset.deltas.items()}, law, 3) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("ticks", [0, 1, 3])
def test_loop_in_the_plane_is_the_sampled_loop(
    settings: Settings, aircraft: AircraftSet, ticks: int
) -> None:
    """The stability margin of the rational loop and of the exactly sampled one, within 1 %."""
    law = feedback_flown(settings)
    onset = UncertainFamily(uncertain_loop(aircraft, law, ticks)).onset(3.0)
    assert onset.size < 3.0

    def growth(factor: float) -> float:
        return exact(aircraft, {k: factor * d for k, d in onset.deltas.items()}, law, ticks)

    assert growth(0.99) < 0.0 < growth(1.01)


@pytest.mark.slow
def test_bounds_of_the_margin_meet(settings: Settings) -> None:
    """The proof and the worst aircraft, within 5 %, and the sampled loop is unstable with it."""
    ranges = tuple(Range(name, 1.0, 0.7, 1.3) for name in NAMES)
    proof = prove(settings, AircraftRanges(ranges, (2,), 0.04))
    case = proof.cases[0]
    assert case.largest_psi < 0.0
    assert case.proved <= case.onset.size <= 1.05 * case.proved
    assert case.exact_onset == pytest.approx(case.onset.size, rel=0.02)
    assert set(as_dict(proof)["ranges"]) == set(NAMES)
    assert proof.gain is not None
    for bounds in (proof.gain, *proof.disks.values()):
        assert bounds.nominal < bounds.lower <= bounds.upper <= 1.15 * bounds.lower
    wind = wind_to_h(proof.aircraft, proof.law, 2, *h_of(settings))
    for corner in itertools.product((-1.0, 1.0), repeat=3):
        assert wind.gain(np.array(corner))[0] <= proof.gain.upper
        sampled = judged(proof, dict(zip(NAMES, corner, strict=True)))
        assert sampled.disk_input >= 0.98 / proof.disks["input"].upper
        assert sampled.disk_output >= 0.98 / proof.disks["output"].upper
    # The worst members found, sampled exactly and with the other algorithm for mu.
    for at in ("input", "output"):
        sampled = judged(proof, proof.disks[at].deltas)
        margin = {"input": sampled.disk_input, "output": sampled.disk_output}[at]
        assert margin == pytest.approx(1.0 / proof.disks[at].lower, rel=0.03)


def judged(proof: Proof, deltas: Mapping[str, float]) -> Assessment:
    """Disk margins of one aircraft, linearised anew, its loop sampled exactly; 2 ticks of delay."""
    helicopter = proof.aircraft.aircraft
    lag = Actuation(helicopter.servo_bandwidth_radps, helicopter.servo_damping, 2 * TICK_S)
    return judge(*proof.aircraft.linear(deltas), proof.law, lag)


def h_of(settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    config = AttitudeConfig.from_parameters(settings.nodes["inner_loop"])
    return config.C, config.D


def test_gains_are_those_of_the_sampled_loop(settings: Settings, aircraft: AircraftSet) -> None:
    """The nominal disk margin as `heli design` has it; the norm of a member between its samples."""
    law = feedback_flown(settings)
    disks = disks_at_input(aircraft, law, 1)
    nominal = np.zeros(len(disks.names))
    known = margins_as_flown(settings.nodes)
    assert known is not None
    assert 1.0 / disks.gain(nominal)[0] == pytest.approx(known.input, rel=0.02)
    outputs = disks_at_output(aircraft, law, 1)
    assert 1.0 / outputs.gain(nominal)[0] == pytest.approx(known.output, rel=0.02)

    C, D = h_of(settings)
    wind = wind_to_h(aircraft, law, 1, C, D)
    member = dict(zip(wind.names, np.linspace(-0.6, 0.7, len(wind.names)).tolist(), strict=True))
    A, B = aircraft.linear(member)
    helicopter, speed = aircraft.aircraft, aircraft.values(member)["servo_speed"]
    behind = with_servos(A, B, speed * helicopter.servo_bandwidth_radps, helicopter.servo_damping)
    size = behind[0].shape[0]
    h = np.zeros((9, size))
    h[:, :9], h[:, 11:14] = C, D
    plant = HeldPlant(
        *behind, -behind[0][:, 9:11], h, np.eye(size)[list(law.measured)], TICK_S, TICK_S
    )
    norm = sampled_norm(plant, SampledLaw(*law[:4]), 1e-4)
    gain = wind.gain(np.array([member[name] for name in wind.names]))[0]
    assert gain == pytest.approx(norm.upper, rel=0.02)


def test_worst_aircraft_flown_loses_it_where_the_linear_one_does(
    settings: Settings, aircraft: AircraftSet
) -> None:
    """Nonlinear simulation, 5 % below and above the onset; above, it grows as fast."""
    law = feedback_flown(settings)
    onset = UncertainFamily(uncertain_loop(aircraft, law, 1)).onset(3.0)
    for factor, sign in ((0.95, -1.0), (1.05, 1.0)):
        deltas = {name: factor * delta for name, delta in onset.deltas.items()}
        flown = growth_in_flight(settings, aircraft, deltas, 1, onset.frequency_radps)
        assert np.sign(flown) == sign
    assert flown == pytest.approx(exact(aircraft, deltas, law, 1), rel=0.1)


BAD = {
    "mass: [1.3, 1.0, 0.7]": "from low to high",
    "mass: [1.1, 1.0, 1.3]": "has to lie inside the range",
    "delay_ticks: [3.0, 1.0]": "the fewest first",
    "mas: [0.7, 1.0, 1.3]": "mass",
    "gap: -1.0": "gap",
    "mass: [0.7, 1.0, 3.9]": "mass 3.9: an aircraft of the ranges cannot be flown",
}


@pytest.mark.parametrize(("line", "expected"), BAD.items())
def test_bad_sets_are_refused_in_one_sentence(
    tmp_path: Path, line: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "ranges.yaml"
    file.write_text(f"/**/robust:\n  ros__parameters:\n    {line}\n", encoding="utf-8")
    assert main(["robust", "--params", str(file)]) == 2
    stderr = capsys.readouterr().err
    assert expected in stderr
    assert len([row for row in stderr.splitlines() if row.startswith("heli")]) == 1


def test_unstable_nominal_loop_is_refused(settings: Settings) -> None:
    """With 10 ticks of delay the nominal aircraft is lost: nothing to prove, said so."""
    ranges = (Range("inertia_xx", 1.0, 0.7, 1.3),)
    with pytest.raises(ParameterError, match="10 ticks"):
        prove(settings, AircraftRanges(ranges, (10,), 0.04))
