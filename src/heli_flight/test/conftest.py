# SPDX-License-Identifier: Apache-2.0
"""A flight by the command, for the tests of what files say and bring along."""

import json

import pytest

from heli_flight.cli.app import main


@pytest.fixture
def fly():
    """Fly into a folder, without a report: exit code and result.json."""

    def run(folder, *words):
        code = main(["hover", "--no-report", "--out", str(folder), *map(str, words)])
        return code, json.loads((folder / "result.json").read_text())

    return run
