# SPDX-License-Identifier: Apache-2.0
"""Parameter files that an option names: packaged ones by their name, the user's own by path."""

from dataclasses import dataclass
from pathlib import Path

from heli_parameters.locate import config_folder
from heli_parameters.parameters import ParameterError


@dataclass(frozen=True)
class NamedFiles:
    """One kind of them: worlds, laws.

    Attributes
    ----------
    word : str
        Name of the option, and of the key in the section `flight`.
    folder : str
        Where the packaged ones lie, under the config folder.
    """

    word: str
    folder: str

    def names(self) -> list[str]:
        """Names of the packaged ones."""
        return sorted(path.stem for path in self._folder().glob("*.yaml"))

    def file(self, name: str, where: str = "") -> Path:
        """File of a packaged one, or the user's own, by its path.

        Raises
        ------
        ParameterError
            There is none; `where` says who named it, default: the option.
        """
        if name in self.names():
            return self._folder() / f"{name}.yaml"
        path = Path(name)
        if path.suffix in (".yaml", ".yml") and path.is_file():
            return path
        raise ParameterError(
            f"{where or f'--{self.word}'} {name}: unknown {self.word}; known: "
            f"{', '.join(self.names())}, or the path of a YAML file"
        )

    def full_name(self, name: str) -> str:
        """A packaged one's name, or the whole path of a user's: what params.yaml says of it."""
        return name if name in self.names() else str(Path(name).absolute())

    def _folder(self) -> Path:
        return config_folder("heli_flight") / self.folder
