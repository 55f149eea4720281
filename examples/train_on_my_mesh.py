"""Train a network on your own mesh, starting from the shipped one, and track with it.

    python examples/train_on_my_mesh.py --output out/robot
    python examples/train_on_my_mesh.py --mesh drill.glb --photos PICTURES --steps 2000 \\
        --output out/drill

The shipped network needs no training on an object; this makes it better on yours alone. The whole
machinery (configurations, resuming, several processors) is `moveit6d fit`: docs/how-to/train.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from lightning_modules.cli import main as fit
from moveit6d import InputError, Mesh, PoseTracker, load_policy
from moveit6d.geometry.symmetry_file import write_symmetries
from moveit6d.policies import SHIPPED_WEIGHTS
from moveit6d.synthesis.objects.demo_object import demo_object
from moveit6d.synthesis.objects.mesh_file import write_glb
from moveit6d.synthesis.sequences.sequence import Scene

CONFIG = Path(__file__).parents[1] / "configs" / "fit" / "my_object.yaml"


def main(arguments: Sequence[str] | None = None) -> None:
    """Prepare the mesh, train, track a clip with what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--mesh", type=Path, help="the object; none: a toy robot")
    parser.add_argument(
        "--mesh_unit", choices=("m", "cm", "mm", "in"), default="m", help="the mesh's unit"
    )
    parser.add_argument("--photos", type=Path, help="pictures for backgrounds; none: made ones")
    parser.add_argument("--steps", type=int, default=100, help="batches of training")
    parser.add_argument("--batch", type=int, default=16, help="pairs a batch")
    parser.add_argument("--frames", type=int, default=10, help="of the clip that is tracked")
    parser.add_argument("--output", type=Path, default=Path("out/mine"), help="for the results")
    parser.add_argument(
        "--weights", type=Path, default=SHIPPED_WEIGHTS, help="weights to start from"
    )
    args = parser.parse_args(arguments)

    mesh = demo_object() if args.mesh is None else Mesh.load(args.mesh, args.mesh_unit)
    meshes = keep_mesh(mesh, args.output)
    weights = args.output / "weights.safetensors"
    # What `moveit6d fit` would be given; the configuration says the rest.
    options = {
        "config": CONFIG,
        "model.init_from": args.weights,
        "model.total_steps": args.steps,
        "data.meshes": meshes,
        "data.mesh_unit": "m",
        "data.photos": args.photos or "null",
        "data.batch_size": args.batch,
        "data.workers": 0,
        "trainer.max_steps": args.steps,
        "output": args.output,
        "figures.every_n_steps": 10,
    }
    fit([f"--{name}={value}" for name, value in options.items()])

    # A clip of the object that training has not seen.
    scene = Scene(mesh, seed=5, frames=args.frames, difficulty="easy")
    shots = [scene.render_frame(number) for number in range(args.frames)]
    tracker = PoseTracker(mesh, scene.camera, shots[0].pose, policy=load_policy(weights))
    for number, rendered in enumerate(shots[1:], 1):
        found = tracker.update(rendered.image).pose
        if found is not None:
            error = float((found.translation - rendered.pose.translation).norm())
            print(f"frame {number}: {1000 * error:.1f} mm off")
    print(f"Use it: moveit6d track --weights {weights} …")


def keep_mesh(mesh: Mesh, output: Path) -> Path:
    """The folder of one mesh that training reads: its texture and symmetries with it, metres.

    `InputError` if `output` was made for another mesh: its checkpoint would be gone on with.
    """
    folder = output / "meshes"
    with tempfile.TemporaryDirectory() as work:
        file = Path(work) / f"{mesh.name}.glb"
        write_glb(file, mesh)
        write_symmetries(file, mesh.symmetries)
        new = {path.name: path.read_bytes() for path in Path(work).iterdir()}
    folder.mkdir(parents=True, exist_ok=True)
    old = {path.name: path.read_bytes() for path in folder.iterdir()}
    if old and old != new:
        raise InputError(
            f"{output} was made for another mesh ({', '.join(sorted(old))}); give another --output."
        )
    for name, content in new.items():
        (folder / name).write_bytes(content)
    return folder


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        sys.exit(f"train_on_my_mesh: {error}")
