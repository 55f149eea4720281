"""`moveit6d reproduce`: the paper's tables and figures, ours beside the printed ones.

Never computes a figure itself; `evaluation.reproduce` does.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..config import PAPER_CONFIG, SeedDetectorConfig, TrackerConfig
from ..errors import InputError
from ..extras import require
from . import track
from .apart import check_apart, files_of_sequences, given_paths
from .common import (
    DATASET_FORMATS,
    Setting,
    add_jobs_options,
    add_tracking_options,
    add_verb,
    make_tools,
    new_folder,
    positive,
    versions,
    weights_facts,
)
from .messages import note, progress
from .reproduce_pages import DESCRIPTION, EPILOG, KINDS
from .seed_options import add_seed_options, seeds_of
from .settings import EVERYTHING, SettingsPart

if TYPE_CHECKING:
    from ..datasets.sequences import Sequence
    from ..evaluation.reproduce.reproduction import Reproduction
    from ..evaluation.reproduce.tracks import ScoredTrack
    from ..policies import Policy


SEEDS = SeedDetectorConfig(criterion="iterations")  # the paper's criterion
WRITTEN = (".md", ".json", ".csv", ".png", ".svg")
FROM_TRACKS = ("ycb_add", "ycb_auc", "laval")  # may work in several processes
# The settings that these read; the others may read all.
PARTS = {
    **dict.fromkeys(FROM_TRACKS, track.READ),
    "convergence": SettingsPart(
        ("loop",),
        but=("loop.augment", "loop.augment_size", "loop.width_error", "loop.displacement_error"),
    ),
    "attention": SettingsPart(()),
}


def _bases() -> dict[str, TrackerConfig]:
    """The settings without any option, where they are not the paper's for tracking."""
    from ..evaluation.reproduce import published_figures as published

    loop = replace(
        PAPER_CONFIG.loop,
        max_iterations=published.CONVERGENCE_STEPS,
        step_size=published.CONVERGENCE_STEP,
    )
    return {"convergence": replace(PAPER_CONFIG, loop=loop)}


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "reproduce", "the paper's tables and figures on a data set", DESCRIPTION, EPILOG
    )
    kinds = parser.add_subparsers(title="names", metavar="NAME", required=True)
    for name, (summary, text, example) in KINDS.items():
        epilog = f"examples:\n  moveit6d reproduce {name} {example}\n"
        one = add_verb(kinds, name, summary, text, epilog)
        one.add_argument(
            "--data", type=Path, required=name != "runtime", metavar="DIR", help="data set"
        )
        one.add_argument(
            "--format",
            choices=DATASET_FORMATS,
            help="its format, if it is not recognised",
        )
        one.add_argument("--output", type=Path, required=True, metavar="DIR", help="for results")
        one.add_argument("--only", nargs="+", metavar="NAME", help="sequences or objects")
        one.add_argument(
            "--frames",
            type=positive,
            metavar="N",
            help="of a sequence: the first N of a track, else N spread evenly",
        )
        _add_own(one, name)
        if name in FROM_TRACKS:
            add_jobs_options(one)
        add_tracking_options(one, _bases().get(name, PAPER_CONFIG), PARTS.get(name, EVERYTHING))
        one.set_defaults(run=run, name=name)


def _add_own(parser: argparse.ArgumentParser, name: str) -> None:
    """The options of one kind."""
    if name == "laval":
        parser.add_argument(
            "--no_depth_weights", type=Path, metavar="FILE", help="weights of a model without depth"
        )
    if name == "convergence":
        parser.add_argument(
            "--m", type=int, nargs="+", metavar="M", help="values of m (default: 0 to 45)"
        )
        parser.add_argument("--reading", choices=("formula", "total"), help="only this reading")
    if name == "runtime":
        parser.add_argument(
            "--repeats", type=positive, default=512, metavar="N", help="iterations that are timed"
        )
    if name == "attention":
        parser.add_argument(
            "--checkpoints", type=Path, nargs="+", default=[], metavar="FILE", help="weights files"
        )
    if name == "detection":
        add_seed_options(parser, SEEDS)


def run(args: argparse.Namespace) -> int:
    """Run one reproduction, print it and write its files."""
    require("report", "moveit6d reproduce")
    from ..evaluation.reproduce.reproduction import write_reproduction
    from ..visualization.plots import draw

    reproduction = RUNS[args.name](args)
    print(reproduction.markdown())
    folder = new_folder(args.output)
    write_reproduction(reproduction, folder)
    for chart in reproduction.charts:
        draw(chart, folder, reproduction.data)
    note(f"written to {folder}.")
    return 0


def _opened(args: argparse.Namespace) -> tuple[list[Sequence], str]:
    """The sequences, and what the data is in words."""
    from ..datasets.catalog import open_dataset, recognise
    from ..evaluation.reproduce.data import choose, describe

    if not args.data.is_dir():
        raise InputError(f"{args.data} is not a folder; it should hold a data set.")
    kind = args.format or recognise(args.data)
    # Workers of a cluster have other working folders.
    videos = choose(open_dataset(args.data.resolve(), kind), args.only)
    _check_output(args, videos)
    return videos, describe(args.data, kind)


def _check_output(args: argparse.Namespace, videos: list[Sequence]) -> None:
    """`InputError` where one of the files that would be replaced in the output is an input."""
    there = (*args.output.glob(f"{args.name}*"), *args.output.glob("tracks*/*"))
    written = [path for path in there if path.is_file() and path.suffix in WRITTEN]
    check_apart({"--output": written}, [*given_paths(args, "output"), *files_of_sequences(videos)])


def _setting(args: argparse.Namespace, weights: Path | None) -> Setting:
    """What decides the numbers: the paper's method unless options say otherwise."""
    given = argparse.Namespace(**{**vars(args), "weights": weights})
    return Setting.of(given, _bases().get(args.name, PAPER_CONFIG))


def _facts(args: argparse.Namespace, setting: Setting) -> dict[str, Any]:
    """What decides the numbers; no places on this machine."""
    return {
        **weights_facts(setting.weights),
        "mode": setting.config.loop.mode,
        "float32": args.float32,
        "renderer": args.renderer,
        "config": json.loads(json.dumps(setting.config.as_dict())),
        "only": sorted(args.only or []),
        "versions": versions(),
    }


def _tracks(
    args: argparse.Namespace,
    videos: list[Sequence],
    weights: Path | None,
    place: str = "tracks",
    resume: bool = True,
) -> tuple[list[ScoredTrack], dict[str, Any]]:
    """Tracks under the paper's protocol, kept in the output folder, and the settings.

    With `resume` those that are there are taken.
    """
    from ..evaluation.protocols import PAPER
    from ..evaluation.reproduce.tracks import scored
    from ..evaluation.runner import TrackStore, Workers
    from .sequence_job import SequenceJob, run_sequences, settings_of_track

    setting = _setting(args, weights)
    jobs = [
        SequenceJob(
            sequence=video,
            config=setting.config,
            threads=setting.threads,
            protocol=PAPER,
            frames=args.frames,
            settings=settings_of_track(video, setting, PAPER.name, frames=args.frames),
            setting=setting,
        )
        for video in videos
    ]
    rows = {}
    for done in run_sequences(
        jobs,
        setting,
        store=TrackStore(new_folder(new_folder(args.output) / place)),
        resume=resume,
        workers=Workers(args.jobs, args.ray, args.threads)
        if args.name in FROM_TRACKS
        else Workers(),
    ):
        if done.tracked is None:
            raise InputError(f"{done.job.sequence.name}: {done.error}")
        rows[done.job.sequence.name] = done.tracked.rows
    found = (scored(video, rows[video.name]) for video in videos)
    facts = {**_facts(args, setting), "protocol": PAPER.name}
    return [one for one in found if one is not None], facts


def _ycb(args: argparse.Namespace) -> Reproduction:
    from ..evaluation.reproduce import ycb

    videos, data = _opened(args)
    tracks, facts = _tracks(args, videos, args.weights)
    scores = ycb.measure(tracks)
    if not scores.plain:
        raise InputError(f"{args.data}: no sequence has a frame to score.")
    make = ycb.add_reproduction if args.name == "ycb_add" else ycb.auc_reproduction
    return make(scores, data, facts)


def _laval(args: argparse.Namespace) -> Reproduction:
    from ..evaluation.reproduce import laval
    from ..evaluation.reproduce import published_figures as published

    videos, data = _opened(args)
    videos = laval.occlusion_videos(videos)
    weights = {published.LAVAL_MODELS[0]: (args.weights, "tracks")}
    if args.no_depth_weights is not None:
        weights[published.LAVAL_MODELS[1]] = (args.no_depth_weights, "tracks_no_depth")
    models: dict[str, laval.Figures] = {}
    facts: dict[str, Any] = {}
    for model, (file, place) in weights.items():
        tracks, mine = _tracks(args, videos, file, place)
        models[model] = laval.measure(tracks)
        facts = {**facts, model: mine} if facts else mine
    return laval.reproduction(models, data, facts)


def _convergence(args: argparse.Namespace) -> Reproduction:
    from ..evaluation.reproduce import convergence

    videos, data = _opened(args)
    setting = _setting(args, args.weights)
    policy, renderer = make_tools(setting)
    readings = tuple(convergence.Reading) if args.reading is None else (args.reading,)
    given: dict[str, Any] = {} if args.m is None else {"ms": tuple(args.m)}
    plan = convergence.Plan(
        readings=tuple(map(convergence.Reading, readings)),
        frames=args.frames,
        loop=setting.config.loop,
        **given,
    )
    trials, asked, read = [], 0, 0
    for video in videos:
        runs = convergence.run(video, policy, renderer, plan)
        number = len(convergence.frames_of(video, plan))
        for found in progress(runs, number, video.name):
            trials += found
            asked, read = asked + 1, read + bool(found)
    _say_unread(args.data, asked, read)
    return convergence.reproduction(trials, data, _facts(args, setting))


def _runtime(args: argparse.Namespace) -> Reproduction:
    from ..evaluation.iteration_timing import WARM_UP, time_iteration
    from ..evaluation.reproduce import runtime
    from ..synthesis.objects.demo_object import demo_object

    tracks: list[ScoredTrack] = []
    data = "surrogate (an object made by the library)"
    if args.data is None:
        _check_output(args, [])
        mesh = demo_object()
    else:
        videos, data = _opened(args)
        mesh = videos[0].load_mesh()
        # Anew: times of another day, of more threads or of another machine are others.
        tracks, _ = _tracks(args, videos, args.weights, resume=False)
    setting = _setting(args, args.weights)
    policy, renderer = make_tools(setting)
    count = args.repeats + WARM_UP
    times = time_iteration(
        mesh, policy, renderer, progress(range(count), count, "iteration", "iteration")
    )
    facts = {
        **_facts(args, setting),
        "object": mesh.name,
        "faces": len(mesh.faces),
        "threads": args.threads,
        "iterations": args.repeats,
    }
    return runtime.reproduction(times, tracks, data, facts)


def _attention(args: argparse.Namespace) -> Reproduction:
    from ..evaluation.reproduce import attention
    from ..networks.weights_file import load_network
    from ..policies import load_policy

    videos, data = _opened(args)
    setting = _setting(args, args.weights)
    policy, renderer = make_tools(setting)
    policies: dict[str, Policy] = {}
    steps = [load_network(path).facts.get("steps") for path in args.checkpoints]
    names = attention.column_names(list(zip(args.checkpoints, steps, strict=True)))
    for name, path in zip(names, args.checkpoints, strict=True):
        policies[name] = load_policy(path, compute=setting.compute)
    policies[attention.MODEL] = policy
    frames = args.frames or 1
    cases = attention.patches(videos, frames, renderer)
    _say_unread(args.data, _asked(videos, frames), len(cases))
    return attention.reproduction(cases, policies, data, _facts(args, setting))


def _detection(args: argparse.Namespace) -> Reproduction:
    from ..estimation import SeedDetector
    from ..evaluation.reproduce import detection

    videos, data = _opened(args)
    setting = _setting(args, args.weights)
    policy, renderer = make_tools(setting)
    config = seeds_of(args, SEEDS, setting.config.loop)
    detectors = {
        video.name: SeedDetector(
            video.load_mesh(),
            video.camera,
            policy=policy,
            renderer=renderer,
            config=config,
            threads=setting.threads,
        )
        for video in videos
    }
    trials, example = [], None
    frames = args.frames or 1
    runs, asked = detection.run(videos, detectors, frames), _asked(videos, frames)
    for trial, image, found in progress(runs, asked, "detect"):
        trials.append(trial)
        if example is None:
            video = next(one for one in videos if one.name == trial.video)
            curve = detection.turned_starts(detectors[video.name], image, video.truth[trial.frame])
            example = detection.Example(image, found, detection.TURNS, *curve)
    _say_unread(args.data, asked, len(trials))
    assert example is not None
    facts = {**_facts(args, setting), "detector": json.loads(json.dumps(asdict(config)))}
    return detection.reproduction(trials, example, data, facts)


def _asked(videos: list[Sequence], frames: int) -> int:
    """How many frames there are if so many are wanted of every sequence."""
    from ..evaluation.reproduce.convergence import Plan, frames_of

    return sum(len(frames_of(video, Plan(frames=frames))) for video in videos)


def _say_unread(data: Path, asked: int, read: int) -> None:
    """Say how many frames were left out; `InputError` if none could be read."""
    if not read:
        raise InputError(f"{data}: no frame with a true pose could be read.")
    if read < asked:
        note(f"{asked - read} of {asked} frames could not be read and are left out.")


RUNS: Mapping[str, Callable[[argparse.Namespace], Reproduction]] = {
    "ycb_add": _ycb,
    "ycb_auc": _ycb,
    "laval": _laval,
    "convergence": _convergence,
    "runtime": _runtime,
    "attention": _attention,
    "detection": _detection,
}
