"""The page of a report: complete, and what comes from files is text."""

from __future__ import annotations

import pytest
from jinja2 import UndefinedError

from moveit6d.visualization.html_template import render_page


def test_what_is_not_given_is_left_out() -> None:
    page = render_page(title="drill", verdict="5 frames")
    assert page.lstrip().lower().startswith("<!doctype html>")
    assert "drill" in page and "5 frames" in page and "<table" not in page


def test_names_from_files_are_escaped() -> None:
    page = render_page(
        title="<script>alert(1)</script>", verdict="a & b", facts={"video": "<img src=x>"}
    )
    assert "<script>alert" not in page and "&lt;script&gt;alert(1)" in page
    assert "a &amp; b" in page and "<img src=x>" not in page and "video" in page


def test_a_page_without_its_title_is_a_defect() -> None:
    with pytest.raises(UndefinedError):
        render_page(verdict="5 frames")
