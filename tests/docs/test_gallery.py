# SPDX-License-Identifier: Apache-2.0
"""Every example of the gallery runs, draws its picture, and shows what the page says of it."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs/gallery"
CHEAP = ("figure_eight", "chirp")
MOST_BYTES, MOST_LINES = 1_200_000, 40


def gallery_script():
    """scripts/gallery.py as a module."""
    spec = importlib.util.spec_from_file_location("gallery", ROOT / "scripts/gallery.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["gallery"] = module
    spec.loader.exec_module(module)
    return module


gallery = gallery_script()
EXAMPLES = gallery.examples()


def away_m(flight):
    """Distance from the reference after 5 s, m."""
    off = flight.truth.pos_ned_m - flight.reference.pos_ned_m
    return np.linalg.norm(off, axis=1)[flight.time_s > 5.0]


def hover(names):
    flight = names["flight"]
    assert not flight.lost and all(flight.metrics[name].inside for name in flight.metrics)
    assert flight.truth.altitude_m[[0, -1]] == pytest.approx([10.0, 20.0], abs=0.5)


def weight(names):
    packaged, heavy = names["worst_deg"]
    assert heavy < 2.0 / 3.0 * packaged


def gamma(names):
    close, loose = names["peak"]
    assert close < 0.8 * loose


def step(names):
    late_s = names["late_s"]
    assert min(late_s, key=late_s.get) == "hinf_output" and late_s["hinf_output"] < 0.2


def singular(names):
    assert (names["sigma"][0] >= names["sigma"][1]).all()


def own_law(names):
    assert "MyLaw" in repr(names["flight"]) and away_m(names["flight"]).max() < 0.2


def own_aircraft(names):
    assert names["pitch_deg"][-1] < -5.0 < names["pitch_deg"][0] < 1.0


def figure_eight(names):
    assert away_m(names["flight"]).max() < 0.5


def campaign(names):
    found = names["campaign"]
    assert found.inside == len(found) == 12


def chirp(names):
    low = names["hz"][names["band"]] < 2.5
    assert names["measured"][low] == pytest.approx(names["model"][low], rel=0.1)
    assert names["hz"][names["band"]][np.argmax(names["measured"])] == pytest.approx(4.0, abs=0.3)


def mpc(names):
    end = names["rows"][-1][1:]
    assert end == pytest.approx([5.0, 0.0, -12.0], abs=0.05)
    assert np.abs(names["now"].u + names["plan"][:4]).max() <= 0.8


FACTS = (hover, weight, gamma, step, singular, own_law, own_aircraft, figure_eight, campaign,
         chirp, mpc)  # fmt: skip


@pytest.mark.parametrize(
    "facts",
    [
        pytest.param(facts, marks=() if facts.__name__ in CHEAP else pytest.mark.slow)
        for facts in FACTS
    ],
    ids=lambda facts: facts.__name__,
)
def test_an_example_shows_what_the_page_says(facts, tmp_path):
    name = facts.__name__
    facts(gallery.run(EXAMPLES[name], tmp_path))
    drawn, kept = imread(tmp_path / f"{name}.png"), imread(FOLDER / f"{name}.png")
    assert drawn.shape == kept.shape


def test_every_example_is_short_and_has_its_picture():
    assert sorted(EXAMPLES) == sorted(facts.__name__ for facts in FACTS)
    pictures = list(FOLDER.glob("*.png"))
    assert {path.stem for path in pictures} == set(EXAMPLES)
    assert sum(path.stat().st_size for path in pictures) < MOST_BYTES
    for example in EXAMPLES.values():
        assert len(example.code.splitlines()) <= MOST_LINES, example.title


def test_code_that_draws_nothing_is_refused(tmp_path):
    idle = gallery.Example("idle", "Idle", (), "x = 1\n")
    with pytest.raises(SystemExit, match=r"drew no idle\.png"):
        gallery.run(idle, tmp_path)
    assert gallery.main(["juggle"]) == 2
