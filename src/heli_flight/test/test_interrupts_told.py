# SPDX-License-Identifier: Apache-2.0
"""What fails after an interrupt that C code has swallowed is told as the interrupt."""

import pytest

from heli_flight import interrupts


def test_a_failure_after_a_swallowed_interrupt_is_the_interrupt(monkeypatch):
    monkeypatch.setattr(interrupts, "_seen", True)
    with pytest.raises(KeyboardInterrupt), interrupts.told():
        raise ValueError("Invalid bounding box")


def test_a_failure_of_its_own_stays_what_it_is(monkeypatch):
    monkeypatch.setattr(interrupts, "_seen", False)
    with pytest.raises(ValueError, match="too long"), interrupts.told():
        raise ValueError("too long")


def test_what_does_not_fail_stands(monkeypatch):
    """The result of a command that has ended is there, interrupted or not."""
    monkeypatch.setattr(interrupts, "_seen", True)
    with interrupts.told():
        done = True
    assert done
