"""`moveit6d benchmark`: the tracker against other trackers, and the time of one iteration.

Never more than arguments and printing; `benchmark_tracking` is the first of its kinds.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from . import benchmark_detection, benchmark_tracking, refine
from .common import (
    CLUSTERS,
    UNITS,
    Setting,
    add_machine_options,
    add_network_options,
    add_tracking_options,
    add_untextured_option,
    add_verb,
    make_tools,
    mesh_or_demo,
    positive,
    seed,
    share,
    use_threads,
)
from .messages import progress
from .settings import SettingsPart

# The settings that decide about a rendered image in which no object is lost.
READ = SettingsPart(
    ("loop", "multi_start", "single_image", "contour"), but=(*refine.READ.but, "loop.width_error")
)

DESCRIPTION = """\
  moveit6d benchmark tracking   tracks whole sequences, beside rivals' results
  moveit6d benchmark detection  finds objects in single frames, from nothing
  moveit6d benchmark recovery   loses objects and finds them again
  moveit6d benchmark motion     counts iterations by how fast an object moves
  moveit6d benchmark refinement   refines rendered objects from starts of a known distance
  moveit6d benchmark iteration    times the parts of one iteration: crop, render, network, …
  moveit6d benchmark oracle     proves the loop with a policy that knows the truth
"""

ORACLE = """\
Runs the loop from random starts of the paper's five clusters on three procedural objects, with a
policy that knows the true pose, and prints how far from it the loops end: under half a step
on every axis if crop, rendering, updates and stop rules are right. About one loop in a thousand
of single steps ends by oscillation instead, a few thousandths of a step farther away, because
rotations do not commute. No weights are used.
"""

ORACLE_EXAMPLES = """\
examples:
  moveit6d benchmark oracle --starts 1000
  moveit6d benchmark oracle --starts 1000 --renderer pyrender
"""

REFINEMENT = """\
Renders every object of a folder at random poses in front of photos, perturbs the pose by the
units of one of the paper's clusters on all six axes, refines, and prints the share of cases
with ADD below 2, 5 and 10 % of the diameter before and after, and how many iterations it took.
"""

REFINEMENT_EXAMPLES = """\
examples:
  moveit6d benchmark refinement --objects meshes --photos photos --cluster all_small
  moveit6d benchmark refinement --objects meshes --photos photos --cluster all_large --occluded 1
"""

ITERATION = """\
One iteration cuts the patch out of the frame, renders the object at the current pose, asks the
network and updates the pose. This prints the median time of each part over many iterations on one
object, made by the library itself if no --mesh is given, in a frame of 640x480.
"""

ITERATION_EXAMPLES = """\
examples:
  moveit6d benchmark iteration --threads 1
  moveit6d benchmark iteration --mesh drill.glb --mesh_unit m --repeats 200
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "benchmark", "compare with other trackers, or time an iteration", DESCRIPTION, ""
    )
    kinds = parser.add_subparsers(title="kinds", metavar="KIND", required=True)
    benchmark_tracking.add_kind(kinds)
    benchmark_detection.add_kinds(kinds)
    three = add_verb(
        kinds, "refinement", "refine rendered objects", REFINEMENT, REFINEMENT_EXAMPLES
    )
    three.add_argument("--objects", type=Path, required=True, metavar="DIR", help="meshes, metres")
    three.add_argument("--photos", type=Path, required=True, metavar="DIR", help="backgrounds")
    three.add_argument(
        "--cluster", choices=CLUSTERS, default="all_small", help="how far the starts are off"
    )
    three.add_argument(
        "--occluded",
        type=share,
        default=0.0,
        metavar="SHARE",
        help="share of cases with a third of the object occluded",
    )
    three.add_argument(
        "--gamma",
        type=float,
        default=2.2,
        metavar="G",
        help="light mixes at the object's edge as in a camera of this gamma; 1: colours mix",
    )
    three.add_argument("--number", type=positive, default=200, metavar="N", help="cases")
    three.add_argument("--seed", type=seed, default=0, metavar="N", help="of the cases")
    add_untextured_option(three)
    add_tracking_options(three, part=READ)
    three.set_defaults(run=refinement)
    four = add_verb(kinds, "oracle", "prove the loop", ORACLE, ORACLE_EXAMPLES)
    four.add_argument("--starts", type=positive, default=100, metavar="N", help="loops a mode")
    add_machine_options(four)
    four.set_defaults(run=oracle)
    two = add_verb(
        kinds, "iteration", "time the parts of one iteration", ITERATION, ITERATION_EXAMPLES
    )
    two.add_argument("--mesh", type=Path, metavar="FILE", help="object instead of a procedural one")
    two.add_argument("--mesh_unit", choices=UNITS, help="the mesh's unit (default: m)")
    two.add_argument("--repeats", type=positive, default=100, metavar="N", help="iterations")
    two.add_argument("--weights", type=Path, metavar="FILE", help="weights instead of the shipped")
    add_untextured_option(two)
    add_machine_options(two)
    add_network_options(two)
    two.set_defaults(run=iteration)


def iteration(args: argparse.Namespace) -> int:
    """Time the parts of one iteration."""
    import torch

    from ..evaluation.iteration_timing import WARM_UP, time_iteration
    from ..evaluation.tables import plain

    mesh = mesh_or_demo(args)
    policy, renderer = make_tools(Setting.of(args))
    count = args.repeats + WARM_UP
    rounds = progress(range(count), count, "iteration", "iteration")
    times = time_iteration(mesh, policy, renderer, rounds)
    rows = [[part, f"{value:.2f}"] for part, value in times.parts.items()]
    rows += [["sum", f"{times.total:.2f}"], ["whole iteration", f"{times.whole:.2f}"]]
    print(
        f"{mesh.name}, {len(mesh.faces)} faces, {args.renderer}, "
        f"{torch.get_num_threads()} threads, median of {args.repeats}\n"
    )
    print(plain(["part", "ms"], rows))
    return 0


def refinement(args: argparse.Namespace) -> int:
    """Refine rendered objects."""
    import numpy as np
    import torch

    from ..evaluation.metrics import ADD_LIMIT, auroc
    from ..evaluation.synthetic_refinement import run_cases
    from ..evaluation.tables import plain
    from ..geometry.mesh import Mesh
    from ..synthesis.augmentation.photos import load_photos
    from ..synthesis.single_images import make_cases
    from ..synthesis.training.source import mesh_files

    paths = mesh_files(args.objects)
    setting = Setting.of(args)
    policy, renderer = make_tools(setting)
    meshes = [Mesh.load(path, allow_untextured=args.allow_untextured) for path in paths]
    photos = load_photos(args.photos)
    cases = list(
        make_cases(
            meshes,
            photos,
            renderer,
            cluster=args.cluster,
            occluded=args.occluded,
            number=args.number,
            seed=args.seed,
            gamma=args.gamma,
        )
    )
    runs = run_cases(cases, policy, renderer, setting.config)
    found = list(progress(runs, len(cases), "refine", "case"))
    rows = []
    for name, errors in (
        ("before", np.array([case.before for case in found])),
        ("after", np.array([case.after for case in found])),
    ):
        shares = [f"{100 * float((errors < limit).mean()):.1f}" for limit in (0.02, 0.05, 0.10)]
        rows.append([name, *shares, f"{100 * float(np.median(errors)):.2f}"])
    print(
        f"{len(found)} cases, {len(meshes)} objects, cluster {args.cluster}, occluded "
        f"{args.occluded:g}, gamma {args.gamma:g}, seed {args.seed}\n"
    )
    print(plain(["", "ADD<2%", "ADD<5%", "ADD<10%", "median % d"], rows))
    iterations = [case.result.iterations for case in found]
    print(f"\niterations: mean {np.mean(iterations):.2f}, median {np.median(iterations):g}")
    belief = torch.tensor([case.result.confidence for case in found])
    right = torch.tensor([case.after < ADD_LIMIT for case in found])
    print(f"confidence: AUROC {auroc(belief, right):.3f} for ADD < 10 % d")
    return 0


def oracle(args: argparse.Namespace) -> int:
    """Run the loop with the oracle."""
    import numpy as np

    from ..config import ActionMode
    from ..evaluation.oracle import oracle_errors
    from ..evaluation.tables import plain
    from ..rendering.backends import make_renderer
    from ..synthesis.objects.shapes import random_object

    use_threads(args.threads)
    renderer = make_renderer(args.renderer)
    random = np.random.default_rng(0)
    meshes = [random_object(random) for _ in range(3)]
    rows = []
    for mode in ActionMode:
        loops = oracle_errors(meshes, renderer, mode, args.starts)
        left = np.array(list(progress(loops, args.starts, mode.value, "loop")))
        rows.append([mode.value, str(len(left)), str(int((left < 0.5).sum())), f"{left.max():.3f}"])
    print(f"{args.renderer}, objects {', '.join(mesh.name for mesh in meshes)}\n")
    print(plain(["mode", "starts", "within half a step", "largest delta left"], rows))
    return 0
