"""Frames that come by themselves: an address on this very machine, and the newest of many."""

from __future__ import annotations

import functools
import http.server
import io
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from moveit6d.datasets import live
from moveit6d.datasets.live import LatestFrames, NetworkVideo, is_address
from moveit6d.datasets.video import VideoFrame, open_frames
from moveit6d.errors import InputError
from moveit6d.visualization.video import VideoWriter


class Silent(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """A folder with a video of twelve frames, served on this machine."""
    with VideoWriter(tmp_path / "clip.mp4", 25) as movie:
        for number in range(12):
            movie.write(np.full((48, 64, 3), 20 * number, np.uint8))
    (tmp_path / "text.mp4").write_text("no video")
    handler = functools.partial(Silent, directory=str(tmp_path))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://user:secret@127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()
    thread.join()


def test_a_video_at_an_address(address: str) -> None:
    frames = open_frames(f"{address}/clip.mp4")
    assert isinstance(frames, NetworkVideo) and not frames.live and frames.fps == 25
    found = list(frames)
    assert [frame.index for frame in found] == list(range(12))
    images = [frame.image for frame in found]
    assert all(image is not None and image.shape == (48, 64, 3) for image in images)
    assert abs(int(images[6].mean()) - 120) < 5  # type: ignore[union-attr]
    assert "secret" not in found[0].name and found[0].name.endswith("/clip.mp4#000000")


@pytest.mark.parametrize("path", ["/missing.mp4", "/text.mp4"])
def test_an_address_without_a_video_is_one_sentence(address: str, path: str) -> None:
    with pytest.raises(InputError, match="cannot be opened") as caught:
        open_frames(address + path)
    assert "secret" not in str(caught.value) and "127.0.0.1" in str(caught.value)


class Webcam(http.server.BaseHTTPRequestHandler):
    """Six JPEGs one after the other, and then nothing; under another path never anything.

    Those of `broken` are no pictures.
    """

    broken: tuple[int, ...] = ()

    def log_message(self, *_: object) -> None:
        pass

    def do_GET(self) -> None:
        if self.path == "/camera":
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
            self.end_headers()
            for number in range(6):
                stream = io.BytesIO()
                Image.fromarray(np.full((48, 64, 3), 20 * number, np.uint8)).save(stream, "JPEG")
                if number in self.broken:
                    stream = io.BytesIO(b"no picture" * 30)
                    stream.seek(0, io.SEEK_END)
                head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {stream.tell()}"
                self.wfile.write(f"{head}\r\n\r\n".encode() + stream.getvalue() + b"\r\n")
        time.sleep(1.5)


def test_a_camera_in_the_net_that_falls_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "PATIENCE", 0.7)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Webcam)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    place = f"http://127.0.0.1:{server.server_address[1]}"
    frames = open_frames(f"{place}/camera")
    assert isinstance(frames, NetworkVideo) and frames.live
    *found, last = frames
    assert len(found) >= 5 and all(frame.image is not None for frame in found)
    assert last.image is None and "gave no more frames (no answer for" in str(last.error)
    with pytest.raises(InputError, match=r"/silent cannot be opened \(no answer for 0\.7 seconds"):
        open_frames(f"{place}/silent")
    server.shutdown()
    server.server_close()


@pytest.mark.parametrize("patience", [300, 1])
def test_a_damaged_frame_of_a_stream_is_one_frame(
    monkeypatch: pytest.MonkeyPatch, patience: int
) -> None:
    monkeypatch.setattr(live, "PATIENCE", 0.5)
    monkeypatch.setattr(live, "MOST_DAMAGED", patience)
    monkeypatch.setattr(Webcam, "broken", (2, 3))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Webcam)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    *found, last = open_frames(f"http://127.0.0.1:{server.server_address[1]}/camera")
    server.shutdown()
    server.server_close()
    known = [frame.image is not None for frame in found]
    assert [frame.index for frame in (*found, last)] == list(range(len(found) + 1))
    assert found[2].error == "damaged: Invalid data found when processing input"
    assert last.image is None and "gave no more frames" in str(last.error)
    if patience == 1:  # the second in a row is one too many
        assert known == [True, True, False] and "Invalid data" in str(last.error)
    else:
        assert known[:5] == [True, True, False, False, True]


def test_nobody_at_the_address() -> None:
    with pytest.raises(InputError, match=r"rtsp://127\.0\.0\.1:9/live cannot be opened"):
        open_frames("rtsp://user:secret@127.0.0.1:9/live")


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("rtsp://user:secret@[::1]:9/live", "rtsp://[::1]:9/live"),
        ("rtsp://user:secret@127.0.0.1:port/live", "rtsp://127.0.0.1/live"),
    ],
)
def test_the_name_of_an_address_hides_who_asks(address: str, shown: str) -> None:
    with pytest.raises(InputError) as caught:
        open_frames(address)
    assert str(caught.value).startswith(f"{shown} cannot be opened")


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("rtsp://camera/1", True), ("HTTP://host/a.mp4", True), ("udp://0.0.0.0:5000", True),
        ("file:///etc/passwd", False), ("clip.mp4", False), ("concat:a|b", False), ("0", False),
    ],
)  # fmt: skip
def test_what_is_an_address(source: str, expected: bool) -> None:
    assert is_address(source) is expected


class Ticking:
    """Ten frames, one each hundredth of a second."""

    length, fps, live = 10, 100.0, True

    def __init__(self, broken: BaseException | None = None) -> None:
        self.broken = broken

    def __iter__(self) -> Iterator[VideoFrame]:
        for number in range(10):
            time.sleep(0.01)
            yield VideoFrame(number, str(number), np.zeros((2, 2, 3), np.uint8))
        if self.broken:
            raise self.broken
        yield VideoFrame(10, "10", None, "gone")


def test_who_is_slow_sees_the_newest_frame_and_the_end() -> None:
    seen = []
    for frame in LatestFrames(Ticking()):
        seen.append(frame.index)
        time.sleep(0.035)
    assert seen == sorted(set(seen)) and seen[-1] == 10
    assert len(seen) < 9  # several were left out
    quick = [frame.index for frame in LatestFrames(Ticking())]
    assert quick[-1] == 10 and len(quick) >= len(seen)
    with pytest.raises(ZeroDivisionError):
        list(LatestFrames(Ticking(ZeroDivisionError())))


class Held:
    """A first frame, and once that is taken all the others at once; the end comes when told to."""

    length, fps, live = None, None, True

    def __init__(self, errors: list[str | None]) -> None:
        self.errors = errors
        self.taken, self.all_there, self.end = (threading.Event() for _ in range(3))

    def __iter__(self) -> Iterator[VideoFrame]:
        for number, error in enumerate([None, *self.errors]):
            image = np.zeros((2, 2, 3), np.uint8) if error is None else None
            yield VideoFrame(number, str(number), image, error)
            if number == 0:
                assert self.taken.wait(5)
        self.all_there.set()
        assert self.end.wait(5)


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        (["a", None, "b", None], [0, 3, 4]), ([None, "a", "b"], [0, 3]),
        (["a", None, None], [0, 1, 3]), ([None, None], [0, 2]),
    ],
)  # fmt: skip
def test_of_what_was_missed_only_the_last_error_is_told(
    errors: list[str | None], expected: list[int]
) -> None:
    source, seen = Held(errors), []
    for frame in LatestFrames(source):
        seen.append(frame.index)
        source.taken.set()
        assert source.all_there.wait(5)
        if frame.index == len(errors):
            source.end.set()
    assert seen == expected


@pytest.mark.parametrize("source", ["rtsp://user:secret@camera/1", Path("clip.mp4"), 0, None])
def test_what_gives_no_frames_is_said(source: Any) -> None:
    with pytest.raises(InputError, match=r"takes the frames that open_frames\(…\) gives") as caught:
        LatestFrames(source)
    assert "secret" not in str(caught.value)


def test_giving_up_ends_the_reading() -> None:
    for frame in LatestFrames(Ticking()):
        if frame.index >= 2:
            break
    deadline = time.monotonic() + 5
    while any(thread.name == "live frames" for thread in threading.enumerate()):
        assert time.monotonic() < deadline
        time.sleep(0.01)
