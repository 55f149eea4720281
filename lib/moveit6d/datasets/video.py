"""Frames of a video, one after the other: a folder of images, a video file, or a live camera.

Never holds more than the few frames read ahead and never stops at a bad one: that frame says what
was wrong.
"""

from __future__ import annotations

import operator
import queue
import re
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, SupportsIndex
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from ..checks import shown
from ..errors import InputError
from .image_depth import BitDepth, deep_rgb, is_deep, to_rgb8
from .image_names import fits, in_order, is_pattern, series

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")
# Not EPS, for which Pillow starts another program.
IMAGE_FORMATS = ("JPEG", "PNG", "BMP", "TIFF", "WEBP", "PPM", "MPO", "GIF", "TGA", "JPEG2000")
# A header of a few bytes can promise gigabytes: more pixels than this only in a file of its size.
FREE_PIXELS, PIXELS_PER_BYTE = 40_000_000, 300
# A camera that gives nothing this many times in a row is taken to be gone.
CAMERA_PATIENCE = 30
LOOKED_AT = 8  # images from which the bits of all are told
UNSPECIFIED = 2  # AVCOL_SPC_UNSPECIFIED
HD_LINES = 720  # smaller video without a tag is BT.601, which ffmpeg assumes
AHEAD = 3  # frames that are read while another is worked on
LARGEST_CAMERA = 2**31 - 1  # OpenCV's indices are C's int

Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
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


def open_frames(source: str | PathLike[str] | SupportsIndex) -> FrameSource:
    """The frames of a folder, a video file, an address (rtsp://…), or the camera with that index.

    Images of a folder come in the order of their names, numbers in names compared as numbers
    (9.png before 10.png), time stamps as decimals. A pattern takes some of them: a glob pattern
    (`folder/*-color.png`) or printf's (`folder/%06d.jpg`, all such numbers that there are).
    `InputError` if there is nothing to read, and for a folder that holds several series (colour and
    depth) without a pattern. Every frame comes, also of live sources, however late: who would
    rather have the newest one takes `LatestFrames(open_frames(…))`.
    """
    if not isinstance(source, str | PathLike):
        return LiveCamera(_camera_index(source))
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
            from .video_file import VideoFile

            return VideoFile(path)
        if is_pattern(path.name) and path.parent.is_dir():
            return ImageFolder(path.parent, path.name)
    if str(source).isdecimal() and len(str(source)) < 4:
        return LiveCamera(int(str(source)))
    raise InputError(
        f"{str(path)[:200]} does not exist: give a folder of images, a video, an address "
        "(rtsp://…, http://…) or a camera index."
    )


def _camera_index(source: Any) -> int:
    """A whole number of any kind; `InputError` for what is neither that nor a name."""
    try:
        if not isinstance(source, bool | np.bool_):
            return operator.index(source)
    except TypeError:
        pass
    raise InputError(
        "Frames come from a folder of images, a video, an address (rtsp://…, http://…) or a camera "
        f"index, found {shown(source)}."
    )


def image_files(source: FrameSource) -> tuple[Path, ...]:
    """The image files that frames are read from, in order; none of a video or a camera."""
    return tuple(getattr(source, "paths", ()))


def image_size(path: str | Path) -> tuple[int, int]:
    """Width and height of an image, of which no more than the header is read."""
    with opened_image(path) as opened:
        return int(opened.size[0]), int(opened.size[1])


def first_size(paths: Iterable[str | Path]) -> tuple[int, int]:
    """Width and height of the first image that can be opened; `InputError` if none of them can.

    So that a missing or damaged image is no more than a frame with an error.
    """
    first: InputError | None = None
    for path in paths:
        try:
            return image_size(path)
        except InputError as error:
            first = first or error
    raise first or InputError("There is no image to take the size from; give at least one.")


def read_image(path: str | Path, depth: BitDepth | None = None) -> Image:
    """One image as RGB (H, W, 3); grey becomes RGB, other depths 8 bits (`image_depth`).

    `depth` is what other images of the same source have shown of its bits. `InputError` if it is
    damaged or its numbers cannot be read.
    """
    from PIL import ImageOps

    path = Path(path)
    with opened_image(path) as opened:
        deep = is_deep(opened)
        if deep:
            return deep_rgb(path, depth)
        return to_rgb8(ImageOps.exif_transpose(opened), path, depth)


@contextmanager
def opened_image(path: str | Path) -> Iterator[Any]:
    """An image file, opened by Pillow; whatever goes wrong with it is an `InputError`."""
    from PIL import Image as Pillow

    path = Path(path)
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
    """Image files in the order given; a missing or damaged one is a frame with an error.

    All are taken to have as many bits as `depth` has seen: those of the brightest so far.
    """

    fps: float | None = None

    def __init__(self, paths: Iterable[str | Path]) -> None:
        self.paths = tuple(map(Path, paths))
        self.length: int | None = len(self.paths)
        self.depth = BitDepth()
        self._last: tuple[tuple[int, int], VideoFrame] | None = None

    def __iter__(self) -> Iterator[VideoFrame]:
        looked = bool(self.depth.bits)
        for index in range(len(self.paths)):
            frame = self.frame(index)
            if self.depth.bits and not looked:  # the first of more than 8 bits may be a dark one
                looked = True
                for other in range(0, len(self.paths), 1 + len(self.paths) // LOOKED_AT):
                    self.frame(other)
                frame = self.frame(index)
            yield frame

    def frame(self, index: int) -> VideoFrame:
        """The frame of that number; the last one is kept, and not decoded again."""
        if self._last is not None and self._last[0] == (index, self.depth.bits):
            return _own(self._last[1])
        path = self.paths[index]
        try:
            frame = VideoFrame(index, path.name, read_image(path, self.depth))
        except InputError as error:
            frame = VideoFrame(index, path.name, None, str(error))
        self._last = (index, self.depth.bits), _own(frame)
        return frame


def _own(frame: VideoFrame) -> VideoFrame:
    """The same frame with pixels of its own: who has the other one may draw on it."""
    return frame if frame.image is None else replace(frame, image=frame.image.copy())


class ImageFolder(ImageList):
    """The images of a folder in the order of their names, or those whose names fit a pattern.

    Without one, `InputError` if they are more than one video (`image_names.series`).
    """

    def __init__(self, folder: Path, pattern: str | None = None) -> None:
        try:
            found = [p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES]
        except OSError as error:
            raise InputError(f"{folder} cannot be read: {error.strerror}.") from error
        paths = in_order(p for p in found if not p.name.startswith("."))
        if pattern is not None:
            paths = [path for path in paths if fits(path.name, pattern)]
        super().__init__(paths)
        if not self.paths and pattern is not None:
            raise InputError(
                f"{folder / pattern} does not exist: give a folder of images, or a pattern that "
                "fits some of their names."
            )
        if not self.paths:
            raise InputError(f"{folder} holds no images ({', '.join(IMAGE_SUFFIXES)}).")
        several = [] if pattern is not None else series([path.name for path in paths])
        if several:
            colour = next((one for one in several if re.search("colou?r|rgb", one, re.I)), "")
            raise InputError(
                f"{folder} holds {len(several)} series of images with the same numbers "
                f"({', '.join(several[:5])}{', …' * (len(several) > 5)}); give the one to read, as "
                f"'{folder}/{colour or several[0]}', or '{folder}/*' for all."
            )


class ReadBeside:
    """A source whose frames are read in another thread; its length and pace stay.

    `InputError` for what is no `FrameSource`, as the name of a video.
    """

    def __init__(self, source: FrameSource) -> None:
        if not all(hasattr(source, name) for name in ("__iter__", "length", "fps")):
            raise InputError(
                f"{type(self).__name__} takes the frames that open_frames(…) gives, found a "
                f"{type(source).__name__}."
            )
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


class LiveCamera:
    """The frames of the camera with an index, until it is gone or the user stops.

    `InputError` where there is no such camera.
    """

    length: int | None = None
    live = True

    def __init__(self, index: int) -> None:
        import cv2

        if not 0 <= index <= LARGEST_CAMERA:  # OpenCV crashes
            raise InputError(f"The index of a camera counts from 0, found {index}.")
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


def to_upright_rgb(picture: Any) -> Image:
    """A decoded picture of PyAV's as RGB (H, W, 3), turned as players turn it.

    High-definition video that does not say what its colours mean is BT.709, as players take it.
    """
    # Only where it must: given to a tagged picture, the argument would overrule the tag.
    untagged = picture.colorspace == UNSPECIFIED and picture.height >= HD_LINES
    colors = {"src_colorspace": "itu709"} if untagged else {}
    image: Image = picture.to_ndarray(format="rgb24", **colors)
    quarter_turns = round((picture.rotation or 0) / 90) % 4
    return np.ascontiguousarray(np.rot90(image, quarter_turns)) if quarter_turns else image
