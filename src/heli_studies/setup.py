# SPDX-License-Identifier: Apache-2.0
"""Build by colcon; what all packages have in common stands in scripts/ros_package.py."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))

from ros_package import setup_package  # noqa: E402

setup_package()
