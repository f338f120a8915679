# SPDX-License-Identifier: Apache-2.0
"""Aircraft files and plant parameters: bad ones are refused by name, good ones are documented."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from heli_core.errors import ParameterCause as Cause
from heli_core.errors import PlantConfigError
from heli_core.parameters import load
from heli_core.rows import PLANT
from heli_dynamics_sim.aircraft import (
    AircraftError,
    HelicopterParameters,
    ModelOptions,
    allowed,
    file_fields,
    find_aircraft,
)
from heli_dynamics_sim.airframe import make_state
from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.helicopter import state_derivative
from heli_dynamics_sim.parameters import TABLE

CONFIG = Path(__file__).resolve().parents[1] / "config"
HELION = CONFIG / "aircraft" / "helion.yaml"


@pytest.fixture
def write(tmp_path):
    """write(old, new): path of the default aircraft's file with one line changed."""

    def build(old, new):
        text = HELION.read_text()
        assert text.count(old) == 1
        path = tmp_path / "mine.yaml"
        path.write_text(text.replace(old, new))
        return path

    return build


@pytest.mark.parametrize(
    ("old", "new", "cause", "key"),
    [
        ("mass_kg: 9.750", "# ", Cause.MISSING, "body.mass_kg"),
        ("mass_kg: 9.750", "masss_kg: 9.750", Cause.UNKNOWN_KEY, "body.masss_kg"),
        ("mass_kg: 9.750", '"ma\u00adss": 9.750', Cause.UNKNOWN_KEY, "body.ma\\xadss"),
        ("body:", '"bo\\e[2J\\ndy": 3\nrest:', Cause.TYPE, "bo\\x1b[2J\\ndy"),
        ("mass_kg: 9.750", "mass_kg: -9.750", Cause.BOUNDS, "body.mass_kg"),
        ("mass_kg: 9.750", "mass_kg: 0", Cause.BOUNDS, "body.mass_kg"),
        ("mass_kg: 9.750", "mass_kg: .nan", Cause.NOT_FINITE, "body.mass_kg"),
        ("mass_kg: 9.750", "mass_kg: .inf", Cause.NOT_FINITE, "body.mass_kg"),
        ("mass_kg: 9.750", "mass_kg: heavy", Cause.TYPE, "body.mass_kg"),
        ("mass_kg: 9.750", "mass_kg: true", Cause.TYPE, "body.mass_kg"),
        ("mass_kg: 9.750", "mass_kg: [1.0]", Cause.TYPE, "body.mass_kg"),
        ("inertia_zz_kgm2: 0.787", "inertia_zz_kgm2: 0.9", Cause.CONFLICT, "body.inertia_*"),
        ("coupling: identified", "coupling: eq8", Cause.CHOICE, "flapping.coupling"),
        ("stall_full: 0.6", "stall_full: 0.2", Cause.CONFLICT, "fins.stall_full"),
        ("servo:", "servo: 3\nrest:", Cause.TYPE, "servo"),
        ("body:", "body: [", Cause.SYNTAX, ""),
    ],
)  # fmt: skip
def test_bad_aircraft_files_are_refused_by_name(write, old, new, cause, key):
    path = write(old, new)
    with pytest.raises(AircraftError) as caught:
        HelicopterParameters.from_yaml(path)
    error = caught.value
    assert (error.cause, error.where) == (cause, str(path))
    assert error.key == key
    assert "\n" not in str(error) and str(error).startswith(f"{path}: {key}")


def test_an_unknown_key_names_what_may_be_meant_and_a_missing_one_its_bounds(write):
    with pytest.raises(AircraftError) as caught:
        HelicopterParameters.from_yaml(write("mass_kg: 9.750", "masss_kg: 9.750"))
    assert caught.value.meant == "body.mass_kg"
    with pytest.raises(AircraftError) as caught:
        HelicopterParameters.from_yaml(write("mass_kg: 9.750", "# "))
    assert caught.value.cause is Cause.MISSING
    (mass,) = (f for f in file_fields(HelicopterParameters) if f.metadata["key"] == "body.mass_kg")
    assert caught.value.allowed == allowed(mass.metadata)
    assert {"(0,", "1000)", "kg"} <= set(caught.value.allowed.split())


def test_missing_and_empty_files(tmp_path):
    (tmp_path / "empty.yaml").write_text("")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    for file, cause in (
        ("helicon.yaml", Cause.UNREADABLE),
        (tmp_path / "nowhere" / "x.yaml", Cause.UNREADABLE),
        (tmp_path / "empty.yaml", Cause.SYNTAX),
        (tmp_path / "binary.yaml", Cause.UNREADABLE),
    ):
        with pytest.raises(AircraftError) as caught:
            HelicopterParameters.from_yaml(file)
        assert (caught.value.cause, caught.value.where) == (cause, str(file))
        assert ("helion.yaml" in str(caught.value)) == (file == "helicon.yaml")


def test_a_packaged_name_means_the_packaged_file(tmp_path, monkeypatch, write):
    monkeypatch.chdir(tmp_path)
    Path("helion.yaml").write_text("plant: {}")  # say, a parameter file of the same name
    assert HelicopterParameters.from_yaml("helion.yaml").mass_kg == 9.75
    with pytest.raises(AircraftError, match="main_rotor.feathering_kgm2: missing"):
        HelicopterParameters.from_yaml("./helion.yaml")
    write("mass_kg: 9.750", "mass_kg: 9.5")
    assert HelicopterParameters.from_yaml("mine.yaml").mass_kg == 9.5


def test_integers_are_numbers_in_an_aircraft_file(write):
    assert HelicopterParameters.from_yaml(write("mass_kg: 9.750", "mass_kg: 9")).mass_kg == 9.0


@pytest.mark.parametrize("path", sorted((CONFIG / "aircraft").glob("*.yaml")), ids=lambda p: p.stem)
def test_every_value_of_an_aircraft_has_symbol_unit_meaning_and_source(path):
    rules = {item.metadata["key"]: item.metadata for item in file_fields(HelicopterParameters)}
    group, keys = "", set()
    for line in path.read_text().splitlines():
        if re.match(r"\w+:$", line):
            group = line[:-1]
        match = re.match(r"  (\w+): +\S+ +# (\S+) \[(.+?)\] (.+); (.+)$", line)
        assert match or not line.startswith("  "), line
        if match:
            key = f"{group}.{match[1]}"
            keys.add(key)
            if "unit" in rules[key]:
                assert (match[2], match[3]) == (rules[key]["symbol"], rules[key]["unit"]), key
    assert keys == rules.keys()
    HelicopterParameters.from_yaml(path)


def test_every_plant_parameter_is_in_the_file_with_a_comment():
    tree = yaml.safe_load((CONFIG / "plant.yaml").read_text())["/**/plant"]["ros__parameters"]

    def names(node, prefix=""):
        for key, value in node.items():
            if isinstance(value, dict):
                yield from names(value, f"{prefix}{key}.")
            else:
                yield prefix + key

    assert sorted(names(tree)) == sorted(row.name for row in TABLE)


@pytest.mark.parametrize("preset", ["gps_standalone", "gps_rtk"])
def test_gps_presets_set_the_gps_and_nothing_else(preset):
    base = load(TABLE, [CONFIG / "plant.yaml"], "plant")
    values = load(TABLE, [CONFIG / "plant.yaml", CONFIG / f"{preset}.yaml"], "plant")
    changed = {key for key in base if not np.array_equal(base[key], values[key])}
    got = [values[f"sensors.gps.{key}"] for key in ("white_m", "drift_m", "velocity_mps")]
    if preset == "gps_standalone":
        assert changed == set()
        assert got == [0.3, 1.0, 0.1]
    else:
        assert changed <= {key for key in base if key.startswith("sensors.gps.")}
        assert got == [0.006, 0.006, 0.03]


GRADES = ["sensors_consumer", "sensors_industrial", "sensors_rtk"]


@pytest.mark.parametrize("grade", GRADES)
def test_grades_set_the_sensors_and_nothing_else(grade):
    base = load(TABLE, [CONFIG / "plant.yaml"], "plant")
    values = load(TABLE, [CONFIG / "plant.yaml", CONFIG / f"{grade}.yaml"], "plant")
    changed = {key for key in base if not np.array_equal(base[key], values[key])}
    assert all(key.startswith("sensors.") for key in changed)
    # every error beyond noise and drift that there is
    new = {
        "imu.gyro_scale_sigma", "imu.accel_misalignment_rad", "imu.accel_range_mps2",
        "imu.clock_jitter_s", "imu.vibration.rev_mps2", "imu.vibration.rev_radps",
        "imu.vibration.blade_mps2", "imu.vibration.blade_radps", "mag.hard_iron_sigma_t",
        "mag.soft_iron_sigma", "mag.power_field_t_per_w", "mag.clock_jitter_s",
        "baro.wind_coefficients", "baro.wash_coefficient", "baro.clock_jitter_s",
        "gps.latency_jitter_s", "gps.multipath.sigma_m", "gps.satellites.blocked",
        "gps.outage.interval_s", "gps.jump.sigma_m", "gps.covariance",
    }  # fmt: skip
    assert {f"sensors.{key}" for key in new} <= changed
    assert not any(np.any(base[f"sensors.{key}"]) for key in new - {"gps.covariance"})


@pytest.mark.parametrize("grade", GRADES)
def test_grades_have_a_comment_with_a_source_above_each_value(grade):
    """A source, or the word that there is none: [E] an estimate, (r) recalled."""
    rest = (CONFIG / f"{grade}.yaml").read_text().split("/**/plant:")[1].split("/**/observer:")[0]
    comment, below = "", 99
    for line in rest.splitlines()[2:]:
        text = line.strip()
        if text.startswith("#"):
            comment, below = (comment if below == 0 else "") + text, 0
        elif not text.endswith(":"):
            below += 1
            assert comment and below <= 4, line
    assert "ADIS16475" in rest or "BMI055" in rest


def test_better_grades_have_smaller_errors():
    grades = [
        load(TABLE, [CONFIG / "plant.yaml", CONFIG / f"{grade}.yaml"], "plant") for grade in GRADES
    ]
    for key in ("imu.gyro_scale_sigma", "mag.hard_iron_sigma_t", "gps.multipath.sigma_m",
                "gps.latency_jitter_s", "gps.jump.sigma_m", "imu.vibration.rev_mps2"):  # fmt: skip
        sizes = [np.max(values[f"sensors.{key}"]) for values in grades]
        assert sizes == sorted(sizes, reverse=True) and sizes[0] > sizes[2], key


@pytest.mark.parametrize(
    ("changes", "cause", "key"),
    [
        (
            {"wind__profile_altitude_m": [0.0, 20.0, 10.0]},
            Cause.CONFLICT,
            "wind.profile_altitude_m",
        ),
        ({"wind__profile_speed_mps": [3.0]}, Cause.LENGTH, "wind.profile_speed_mps"),
        ({"wind__gust__duration_s": [1.0, 2.0]}, Cause.LENGTH, "wind.gust.duration_s"),
        ({"wind__gust__amplitude_mps": np.zeros((3, 3))}, Cause.LENGTH, "wind.gust.amplitude_mps"),
        ({"initial__pos_ned_m": [0.0, 0.0, 1.0]}, Cause.BOUNDS, "initial.pos_ned_m"),
        (
            {"sensors__gps__satellites__blocked": 4.0, "sensors__gps__satellites__blocked_s": 3.0},
            Cause.BOUNDS,
            "sensors.gps.satellites.blocked_s",
        ),
    ],
)
def test_parameters_that_do_not_fit_together(parameters, changes, cause, key):
    with pytest.raises(PlantConfigError) as caught:
        PlantConfig.from_parameters(parameters(**changes))
    assert (caught.value.cause, caught.value.key) == (cause, key)
    assert str(caught.value).startswith(f"{key}: ")


@pytest.mark.parametrize(("x", "u", "w"), [(24, 4, 3), (PLANT.size, 3, 3), (PLANT.size, 4, 2)])
def test_state_derivative_refuses_wrong_lengths(helicopter, x, u, w):
    with pytest.raises(ValueError, match="has shape"):
        state_derivative(np.zeros(x), np.zeros(u), np.zeros(w), helicopter)


def test_each_term_is_a_parameter_and_off(parameters, plant_config):
    values = parameters()
    assert {key for key in values if key.startswith("terms.")} == {
        f"terms.{name}" for name in ModelOptions._fields
    }
    assert (
        plant_config().helicopter.terms
        == ModelOptions()
        == ModelOptions(*(False for _ in ModelOptions._fields))
    )
    assert HelicopterParameters.from_yaml("helion.yaml").terms == ModelOptions()
    for name in ModelOptions._fields:
        flown = plant_config(**{f"terms__{name}": True}).helicopter
        assert flown.terms == ModelOptions()._replace(**{name: True})
        assert flown.params.terms == flown.terms


def test_states_of_terms_stay_and_do_nothing_while_their_terms_are_off(helicopter):
    x = make_state((0.0, 0.0, -20.0))
    x[PLANT.vel], x[PLANT.servo_col] = (2.0, -1.0, 0.5), -0.2
    u, wind = np.zeros(4), np.zeros(3)
    plain = state_derivative(x, u, wind, helicopter)
    x[PLANT.servo_rate.stop :] = 7.0
    other = state_derivative(x, u, wind, helicopter)
    assert other.tobytes() == plain.tobytes()
    assert not plain[PLANT.servo_rate.stop :].any()


@pytest.mark.parametrize(
    ("digits", "cause", "key"), [(150, Cause.BOUNDS, "body.mass_kg"), (400, Cause.SYNTAX, "")]
)
def test_a_number_without_end_is_refused(tmp_path, digits, cause, key):
    """An integer of hundreds of digits is no float; found by damaging files."""
    text = find_aircraft("helion.yaml").read_text()
    path = tmp_path / "heavy.yaml"
    path.write_text(re.sub(r"mass_kg: [\d.]+", "mass_kg: " + "9" * digits, text))
    with pytest.raises(AircraftError) as caught:
        HelicopterParameters.from_yaml(path)
    assert (caught.value.cause, caught.value.key) == (cause, key)
