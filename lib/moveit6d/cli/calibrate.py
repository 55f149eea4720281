"""`moveit6d calibrate`: a camera file from pictures of a printed board.

Never more than reading pictures, the fit, and writing.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..io import check_writable
from .apart import check_apart
from .common import add_verb
from .messages import note, progress

if TYPE_CHECKING:
    from ..camera_calibration import Board, Calibration, Corners
    from ..datasets.video import FrameSource, VideoFrame

DESCRIPTION = """\
Print the board, glue it to something flat, and film it with the camera and the settings
(resolution, zoom, focus, stabilisation off) that will be used for tracking: half a minute in which
the board comes to every corner of the picture, near and far, tilted by 30 to 45 degrees each way.
Photos in a folder will do as well, twenty or more. Which size the board is printed in does not
matter, only that it is flat.

files written:
  --output       the camera file that track and detect read with --camera
  --print_board  a page to print at 100 %: A4 at 300 dots an inch, .png or .pdf
"""

EPILOG = """\
examples:
  moveit6d calibrate --print_board board.pdf
  moveit6d calibrate --video board.mp4 --output camera.json
  moveit6d calibrate --video photos/ --board chessboard --squares 10x7 --output camera.json
  moveit6d calibrate --video action_cam.mp4 --lens fisheye --output camera.json
"""

TRIED = 300  # frames in which the board is looked for; a few times more where the end is not known
PAPER = (2480, 3508)  # A4 at 300 dots an inch, pixels
MARGIN = 120  # pixels of white around the printed board


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "calibrate", "make a camera file", DESCRIPTION, EPILOG)
    parser.add_argument(
        "--video", metavar="SOURCE", help="folder of photos, video file, address or camera index"
    )
    parser.add_argument("--output", type=Path, metavar="FILE", help="camera.json to write")
    parser.add_argument(
        "--print_board", type=Path, metavar="FILE", help="write the board to print, .png or .pdf"
    )
    parser.add_argument(
        "--board", choices=("charuco", "chessboard"), default="charuco",
        help="charuco may leave the picture in part, of a chessboard all must be seen",
    )  # fmt: skip
    parser.add_argument(
        "--squares", type=_squares, default=(8, 11), metavar="COLUMNSxROWS",
        help="squares of the board, not inner corners (default: 8x11)",
    )  # fmt: skip
    parser.add_argument(
        "--dictionary", default="4x4_250", metavar="NAME", help="of a charuco board's markers"
    )
    parser.add_argument(
        "--lens", choices=("none", "standard", "rational", "fisheye"), default="standard",
        help="distortion: none, 5 coefficients, 8 (wide lenses), or the fisheye's 4",
    )  # fmt: skip
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print a board, or calibrate, or both."""
    from ..camera_calibration import Board
    from ..datasets.video import image_files, open_frames

    board = Board(args.board, args.squares[0], args.squares[1], args.dictionary)
    if args.print_board is None and args.video is None:
        raise InputError(
            "give --video and --output to calibrate, or --print_board FILE for the board to film."
        )
    if (args.video is None) != (args.output is None):
        raise InputError("--video and --output are needed together.")
    if args.output is not None:
        check_writable(args.output)
    frames = None if args.video is None else open_frames(args.video)
    read = () if frames is None else image_files(frames) or (Path(args.video),)
    check_apart({"--print_board": (args.print_board,), "--output": (args.output,)}, read)
    if args.print_board is not None:
        print_board(board, args.print_board)
        print(f"{args.print_board}: print it at 100 % and glue it to something flat")
    return 0 if frames is None else _calibrate(args, board, frames)


def _calibrate(args: argparse.Namespace, board: Board, frames: FrameSource) -> int:
    from ..camera_calibration import calibrate, choose_views
    from ..threads import limited_threads

    with limited_threads(1):
        views, size = _views(board, frames)
        if size is None:
            raise InputError(f"{args.video}: there is no picture that can be read.")
        chosen = [views[number] for number in choose_views(views, *size)]
        try:
            found = calibrate(chosen, *size, args.lens)
        except InputError as error:
            raise InputError(f"{args.video}: {error}") from None
    _write(args.output, found)
    for doubt in found.doubts():
        note(f"{doubt}.")
    print(
        f"{found.views} pictures, corners {found.error:.2f} pixels off, field of view "
        f"{found.field_of_view:.0f} degrees, {100 * found.coverage:.0f} % of the picture seen: "
        f"{args.output}"
    )
    return 0


def _views(board: Board, frames: FrameSource) -> tuple[list[Corners], tuple[int, int] | None]:
    """The board in frames spread over the source, and the size that they all have."""
    views: list[Corners] = []
    size: tuple[int, int] | None = None
    for frame in progress(_spread(frames), frames.length and min(frames.length, TRIED), "board"):
        if frame.image is None:
            note(f"frame {frame.index}: {frame.error}")
            continue
        height, width = frame.image.shape[:2]
        size = size or (width, height)
        if (width, height) != size:
            raise InputError(
                f"{frame.name} is {width}×{height}, those before {size[0]}×{size[1]}; a camera "
                "is calibrated for one resolution."
            )
        corners = board.find(frame.image)
        if corners is not None:
            views.append(corners)
    return views, size


def _spread(frames: FrameSource) -> Iterator[VideoFrame]:
    """Up to `TRIED` frames: evenly spread if their number is known, of a camera the first ones.

    A video file that does not say how many it has is read to its end, the farther the sparser.
    """
    from ..datasets.video import is_live

    every = max(1, math.ceil((frames.length or 0) / TRIED))
    to_the_end = frames.length is None and not is_live(frames)
    taken = 0
    for frame in frames:
        if to_the_end and frame.index >= TRIED * every:
            every *= 2
        if frame.index % every == 0:
            yield frame
            taken += 1
        if taken == TRIED and not to_the_end:
            return


def _write(path: Path, found: Calibration) -> None:
    """The camera file, with what the calibration says of itself."""
    from ..datasets.pose_files import camera_content
    from ..io import write_json

    facts = {"reprojection_error": found.error, "images": found.views}
    write_json(path, {**camera_content(found.camera), **facts})


def print_board(board: Board, path: Path) -> None:
    """The board on an A4 page, upright or lying as it fills more of it."""
    from PIL import Image, ImageDraw, ImageFont

    from ..io import replacing

    if path.suffix.lower() not in (".png", ".pdf"):
        raise InputError(f"{path}: boards are written as .png or .pdf.")
    width, height = PAPER if board.rows >= board.columns else PAPER[::-1]
    square = min((width - 2 * MARGIN) // board.columns, (height - 3 * MARGIN) // board.rows)
    picture = Image.fromarray(board.draw(square, 0))
    page = Image.new("L", (width, height), 255)
    page.paste(picture, ((width - picture.width) // 2, (height - MARGIN - picture.height) // 2))
    words = f"moveit6d calibrate --board {board.kind} --squares {board.columns}x{board.rows}"
    if board.kind == "charuco":
        words += f" --dictionary {board.dictionary}"
    font = ImageFont.load_default(40)
    ImageDraw.Draw(page).text((MARGIN, height - MARGIN), words, 0, font)
    with replacing(path) as temporary:
        page.save(temporary, resolution=300, dpi=(300, 300))


def _squares(text: str) -> tuple[int, int]:
    columns, _, rows = text.lower().replace("×", "x").partition("x")
    if not (columns.isdecimal() and rows.isdecimal()):
        raise argparse.ArgumentTypeError(f"must be like 8x11, found {text!r}")
    return int(columns), int(rows)
