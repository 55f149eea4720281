"""Frames of a video file.

Never stops at a bad one: that frame says what was wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..errors import InputError
from .video import VideoFrame, opened_image, to_upright_rgb


class VideoFile:
    """The frames of a video file, turned upright as players do.

    A damaged frame, and the place where a cut-off file ends, are frames with an error.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        _refuse_collections(path)
        with self._open() as container:
            stream = _video_stream(container, path)
            self.length: int | None = stream.frames or None
            self.fps: float | None = float(stream.average_rate) if stream.average_rate else None

    @property
    def sample_aspect_ratio(self) -> float:
        """Width of a pixel by its height in the upright picture; 1 where the file says nothing."""
        import av

        with self._open() as container:
            stream = _video_stream(container, self.path)
            picture = None
            with suppress(av.error.FFmpegError):
                picture = next(container.decode(stream), None)
            return pixel_aspect(stream, picture)

    def __iter__(self) -> Iterator[VideoFrame]:
        import av

        index, last = 0, 0.0
        first: float | None = None
        broken: str | None = None
        with self._open() as container:
            stream = _video_stream(container, self.path)
            packets = decoded(container.demux(stream))
            while True:
                try:
                    pictures, damage = next(packets)
                except StopIteration:
                    break
                except av.error.FFmpegError as error:
                    broken = f"{error.strerror}"
                    break
                if damage is not None:
                    yield VideoFrame(index, self._name(index), None, f"damaged: {damage.strerror}")
                    index += 1
                for picture in pictures:
                    if picture.time is not None:
                        first = picture.time if first is None else first
                        last = picture.time - first
                    yield VideoFrame(index, self._name(index), to_upright_rgb(picture))
                    index += 1
            if broken is not None or self._cut_off(container, stream, index, last):
                whole = f" of {self.length}" if self.length else ""
                message = f"{self.path} ends after {index}{whole} frames: cut off or damaged"
                yield VideoFrame(
                    index, self._name(index), None, f"{message} ({broken or 'no more'})."
                )

    def _cut_off(self, container: Any, stream: Any, frames: int, last: float) -> bool:
        """Whether both the promised frames and the promised time are missing.

        One alone proves nothing: edited videos hide frames, and the sound may be longer.
        """
        import av

        lengths = [float(container.duration) / av.time_base] if container.duration else []
        if stream.duration:
            lengths.append(float(stream.duration * stream.time_base))
        if not lengths:
            return False
        missing: float = min(lengths) - last
        if self.length:
            return frames < self.length and missing > 2.5 / (self.fps or 25)
        return missing > 0.5 + 2.5 / (self.fps or 25)

    def _open(self) -> Any:
        import av

        try:
            if not self.path.is_file():  # a pipe would never end
                raise InputError(f"{self.path} is not a regular file.")
            return av.open(str(self.path), metadata_errors="replace")
        except (av.error.FFmpegError, OSError) as error:
            raise InputError(
                f"{self.path} is not a video that can be opened ({error.strerror}); a video that "
                "was cut off while it was written may have lost its index."
            ) from error

    def _name(self, index: int) -> str:
        return f"{self.path.name}#{index:06d}"


def decoded(packets: Iterable[Any]) -> Iterator[tuple[list[Any], Any]]:
    """Of each of PyAV's packets the pictures, and the error of one that is damaged, else None."""
    import av

    for packet in packets:
        try:
            found, damage = packet.decode(), None
        except av.error.FFmpegError as error:
            found, damage = [], error
        yield found, damage


def pixel_aspect(stream: Any, picture: Any = None) -> float:
    """Width by height of the pixels of a stream of PyAV's, turned as one of its pictures is."""
    ratio = float(stream.sample_aspect_ratio or 1)
    turned = picture is not None and round((picture.rotation or 0) / 90) % 2
    return 1 / ratio if turned else ratio


def _refuse_collections(path: Path) -> None:
    """`InputError` for files of which ffmpeg would show the first picture and no other."""
    head = b""
    with suppress(OSError):  # which is told when it is opened
        if path.is_file():
            with path.open("rb") as file:
                head = file.read(512)
    if head.startswith(b"PK\x03\x04") or head[257:262] == b"ustar":
        raise InputError(f"{path} is an archive; unpack it and give the folder with its images.")
    if head.startswith((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")):
        with opened_image(path) as opened:
            pages = int(getattr(opened, "n_frames", 1))
        if pages > 1:
            raise InputError(
                f"{path} is a TIFF file of {pages} pages; save each as an image of its own and "
                "give the folder with them."
            )


def _video_stream(container: Any, path: Path) -> Any:
    if not container.streams.video:
        raise InputError(f"{path} holds no video.")
    return container.streams.video[0]
