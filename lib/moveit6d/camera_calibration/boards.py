"""The boards that cameras are calibrated with: chessboards and ChArUco boards, OpenCV's both.

Never estimates a camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

BoardKind = Literal["charuco", "chessboard"]
MARKER = 0.75  # of a square
DICTIONARY = "4x4_250"
FEWEST = 8  # corners of a board seen in part without which a picture says too little
DETECTED_AT = 1600  # pixels of the longer side: chessboards are found there and refined in full


@dataclass(frozen=True)
class Corners:
    """Corners found in one picture: pixels (N, 2) and their places on the board (N, 3), squares."""

    pixels: NDArray[np.float32]
    places: NDArray[np.float32]


@dataclass(frozen=True)
class Board:
    """A board of `columns` × `rows` squares, black and white; a ChArUco board has markers too.

    `dictionary` names the markers as OpenCV does, without DICT_. Of a chessboard all inner corners
    must be seen, of a ChArUco board a part will do.
    """

    kind: BoardKind = "charuco"
    columns: int = 8
    rows: int = 11
    dictionary: str = DICTIONARY

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > 50:
            raise InputError(
                f"A board has 3 to 50 squares a side, found {self.columns} × {self.rows}."
            )
        if self.kind == "charuco":
            self._dictionary()

    def find(self, image: NDArray[np.uint8]) -> Corners | None:
        """The corners in an RGB image (H, W, 3); None where the board is not seen well enough."""
        import cv2

        grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
        return self._charuco(grey) if self.kind == "charuco" else self._chessboard(grey)

    def draw(self, square: int, margin: int) -> NDArray[np.uint8]:
        """The board as a picture (H, W), `square` pixels a square and a white margin around it."""
        import cv2

        if self.kind == "charuco":
            size = (self.columns * square, self.rows * square)
            picture = np.asarray(self._boards[0].generateImage(size, None, 0, 1))
        else:
            row, column = np.indices((self.rows, self.columns))
            cells = np.where((row + column) % 2, 255, 0).astype(np.uint8)
            picture = cells.repeat(square, 0).repeat(square, 1)
        edges = (margin,) * 4
        framed = cv2.copyMakeBorder(picture, *edges, cv2.BORDER_CONSTANT, value=255)
        return np.asarray(framed, np.uint8)

    def _charuco(self, grey: NDArray[np.uint8]) -> Corners | None:
        import cv2

        best: Corners | None = None
        for board in self._boards:
            corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
            if ids is None or len(ids) < FEWEST:
                continue
            places = np.asarray(board.getChessboardCorners(), np.float32)[np.ravel(ids)]
            spread = np.ptp(places[:, :2], axis=0).min()
            if spread >= 2 and (best is None or len(ids) > len(best.pixels)):
                best = Corners(np.asarray(corners, np.float32).reshape(-1, 2), places)
        return best

    def _chessboard(self, grey: NDArray[np.uint8]) -> Corners | None:
        import cv2

        inner = (self.columns - 1, self.rows - 1)
        scale = max(1.0, max(grey.shape) / DETECTED_AT)
        small = grey
        if scale > 1:
            size = (round(grey.shape[1] / scale), round(grey.shape[0] / scale))
            small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        found, corners = cv2.findChessboardCornersSB(small, inner, flags=flags)
        if not found:
            return None
        pixels = np.asarray(corners, np.float32).reshape(-1, 1, 2)
        if scale > 1:
            ratio = np.array(grey.shape[::-1]) / np.array(small.shape[::-1])
            pixels = ((pixels + 0.5) * ratio - 0.5).astype(np.float32)
            stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)
            reach = round(2 * scale) + 2
            pixels = cv2.cornerSubPix(grey, pixels, (reach, reach), (-1, -1), stop)
        y, x = np.divmod(np.arange(inner[0] * inner[1]), inner[0])
        places = np.column_stack([x, y, np.zeros(len(x))]).astype(np.float32)
        return Corners(pixels.reshape(-1, 2), places)

    @cached_property
    def _boards(self) -> tuple[Any, ...]:
        """OpenCV's board, and the same as versions before 4.6 drew those of even rows."""
        import cv2

        size = (self.columns, self.rows)
        made = [cv2.aruco.CharucoBoard(size, 1.0, MARKER, self._dictionary()) for _ in range(2)]
        made[1].setLegacyPattern(True)
        return tuple(made[: 1 + (self.rows % 2 == 0)])

    def _dictionary(self) -> Any:
        import cv2

        name = f"DICT_{self.dictionary}".upper()
        number = next((getattr(cv2.aruco, n) for n in dir(cv2.aruco) if n.upper() == name), None)
        if number is None:
            known = sorted(n[5:].lower() for n in dir(cv2.aruco) if n.startswith("DICT_"))
            raise InputError(
                f"There is no marker dictionary {self.dictionary!r}; choose one of "
                f"{', '.join(dict.fromkeys(known))}."
            )
        dictionary = cv2.aruco.getPredefinedDictionary(number)
        if self.columns * self.rows // 2 > len(dictionary.bytesList):
            raise InputError(
                f"{self.columns} × {self.rows} squares need more markers than "
                f"{self.dictionary} has ({len(dictionary.bytesList)})."
            )
        return dictionary
