"""Names of images: their order, patterns, and the series that a folder holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from moveit6d.datasets.image_names import fits, in_order, is_pattern, series


@pytest.mark.parametrize(
    "names",
    [
        ["1.PNG", "9.png", "10.png"],
        ["1311868164.0.png", "1311868164.033.png", "1311868164.066.png", "1311868164.33.png",
         "1311868165.0.png"],
        ["1311868164.png", "1311868164.033.png", "1311868164.33.png", "1311868165..png"],
        ["cam0_9.5_rgb.png", "cam0_10.25_rgb.png", "cam0_10.3_rgb.png"],
        ["0.1.png", "0.9.png", "0.10.png"],  # counted, not measured
        ["0.033.png", "0.066.png", "0.100.png"],
        ["a_0.5.png", "b_0.25.png"],
    ],
)  # fmt: skip
def test_numbers_count_and_times_are_decimals(names: list[str]) -> None:
    for mixed in (names, names[::-1]):
        assert [path.name for path in in_order(map(Path, mixed))] == names


@pytest.mark.parametrize(
    ("pattern", "name", "expected"),
    [
        ("*-color.png", "01-color.png", True), ("*-color.png", "01-depth.png", False),
        ("%06d.jpg", "000012.jpg", True), ("%06d.jpg", "1000000.jpg", True),
        ("%06d.jpg", "12.jpg", False), ("%06d.jpg", "000012-mask.jpg", False),
        ("a%d_%02d.png", "a7_03.png", True), ("a%d_*.png", "ab_03.png", False),
        ("[ab]?.png", "b1.png", True),
    ],
)  # fmt: skip
def test_patterns(pattern: str, name: str, expected: bool) -> None:
    assert is_pattern(pattern) and not is_pattern(name)
    assert fits(name, pattern) is expected


def numbered(*forms: str, count: int = 12) -> list[str]:
    return [form.format(number) for number in range(count) for form in forms]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (numbered("{:06}-color.png", "{:06}-depth.png"), ["*-color.png", "*-depth.png"]),
        (numbered("{:04}.jpg", "{:04}-mask.jpg"), ["%04d.jpg", "*-mask.jpg"]),
        (numbered("{}.jpg", "{}.png"), ["*.jpg", "*.png"]),
        (numbered("rgb8_{:03}.png", "depth16_{:03}.png"), ["rgb8_*.png", "depth16_*.png"]),
        (numbered("a[1]_{}.png", "b_{}.png"), ["a[[]1]_*.png", "b_*.png"]),
        (numbered("frame-{:06}.png"), []),
        (numbered("scene1_{:03}.png", "scene2_{:03}.png"), []),
        (["1.png", "2.jpg", "3.png", "4.jpg"], []),  # one video of two kinds of files
        (["leaf1.jpg", "leaf2.jpg", "brick1.jpg", "brick2.jpg"], []),
        (numbered("leaf{}.jpg") + numbered("brick{}.jpg", count=7), []),  # photos of many things
        (["a.png", "b.png", "c.png"], []),
        ([], []),
    ],
)
def test_series_are_the_same_numbers_with_other_names(
    names: list[str], expected: list[str]
) -> None:
    assert series(names) == expected
    for pattern in expected:
        assert sum(fits(name, pattern) for name in names) == len(names) // len(expected)
