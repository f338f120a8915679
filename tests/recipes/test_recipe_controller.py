# SPDX-License-Identifier: Apache-2.0
"""CONTRIBUTING, "To add a controller": the template's four steps, and the law flies."""

import json

import pytest

PACKAGE = "src/heli_inner_hinf/heli_inner_hinf"


def add_law(copy):
    """Steps 1 to 3 of `controller_template.py`; without step 4, the law uses the PID's gains."""
    template = copy.path(f"{PACKAGE}/controller_template.py").read_text()
    copy.write(f"{PACKAGE}/my_controller.py", template)
    copy.replace(f"{PACKAGE}/controller_state.py", '"indi": 2,', '"indi": 2, "mine": 3,')
    dispatch = f"{PACKAGE}/controllers.py"
    first = "from heli_inner_hinf.controller_state import"
    copy.replace(dispatch, first, f"from heli_inner_hinf.my_controller import user_law\n{first}")
    branch = "        pid_law(x9, r3, k, state, u3)\n"
    mine = "    elif k.controller == 3:\n        user_law(x9, r3, k, state, u3)\n"
    copy.replace(dispatch, branch, branch + mine)


# The laws and what calls them are compiled anew, on loaded cores for minutes.
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_new_law_is_a_choice_and_holds_the_attitude(copy, tmp_path):
    add_law(copy)
    copy.lend_kernels()
    command = ["-m", "heli_flight.cli.hover_test", "--one-process", "--no-report", "--json"]
    command += ["--scenario", "attitude", "--duration", "10", "--out", tmp_path / "flight"]
    done = copy.run(*command, "--attitude-controller", "mine", code=None)
    result = json.loads(done.stdout)
    assert result["lost"] == ""
    errors = {(m["key"], m["measured_from"]): m["max"] for m in result["metrics"]}
    assert max(errors.values()) < 5.0
    done = copy.run(
        *command[:-2], "--out", tmp_path / "other", "--attitude-controller", "nobody", code=2
    )
    assert "mine" in done.stderr
