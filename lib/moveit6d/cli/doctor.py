"""`moveit6d doctor`: says what works on this machine and what does not.

Never installs or changes anything.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from pathlib import Path
from typing import Any

from ..errors import InputError, RenderingUnavailable
from . import doctor_mesh
from .common import NO_RENDERING, UNITS, add_verb, versions

DESCRIPTION = """\
Prints versions, the renderers that run here (each one renders a test object), the network's
weights, and the video formats that can be written. A missing OpenGL library is no fault: the
default renderer, embree, does not need one.

With --mesh it says instead what was understood of a mesh file: size in metres, faces, materials,
texture, symmetries, and whatever of its looks cannot be shown (exit code 2); and it writes a
picture of the object from six sides.
"""

EPILOG = """\
examples:
  moveit6d doctor
  moveit6d doctor --mesh drill.obj --mesh_unit mm --output sides.png
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "doctor", "say what works on this machine", DESCRIPTION, EPILOG)
    parser.add_argument("--mesh", type=Path, metavar="FILE", help="a mesh to look at instead")
    parser.add_argument("--mesh_unit", choices=UNITS, help="its unit, if the file does not say it")
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="its picture (default: NAME_sides.png)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the findings; 3 if the default renderer does not run, 2 if the weights do not load."""
    if args.mesh is not None:
        return doctor_mesh.run(args.mesh, args.mesh_unit, args.output)
    for option in ("mesh_unit", "output"):
        if getattr(args, option) is not None:
            raise InputError(f"--{option} needs --mesh, the file that it is about.")
    import torch

    from ..networks.inference import is_bfloat16_fast

    print("versions")
    for name, version in versions().items():
        print(f"  {name:10} {version}")
    print("machine")
    print(f"  {'system':10} {platform.system()} {platform.machine()}")
    print(f"  {'cores':10} {os.cpu_count()}, torch uses {torch.get_num_threads()}")
    print(f"  {'network':10} {'bfloat16 (AMX)' if is_bfloat16_fast() else 'float32'}")
    print("renderers")
    works = {name: _renders(name) for name in _renderers()}
    print("weights")
    loads = _weights()
    print("video")
    _video()
    if not works["embree"]:
        return NO_RENDERING
    return 0 if loads else 2


def _renderers() -> tuple[str, ...]:
    from ..rendering.backends import NAMES

    return NAMES


def _renders(name: str) -> bool:
    """Render a cube of 10 cm at half a metre and say how long that takes."""
    import numpy as np
    import torch

    from ..geometry.mesh import Mesh
    from ..geometry.pose import Pose
    from ..rendering.backends import make_renderer

    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 0.1
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
    cube = Mesh.from_arrays("cube", corners, faces)
    pose = Pose(torch.eye(3)[None], torch.tensor([[0.0, 0.0, 0.5]]))
    matrix = torch.tensor([[[250.0, 0.0, 63.5], [0.0, 250.0, 63.5], [0.0, 0.0, 1.0]]])
    try:
        renderer = make_renderer(name)
        renderer.render([cube], pose, matrix)
        start = time.perf_counter()
        mask = renderer.render([cube], pose, matrix).mask
    except RenderingUnavailable as error:
        print(f"  {name:10} does not run here: {error}")
        return False
    milliseconds = 1000 * (time.perf_counter() - start)
    right = 2500 < float(mask.sum()) < 5000
    print(f"  {name:10} {'works' if right else 'renders nonsense'}, {milliseconds:.1f} ms a patch")
    return right


def _weights() -> bool:
    from ..policies import load_policy

    try:
        policy = load_policy()
    except InputError as error:
        print(f"  {error}")
        return False
    print(f"  {'load':10} {policy.source}")
    return True


def _video() -> None:
    import av

    from ..visualization.video import CODECS

    there = [name for name in CODECS if name in av.codecs_available]
    print(f"  {'mp4':10} {there[0] if there else 'cannot be written'}")
