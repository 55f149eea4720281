"""Values of files: what is right comes back, what is wrong is named in one sentence."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moveit6d import checks
from moveit6d.errors import InputError


@given(st.integers(-(2**53), 2**53))
def test_whole_numbers_come_back_however_they_are_written(value: int) -> None:
    assert checks.whole(value, "x") == value
    assert checks.whole(float(value), "x") == value


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: checks.number("3", "x"), "x must be a number, found '3'"),
        (lambda: checks.number(True, "x"), "x must be a number, found True"),
        (lambda: checks.number(math.nan, "x"), "x must be a finite number"),
        (lambda: checks.number(10**400, "x"), "x must be a finite number"),
        (lambda: checks.whole(2.5, "x"), "x must be a whole number, found 2.5"),
        (lambda: checks.whole(2.0**60, "x"), "x must be a whole number"),
        (lambda: checks.numbers([1, 2], 3, "x"), "x must be 3 numbers, found 2"),
        (lambda: checks.numbers([1, None], 2, "x"), "x must be a number, found None"),
        (lambda: checks.listed({}, "x"), "x must be a list"),
        (lambda: checks.mapping([], "x"), "x must be a JSON object"),
        (lambda: checks.entry({}, "fx", "camera.json"), "camera.json has no fx"),
    ],
)
def test_what_is_wrong_is_named(call: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()


def test_what_is_right_comes_back() -> None:
    assert checks.number(3, "x") == 3.0 and checks.numbers((1, 2.5), None, "x") == [1.0, 2.5]
    assert checks.listed((1,), "x") == [1] and checks.mapping({"a": 1}, "x") == {"a": 1}
    assert checks.entry({"a": 1}, "a", "x") == 1


@pytest.mark.parametrize("name", ["", ".hidden", "a/b", "..", "a\\b", "C:", "a\nb", "x" * 201])
def test_names_that_could_leave_the_folder_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="cannot be a name"):
        checks.file_name(name, "info.json")
    assert checks.file_name("drill_01 é", "info.json") == "drill_01 é"


def test_what_readers_stumble_upon_names_the_file() -> None:
    words = r"^a\.json cannot be read as a camera: no 'fx'\.$"
    with pytest.raises(InputError, match=words), checks.reading("a.json", "a camera"):
        {}["fx"]
    with pytest.raises(InputError, match=r"^inner sentence\.$"), checks.reading("a.json"):
        raise InputError("inner sentence.")
    with pytest.raises(MemoryError), checks.reading("a.json"):  # no fault of the file's
        raise MemoryError


def test_long_values_are_shortened() -> None:
    assert checks.shown([1, 2]) == "[1, 2]"
    assert len(checks.shown("x" * 500)) <= 60
    assert checks.shown(10**5000) == "int"
