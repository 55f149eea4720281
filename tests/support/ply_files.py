"""PLY files as text."""

from __future__ import annotations

import numpy as np

from tests.support.patches import BOX


def ply(head: list[str], rows: list[str], form: str = "ascii") -> str:
    return "\n".join(["ply", f"format {form} 1.0", *head, "end_header", *rows]) + "\n"


def textured_ply(names: tuple[str, str] = ("s", "t"), comment: str = "skin.png") -> str:
    head = [f"comment TextureFile {comment}", "element vertex 24"]
    head += [f"property float {name}" for name in ("x", "y", "z", *names)]
    head += ["element face 12", "property list uchar int vertex_indices"]
    rows = [" ".join(map(str, row)) for row in np.concatenate([BOX.vertices, BOX.uv], 1).tolist()]
    return ply(head, rows + ["3 {} {} {}".format(*face) for face in BOX.faces.tolist()])
