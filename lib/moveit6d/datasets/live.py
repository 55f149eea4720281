"""Frames that come by themselves: of a camera beside this machine, or from an address in the net.

Never keeps a frame for longer than the next one needs to come: who is too slow misses frames, but
never sees the past.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import suppress
from typing import Any
from urllib.parse import SplitResult, urlsplit

from ..errors import InputError
from .video import ReadBeside, VideoFrame, to_upright_rgb
from .video_file import decoded, pixel_aspect

# Protocols of PyAV's ffmpeg; files that are fetched (http) are waited for, streams are not.
STREAMED = ("rtsp", "rtsps", "rtmp", "rtmps", "rtp", "udp", "srt", "tcp", "mms")
FETCHED = ("http", "https", "ftp")
PATIENCE = 10.0  # seconds without an answer after which a connection is given up
# Damaged frames in a row after which it is, too: more than lie between a stream's key frames.
MOST_DAMAGED = 300


def is_address(source: str) -> bool:
    """Whether a text is an address in the net and no path."""
    scheme = re.match(r"([a-z][a-z0-9+]*)://", source.lower())
    return scheme is not None and scheme[1] in (*STREAMED, *FETCHED)


class NetworkVideo:
    """The frames of a video at an address: rtsp://…, http://… and what else ffmpeg knows.

    `live` says whether it goes on without us. A damaged frame is a frame with an error, a
    connection that breaks is one last such frame. User name and password of the address are in no
    name and no message.
    """

    length: int | None = None

    def __init__(self, address: str) -> None:
        self._address = address
        parts = urlsplit(address)
        self.live = parts.scheme.lower() in STREAMED
        self.name = f"{parts.scheme}://{_host(parts)}{parts.path}"
        with self._open() as container:
            if not container.streams.video:
                raise InputError(f"{self.name} holds no video.")
            # Cameras in the net that give one JPEG after the other.
            self.live = self.live or container.format.name == "mpjpeg"
            rate = container.streams.video[0].average_rate
            self.fps: float | None = float(rate) if rate else None
            self.sample_aspect_ratio = pixel_aspect(container.streams.video[0])

    def __iter__(self) -> Iterator[VideoFrame]:
        import av

        index = damaged = 0
        try:
            with self._open() as container:
                for pictures, damage in decoded(container.demux(container.streams.video[0])):
                    if damage is not None:
                        damaged += 1
                        if damaged > MOST_DAMAGED:
                            raise damage
                        message = f"damaged: {_reason(damage)}"
                        yield VideoFrame(index, self._name(index), None, message)
                        index += 1
                    for picture in pictures:
                        damaged = 0
                        yield VideoFrame(index, self._name(index), to_upright_rgb(picture))
                        index += 1
        except (av.error.FFmpegError, OSError) as error:
            message = f"{self.name} gave no more frames ({_reason(error)})."
            yield VideoFrame(index, self._name(index), None, message)

    def _open(self) -> Any:
        import av

        options = {"rtsp_transport": "tcp"} if self._address.lower().startswith("rtsp") else {}
        try:
            return av.open(self._address, options=options, timeout=PATIENCE)
        except (av.error.FFmpegError, OSError, ValueError) as error:
            raise InputError(
                f"{self.name} cannot be opened ({_reason(error)}); is the address right, and does "
                "it answer from here?"
            ) from None

    def _name(self, index: int) -> str:
        return f"{self.name}#{index:06d}"


class LatestFrames(ReadBeside):
    """The newest frame of a source each time one is asked for; those in between are left out.

    For live sources: a tracker that is slower than the camera would otherwise see the past.
    Reading goes on in a thread of its own, which ends with the source or as soon as the iteration
    is given up.

    Examples:
        >>> from moveit6d import LatestFrames, open_frames
        >>> for frame in LatestFrames(open_frames("rtsp://camera/stream")):  # doctest: +SKIP
        ...     result = tracker.update(frame.image)
    """

    def __iter__(self) -> Iterator[VideoFrame]:
        # At most the last error, the newest frame behind it, and the end.
        newest: list[VideoFrame | BaseException | None] = []
        changed, given_up = threading.Condition(), threading.Event()

        def put(item: VideoFrame | BaseException | None) -> None:
            with changed:
                if isinstance(item, VideoFrame):
                    errors = [one for one in newest if isinstance(one, VideoFrame) and one.error]
                    newest[:] = [] if item.error else errors[-1:]
                newest.append(item)
                changed.notify()

        def read() -> None:
            try:
                for frame in self.source:
                    if given_up.is_set():
                        return
                    put(frame)
                put(None)
            except BaseException as error:  # belongs to who iterates
                put(error)

        reader = threading.Thread(target=read, name="live frames", daemon=True)
        reader.start()
        try:
            while True:
                with changed:
                    while not newest:
                        changed.wait()
                    item = newest.pop(0)
                if item is None:
                    return
                if isinstance(item, BaseException):
                    raise item
                yield item
        finally:
            given_up.set()


def _host(parts: SplitResult) -> str:
    """Host and port of an address, without user and password."""
    host = parts.hostname or ""
    with suppress(ValueError):  # of a port that is no number
        if parts.port is not None:
            host = f"[{host}]" if ":" in host else host
            return f"{host}:{parts.port}"
    return host


def _reason(error: BaseException) -> str:
    import av

    if isinstance(error, av.error.ExitError):
        return f"no answer for {PATIENCE:g} seconds"
    return str(getattr(error, "strerror", None) or type(error).__name__)
