"""An OBJ file, its library and its picture on disk."""

from __future__ import annotations

from pathlib import Path

from tests.support.patches import BOX

MTL = "newmtl mat\nKd 0.8 0.8 0.8\nmap_Kd skin.png\n"


def write(folder: Path, mtl: str | bytes = MTL, obj: str | bytes | None = None) -> Path:
    BOX.write_picture(folder / "skin.png")
    content = mtl.encode() if isinstance(mtl, str) else mtl
    (folder / "m.mtl").write_bytes(content)
    text = BOX.obj() if obj is None else obj
    (folder / "box.obj").write_bytes(text.encode() if isinstance(text, str) else text)
    return folder / "box.obj"
