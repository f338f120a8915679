# SPDX-License-Identifier: Apache-2.0
"""The course: each exercise is whole, and its code prints what its solution says."""

import re
from pathlib import Path

import pytest

TEXT = (Path(__file__).resolve().parents[2] / "docs/course.md").read_text("utf-8")
EXERCISES = re.split(r"(?m)^## (?=\d)", TEXT)[1:]
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
# Numbers of a table agree to a tenth, or to a unit of their last digit but one.
SHARE = 0.1


def agree(said, printed):
    """Whether two numbers, as they are written, are the same on another machine, too."""
    digits = len(said.partition(".")[2])
    return abs(float(said) - float(printed)) <= SHARE * abs(float(said)) + 3.0 * 10.0**-digits


@pytest.mark.parametrize("exercise", EXERCISES, ids=lambda text: text.splitlines()[0])
def test_an_exercise_has_goal_time_questions_and_an_answer_to_each(exercise):
    assert "**Goal:**" in exercise and re.search(r"\*\*Time:\*\* \d+ minutes", exercise)
    _, asked, answered = re.split(r"\*\*Questions\*\*|\*\*Solution\*\*", exercise)
    questions, answers = (re.findall(r"(?m)^(\d)\. \S", part) for part in (asked, answered))
    assert questions == answers and len(questions) >= 3


@pytest.mark.parametrize(
    "exercise",
    [pytest.param(text, marks=() if i == 0 else pytest.mark.slow)
     for i, text in enumerate(EXERCISES)],
    ids=lambda text: text.splitlines()[0],
)  # fmt: skip
def test_the_code_prints_what_the_solution_says(exercise, capsys):
    code = re.search(r"(?s)```py\n(.*?)```", exercise)[1]
    said = re.search(r"(?s)```text\n(.*?)```", exercise)[1]
    exec(compile(code, exercise.splitlines()[0], "exec"), {"__name__": "course"})
    printed = capsys.readouterr().out
    assert NUMBER.sub("#", printed) == NUMBER.sub("#", said)
    pairs = zip(NUMBER.findall(said), NUMBER.findall(printed), strict=True)
    assert [pair for pair in pairs if not agree(*pair)] == []


def test_there_are_six():
    titles = [re.match(r"\d\. ([\w ]+)", text)[1] for text in EXERCISES]
    assert titles == ["Trim", "Weights", "Gamma", "Observer", "Wind", "Own controller"]
