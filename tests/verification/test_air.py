# SPDX-License-Identifier: Apache-2.0
"""The air at the parts of the aircraft."""

import numpy as np
import pytest

from heli_dynamics_sim.helicopter import disc_tilt_of_gust

LOCK_NUMBER = 6.0


def steady_flapping(attack):
    """(cos, sin) harmonics of the flapping that the angle of attack cos a + sin b drives.

    Hinged blade without spring, azimuth psi: beta'' + gamma/8 beta' + beta = gamma/8 alpha(psi),
    Bramwell's flapping equation for an angle of attack that is the same at every radius. Once per
    turn beta'' and beta cancel: the blade follows a quarter of a turn later.
    """
    once = 1j
    response = LOCK_NUMBER / 8.0 / (once**2 + LOCK_NUMBER / 8.0 * once + 1.0)
    beta = response * (attack[0] - 1j * attack[1])
    return beta.real, -beta.imag


@pytest.mark.parametrize(("p", "q"), [(0.3, 0.0), (0.0, 0.3), (-0.2, 0.5)])
def test_gust_that_turns_tilts_the_disc_as_the_flapping_equation_says(p, q):
    """Air turning about both axes of the disc; flapping blade, by vectors in body axes; 1e-12."""
    speed = 193.73
    azimuths = np.radians([0.0, 90.0])
    attack = []
    for psi in azimuths:  # clockwise from above, from the nose: the torque's sense
        blade = np.array([np.cos(psi), np.sin(psi), 0.0])
        up = -np.cross([p, q, 0.0], blade)[2]
        attack.append(up / speed)
    nose_up, right_up = steady_flapping(attack)
    a_s, b_s = disc_tilt_of_gust(p, q, speed)  # backwards: nose up; to the right: right side down
    assert (a_s, -b_s) == pytest.approx((nose_up, right_up), abs=1e-12)
