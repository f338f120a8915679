# SPDX-License-Identifier: Apache-2.0
"""What a node is called, and where its parameters come from."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from heli_parameters import locate
from heli_parameters.common_table import with_common
from heli_parameters.parameters import Parameter, load, stated

_FILES = "heli_parameters"


class StartError(Exception):
    """A node cannot start; the message is one line for the user."""


@dataclass(frozen=True)
class NodeSpec:
    """What a node is.

    Attributes
    ----------
    name : str
        Node name.
    package : str
        Package whose `config/` holds the default values.
    table : tuple of Parameter
        Its own parameters.
    config : str
        File name of the defaults.
    """

    name: str
    package: str
    table: tuple[Parameter, ...]
    config: str

    def full_table(self) -> tuple[Parameter, ...]:
        """Own and common parameters."""
        return with_common(self.table)

    def default_files(self) -> list[Path]:
        """Packaged YAML files, weakest first; `StartError` if the installation lacks them."""
        try:
            own = locate.config_folder(self.package) / self.config
            return [locate.config_folder(_FILES) / "common.yaml", own]
        except locate.MissingFileError as error:
            raise StartError(str(error)) from error

    def resolve(
        self, params_files: Sequence[str] = (), rules: Sequence[str] = (), name: str = ""
    ) -> dict[str, Any]:
        """Values of all parameters; raises `ParameterError` or `StartError`.

        Packaged files speak of the node by its own name, the user's by the one that it was given.
        """
        table = self.full_table()
        values = load(table, self.default_files(), self.name)
        given = stated(table, params_files, name or self.name, rules)
        return values | {key: entry.value for key, entry in given.items()}
