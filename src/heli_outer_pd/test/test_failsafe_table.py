# SPDX-License-Identifier: Apache-2.0
"""The table of failsafes: one row per condition, the severer action wins, the page shows it."""

import subprocess
import sys
from pathlib import Path

import pytest

from heli_outer_pd.failsafes import FAILSAFES, Action, Condition, of, severest

ROOT = Path(__file__).resolve().parents[3]


def test_each_condition_has_one_row():
    assert [row.condition for row in FAILSAFES] == list(Condition)
    for row in FAILSAFES:
        assert row.within_s > 0.0 and row.action > Action.NONE
        assert row.detected and row.recovery and row.status
        assert of(row.condition) is row


@pytest.mark.parametrize("condition", Condition)
def test_the_severer_action_wins(condition):
    assert severest([condition]) == of(condition).action
    assert severest([condition, Condition.POSITION_LOST_LONG]) == max(
        of(condition).action, Action.LAND
    )
    assert severest([]) == Action.NONE


def test_what_is_lost_longer_is_severer():
    story = (
        Condition.GPS_SILENT,
        Condition.POSITION_LOST,
        Condition.POSITION_LOST_LONG,
    )
    actions = [of(condition).action for condition in story]
    assert actions == sorted(set(actions))


def test_the_page_is_drawn_from_the_table():
    script = ROOT / "scripts/failsafe_page.py"
    assert subprocess.run([sys.executable, script, "--check"], check=False).returncode == 0
