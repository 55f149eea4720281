"""Pack all that a training on a lent GPU machine needs into one folder of at most 64 MiB.

    python tools/pack_for_gpu.py MESHES PHOTOS OUTPUT [--mesh_unit mm] [--wheels FOLDER]

The code, the configurations, the folder of meshes with all that is in it (materials, pictures,
declared symmetries), the photographs at the size at which they are used, and wheels of what is
missing there. An older pack at OUTPUT is replaced; any other folder that holds something is
refused. On that machine, from OUTPUT: `bash train_on_gpu.sh MINUTES`.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from moveit6d.cli.common import UNITS
from moveit6d.errors import InputError
from moveit6d.geometry.crop import look_at
from moveit6d.geometry.mesh import Mesh, Unit, sphere_diameters
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import random_rotations
from moveit6d.io import replacing_folder
from moveit6d.rendering.embree import EmbreeRenderer
from moveit6d.synthesis.augmentation.photos import load_photos
from moveit6d.synthesis.training.source import mesh_files

ROOT = Path(__file__).parents[1]
LIMIT = 64 * 2**20
QUALITY = 70  # of the photographs: they lie behind objects, and are made worse anyway
UNIT = "mesh_unit"  # file with the unit of the meshes, for the scripts
SCRIPTS = ("train_on_gpu.sh", "probe_gpu.py")
PACKED = {*SCRIPTS, "code", "meshes", "photos", "wheels", UNIT, "reference.npz"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Pack, and say how large it became."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("photos", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--mesh_unit", choices=UNITS, default="m", help="of the meshes")
    parser.add_argument("--wheels", type=Path, help="folder of .whl files to install there")
    args = parser.parse_args(arguments)
    _refuse_foreign(args.output)
    with replacing_folder(args.output) as folder:
        _pack(args, folder)
    size = sum(path.stat().st_size for path in args.output.rglob("*") if path.is_file())
    print(f"{args.output}: {size / 2**20:.1f} MiB")
    if size > LIMIT:
        raise InputError(
            f"{args.output} is larger than the {LIMIT // 2**20} MiB that a lent machine takes: "
            "pack fewer meshes or photographs."
        )
    return 0


def _refuse_foreign(output: Path) -> None:
    if output.exists() and not output.is_dir():
        raise InputError(f"{output} is a file; a pack is a folder: give a new one.")
    there = {path.name for path in output.iterdir()} if output.exists() else set()
    others = sorted(there - PACKED) or sorted(there if not there.issuperset(SCRIPTS) else ())
    if others:
        raise InputError(
            f"{output} holds {others[0]}, which is not of a pack and would be lost; give a new "
            "folder."
        )


def _pack(args: argparse.Namespace, output: Path) -> None:
    code = output / "code"
    no_caches = shutil.ignore_patterns("__pycache__", "*.safetensors")
    for name in ("lib/moveit6d", "lightning_modules", "configs"):
        shutil.copytree(ROOT / name, code / name, ignore=no_caches)
    teacher = Path("examples/correlation/multi_object.safetensors")  # of configs/fit/compact.yaml
    (code / teacher).parent.mkdir(parents=True)
    shutil.copy(ROOT / teacher, code / teacher)
    for name in SCRIPTS:
        shutil.copy(ROOT / "tools" / name, output)
    mesh_files(args.meshes)  # `InputError` if there is none
    shutil.copytree(args.meshes, output / "meshes")
    (output / "photos").mkdir()
    for number, photo in enumerate(load_photos(args.photos)):
        Image.fromarray(photo).save(output / f"photos/{number:05d}.jpg", quality=QUALITY)
    if args.wheels is not None:
        shutil.copytree(args.wheels, output / "wheels")
    (output / UNIT).write_text(args.mesh_unit, encoding="utf-8")
    _write_reference(output / "meshes", args.mesh_unit, output / "reference.npz")


def _write_reference(meshes: Path, unit: Unit, output: Path) -> None:
    """Renderings by ray casting, with which `probe_gpu.py` compares those of the GPU."""
    paths = mesh_files(meshes)[::22]
    loaded = [Mesh.load(path, unit=unit, allow_flat=True) for path in paths]
    generator = torch.Generator().manual_seed(0)
    diameter = sphere_diameters(loaded)
    distance = 2.2 + 8 * torch.rand(len(loaded), generator=generator, dtype=torch.float64)
    ahead = torch.nn.functional.pad((diameter * distance)[:, None], (2, 0))
    pose = Pose(random_rotations(len(loaded), generator), ahead)
    seen = EmbreeRenderer().render(loaded, pose, look_at(pose, diameter).intrinsics)
    np.savez_compressed(
        output,
        names=[path.name for path in paths],
        rotation=pose.rotation.numpy(),
        translation=pose.translation.numpy(),
        albedo=seen.albedo.half().numpy(),
        depth=seen.depth.numpy(),
    )


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"pack_for_gpu: {error}")
