# SPDX-License-Identifier: Apache-2.0
"""A box of parameters proved stable in parts, where the whole is not.

The upper bound of the structured singular value with real parameters is not tight: scalings treat a
parameter that enters often as more than it is. On a part of the box it is nearer. So the box is cut
in two along the parameter that helps most, until each part has a certificate of its own (branch and
bound: Newlin and Young, "Mixed mu problems and branch and bound techniques", Int. J. Robust
Nonlinear Control 7, 1997).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from heli_core.errors import RobustCause, RobustError
from heli_inner_hinf.robust.certificate import (
    Block,
    RobustCertificate,
    Structure,
    UncertainSystem,
    certify,
    real,
)
from heli_inner_hinf.robust.uncertain import Uncertain

MOST_CUTS = 3
"""Of a part that cannot be certified, one after the other: at most 2^3 parts."""


@dataclass(frozen=True)
class ProvedPart:
    """A part of a box, and what proves it.

    Attributes
    ----------
    centre, half : mapping of str to float
        Deviations in its middle, and from there to its ends.
    certificate : RobustCertificate
        No member of the part is unstable; its level is 1, in units of `half`.
    largest_psi : float
        The second look at it; holds below 0.
    """

    centre: Mapping[str, float]
    half: Mapping[str, float]
    certificate: RobustCertificate
    largest_psi: float


def loop_of(A: Uncertain) -> tuple[UncertainSystem, list[Block]]:
    """M(s) of the channels of x' = A(delta) x, and its blocks."""
    names = dict.fromkeys(A.channels)
    blocks = [real(name, A.channels.count(name)) for name in names]
    return UncertainSystem(A.D, A.C, A.B, A.A), blocks


def prove_in_parts(
    A: Uncertain, size: float, at_radps: float, cuts: int = MOST_CUTS
) -> tuple[ProvedPart, ...]:
    """Parts that together are the box of all deviations up to a size, each proved stable.

    Parameters
    ----------
    A : Uncertain
        State matrix of x' = A(delta) x.
    size : float
        Of the box: every deviation from -size to size.
    at_radps : float
        Where the bound is worst, as the onset's frequency: by it is decided where to cut.
    cuts : int
        How often a part may be cut.

    Returns
    -------
    tuple of ProvedPart
        Empty where a part has no certificate after so many cuts.

    Raises
    ------
    RobustError
        UNSTABLE: the member in the middle of a part.
    """
    names = list(dict.fromkeys(A.channels))
    centre, half = dict.fromkeys(names, 0.0), dict.fromkeys(names, size)
    return _proved(A, centre, half, at_radps, cuts)


def _proved(
    A: Uncertain,
    centre: Mapping[str, float],
    half: Mapping[str, float],
    at_radps: float,
    cuts: int,
) -> tuple[ProvedPart, ...]:
    if _slack(A, centre, half, at_radps) > 0.0:
        system, blocks = loop_of(A.within(centre, half).reduced())
        try:
            proof = certify(system, blocks, 1.0, most=1.0)
            return (ProvedPart(centre, half, proof, proof.largest_psi(system)),)
        except RobustError as error:
            if error.cause is not RobustCause.NO_CERTIFICATE:
                raise
    if cuts == 0:
        return ()
    trials = {name: _halves(centre, half, name) for name in centre}
    best = max(trials, key=lambda name: min(_slack(A, *part, at_radps) for part in trials[name]))
    both = [_proved(A, *part, at_radps, cuts - 1) for part in trials[best]]
    return both[0] + both[1] if all(both) else ()


def _slack(
    A: Uncertain, centre: Mapping[str, float], half: Mapping[str, float], at_radps: float
) -> float:
    """By how much scalings certify a part at one frequency; not above 0: they do not."""
    system, blocks = loop_of(A.within(centre, half).reduced())
    return Structure(blocks).scalings(system.response(at_radps), 1.0).slack


def _halves(
    centre: Mapping[str, float], half: Mapping[str, float], name: str
) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Both halves of a part along one parameter."""
    quarter = 0.5 * half[name]
    return [
        ({**centre, name: centre[name] + side * quarter}, {**half, name: quarter})
        for side in (-1.0, 1.0)
    ]
