# SPDX-License-Identifier: Apache-2.0
"""Draw docs/dispersion.png: errors of the dispersed hover test, for each controller.

Usage: ./heli python -m evidence.draw_dispersion
after `./heli results make dispersion dispersion_honest`
"""

import sys

from evidence.experiments.dispersion import CAMPAIGNS, SHOWN
from evidence.files import checkout, read
from heli_core.errors import FlightError
from heli_core.metrics import BY_KEY
from heli_flight.report.figures import BLUE, GREEN, GREY, ORANGE, picture

COLOURS = {"hinf": BLUE, "lqr": ORANGE, "pid": GREEN}
STYLES = dict(zip(CAMPAIGNS, ("-", "--"), strict=True))


def main() -> int:
    """Exit code 2, with a sentence, if a file is not made yet."""
    root = checkout()
    try:
        campaigns = {name: read(root, name)["found"] for name in CAMPAIGNS}
    except FlightError as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 2
    path = root / "docs" / "dispersion.png"
    with picture(path, 1, len(SHOWN), (9.0, 3.6), sharey=True) as (figure, axes):
        for axis, key in zip(axes[0], SHOWN, strict=True):
            for name, campaign in campaigns.items():
                for of_law in campaign["laws"]:
                    # The largest of all is one flight's.
                    least = 1.0 / of_law["flights"]
                    above = [max(1.0 - level, least) for level in campaign["levels"]]
                    values = of_law["figures"][f"{key} (truth)"]["quantiles"]
                    label = f"{of_law['laws']}, {campaign['world']} ({of_law['flights']})"
                    colour = COLOURS[of_law["laws"]]
                    axis.plot(values, above, STYLES[name], color=colour, label=label)
            axis.axvline(BY_KEY[key].paper, color=GREY, ls=":", label="bound (paper)")
            axis.set_xlabel(f"{BY_KEY[key].label} ({BY_KEY[key].unit})")
            axis.set_xlim(left=0.0)
            axis.set_yscale("log")
        axes[0, 0].set_ylabel("share of flights above")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return 0


if __name__ == "__main__":
    sys.exit(main())
