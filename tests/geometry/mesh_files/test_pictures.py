"""Pictures of meshes that cannot be shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.ply_files import textured_ply


def test_pictures_that_promise_more_than_they_hold(tmp_path: Path) -> None:
    import struct
    import zlib

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + check

    size = 30_000
    rows = zlib.compress(bytes((size // 8 + 1) * size // 8))
    picture = b"\x89PNG\r\n\x1a\n" + chunk(
        b"IHDR", struct.pack(">IIBBBBB", size, size, 1, 0, 0, 0, 0)
    )
    (tmp_path / "skin.png").write_bytes(picture + chunk(b"IDAT", rows) + chunk(b"IEND", b""))
    (tmp_path / "box.ply").write_text(textured_ply())
    with pytest.raises(InputError, match=r"30000×30000|readable picture"):
        Mesh.load(tmp_path / "box.ply")
