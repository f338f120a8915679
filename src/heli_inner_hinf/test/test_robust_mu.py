# SPDX-License-Identifier: Apache-2.0
"""Bounds of the structured singular value against published ones, and the proof between points."""

import numpy as np
import pytest

from heli_core.errors import RobustCause, RobustError
from heli_inner_hinf.robust.certificate import Block, Structure, UncertainSystem, certify, real
from heli_inner_hinf.robust.parts import prove_in_parts
from heli_inner_hinf.robust.uncertain import Range, Uncertain
from heli_inner_hinf.robust.worst_case import UncertainFamily

RANGES = {name: Range(name, 1.0, 0.8, 1.2) for name in ("m1", "m2", "k")}


@pytest.fixture(scope="module")
def two_masses() -> Uncertain:
    """State matrix of the example of MATLAB's documentation "Robust stability and worst-case gain
    of uncertain system": two masses, a spring, C = 100 ((s + 1) / (0.001 s + 1))^3, all +-20 %."""
    x1, v1, x2, v2, u = np.eye(5)[:, None, :]
    m1, m2, k = (RANGES[name].matrix for name in ("m1", "m2", "k"))
    spring = k @ (x1 - x2)
    plant = Uncertain.stacked(
        [[v1], [m1.inverse() @ (u + -np.eye(1) @ spring)], [v2], [m2.inverse() @ spring]]
    )
    # (s + 1) / (0.001 s + 1) three times, each x' = -1000 x + 1000 in, out = 1000 in - 999 x.
    law, out = np.zeros((3, 7)), 100.0 * np.eye(1, 7, 2)
    for i in range(3):
        law[i] = 1000.0 * out - 1000.0 * np.eye(1, 7, 4 + i)
        out = 1000.0 * out - 999.0 * np.eye(1, 7, 4 + i)
    closing = np.vstack([np.eye(4, 7), -out])
    return Uncertain.stacked([[plant @ closing], [law]]).reduced()


def _loop(A: Uncertain) -> tuple[UncertainSystem, list[Block]]:
    names = dict.fromkeys(A.channels)
    return UncertainSystem(A.D, A.C, A.B, A.A), [
        real(name, A.channels.count(name)) for name in names
    ]


def test_matlab_robstab_example(two_masses: Uncertain) -> None:
    """MATLAB: margin 2.8826 to 2.8864 at 575.0339 rad/s, destabilised by k = 1.5773."""
    assert two_masses.channels == ("k", "m1", "m2")
    onset = UncertainFamily(two_masses).onset(4.0)
    assert onset.size == pytest.approx(2.8864, rel=1e-4)
    assert onset.frequency_radps == pytest.approx(575.0339, rel=1e-6)
    assert RANGES["k"].value(onset.deltas["k"]) == pytest.approx(1.5773, abs=5e-5)
    poles = np.linalg.eigvals(two_masses.at(onset.deltas))
    assert abs(np.max(poles.real)) < 1e-5

    system, blocks = _loop(two_masses)
    proof = certify(system, blocks, 1.0013 / onset.size)
    assert 1.0 / proof.level == pytest.approx(2.8826, rel=2e-3)
    assert 1.0 / proof.level <= onset.size
    assert proof.largest_psi(system) < 0.0
    edges = np.array([(piece.low_radps, piece.high_radps) for piece in proof.pieces])
    assert edges[0, 0] == 0.0
    assert np.max(edges[:, 1]) == np.inf
    assert np.all(edges[1:, 0] <= np.maximum.accumulate(edges[:, 1])[:-1])


def test_level_below_the_lower_bound_is_not_certified(two_masses: Uncertain) -> None:
    system, blocks = _loop(two_masses)
    with pytest.raises(RobustError) as refused:
        certify(system, blocks, 0.98 / 2.88636, most=0.99 / 2.88636)
    assert refused.value.cause is RobustCause.NO_CERTIFICATE
    proof = certify(system, blocks, 0.9 / 2.88636)
    assert 1.0 / 2.88636 < proof.level < 1.01 / 2.88636


def test_no_member_of_a_certified_set_is_unstable(two_masses: Uncertain) -> None:
    family, rng = UncertainFamily(two_masses), np.random.default_rng(0)
    inside = rng.choice([-1.0, 1.0], (200, 3)) * 2.88
    assert max(family.abscissa(delta) for delta in inside) < 0.0


def test_unstable_nominal_is_refused() -> None:
    system = UncertainSystem(np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)))
    with pytest.raises(RobustError, match=" 1, ") as refused:
        certify(system, [real("a")], 1.0)
    assert refused.value.cause is RobustCause.UNSTABLE


DKPY = [
    (
        [
            "1j 2 2j 0 -1 -1+3j 2+3j",
            "3+1j 2-1j -1+1j 2+1j -1+1j 1 -1+1j",
            "3+1j 1j 2+2j -1+2j 3-1j 3j -1+1j",
            "-1+1j -1-1j 1j 0 1-1j 2-1j 2+2j",
            "3 1j 1+1j 3j 1+1j 3j -1j",
            "1 3+2j 2+2j 3j 1+2j 2+1j -1+2j",
            "2+1j -1-1j -1 3+3j 2+3j 2j 1-1j",
        ],
        [
            Block("a", "complex", 2, 2),
            Block("b", "complex", 1, 1),
            Block("c", "full", 3, 2),
            Block("d", "full", 1, 2),
        ],
        10.5523,
    ),
    (
        [
            "1j 2 2j 0",
            "3+1j 2-1j -1+1j 2+1j",
            "3+1j 1j 2+2j -1+2j",
            "3-1j 3j -1+1j 2+2j",
            "-1+1j -1-1j 1j 0",
            "1-1j 2-1j 2+2j 1",
            "3 1j 1+1j 3j",
            "1+2j 2+1j -1+2j 1j",
            "2+1j -1-1j -1 3+3j",
            "2+3j 2j 1-1j 0",
        ],
        [Block("a", "full", 4, 2), Block("b", "full", 6, 2)],
        10.2438,
    ),
]


@pytest.mark.parametrize(("rows", "blocks", "published"), DKPY)
def test_upper_bounds_of_dkpy(rows: list[str], blocks: list[Block], published: float) -> None:
    """Matrices and bounds of dkpy's own tests (github.com/decargroup/dkpy)."""
    M = np.array([[complex(number) for number in row.split()] for row in rows])
    assert Structure(blocks).upper(M, 1e-6) == pytest.approx(published, rel=1e-4)


AB13MD = [
    ([real("a"), real("b"), Block("c", "complex", 1, 1), Block("d", "full", 2, 2)], 3.65368923),
    ([real("a"), real("b"), Block("d", "full", 3, 3)], 3.72954861),
    ([Block(str(i), "complex", 1, 1) for i in range(5)], 3.73952174),
]


@pytest.mark.parametrize(("blocks", "bound"), AB13MD)
def test_upper_bounds_of_slicot(blocks: list[Block], bound: float) -> None:
    """What SLICOT's AB13MD (ctrlsys 1.1.1, worked out on 2026-11-22) gives for this matrix."""
    i, j = np.indices((5, 5))
    M = np.cos(1.0 + 2.0 * i + 3.0 * j) + 1j * np.sin(2.0 + 5.0 * i - j)
    assert Structure(blocks).upper(M, 1e-6) == pytest.approx(bound, rel=3e-6)


def test_real_blocks_make_the_bound_smaller_than_complex_ones() -> None:
    """A rotation by 90 deg: no real number destabilises it, a complex one of size one does."""
    M = np.array([[1.0j]])
    assert Structure([real("a")]).upper(M) < 1e-3
    assert Structure([Block("a", "complex", 1, 1)]).upper(M) == pytest.approx(1.0, rel=1e-3)


def test_onset_is_not_above_that_of_any_corner(two_masses: Uncertain) -> None:
    """The iteration on signs alone ends at one corner; every other one is looked at, too."""
    family = UncertainFamily(two_masses)
    onset = family.onset(4.0)
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * len(family.names))).reshape(3, -1).T
    for corner in corners:
        assert family.abscissa(0.999 * onset.size * corner) < 0.0


def test_part_of_a_box_has_the_members_that_it_has_in_the_whole(two_masses: Uncertain) -> None:
    names = dict.fromkeys(two_masses.channels)
    centre = dict(zip(names, (0.4, -0.2, 0.1), strict=True))
    half = dict(zip(names, (0.5, 0.3, 1.2), strict=True))
    part = two_masses.within(centre, half)
    rng = np.random.default_rng(2)
    for _ in range(5):
        inside = dict(zip(names, rng.uniform(-1.0, 1.0, 3).tolist(), strict=True))
        whole = {name: centre[name] + half[name] * inside[name] for name in names}
        np.testing.assert_allclose(part.at(inside), two_masses.at(whole), rtol=1e-9, atol=1e-6)


def test_box_is_proved_in_parts_up_to_the_onset_and_not_beyond(two_masses: Uncertain) -> None:
    onset = UncertainFamily(two_masses).onset(4.0)
    cut = prove_in_parts(two_masses, 0.999 * onset.size, onset.frequency_radps)
    assert cut
    assert max(part.largest_psi for part in cut) < 0.0
    volume = sum(np.prod(list(part.half.values())) for part in cut)
    assert volume == pytest.approx((0.999 * onset.size) ** 3)
    assert prove_in_parts(two_masses, 1.01 * onset.size, onset.frequency_radps, cuts=1) == ()
