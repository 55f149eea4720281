"""Curves as SVG: valid, complete, reproducible, with places that can be read back as frames."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import pytest

from moveit6d.visualization.curves import BLUE, Curves, curves_svg, limits

NAN = math.nan
SOME = Curves(
    frames=range(20), error=[NAN, *[1.0 * k for k in range(18)], math.inf],
    confidence=[0.9] * 10 + [0.2] * 10, iterations=[3.0] * 20, missing=[19], resets=[7],
)  # fmt: skip


def test_the_svg_is_valid_and_names_its_curves() -> None:
    text = curves_svg(SOME, 0.5)
    root = ElementTree.fromstring(text)
    assert root.tag.endswith("svg")
    words = {"".join(node.itertext()).strip() for node in root.iter() if node.tag.endswith("text")}
    assert {"ADD, % of d", "confidence", "iterations", "frame"} <= words
    assert curves_svg(SOME, 0.5) == text, "the same run gives the same file"


def test_curves_without_numbers_are_left_out() -> None:
    unknown = replace(SOME, error=[NAN] * 20)
    text = curves_svg(unknown, 0.5)
    assert "ADD, % of d" not in text and "confidence" in text
    nothing = replace(unknown, confidence=[NAN] * 20, iterations=[NAN] * 20)
    assert curves_svg(nothing, 0.5) == ""
    assert "ADD" in curves_svg(replace(SOME, error=[math.inf] * 20), 0.5)


def test_a_place_in_the_picture_is_a_frame() -> None:
    text = curves_svg(SOME, 0.5)
    found = limits(SOME.frames)
    assert found["first"] == -0.5 and found["last"] == 19.5
    width = float(ElementTree.fromstring(text).attrib["viewBox"].split()[2])
    # The axes' own background is the second path of the figure, from edge to edge.
    paths = [
        node.attrib["d"]
        for node in ElementTree.fromstring(text).iter()
        if node.tag.endswith("path")
    ]
    numbers = [float(word) for word in paths[1].split() if word not in ("M", "L", "z")]
    assert min(numbers[::2]) / width == pytest.approx(found["left"], abs=1e-3)
    assert max(numbers[::2]) / width == pytest.approx(found["right"], abs=1e-3)


def lines_of(curves: Curves) -> list[str]:
    """What the blue lines and marks of the errors are drawn with."""
    text = curves_svg(replace(curves, confidence=[NAN] * len(curves.frames)), 0.5)
    return [
        node.tag.split("}")[1] + "L" * node.attrib.get("d", "").count("L")
        for node in ElementTree.fromstring(text).iter()
        if BLUE in node.attrib.get("style", "") and "id" not in node.attrib
    ]


def test_known_errors_are_joined_where_the_truth_has_holes() -> None:
    sparse = [float(k) if k % 5 == 0 else NAN for k in range(20)]
    assert lines_of(replace(SOME, error=sparse, missing=[])) == ["pathLLL"]


def test_a_line_ends_at_a_missing_pose_and_a_point_alone_is_marked() -> None:
    sparse = [float(k) if k % 5 == 0 else NAN for k in range(20)]
    assert lines_of(replace(SOME, error=sparse, missing=[8])) == ["pathL", "pathL"]
    assert lines_of(replace(SOME, error=sparse, missing=[12])) == ["pathLL", "use"]
