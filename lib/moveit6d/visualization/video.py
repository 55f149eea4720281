"""Writes a video file that ordinary players play, frame by frame.

Never holds more than one frame. The file appears under its name when it is finished; whatever ends
the block (Ctrl-C too), the frames so far make a whole video.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ..checks import shown
from ..errors import InputError
from ..geometry.images import rgb_bytes
from ..io import discard, replacing
from ..typing import ImageLike

CODECS = ("libx264", "mpeg4")  # the first that this machine's PyAV can write
QUALITY = {"libx264": {"crf": "20", "preset": "veryfast"}, "mpeg4": {"qmin": "3", "qmax": "3"}}
USUAL_RATE = 25.0  # frames a second
LARGEST_DENOMINATOR = 1001  # of a rate as a fraction: 30000/1001 is usual


class VideoWriter:
    """An mp4 in the making: use as a context manager and `write` RGB frames (H, W, 3).

    Every kind of image that `prepare_frame` takes will do. The first frame sets the size (made even
    by dropping a row or column); later ones of another size are scaled to it. A block that wrote no
    frame leaves no file, and an older file as it was. `fps` that no video has (0, NaN, None of a
    source that does not know) is 25; `InputError` for what is no number.
    """

    def __init__(self, path: str | Path, fps: float | None = None) -> None:
        self.path = Path(path)
        self.fps = _rate(fps, self.path)
        self._place: AbstractContextManager[Path] | None = None  # only inside of the block
        self._temporary = self.path
        self._container: Any = None
        self._stream: Any = None

    def __enter__(self) -> VideoWriter:
        if self._place is not None:
            raise InputError(f"{self.path} is being written already, by another block.")
        place = replacing(self.path)
        self._temporary = place.__enter__()
        self._place = place
        return self

    def write(self, image: ImageLike) -> None:
        """Append one frame; `InputError` for what is no image, and outside of the block."""
        import av

        if self._place is None:
            raise InputError(
                f"{self.path}: frames are written inside of `with VideoWriter(path) as video:`, "
                "and none after one that failed."
            )
        pixels = rgb_bytes(image)
        even = np.ascontiguousarray(pixels[: pixels.shape[0] // 2 * 2, : pixels.shape[1] // 2 * 2])
        if self._stream is None:
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
        place = self._place
        try:
            if place is not None and self._stream is None:
                discard(place)
            elif place is not None:
                with self._failing():
                    self._encode(None)
                    self._container.close()
                place.__exit__(None, None, None)
        finally:
            self._place = self._container = self._stream = None

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
            with suppress(OSError):  # ffmpeg crashes where a container is forgotten unclosed
                self._container.close()
            if self._place is not None:
                discard(self._place)
            self._place = None
            reason = error.strerror or error
            raise InputError(f"{self.path} cannot be written: {reason}.") from error

    def _open(self, width: int, height: int) -> None:
        import av

        if width < 2 or height < 2:
            raise InputError(f"{self.path}: frames of {width}×{height} pixels make no video.")
        name = next((name for name in CODECS if name in av.codecs_available), CODECS[-1])
        try:
            container = av.open(str(self._temporary), "w", format="mp4")
        except (av.error.FFmpegError, OSError) as error:
            raise InputError(f"{self.path} cannot be written: {error.strerror}.") from error
        rate = Fraction(self.fps).limit_denominator(LARGEST_DENOMINATOR)
        try:
            stream = container.add_stream(name, rate=rate, options=QUALITY[name])
        except (av.error.FFmpegError, ValueError) as error:  # a codec that is not there
            container.close()
            raise InputError(f"{self.path} cannot be written: {error}.") from error
        stream.width, stream.height = width, height
        stream.pix_fmt = "yuv420p"
        self._container, self._stream = container, stream


def _rate(fps: Any, path: Path) -> float:
    """Frames a second of the video."""
    if fps is None:
        return USUAL_RATE
    try:
        rate = float(fps)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{path}: fps must be a number, found {shown(fps)}.") from None
    return rate if 1 / LARGEST_DENOMINATOR <= rate < 1000 else USUAL_RATE
