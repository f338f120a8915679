# SPDX-License-Identifier: Apache-2.0
"""`heli fault` in a flight of the graph: from now on, listed, cleared, told in the result."""

import json
import subprocess
import sys

import pytest
import yaml

from heli_dynamics_sim.plant import PlantStatus

HELI = [sys.executable, "-m", "heli_flight.cli.app"]


def heli(env, *words):
    done = subprocess.run([*HELI, *words], env=env, capture_output=True, text=True, timeout=120)
    return done.returncode, done.stdout.strip(), done.stderr.strip()


@pytest.mark.slow
def test_a_fault_is_given_listed_and_cleared_while_it_flies(ros_env, tmp_path, living):
    """By the plant's clock, in real time; the last one ends the flight."""
    out = tmp_path / "flight"
    flight = subprocess.Popen(
        [*HELI, "hover", "--realtime", "--no-report", "--world", "paper", "--duration", "300",
         "--out", str(out)],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        # It waits for the plant's service, and with it for the flight.
        code, printed, wrong = heli(
            ros_env, "fault", "baro", "bias", "-30", "--duration", "200", "--timeout", "100"
        )
        assert code == 0, wrong
        fault = yaml.safe_load(printed)
        assert (fault["what"], fault["kind"], fault["value"]) == ("baro", "bias", -30.0)
        assert fault["start_s"] >= 0.0
        code, _, wrong = heli(ros_env, "fault", "baro", "melts")
        assert code == 2 and "melts" in wrong and "bias" in wrong and wrong.count("\n") == 0
        status = heli(ros_env, "echo", "/diagnostics", "--count", "20", "--timeout", "60")[1]
        assert "baro bias" in status
        (listed,) = json.loads(heli(ros_env, "fault", "--list", "--json")[1])["faults"]
        assert yaml.safe_load(listed) == fault
        code, printed, wrong = heli(ros_env, "fault", "--clear")
        assert code == 0 and "baro bias -30" in printed, wrong
        assert heli(ros_env, "fault", "--list")[1] == "none"
        # What nobody survives ends the flight.
        code, _, wrong = heli(ros_env, "fault", "delta_lat", "runaway", "0.5")
        assert code == 0, wrong
        rest, _ = flight.communicate(timeout=120)
    finally:
        flight.kill()
    assert flight.returncode == 1, rest
    assert living() == []
    result = json.loads((out / "result.json").read_text())
    assert result["lost"] in (PlantStatus.ROLLED_OVER.sentence, PlantStatus.HIT_GROUND.sentence)
    (note,) = [note for note in result["notes"] if "baro bias -30" in note]
    assert "cleared at" in note and "delta_lat runaway 0.5" in note
