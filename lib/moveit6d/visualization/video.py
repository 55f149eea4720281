"""Writes a video file that ordinary players play, frame by frame.

Never holds more than one frame. The file appears under its name when it is finished; whatever ends
the block (Ctrl-C too), the frames so far make a whole video.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.images import rgb_bytes
from ..io import discard, replacing
from ..typing import ImageLike

CODECS = ("libx264", "mpeg4")  # the first that this machine's PyAV can write
QUALITY = {"libx264": {"crf": "20", "preset": "veryfast"}, "mpeg4": {"qmin": "3", "qmax": "3"}}


class VideoWriter:
    """An mp4 in the making: use as a context manager and `write` RGB frames (H, W, 3).

    Every kind of image that `prepare_frame` takes will do. The first frame sets the size (made even
    by dropping a row or column); later ones of another size are scaled to it. A block that wrote no
    frame leaves no file.
    """

    def __init__(self, path: str | Path, fps: float | None = None) -> None:
        self.path = Path(path)
        self.fps = fps if fps is not None and 0 < fps < 1000 else 25.0
        self._place = replacing(self.path)
        self._temporary = self.path
        self._container: Any = None
        self._stream: Any = None
        self._broken = False

    def __enter__(self) -> VideoWriter:
        self._temporary = self._place.__enter__()
        return self

    def write(self, image: ImageLike) -> None:
        """Append one frame; `InputError` for what is no image."""
        import av

        pixels = rgb_bytes(image)
        even = np.ascontiguousarray(pixels[: pixels.shape[0] // 2 * 2, : pixels.shape[1] // 2 * 2])
        if self._container is None:
            self._open(even.shape[1], even.shape[0])
        width, height = self._stream.width, self._stream.height
        picture = av.VideoFrame.from_ndarray(even, format="rgb24")
        if (picture.width, picture.height) != (width, height):
            picture = picture.reformat(width=width, height=height)
        with self._failing():
            self._encode(picture)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._broken:
            return
        if self._container is None:
            discard(self._place)
            return
        with self._failing():
            self._encode(None)
            self._container.close()
        self._place.__exit__(None, None, None)

    def _encode(self, picture: Any) -> None:
        """Write a picture, or with None what the codec still holds."""
        for packet in self._stream.encode(picture):
            self._container.mux(packet)

    @contextmanager
    def _failing(self) -> Iterator[None]:
        """Errors of the disk, which leave nothing of the video."""
        try:
            yield
        except OSError as error:  # PyAV's errors of files are such, too
            self._broken = True
            with suppress(OSError):  # ffmpeg crashes where a container is forgotten unclosed
                self._container.close()
            discard(self._place)
            reason = error.strerror or error
            raise InputError(f"{self.path} cannot be written: {reason}.") from error

    def _open(self, width: int, height: int) -> None:
        import av

        if width < 2 or height < 2:
            raise InputError(f"{self.path}: frames of {width}×{height} pixels make no video.")
        name = next((name for name in CODECS if name in av.codecs_available), CODECS[-1])
        try:
            self._container = av.open(str(self._temporary), "w", format="mp4")
        except (av.error.FFmpegError, OSError) as error:
            raise InputError(f"{self.path} cannot be written: {error.strerror}.") from error
        rate = Fraction(self.fps).limit_denominator(1001)
        self._stream = self._container.add_stream(name, rate=rate, options=QUALITY[name])
        self._stream.width, self._stream.height = width, height
        self._stream.pix_fmt = "yuv420p"
