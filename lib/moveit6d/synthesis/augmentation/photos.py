"""A bank of photographs that become backgrounds, occluders and textures.

Never augments and never renders.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from PIL import Image

from ...datasets.video import IMAGE_SUFFIXES, read_image
from ...errors import InputError
from ...typing import RGBImage

SHORT_SIDE = 200  # pixels: enough for a 128-pixel patch, small enough to keep a thousand in memory
SMALLEST = 64  # pixels: the shortest side of a picture that is used

LOG = logging.getLogger("moveit6d")


def photo_files(folder: Path) -> list[Path]:
    """Pictures of a folder in order of their names, maybe damaged ones among them.

    `InputError` if there is no such folder.
    """
    if not folder.is_dir():
        raise InputError(f"Photo folder {folder} does not exist.")
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)


def load_photos(
    folder: Path, limit: int | None = None, size: tuple[int, int] = (SHORT_SIDE, SHORT_SIDE)
) -> list[RGBImage]:
    """Photographs (H, W, 3) uint8 RGB of a folder, reduced to cover `size` (see `read_photos`).

    With a `limit`, an evenly spread part of the folder. Those that cannot be used are left out,
    with a warning. Raises `InputError` if there is none.
    """
    paths = photo_files(folder)
    if limit is not None and len(paths) > limit:
        paths = [paths[i] for i in np.linspace(0, len(paths) - 1, limit).astype(int)]
    photos = read_photos(paths, size, f"Photo folder {folder}")
    if len(photos) < len(paths):
        LOG.warning(
            "Photo folder %s: %d of %d pictures are left out, not readable or smaller than %d "
            "pixels", folder, len(paths) - len(photos), len(paths), SMALLEST,
        )  # fmt: skip
    return photos


def read_photos(
    paths: Sequence[Path], size: tuple[int, int], where: str = "The list"
) -> list[RGBImage]:
    """Photographs that can be read and have 64 pixels a side, as small as they cover `size`.

    `size` is a width and a height in pixels; smaller pictures stay as they are. Never holds more
    than one as large as its file. `InputError`, with `where` they are from, if none is left.
    """
    photos = []
    for path in paths:
        with suppress(InputError):  # one bad file is no reason
            photos.append(_reduced(read_image(path), size))
    photos = [photo for photo in photos if min(photo.shape[:2]) >= SMALLEST]
    if not photos:
        raise InputError(f"{where} holds no readable picture of {SMALLEST} pixels or more.")
    return photos


def _reduced(photo: RGBImage, size: tuple[int, int]) -> RGBImage:
    height, width = photo.shape[:2]
    scale = max(size[0] / width, size[1] / height)
    if scale >= 1:
        return photo
    picture = Image.fromarray(photo)
    smaller = round(width * scale), round(height * scale)
    return np.asarray(picture.resize(smaller, Image.Resampling.BOX))
