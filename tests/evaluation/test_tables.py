"""Tables as text."""

from __future__ import annotations

from moveit6d.evaluation.tables import markdown, percent, plain


def test_markdown_is_aligned_and_is_markdown() -> None:
    assert markdown(["name", "n"], [["a", "10"], ["longer", "3"]]).splitlines() == [
        "| name   |  n |",
        "| ------ | -- |",
        "| a      | 10 |",
        "| longer |  3 |",
    ]


def test_plain_columns_line_up() -> None:
    assert plain(["part", "ms"], [["crop", "0.25"]]) == "part    ms\ncrop  0.25"


def test_percent_has_one_digit() -> None:
    assert percent(2 / 3) == "66.7 %" and percent(1) == "100.0 %"
