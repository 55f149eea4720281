"""Photographs of a folder: scaled down, evenly chosen, and without those that cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.synthesis.augmentation.photos import SHORT_SIDE, load_photos, read_photos


def picture(path: Path, level: int, size: tuple[int, int] = (80, 70)) -> None:
    Image.new("RGB", size, (level, level, level)).save(path)


def test_one_bad_file_is_no_reason(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    picture(tmp_path / "a.png", 10)
    picture(tmp_path / "small.png", 20, (63, 90))
    (tmp_path / "text.jpg").write_text("no picture")
    whole = (tmp_path / "a.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    Image.new("1", (20000, 10000)).save(tmp_path / "huge.png")  # Pillow takes it for an attack
    (only,) = load_photos(tmp_path)
    assert "4 of 5 pictures are left out, not readable or smaller than 64 pixels" in caplog.text
    assert only.shape == (70, 80, 3) and (only == 10).all()
    (tmp_path / "a.png").unlink()
    with pytest.raises(InputError, match="holds no readable picture"):
        load_photos(tmp_path)


def test_they_are_scaled_and_chosen_evenly(tmp_path: Path) -> None:
    for number in range(5):
        picture(tmp_path / f"{number}.png", 10 * number, (600, 500))
    found = load_photos(tmp_path, limit=3)
    assert [int(one.max()) for one in found] == [0, 20, 40]
    assert {one.shape for one in found} == {(SHORT_SIDE, round(SHORT_SIDE * 1.2), 3)}
    assert np.asarray(load_photos(tmp_path)).shape[0] == 5
    picture(tmp_path / "high.png", 70, (500, 600))
    wide, high = read_photos([tmp_path / "0.png", tmp_path / "high.png"], (300, 200))
    assert wide.shape == (250, 300, 3) and high.shape == (360, 300, 3), "they cover the size"
    assert load_photos(tmp_path, size=(2000, 10))[0].shape == (500, 600, 3), "never enlarged"
