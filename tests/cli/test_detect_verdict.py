"""The last lines of `moveit6d detect --image`, and its exit code."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

import pytest

from moveit6d import InputError, Mesh, Pose
from moveit6d.cli.detect_answers import POINTS_ERROR, Answer
from moveit6d.cli.detect_verdict import advice, verdict

NOTHING = dict.fromkeys(("box", "mask", "points", "distance", "start"))
POSE = Pose.identity()
LOST = Answer((), 0.2, 1.0, {})
CLICKED = Answer(((POSE, 0.0, 0, ""),), 0.0, 1.0, {POINTS_ERROR: 1.0})
DAMAGED = Answer((), error="a.png is damaged.")
CORNERS = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
PLAIN = Mesh.from_arrays("part", CORNERS, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def found(*probabilities: float) -> Answer:
    return Answer(
        tuple((POSE, one, 3, "stop_action") for one in probabilities), probabilities[0], 1.0, {}
    )


def options(objects: int = 1, **more: Any) -> Namespace:
    known = {"instances": 1, "method": "templates", "image": [Path("a.png")], **NOTHING}
    return Namespace(mesh=[Path("cup.ply")] * objects, output=Path("out"), **{**known, **more})


@pytest.mark.parametrize(
    ("answers", "instances", "said"),
    [
        ([found(0.9)], 1, "probability 0.90: out/pose.json"),
        (
            [found(0.9, 0.7)], 3,
            "found 2 of 3 instances, probability 0.90, 0.70: out/pose.json, out/pose_2.json",
        ),
        ([found(0.9), LOST], 1, "found in 1 of 2 images: out/poses.csv"),
        ([found(0.9, 0.7), LOST], 3, "found 2 instances in 1 of 2 images: out/poses.csv"),
        ([found(0.9), DAMAGED, LOST], 2, "found 1 instance in 1 of 3 images: out/poses.csv"),
        (
            [CLICKED, found(0.9)], 1,
            "found in 1 of 2 images; the pose clicked in 1 more is not confirmed: out/poses.csv",
        ),
    ],
)  # fmt: skip
def test_what_was_found_of_one_object(
    brick: Mesh, answers: list[Answer], instances: int, said: str, capsys: Any
) -> None:
    args = options(image=[Path("a.png")] * len(answers), instances=instances)
    assert verdict(args, [""], [brick], [[one] for one in answers]) == 0
    assert capsys.readouterr().out == f"{said}\n"


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        ([LOST], "a.png: the object was not found (probability of the best pose 0.20); narrow"),
        ([LOST, DAMAGED], "2 images: the object was not found (probability of the best pose 0.20)"),
        ([CLICKED], "pose 0.00); the pose as clicked is not confirmed: out/pose.json"),
        ([CLICKED, CLICKED], "the pose as clicked in 2 images is not confirmed: out/poses.csv"),
    ],
)
def test_nothing_is_exit_code_3(brick: Mesh, answers: list[Answer], said: str, capsys: Any) -> None:
    args = options(image=[Path("a.png")] * len(answers))
    assert verdict(args, [""], [brick], [[one] for one in answers]) == 3
    output = capsys.readouterr()
    assert said in output.err and not output.out
    with pytest.raises(InputError, match="no image could be used; the first says: a"):
        verdict(args, [""], [brick], [[DAMAGED]])


def test_of_several_objects_there_is_a_sentence_each(brick: Mesh, capsys: Any) -> None:
    args = options(2, image=[Path("x/a.png"), Path("b.png"), Path("c.png")])
    images = [[found(0.9), LOST], [LOST, LOST], [DAMAGED, DAMAGED]]
    assert verdict(args, ["cup", "can"], [brick, brick], images) == 0
    output = capsys.readouterr()
    assert output.out.splitlines() == [
        "cup: found in a.png, probability 0.90",
        "can: not found in a.png (probability of the best pose 0.20)",
        "cup: not found in b.png (probability of the best pose 0.20)",
        "can: not found in b.png (probability of the best pose 0.20)",
        "cup: found in 1 of 3 images: out/poses.csv",
        "can: found in 0 of 3 images: out/poses.csv",
    ]
    assert "not found in any image: can; narrow the search by --distance, or look" in output.err
    args = options(2)
    assert verdict(args, ["cup", "can"], [brick, brick], [[LOST, LOST]]) == 3
    assert "a.png: the objects were not found" in capsys.readouterr().err


def test_advice_goes_by_what_was_given_and_by_the_mesh(brick: Mesh) -> None:
    assert "--distance" in advice(options(), [brick])
    given = options(distance=[0.3, 0.8])
    assert "check --distance" in advice(given, [brick]) and "--box" in advice(given, [brick])
    assert "colours" not in advice(given, [brick])
    said = advice(given, [PLAIN])
    assert "; part has no colours, which is a likely reason: give --points" in said
    assert "--texture_from_start" in said and "check --distance" in said
    clicked = advice(options(points=Path("p.csv")), [PLAIN])
    assert "give --points" not in clicked and "check --points" in clicked
    several = advice(options(2, distance=[0.3, 0.8]), [brick, brick])
    assert several.startswith("; check --distance, or look for one object alone with --box")
    assert advice(options(method="seeds"), [brick]) == ""
