# SPDX-License-Identifier: Apache-2.0
"""The position loop's axes together, against each one alone and against its own poles."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.linalg import block_diag

from heli_core.rows import MEASURED
from heli_flight.settings import resolve
from heli_inner_hinf.controller_state import Actuation, read_inputs
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.tuning import model_of
from heli_outer_pd.analysis import Gains, disk_margin, law, open_loop
from heli_outer_pd.parameters import outer_params
from heli_studies.compare import loop_as_flown
from heli_studies.design.position_search import (
    CoupledPlant,
    _turned,
    common_disk_margin,
    position_loop,
)


@pytest.fixture(scope="module")
def nodes():
    return resolve(world="honest").nodes


@pytest.fixture(scope="module")
def loop(nodes):
    attitude, config = (
        loop_as_flown(nodes),
        AttitudeConfig.from_parameters(nodes["inner_loop"]),
    )
    return position_loop(
        nodes["plant"], nodes["outer_loop"], attitude, model_of(config), Actuation()
    )


@pytest.fixture(scope="module")
def gains(nodes):
    kernel = outer_params(nodes["outer_loop"])
    return tuple(Gains.of(kernel, i) for i in range(3))


def test_axes_that_do_not_meet_have_the_smallest_of_their_margins(loop, gains):
    parts = [axis.lifted for axis in loop.axes]
    A, B, M = (block_diag(*(part[place] for part in parts)) for place in (0, 1, 3))
    # The noises are not driven, their states not seen by the common loop.
    apart = CoupledPlant(A, B, M, loop.coupled.dt_s)
    each = [
        disk_margin(open_loop(axis, axis_gains)[1])
        for axis, axis_gains in zip(loop.axes, gains, strict=True)
    ]
    assert common_disk_margin(apart, loop.axes, gains).alpha == pytest.approx(min(each), rel=2e-3)


def test_along_its_own_axis_the_coupled_aircraft_is_the_axis(loop):
    """Second model: each axis alone, by the attitude loop's closed form; 16 % up to 15 rad/s."""
    p = loop.coupled
    for i, axis in enumerate(loop.axes):
        omega, alone = axis.response
        for at in (1.0, 3.0, 7.0, 15.0):
            k = int(np.argmin(np.abs(omega - at)))
            z = np.exp(1j * omega[k] * p.dt_s)
            moved = p.M @ np.linalg.solve(z * np.eye(len(p.A)) - p.A, p.B[:, i])
            assert abs(moved[3 * i + 1] / alone[k, 1] - 1.0) < 0.16, (i, at)


def test_the_margin_holds_for_gains_and_less_than_the_axes_alone(loop, gains):
    """Within the margin every corner of three gains is stable by the poles; the least gain that is
    not lies beyond it."""
    margin, p = common_disk_margin(loop.coupled, loop.axes, gains).alpha, loop.coupled
    laws = [law(axis_gains, axis) for axis_gains, axis in zip(gains, loop.axes, strict=True)]
    A, B, C, D = (block_diag(*(one[part] for one in laws)) for part in range(4))

    def stable(factors):
        enters = p.B * factors
        closed = np.block([[p.A + enters @ D @ p.M, enters @ C], [B @ p.M, A]])
        return np.max(np.abs(np.linalg.eigvals(closed))) < 1.0

    def within(alpha):
        edge = np.array([(2.0 - alpha) / (2.0 + alpha), (2.0 + alpha) / (2.0 - alpha)])
        return all(stable(edge[[a, b, c]]) for a in (0, 1) for b in (0, 1) for c in (0, 1))

    assert 0.6 < margin < 0.9
    assert within(margin)
    assert not within(2.2 * margin)


def test_an_unstable_loop_has_none(loop, gains):
    wild = (replace(gains[0], K_P=40.0), *gains[1:])
    assert common_disk_margin(loop.coupled, loop.axes, wild).alpha == 0.0


def test_a_law_that_turns_its_errors_does_so_as_it_flies(nodes):
    """Slopes of what the kernel reads at 30 deg of bank."""
    bank, k = 0.5, AttitudeConfig.from_parameters(nodes["inner_loop"]).params
    read = control.ss([], [], [], np.eye(9), True)
    read_matrix = _turned(read, bank).D
    places = [*MEASURED, 0, 1, 2]

    def inputs(place, step):
        x9, r3, v = k.x_trim.copy(), k.x_trim[[0, 1, 8]].copy(), np.zeros(8)
        x9[0] += bank
        (x9 if place < 6 else r3)[places[place]] += step
        read_inputs(x9, r3, k.x_trim, v)
        return v

    for place in range(8):
        slope = (inputs(place, 1e-5) - inputs(place, -1e-5)) / 2e-5
        assert read_matrix[:8, place] == pytest.approx(slope, abs=1e-8), place
