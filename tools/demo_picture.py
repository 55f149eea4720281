"""Makes docs/images/demo.png, the picture in the README, from the overlay of `make demo`.

    make demo && .venv/bin/python tools/demo_picture.py demo/track/overlay.mp4 docs/images/demo.png

Never picks frames by how well they turned out: they are evenly spread over the clip.
"""

from __future__ import annotations

import sys
from pathlib import Path

import av
import numpy as np
from PIL import Image

COLUMNS, ROWS = 3, 2
SIZE = (320, 240)


def main(overlay: Path, picture: Path) -> None:
    """Write the contact sheet."""
    with av.open(str(overlay)) as video:
        frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    chosen = np.linspace(0, len(frames) - 1, COLUMNS * ROWS).round().astype(int)
    sheet = Image.new("RGB", (COLUMNS * SIZE[0], ROWS * SIZE[1]))
    for place, number in enumerate(chosen):
        row, column = divmod(place, COLUMNS)
        tile = Image.fromarray(frames[number]).resize(SIZE, Image.Resampling.LANCZOS)
        sheet.paste(tile, (column * SIZE[0], row * SIZE[1]))
    sheet.save(picture, optimize=True)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
