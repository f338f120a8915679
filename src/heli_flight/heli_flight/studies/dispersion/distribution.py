# SPDX-License-Identifier: Apache-2.0
"""How one parameter is dispersed: from a number in the unit interval to a value."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from heli_parameters.parameters import ParameterError

CHOICE = "choice"
_TINY = 1e-12


@dataclass(frozen=True)
class _Kind:
    """A continuous distribution: its numbers in order, what they must be, its quantiles."""

    numbers: tuple[str, ...]
    allowed: str
    fits: Callable[..., bool]
    quantile: Callable[..., NDArray[np.float64]]


def _truncated(
    share: NDArray[np.float64], mean: float, sigma: float, low: float, high: float
) -> NDArray[np.float64]:
    ends = (low - mean) / sigma, (high - mean) / sigma
    return np.asarray(stats.truncnorm.ppf(share, *ends, loc=mean, scale=sigma))


KINDS: Mapping[str, _Kind] = {
    "uniform": _Kind(
        ("low", "high"), "low < high", lambda low, high: low < high,
        lambda share, low, high: low + (high - low) * share,
    ),
    "normal": _Kind(
        ("mean", "sigma"), "sigma > 0", lambda mean, sigma: sigma > 0.0,
        lambda share, mean, sigma: np.asarray(stats.norm.ppf(share, mean, sigma)),
    ),
    "truncated_normal": _Kind(
        ("mean", "sigma", "low", "high"), "sigma > 0 and low < high",
        lambda mean, sigma, low, high: sigma > 0.0 and low < high, _truncated,
    ),
}  # fmt: skip
NAMES = (*KINDS, CHOICE)


@dataclass(frozen=True)
class Distribution:
    """The distribution of one parameter.

    Attributes
    ----------
    kind : str
        One of `NAMES`.
    numbers : tuple
        What `KINDS` calls for, or the choices.
    whole : bool
        The parameter is an integer: uniform is then over the integers from low to high, both
        among them.
    """

    kind: str
    numbers: tuple[Any, ...]
    whole: bool = False

    def __str__(self) -> str:
        return f"{self.kind} {', '.join(map(str, self.numbers))}"

    def values(self, share: NDArray[np.float64]) -> list[Any]:
        """Quantiles at shares (N,) of the unit interval, as parameters hold them."""
        if self.kind == CHOICE:
            places = np.minimum((share * len(self.numbers)).astype(int), len(self.numbers) - 1)
            return [self.numbers[place] for place in places]
        if self.whole:
            low, high = self.numbers
            return [int(low + min(math.floor(s * (high - low + 1)), high - low)) for s in share]
        inside = np.clip(share, _TINY, 1.0 - _TINY)
        return [float(v) for v in KINDS[self.kind].quantile(inside, *self.numbers)]

    def levels(self, count: int) -> list[Any]:
        """Values of a grid: all choices or integers; else `count`, of uniform with both ends."""
        if self.kind == CHOICE:
            return list(self.numbers)
        if self.whole:
            return list(range(self.numbers[0], self.numbers[1] + 1))
        if self.kind == "uniform":
            return [float(v) for v in np.linspace(self.numbers[0], self.numbers[1], count)]
        return self.values((np.arange(count) + 0.5) / count)


def distribution_of(told: Any, parameter_kind: str, where: str) -> Distribution:
    """Read one from a spec, such as {uniform: [0.8, 1.2]}.

    Parameters
    ----------
    told : object
        What stands in the YAML.
    parameter_kind : str
        Kind of the parameter's row: double, int, string or bool.
    where : str
        Names the place, for sentences.

    Raises
    ------
    ParameterError
    """
    if not isinstance(told, Mapping) or len(told) != 1 or next(iter(told)) not in NAMES:
        raise ParameterError(f"{where}: {told!r}; allowed: one of {', '.join(NAMES)}")
    ((kind, numbers),) = told.items()
    if not isinstance(numbers, Sequence) or isinstance(numbers, str) or not numbers:
        raise ParameterError(f"{where}: {kind}: {numbers!r}; allowed: a list")
    if kind == CHOICE:
        return Distribution(CHOICE, tuple(numbers))
    if parameter_kind not in ("double", "int"):
        raise ParameterError(f"{where}: {kind}: the parameter is no number; allowed: {CHOICE}")
    whole = parameter_kind == "int"
    return Distribution(kind, _numbers(kind, numbers, whole, where), whole)


def _numbers(kind: str, numbers: Sequence[Any], whole: bool, where: str) -> tuple[Any, ...]:
    """The numbers of a continuous distribution, checked."""
    form, told = KINDS[kind], list(numbers)
    if whole and kind != "uniform":
        raise ParameterError(f"{where}: {kind}: the parameter is whole; allowed: uniform, {CHOICE}")
    number = (int,) if whole else (int, float)
    good = len(told) == len(form.numbers) and all(
        isinstance(n, number) and not isinstance(n, bool) and math.isfinite(n) for n in told
    )
    if not good or not form.fits(*told):
        what = "whole numbers" if whole else "numbers"
        names = ", ".join(form.numbers)
        raise ParameterError(
            f"{where}: {kind}: {told}; allowed: {what} [{names}] with {form.allowed}"
        )
    return tuple(told) if whole else tuple(map(float, told))
