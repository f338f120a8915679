# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a plant's parameters."""


class PlantConfigError(ValueError):
    """Parameters that do not fit together; the message names the key and what is allowed."""
