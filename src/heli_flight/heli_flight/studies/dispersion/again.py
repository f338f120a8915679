# SPDX-License-Identifier: Apache-2.0
"""Parameter files with which flights of a campaign are flown again, alone."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from heli_dynamics_sim.aircraft_file import AircraftError
from heli_flight.loop.flight_file import write_parameters
from heli_flight.studies.dispersion.row import settings_of
from heli_flight.studies.dispersion.spec import Spec
from heli_parameters.parameters import ParameterError


def write_again(spec: Spec, numbers: Sequence[int], folder: Path) -> list[Path]:
    """Write a folder `flight_N` for each, and give the files for `heli hover --params`.

    Those whose parameters were refused have none.

    Raises
    ------
    ParameterError
        The folder cannot be written.
    """
    written = []
    for number in numbers:
        own = folder / f"flight_{number}"
        try:
            own.mkdir(parents=True, exist_ok=True)
            settings = settings_of(spec, number, own.resolve())
        except OSError as error:
            raise ParameterError(f"{own}: {error.strerror or error}") from None
        except (ParameterError, AircraftError):
            shutil.rmtree(own)
            continue
        write_parameters(settings, own / "params.yaml")
        written.append(own / "params.yaml")
    return written
