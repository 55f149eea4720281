"""Frames of a video, one after the other: a folder of images, a video file, or a live camera.

Never holds more than the few frames read ahead and never stops at a bad one: that frame says what
was wrong.
"""

from __future__ import annotations

import queue
import re
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .image_depth import deep_rgb, is_deep, to_rgb8

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")
# Not EPS, for which Pillow starts another program.
IMAGE_FORMATS = ("JPEG", "PNG", "BMP", "TIFF", "WEBP", "PPM", "MPO", "GIF", "TGA", "JPEG2000")
# A header of a few bytes can promise gigabytes: more pixels than this only in a file of its size.
FREE_PIXELS, PIXELS_PER_BYTE = 40_000_000, 300
# A camera that gives nothing this many times in a row is taken to be gone.
CAMERA_PATIENCE = 30
AHEAD = 3  # frames that are read while another is worked on

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class VideoFrame:
    """One frame: its number from 0, its name, and the RGB image (H, W, 3), or else `error`."""

    index: int
    name: str
    image: Image | None
    error: str | None = None


class FrameSource(Protocol):
    """Frames in order; `length` and `fps` are None where nobody knows them.

    May be iterated more than once, except a camera.
    """

    @property
    def length(self) -> int | None:
        """How many frames there should be."""

    @property
    def fps(self) -> float | None:
        """Frames a second."""

    def __iter__(self) -> Iterator[VideoFrame]: ...


def is_live(frames: FrameSource) -> bool:
    """Whether frames come by themselves, each only once: from a camera, here or in the net."""
    return bool(getattr(frames, "live", False))


def open_frames(source: str | Path | int) -> FrameSource:
    """The frames of a folder, a video file, an address (rtsp://…), or the camera with that index.

    Images of a folder come in the order of their names, numbers in names compared as numbers
    (9.png before 10.png). `InputError` if there is nothing to read.
    """
    if isinstance(source, int):
        return LiveCamera(source)
    if isinstance(source, str) and "://" in source:
        from .live import NetworkVideo, is_address

        if is_address(source):
            return NetworkVideo(source)
        if source.startswith("file://"):
            source = unquote(urlsplit(source).path)
    path = Path(source)
    device = re.fullmatch(r"/dev/video(\d{1,3})", str(path))
    if device is not None:
        return LiveCamera(int(device[1]))
    with suppress(OSError):  # of a path that is too long
        if path.is_dir():
            return ImageFolder(path)
        if path.exists():
            return VideoFile(path)
    if str(source).isdecimal() and len(str(source)) < 4:
        return LiveCamera(int(str(source)))
    raise InputError(
        f"{str(path)[:200]} does not exist: give a folder of images, a video, an address "
        "(rtsp://…, http://…) or a camera index."
    )


def image_size(path: Path) -> tuple[int, int]:
    """Width and height of an image, of which no more than the header is read."""
    with opened_image(path) as opened:
        return int(opened.size[0]), int(opened.size[1])


def read_image(path: Path) -> Image:
    """One image as RGB (H, W, 3); grey becomes RGB, other depths 8 bits (`image_depth`).

    `InputError` if it is damaged or its numbers cannot be read.
    """
    from PIL import ImageOps

    with opened_image(path) as opened:
        deep = is_deep(opened)
        return deep_rgb(path) if deep else to_rgb8(ImageOps.exif_transpose(opened), path)


@contextmanager
def opened_image(path: Path) -> Iterator[Any]:
    """An image file, opened by Pillow; whatever goes wrong with it is an `InputError`."""
    from PIL import Image as Pillow

    Pillow.init()
    formats = [name for name in IMAGE_FORMATS if name in Pillow.OPEN]
    try:
        if path.exists() and not path.is_file():  # a pipe would never end
            raise InputError(f"{path} is not a regular file.")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Pillow.DecompressionBombWarning)  # checked below
            image = Pillow.open(path, formats=formats)
        with image as opened:
            count, content = opened.size[0] * opened.size[1], path.stat().st_size
            if count > FREE_PIXELS and count > PIXELS_PER_BYTE * content:
                raise InputError(
                    f"{path} says {opened.size[0]}×{opened.size[1]} pixels but has only {content} "
                    "bytes; it is damaged or made to fill the memory."
                )
            yield opened
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{path} does not exist.") from None
    except Exception as error:  # Pillow's readers raise what they stumble upon
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(f"{path} is not a readable image: {reason}.") from error


class ImageList:
    """Image files in the order given; a missing or damaged one is a frame with an error."""

    fps: float | None = None

    def __init__(self, paths: Iterable[Path]) -> None:
        self.paths = tuple(paths)
        self.length: int | None = len(self.paths)

    def __iter__(self) -> Iterator[VideoFrame]:
        for index, path in enumerate(self.paths):
            try:
                yield VideoFrame(index, path.name, read_image(path))
            except InputError as error:
                yield VideoFrame(index, path.name, None, str(error))


class ImageFolder(ImageList):
    """The images of a folder in the order of their names."""

    def __init__(self, folder: Path) -> None:
        try:
            names = [p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES]
        except OSError as error:
            raise InputError(f"{folder} cannot be read: {error.strerror}.") from error
        super().__init__(
            sorted((p for p in names if not p.name.startswith(".")), key=natural_order)
        )
        if not self.paths:
            raise InputError(f"{folder} holds no images ({', '.join(IMAGE_SUFFIXES)}).")


class ReadBeside:
    """A source whose frames are read in another thread; its length and pace stay."""

    def __init__(self, source: FrameSource) -> None:
        self.source = source

    @property
    def length(self) -> int | None:
        """How many frames there should be."""
        return self.source.length

    @property
    def fps(self) -> float | None:
        """Frames a second, as they come."""
        return self.source.fps


class Prefetched(ReadBeside):
    """The frames of a source, up to `AHEAD` of them read while the caller works on another.

    The reading thread ends with the last frame or as soon as the iteration is given up.
    """

    def __init__(self, source: FrameSource, ahead: int = AHEAD) -> None:
        super().__init__(source)
        self.ahead = ahead

    def __iter__(self) -> Iterator[VideoFrame]:
        frames: queue.Queue[VideoFrame | BaseException | None] = queue.Queue(self.ahead)
        given_up = threading.Event()

        def put(item: VideoFrame | BaseException | None) -> bool:
            while not given_up.is_set():
                try:
                    frames.put(item, timeout=0.1)
                    return True
                except queue.Full:
                    continue
            return False

        def read() -> None:
            try:
                for frame in self.source:
                    if not put(frame):
                        return
                put(None)
            except BaseException as error:  # belongs to who iterates
                put(error)

        reader = threading.Thread(target=read, name="frames", daemon=True)
        reader.start()
        try:
            while (item := frames.get()) is not None:
                if isinstance(item, BaseException):
                    raise item
                yield item
        finally:
            given_up.set()
            reader.join()


class VideoFile:
    """The frames of a video file, turned upright as players do.

    A damaged frame, and the place where a cut-off file ends, are frames with an error.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._open() as container:
            stream = _video_stream(container, path)
            self.length: int | None = stream.frames or None
            self.fps: float | None = float(stream.average_rate) if stream.average_rate else None

    def __iter__(self) -> Iterator[VideoFrame]:
        import av

        index, last = 0, 0.0
        first: float | None = None
        broken: str | None = None
        with self._open() as container:
            stream = _video_stream(container, self.path)
            packets = container.demux(stream)
            while True:
                try:
                    packet = next(packets)
                except StopIteration:
                    break
                except av.error.FFmpegError as error:
                    broken = f"{error.strerror}"
                    break
                try:
                    pictures = packet.decode()
                except av.error.FFmpegError as error:
                    yield VideoFrame(index, self._name(index), None, f"damaged: {error.strerror}")
                    index += 1
                    continue
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


class LiveCamera:
    """The frames of the camera with an index, until it is gone or the user stops."""

    length: int | None = None
    live = True

    def __init__(self, index: int) -> None:
        import cv2

        self.index = index
        self._device = cv2.VideoCapture(index)
        if not self._device.isOpened():
            raise InputError(f"camera {index} cannot be opened; is it there, and not in use?")
        sides = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        self.size = tuple(int(self._device.get(side)) for side in sides)
        rate = self._device.get(cv2.CAP_PROP_FPS)
        self.fps: float | None = rate if rate and rate > 0 else None

    def __iter__(self) -> Iterator[VideoFrame]:
        index = silent = 0
        try:
            while silent < CAMERA_PATIENCE:
                there, image = self._device.read()
                name = f"camera{self.index}#{index:06d}"
                if there:
                    silent = 0
                    yield VideoFrame(index, name, np.ascontiguousarray(image[..., ::-1]))
                else:
                    silent += 1
                    yield VideoFrame(index, name, None, f"camera {self.index} gave no frame.")
                index += 1
        finally:
            self._device.release()


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Sort key for names: runs of digits compare as numbers."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), part) if part.isdecimal() else (-1, part) for part in parts]


def _video_stream(container: Any, path: Path) -> Any:
    if not container.streams.video:
        raise InputError(f"{path} holds no video.")
    return container.streams.video[0]


def to_upright_rgb(picture: Any) -> Image:
    """A decoded picture of PyAV's as RGB (H, W, 3), turned as players turn it."""
    image: Image = picture.to_ndarray(format="rgb24")
    quarter_turns = round((picture.rotation or 0) / 90) % 4
    return np.ascontiguousarray(np.rot90(image, quarter_turns)) if quarter_turns else image
