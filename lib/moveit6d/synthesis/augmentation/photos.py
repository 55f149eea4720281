"""A bank of photographs that become backgrounds, occluders and textures.

Never augments and never renders.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from ...errors import InputError

PHOTO_SUFFIXES = {".jpg", ".jpeg", ".png", ".webp", ".bmp"}
SHORT_SIDE = 200  # pixels: enough for a 128-pixel patch, small enough to keep a thousand in memory


def load_photos(folder: Path, limit: int | None = None) -> list[np.ndarray]:
    """Photographs (H, W, 3) uint8 RGB of a folder, their short side at most `SHORT_SIDE` pixels.

    With a `limit`, an evenly spread part of the folder. Raises `InputError` if there is none.
    """
    if not folder.is_dir():
        raise InputError(f"Photo folder {folder} does not exist.")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in PHOTO_SUFFIXES)
    if limit is not None and len(paths) > limit:
        paths = [paths[i] for i in np.linspace(0, len(paths) - 1, limit).astype(int)]
    photos = [photo for photo in map(_read, paths) if min(photo.shape[:2]) >= 64]
    if not photos:
        raise InputError(f"Photo folder {folder} holds no readable picture of 64 pixels or more.")
    return photos


def _read(path: Path) -> np.ndarray:
    try:
        with Image.open(path) as picture:
            rgb = picture.convert("RGB")
    except Exception:  # Pillow's readers raise what they stumble upon; one bad file is no reason
        return np.zeros((1, 1, 3), np.uint8)  # dropped by the size rule
    scale = SHORT_SIDE / min(rgb.size)
    if scale < 1:
        size = (round(rgb.width * scale), round(rgb.height * scale))
        rgb = rgb.resize(size, Image.Resampling.BOX)
    return np.asarray(rgb)
