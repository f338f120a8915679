# SPDX-License-Identifier: Apache-2.0
"""What the observer's tests share: parameters, and a run of the observer over a flight."""

from pathlib import Path

import numpy as np
import pytest

from heli_core.parameters import load
from heli_core.rows import NAV
from heli_observer.layout import ObserverStatus
from heli_observer.observer import ObserverConfig, initial_state, observe, status
from heli_observer.parameters import NODE_NAME, TABLE
from support.synthetic_sensors import hover_path, synthesize

CONFIG = Path(__file__).resolve().parents[1] / "config"


@pytest.fixture
def parameters():
    """Packaged parameters of the observer (a fresh dictionary)."""
    return dict(load(TABLE, [CONFIG / "observer.yaml"], NODE_NAME))


@pytest.fixture
def config_folder():
    return CONFIG


@pytest.fixture
def exact_sensors(parameters):
    """A flight with ideal sensors; the parameters still say that they are noisy."""
    return synthesize(hover_path(climb_mps=2.5), parameters, 30.0, seed=0, noise=0.0)


class Run:
    """One observer over the rows of a flight; `out` holds its output at every tick."""

    def __init__(self, parameters):
        self.config = ObserverConfig(parameters)
        self.params = self.config.params
        self.state = initial_state(self.config)
        self.u = np.array(parameters["trim.u"], dtype=float)
        self.out = np.zeros((0, NAV.size))

    def step(self, tick, y, u=None):
        out = np.empty(NAV.size)
        command = self.u if u is None else np.asarray(u, dtype=float)
        observe(self.state, tick, np.ascontiguousarray(y), command, self.params, out)
        return out

    def fly(self, rows):
        start = len(self.out)
        new = [self.step(start + n, row) for n, row in enumerate(rows)]
        self.out = np.vstack([self.out, *new])
        return self

    @property
    def health(self):
        return ObserverStatus(status(self.state, self.params))


@pytest.fixture
def run_observer():
    """Function (parameters) -> Run."""
    return Run
