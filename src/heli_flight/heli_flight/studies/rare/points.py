# SPDX-License-Identifier: Apache-2.0
"""Flights at chosen points of a campaign's dispersions, instead of those that it samples."""

import hashlib
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from heli_flight.loop.settings import Settings
from heli_flight.studies.dispersion.sampling import SEARCH, correlated
from heli_flight.studies.dispersion.spec import EACH, Spec, check_ends
from heli_parameters.parameters import ParameterError

Array = NDArray[np.float64]
LAST_SEED = 2**31 - 1
REACH = 6.0
"""As far out as rare failures are looked for, sigma."""


@dataclass(frozen=True)
class Points(Spec):
    """A spec whose flights are at points of standard normal space; how it samples counts no more.

    Attributes
    ----------
    parent : Spec
    scores : (N, d) array
        Independent standard normal scores of the dispersed parameters, in the order of the spec:
        their shares are the distributions' quantiles, after the spec's correlation. One more
        column is the score of the seed of wind and sensors, uniform from 1 to `LAST_SEED`; without
        it all flights have `one_seed` of the parent.
    """

    parent: Spec = field(default_factory=Spec)
    scores: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def of(cls, parent: Spec, scores: Array | None = None) -> "Points":
        """Those of a spec; without scores there is no flight."""
        if scores is None:
            scores = np.zeros((0, len(parent.names)))
        own = {f.name: getattr(parent, f.name) for f in fields(Spec)}
        return cls(
            **{**own, "flights": len(scores), "sampling": SEARCH}, parent=parent, scores=scores
        )

    @cached_property
    def identity(self) -> str:
        """Another than the parent's, so that its campaign does not go on with these rows."""
        return hashlib.sha256(f"points of {self.parent.identity}".encode()).hexdigest()

    @cached_property
    def inputs(self) -> list[list[Any]]:
        """Per flight the values of the dispersed parameters, in the order of `names`."""
        shares = stats.norm.cdf(self.scores[:, : len(self.names)])
        at = {name: i for i, name in enumerate(self.names)}
        shares = correlated(shares, [(at[a], at[b], rho) for a, b, rho in self.correlate])
        columns = [d.values(shares[:, i]) for i, d in enumerate(self.disperse.values())]
        return [list(row) for row in zip(*columns, strict=True)] or [[] for _ in self.scores]

    def flight_seed(self, number: int) -> int:
        """Seed of wind and sensors of a flight, counted from 0."""
        if self.scores.shape[1] == len(self.names):
            return one_seed(self.parent)
        share = float(stats.norm.cdf(self.scores[number, -1]))
        return 1 + min(int(share * LAST_SEED), LAST_SEED - 1)

    @cached_property
    def base(self) -> Settings:
        """The flight without dispersions."""
        return self.parent.base


def one_seed(spec: Spec) -> int:
    """Seed of wind and sensors where all flights have the same: the spec's, else 1."""
    return 1 if spec.flight_seeds == EACH else int(spec.flight_seeds)


def seed_is_random(spec: Spec) -> bool:
    """Whether wind and noise are among what is random."""
    return spec.flight_seeds == EACH


def check_reach(spec: Spec, reach: float = REACH) -> None:
    """Let each parameter be checked by its row as far out as a search goes.

    Raises
    ------
    ParameterError
        Nothing is dispersed, or a distribution goes where the parameter may not.
    """
    if not spec.names:
        raise ParameterError("disperse: nothing; allowed: at least one parameter")
    ends = np.array([[-reach], [reach]]) * np.ones(len(spec.names))
    try:
        check_ends(replace(Points.of(spec, ends), correlate=()), spec.base)
    except ParameterError as error:
        raise ParameterError(
            f"{error} ({reach:g} sigma out; such a flight would be no failure of the aircraft; "
            "allowed: a uniform or truncated distribution)"
        ) from None
