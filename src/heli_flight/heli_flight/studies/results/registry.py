# SPDX-License-Identifier: Apache-2.0
"""Which command makes which result file."""

from collections.abc import Iterable

from heli_flight.studies.results.producer import (
    FIT,
    MARGIN,
    NOT_COMPARED,
    TWENTY,
    Producer,
)
from heli_flight.studies.results.registry_of_scale import OF_SCALE
from heli_parameters.parameters import ParameterError

__all__ = ["PRODUCERS", "Producer", "chosen"]

_ATTITUDE = "./heli compare attitude --seeds 1..20 --ideal-navigation --json"
PRODUCERS = (
    Producer(
        "hover",
        "./heli campaign --scenario hover --world paper --seeds 1..20 --json",
        "The hover test with both receivers.",
        TWENTY,
    ),
    Producer(
        "attitude",
        "./heli campaign --scenario attitude --seeds 1..20 --json",
        "The attitude test with both receivers.",
        TWENTY,
    ),
    Producer(
        "worlds",
        "./heli compare worlds --seeds 1..20,2001..2020 --json",
        "The hover test in the worlds, with both receivers.",
        (*TWENTY, *range(2001, 2021)),
    ),
    Producer(
        "worlds_paper",
        "./heli compare worlds --laws paper --seeds 1..20,2001..2020 --json",
        "The hover test in the worlds under the paper's own laws.",
        (*TWENTY, *range(2001, 2021)),
    ),
    Producer(
        "paper_causes",
        "./heli python scripts/paper_causes.py --seeds 1..10",
        "What stands between the paper's laws and its figures, one cause at a time.",
        tuple(range(1, 11)),
        MARGIN,
    ),
    Producer(
        "paths",
        "./heli python scripts/paths_table.py --seeds 1..20",
        "How closely the scenarios along a path are flown, with both receivers.",
        TWENTY,
    ),
    Producer(
        "mte",
        "./heli python scripts/mte_table.py --seeds 1..20",
        "How well the scored manoeuvres are flown, with both receivers.",
        TWENTY,
    ),
    Producer(
        "response",
        "./heli python scripts/response_table.py --seeds 1..5",
        "Responses of the attitude loop to sweeps and steps, by law.",
        tuple(range(1, 6)),
        MARGIN,
    ),
    Producer(
        "w20",
        "./heli compare worlds --worlds honest --w20 2,4,6,8 --seeds 1..20 --json",
        "The hover test in the honest world over the wind at 20 ft.",
        TWENTY,
    ),
    Producer("laws", _ATTITUDE, "The laws in the attitude test.", TWENTY),
    Producer(
        "laws_gusts",
        f"{_ATTITUDE} --gusts",
        "The laws in the attitude test with gusts.",
        TWENTY,
    ),
    Producer(
        "laws_flap_back",
        f"{_ATTITUDE} --gusts --flap-back",
        "The same on a rotor that flaps back.",
        TWENTY,
    ),
    Producer(
        "laws_everywhere",
        "./heli compare laws --seeds 1..20,2001..2020 --n 60 --json",
        "Every file of laws in the worlds and on perturbed aircraft.",
        (*TWENTY, *range(2001, 2021)),
    ),
    Producer(
        "robustness",
        "./heli compare robustness --n 200 --json",
        "The nominal aircraft's laws on aircraft that differ from it.",
        tuple(range(1, 201)),
    ),
    Producer(
        "position_floor",
        "./heli python scripts/position_floor.py --seeds 1..8",
        "The hover beside the least that any linear position law leaves; nose into the wind; "
        "mass, thrust, servos, drag 30 % off.",
        tuple(range(1, 9)),
        MARGIN,
    ),
    Producer(
        "robust",
        "./heli python scripts/robust_table.py",
        "The proof of the packaged attitude law over the named set, other laws beside it.",
        relative=MARGIN,
        # How many pieces a proof takes, and how clear it is, hang on rounding.
        loose={"pieces": NOT_COMPARED, "largest_psi": NOT_COMPARED},
    ),
    Producer(
        "gamma",
        "./heli python scripts/gamma_table.py --seeds 1..10",
        "What gamma and the weights do to the state feedback and to its flights in gusts.",
        tuple(range(1, 11)),
    ),
    Producer(
        "takeoff",
        "./heli python scripts/takeoff_table.py --seeds 1..20",
        "The scenario takeoff_land in winds, on slopes, in two worlds, with both receivers.",
        TWENTY,
    ),
    Producer(
        "failsafes",
        "./heli python scripts/failsafe_table.py --seeds 1..10",
        "Hovers with faults of the sensors, with both receivers.",
        tuple(range(1, 11)),
        # As of a landing without a place to hold.
        MARGIN,
    ),
    Producer(
        "actuator_faults",
        "./heli python scripts/actuator_fault_table.py --seeds 11..20",
        "Hovers with faults of the actuators, with both receivers.",
        tuple(range(11, 21)),
        # An aircraft that is not held keeps no difference small.
        MARGIN,
    ),
    Producer(
        "engine_out",
        "./heli python scripts/engine_out_table.py --seeds 11..20",
        "Hovers whose engine stops, with the failsafe and without.",
        tuple(range(11, 21)),
        # What falls without an engine keeps no difference small.
        MARGIN,
    ),
    Producer(
        "links",
        "./heli python scripts/link_table.py --seeds 1..10",
        "Hovers with faults of the links between nodes, with both receivers.",
        tuple(range(1, 11)),
        # What is nearly lost keeps no difference small.
        MARGIN,
    ),
    Producer(
        "dead_reckoning",
        "./heli python scripts/dead_reckoning_table.py --seeds 1..10",
        "What dead reckoning is off by after the last fix, and of what that is made.",
        tuple(range(1, 11)),
    ),
    Producer(
        "blind_landing",
        "./heli python scripts/blind_landing_table.py --seeds 1..20",
        "Landings after the last fix, in two worlds with both receivers.",
        TWENTY,
        # Without a place to hold nothing keeps a difference small.
        MARGIN,
    ),
    Producer(
        "sequence",
        "./heli python scripts/sequence_table.py --seeds 1..20",
        "The scenario sequence in two worlds with both receivers: ground, changes of modes.",
        TWENTY,
    ),
    Producer(
        "rates",
        "./heli python scripts/rates_table.py --seeds 1..20",
        "The hover test at 100, 200 and 400 Hz with both receivers.",
        TWENTY,
    ),
    Producer(
        "into_wind",
        "./heli python scripts/into_wind_table.py --seeds 1..20",
        "The nose turned into winds from anywhere, in two worlds.",
        TWENTY,
    ),
    Producer(
        "airspeed",
        "./heli python scripts/airspeed_table.py --seeds 1..20",
        "The attitude loop from hover to 12 m/s, and the scenario forward_flight.",
        TWENTY,
        MARGIN,
    ),
    Producer(
        "identification",
        "./heli python scripts/identify_seeds.py --seeds 1..20",
        "The default aircraft identified from flight, then flown with what was found.",
        TWENTY,
        FIT,
    ),
    Producer(
        "identification_others",
        "./heli python scripts/identify_seeds.py --seeds 1 --aircraft xcell60.yaml,logo600.yaml",
        "Two other aircraft identified from flight, then flown with what was found.",
        (1,),
        FIT,
    ),
    Producer(
        "loops",
        "./heli python scripts/loop_table.py",
        "Norms and margins of the laws hinf, their observer and the PID; those of the default.",
        relative=MARGIN,
    ),
    Producer(
        "fusion",
        "./heli python scripts/fusion_table.py --seeds 1..20 --json",
        "Errors and consistency of the navigation.",
        TWENTY,
    ),
    Producer(
        "navigation",
        "./heli python scripts/navigation_table.py --seeds 1..20 --json",
        "Errors of the navigation in the worlds, and their causes.",
        TWENTY,
    ),
    Producer(
        "deviations",
        "./heli python scripts/deviation_table.py --json",
        "A, B, E of the linearised aircraft beside the published ones.",
    ),
    Producer(
        "term_effects",
        "./heli python scripts/term_effects.py",
        "What each term of the aircraft does to trim, A, B, E and the tilt of the disc.",
    ),
    Producer(
        "term_flights",
        "./heli python scripts/term_flights.py --seeds 1..20",
        "The hover test with terms of the rotor, and with eq. (7), unknown to the controllers.",
        TWENTY,
    ),
    Producer(
        "ground",
        "./heli python scripts/ground_table.py --seeds 1..20",
        "Touch-downs, standing in wind, tipping over a skid.",
        TWENTY,
        MARGIN,
    ),
    Producer(
        "cpu_types",
        "./heli python scripts/compare_cpu_types.py --seeds 1..5 --json",
        "The same flights as other processors fly them.",
        tuple(range(1, 6)),
        # What rounding makes of rounding: a number of each kind of processor.
        loose={
            key: NOT_COMPARED
            for key in (
                "differing",
                "same_ticks",
                "position_m",
                "position_end_m",
                "attitude_rad",
            )
        },
    ),
    *OF_SCALE,
)
_BY_NAME = {producer.name: producer for producer in PRODUCERS}


def chosen(names: Iterable[str]) -> list[Producer]:
    """Producers by name, all if there are no names.

    Raises
    ------
    ParameterError
        A name that is none of them.
    """
    wanted = list(names)
    for name in wanted:
        if name not in _BY_NAME:
            raise ParameterError(f"results: {name!r} is none of {', '.join(_BY_NAME)}")
    return [_BY_NAME[name] for name in wanted] or list(PRODUCERS)
