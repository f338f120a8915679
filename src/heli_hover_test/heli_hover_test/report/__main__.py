# SPDX-License-Identifier: Apache-2.0
"""`python -m heli_hover_test.report BAG`: the command `heli report`."""

import sys

from heli_hover_test.cli import main

if __name__ == "__main__":
    sys.exit(main(["report", *sys.argv[1:]]))
