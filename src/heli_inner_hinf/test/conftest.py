# SPDX-License-Identifier: Apache-2.0
"""The published aircraft, the packaged design and random plants for the tests of this package."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from heli_core.parameters import load
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.parameters import NODE_NAME, TABLE
from heli_inner_hinf.regular_form import weights

HERE = Path(__file__).parent
YAML = HERE.parent / "config/inner_loop.yaml"


@pytest.fixture(scope="session")
def published():
    """A, B, E, C, D of the published hover model with the paper's weights."""
    data = yaml.safe_load((HERE / "data/nus_linear_model.yaml").read_text())
    A, B, E = (np.array(data[k], float) for k in "ABE")
    C, D = weights([13, 11, 1, 1], [[0, 0, 1, 0, 0], [0, 0, 0, 0, 5]], [12, 11, 31])
    return A, B, E, C, D


def state_feedback():
    """The packaged parameters, checked, with eq. (17) for the law."""
    return {**load(TABLE, [YAML], NODE_NAME), "controller": "hinf"}


@pytest.fixture
def parameters():
    """The packaged parameters with eq. (17) for the law."""
    return state_feedback()


@pytest.fixture(scope="session")
def config():
    """The packaged design of eq. (17)."""
    return AttitudeConfig.from_parameters(state_feedback())


@pytest.fixture(scope="session")
def random_plant():
    """Maker of plant number i: A, B, E, C, D with 2 to 40 states.

    Modes with time constants from 0.03 to 30 s, up to four of them unstable, weakly coupled and
    rotated; one to six inputs, winds and weighted outputs. Every third has cross terms D'C; every
    second is badly scaled: states by up to 1e6 against each other, inputs and winds by up to 1e6.
    """

    def modes(g, n):
        A, j, unstable = np.zeros((n, n)), 0, int(g.integers(0, min(n, 4) + 1))
        while j < n:
            size, sign = 10.0 ** g.uniform(-1.5, 1.5), 1 if unstable > 0 else -1
            if j + 1 < n and g.random() < 0.6 and unstable != 1:
                damping = g.uniform(0.02, 1.0)
                w = size * np.sqrt(1.0 - damping**2)
                A[j : j + 2, j : j + 2] = [[sign * damping * size, w], [-w, sign * damping * size]]
                j, unstable = j + 2, unstable - 2
            else:
                A[j, j] = sign * size
                j, unstable = j + 1, unstable - 1
        A += 0.1 * np.triu(g.standard_normal((n, n)), 2)
        q, _ = np.linalg.qr(g.standard_normal((n, n)))
        return q @ A @ q.T

    def make(i):
        g = np.random.default_rng(1000 + i)
        n = int(g.integers(2, 41))
        m, k, p = (int(v) for v in g.integers(1, min(n, 6) + 1, 3))
        A, B, E = modes(g, n), g.standard_normal((n, m)), g.standard_normal((n, k))
        C = np.vstack([g.standard_normal((p, n)), np.zeros((m, n))])
        D = np.vstack([np.zeros((p, m)), g.standard_normal((m, m)) + 2.0 * np.eye(m)])
        if i % 3 == 0:
            C, D = g.standard_normal(C.shape), g.standard_normal(D.shape)
        if i % 2 == 0:
            t = 10.0 ** g.uniform(-3, 3, n)
            A, C = A * t[:, None] / t, C / t
            B = B * t[:, None] * 10.0 ** g.uniform(-3, 3, m)
            E = E * t[:, None] * 10.0 ** g.uniform(-3, 3)
        return A, B, E, C, D

    return make
