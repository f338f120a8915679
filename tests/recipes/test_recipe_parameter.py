# SPDX-License-Identifier: Apache-2.0
"""CONTRIBUTING, "To add a parameter": a row, a value with a comment; it is checked everywhere."""

import pytest

TABLE = "src/heli_dynamics_sim/heli_dynamics_sim/parameters.py"
VALUES = "src/heli_dynamics_sim/config/plant.yaml"
ROW = '    Parameter("fuel_kg", "double", "Fuel on board", "kg", lower=0.0, upper=2.0),\n'
COMMENT = "    # Fuel on board at the start of the flight, kg.\n"


def add_row(copy):
    start = "_NODE = (\n"
    copy.replace(TABLE, start, start + ROW)


def add_value(copy, comment=COMMENT):
    before = "    # Length of the flight, s.\n"
    copy.replace(VALUES, before, f"{comment}    fuel_kg: 0.5\n{before}")


def start_plant(copy, *rules, code):
    copy.link()
    program = copy.prefix / "lib/heli_dynamics_sim/plant"
    return copy.run(program, "--ros-args", *rules, code=code).stderr


def test_a_new_parameter_is_declared_bounded_and_suggested(copy):
    add_row(copy)
    add_value(copy)
    copy.packaging("test_packaging_files.py", "-k", "plant")
    stderr = start_plant(copy, "-p", "fuel_kg:=5.0", code=2)
    assert "fuel_kg" in stderr and "5.0" in stderr and "2" in stderr
    assert "fuel_kg" in start_plant(copy, "-p", "feul_kg:=1.0", code=2)


@pytest.mark.slow
def test_a_row_without_value_is_told(copy):
    add_row(copy)
    assert "fuel_kg" in start_plant(copy, code=2)
    assert "fuel_kg" in copy.packaging("test_packaging_files.py", "-k", "plant", code=1).stdout


@pytest.mark.slow
def test_a_value_without_comment_is_told(copy):
    add_row(copy)
    copy.replace(VALUES, "    # Length of the flight, s.\n", "\n    fuel_kg: 0.5\n\n")
    assert "fuel_kg" in copy.packaging("test_packaging_files.py", "-k", "plant", code=1).stdout
