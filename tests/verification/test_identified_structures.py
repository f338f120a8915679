# SPDX-License-Identifier: Apache-2.0
"""Structures of the hover model: each is found again, an unstable one too; a wrong one is told.

The truths are published aircraft (`config/linear`), their flapping states residualised where the
rotor is to follow at once, flown in closed loop with turbulence and noise.
"""

from dataclasses import replace

import numpy as np
import pytest

from heli_analysis.identification import (
    AperiodicRecord,
    IdentificationCause,
    IdentificationError,
    fit_actuators,
    fit_record,
    spectra_of,
    trim_of,
)
from heli_analysis.identification.doubts import StructureDoubt, structure_doubts
from heli_analysis.identification.estimator import Problem, StartSearch, summary
from heli_analysis.identification.model import (
    FAST,
    FastModel,
    empty_model,
    full_matrices,
    transfer,
    values_of,
)
from heli_analysis.identification.structure import (
    AIR,
    FADES_S,
    FULL,
    N_FAST,
    STATE,
    ModelStructure,
    Rotor,
    at_once,
)
from heli_core.linear import hover_system
from heli_core.rows import ACTUATOR, NINE
from heli_core.ticks import TICK_S
from heli_dynamics_sim.linear_aircraft import LinearAircraft
from heli_flight.settings import resolve
from heli_inner_hinf.controller_state import Actuation
from heli_studies.design.make import Basis, design_of
from heli_studies.identify import read_given
from support.identification_flights import (
    Flight,
    fly,
    open_loop_poles,
    stabilising_law,
    true_model,
)

AT_ONCE = ModelStructure(Rotor.QUASI_STATIC)
RIGID = ModelStructure(Rotor.QUASI_STATIC, yaw_gyro=False)
BARE = ModelStructure(yaw_gyro=False)


def published(name, structure):
    """Fast states of a published aircraft in a structure, behind servos, with its delay."""
    aircraft = LinearAircraft.from_yaml(name)
    A9, B9, E9, _ = aircraft.nine()
    A, B, E = A9[FAST, FAST].copy(), np.zeros((N_FAST, 4)), np.zeros((N_FAST, AIR.size))
    B[:, ACTUATOR.attitude], E[:, AIR.velocity] = B9[FAST], E9[FAST]
    B[STATE.r, ACTUATOR.col] = 3.0
    if not structure.yaw_gyro:
        i = STATE.d_int
        A[i], A[:, i], B[i] = 0.0, 0.0, 0.0
        A[i, i] = -1.0 / FADES_S
    if structure.rotor is Rotor.QUASI_STATIC:
        A, B, E = at_once(A, B, E)
    return FastModel(A, B, E, 40.0, 0.7, round(aircraft.delay_s / TICK_S) * TICK_S)


def flown(model, **changes):
    return fly(Flight(seed=1, model=model, law=stabilising_law(model), **changes))


def significant(found, truth):
    """Errors of the significant entries of A and B, relative, and over their sigma."""
    names = [n for n in found.sigma if n[0] in "AB" and found.share.get(n, 0.0) >= 0.01]
    true, value = values_of(names, truth), values_of(names, found.fast)
    nonzero = true != 0.0
    error = np.abs(value - true)
    sigma = np.array([found.sigma[n] for n in names])
    return (error / np.abs(np.where(nonzero, true, 1.0)))[nonzero], error / sigma


# -------------------------------------------------------------------------------------------------
# Structures as such.
# -------------------------------------------------------------------------------------------------


def test_a_rotor_that_follows_at_once_has_the_steady_response_of_one_with_states():
    """At 0.001 rad/s, and not at 20 rad/s."""
    truth = true_model()
    quick = FastModel(*at_once(truth.A, truth.B, truth.E), truth.servo_radps, truth.servo_damping,
                      truth.delay_s)  # fmt: skip
    slow, fast = np.array([0.001]), np.array([20.0])
    np.testing.assert_allclose(transfer(quick, slow), transfer(truth, slow), rtol=3e-3, atol=1e-6)
    by_lat = [transfer(model, fast)[0, 0, 0] for model in (quick, truth)]
    assert abs(by_lat[0] / by_lat[1] - 1.0) > 0.3


@pytest.mark.parametrize("structure", [FULL, BARE, AT_ONCE, RIGID])
def test_states_that_a_structure_has_not_are_driven_by_nothing_and_felt_by_nothing(structure):
    names = structure.actuator_parameters(collective=True)
    assert structure.kept <= set(names) and len(set(names)) == len(names)
    absent = {"a_s", "b_s", "d_int"} - set(structure.states)
    assert not any(state in name for name in names for state in absent)
    A = empty_model(structure).A
    for i in structure.absent:
        assert A[i, i] == -1.0 / FADES_S
        assert not np.delete(A[i], i).any() and not np.delete(A[:, i], i).any()


def test_what_is_beyond_numbers_in_a_summary_is_a_named_cause():
    """SciPy would raise a bare ValueError."""
    spectra = spectra_of(fly(Flight(seed=1, periods=4, period_s=10.0, settle_s=10.0)))
    names = RIGID.actuator_parameters(collective=True)
    problem = Problem([spectra], names, empty_model(RIGID))
    values = values_of(names, empty_model(RIGID))
    values[names.index("A(p,p)")] = np.inf
    with pytest.raises(IdentificationError) as refused:
        summary(problem, values)
    assert refused.value.cause is IdentificationCause.NOT_CONVERGED


def test_a_search_for_a_start_that_meets_no_number_is_a_named_cause():
    spectra = spectra_of(fly(Flight(seed=1, periods=4, period_s=10.0, settle_s=10.0)))
    broken = replace(spectra, z=np.full_like(spectra.z, np.nan))
    for structure in (FULL, RIGID):
        with pytest.raises(IdentificationError) as refused:
            StartSearch(broken, structure).best()
        assert refused.value.cause is IdentificationCause.NOT_CONVERGED


# -------------------------------------------------------------------------------------------------
# Each is found again.
# -------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("structure", [AT_ONCE, RIGID])
def test_a_rigid_x_cell_is_found_again_and_nothing_is_doubted(structure):
    truth = published("xcell_tempest", structure)
    flight = flown(truth)
    found = fit_actuators(flight, structure=structure)
    error, z = significant(found, truth)
    assert error.size >= 7 and error.max() < 0.02 and z.max() < 4.0
    assert found.servo_radps == pytest.approx(40.0, rel=0.005) and found.delay_ticks == 0
    assert structure_doubts(found) == () and found.structure == structure
    # downstream takes it as it takes eq. (10)
    trim = trim_of(flight, found)
    assert trim.x[NINE.a_s] == trim.x[NINE.b_s] == 0.0
    assert np.all(found.B[NINE.a_s : NINE.r] == 0.0)


@pytest.mark.slow
def test_a_design_holds_an_unstable_aircraft_without_rotor_states_and_gyro():
    """What `heli identify` does in the end with a model of that structure."""
    truth = published("blade360", RIGID)
    A, B, E = full_matrices(truth, 0.0, 0.0)
    made = design_of(
        Basis(
            source="Blade 360, rotor at once",
            system=hover_system(A, B, E, "at_once"),
            x_trim=np.zeros(len(NINE)),
            u_trim=np.zeros(ACTUATOR.size),
            actuation=Actuation(truth.servo_radps, truth.servo_damping, truth.delay_s),
            outer={**read_given("helion", []).ground, "rotor.K_col": -0.165},
            plant={},
            residual=float("nan"),
        ),
        resolve(),
        gamma_factor=1.3,
    )
    assert made.reports[-1].stability < 0.0


@pytest.mark.slow
def test_an_unstable_blade_360_with_a_quasi_static_rotor_is_found_again_from_chirps():
    truth = published("blade360", RIGID)
    assert open_loop_poles(truth).real.max() > 0.9
    flight = flown(
        truth, chirps_s=60.0, period_s=240.0, periods=1, u_amplitude=(0.03, 0.03, 0.08, 0.04)
    )
    record = AperiodicRecord(
        flight.u, flight.excitation_u, flight.rate_body_radps, flight.vel_body_mps,
        flight.attitude_rad[:, :2], ((500, flight.u.shape[0]),),
    )  # fmt: skip
    found = fit_record(record, structure=RIGID)
    names = ("A(p,p)", "A(p,q)", "A(q,p)", "A(q,q)", "B(p,d_lat)", "B(p,d_lon)", "B(q,d_lat)",
             "B(q,d_lon)", "B(r,d_ped)")  # fmt: skip
    np.testing.assert_allclose(values_of(names, found.fast), values_of(names, truth), rtol=0.05)
    assert found.delay_ticks == 4
    assert structure_doubts(found) == ()


# -------------------------------------------------------------------------------------------------
# A wrong one is told, where it can be.
# -------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_structure_with_too_many_states_is_told_by_what_is_not_seen_of_them():
    flight = flown(published("xcell_tempest", RIGID))
    assert structure_doubts(fit_actuators(flight, structure=BARE)) == (StructureDoubt.NO_FLAPPING,)
    assert structure_doubts(fit_actuators(flight, structure=AT_ONCE)) == (StructureDoubt.NO_GYRO,)
    assert structure_doubts(fit_actuators(flight)) == (
        StructureDoubt.NO_FLAPPING,
        StructureDoubt.NO_GYRO,
    )


@pytest.mark.slow
def test_a_structure_with_too_few_states_leaves_what_it_does_not_explain():
    with_gyro = flown(published("xcell_tempest", AT_ONCE))
    told = structure_doubts(fit_actuators(with_gyro, structure=RIGID))
    assert told == (StructureDoubt.UNEXPLAINED,)
    with_disc = flown(published("blade360", FULL))
    found = fit_actuators(with_disc, structure=RIGID)
    assert StructureDoubt.UNEXPLAINED in structure_doubts(found)


@pytest.mark.slow
def test_a_disc_as_slow_as_the_body_without_its_states_is_refused_by_name():
    """HeLion's stabiliser bar: no quasi-static rotor comes near it."""
    with pytest.raises(IdentificationError) as refused:
        fit_actuators(fly(Flight(seed=1)), structure=AT_ONCE)
    assert refused.value.cause is IdentificationCause.UNSTABLE
