# SPDX-License-Identifier: Apache-2.0
"""What the MPC is weighed with: itself where no limit acts, by the cost of the packaged gains."""

import numpy as np
import pytest

from evidence.experiments.mpc import example, linear, price
from heli_flight.settings import resolve
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.tuning import model_of
from heli_outer_pd.analysis import Gains, cost, law
from heli_outer_pd.parameters import outer_params
from heli_studies.compare import loop_as_flown
from heli_studies.design.position_search import WANTED, position_loop


@pytest.mark.parametrize("i", range(3))
def test_the_linear_law_commands_what_the_axis_does(i):
    mpc = example()
    axis = mpc.AxisMpc(mpc.MODELS[i], mpc.WEIGHTS[i], 1e9)
    k = linear(axis)
    axis.begin(0.0, 0.0)
    x, rng = np.zeros(len(k.A)), np.random.default_rng(1)
    for _ in range(20):
        position, speed = 0.1 * rng.standard_normal(2)
        read = np.array([position, speed, 0.0])
        axis.observe(speed, speed, 1e9)
        made = axis.command(position, speed, np.zeros(mpc.HORIZON), -1e9, 1e9)
        assert made == pytest.approx((k.C @ x + k.D @ read)[0], abs=1e-9)
        x = k.A @ x + k.B @ read


@pytest.mark.slow
def test_a_law_costs_what_the_search_of_the_packaged_gains_says():
    nodes = resolve("hover", "rtk", world="honest").nodes
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    parts = loop_as_flown(nodes), model_of(config), config.actuation
    around = position_loop(nodes["plant"], nodes["outer_loop"], *parts)
    packaged = outer_params(nodes["outer_loop"])
    for i, (axis, others) in enumerate(zip(around.axes, around.others, strict=True)):
        gains = Gains.of(packaged, i)
        weighed = price(around, i, law(gains, axis))
        assert weighed == pytest.approx(cost(gains, axis, others, WANTED[i]))
