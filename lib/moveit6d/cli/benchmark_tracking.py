"""`moveit6d benchmark tracking`: whole sequences, here or on many machines, beside rivals.

Never shows the tracker a true pose but the start and what the protocol of resets gives it.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..extras import require
from .apart import check_apart, files_of_sequences, given_paths
from .common import (
    DATASET_FORMATS,
    Setting,
    add_jobs_options,
    add_tracking_options,
    add_verb,
    new_folder,
    versions,
    weights_facts,
)
from .messages import note
from .track import READ

if TYPE_CHECKING:
    from ..datasets.sequences import Sequence
    from ..evaluation.runner import Tracked
    from ..evaluation.track_scores import Score
    from .sequence_job import SequenceJob

PROTOCOLS = ("none", "paper", "rbot", "laval")

DESCRIPTION = """\
Tracks every sequence of a data set from its start pose to its end and prints a Markdown table
by level, under the rivals' rows if their results are given. Every sequence gets a fresh
tracker, which never sees a true pose but the start and what the protocol gives. Rivals are
scored anew from their CSV files. `moveit6d evaluate tracking --help` explains the columns.

protocols (--protocol):
  none   no reset; what the project's own tables show
  paper  the true pose is given every 15 frames
  rbot   set to the true pose after a frame that is more than 5 cm or 5 degrees off
  laval  the true pose is given after more than 7 frames in a row 3 cm or 20 degrees off
Frames whose pose was given are not scored, but with --count_resets they are.

files written to --output (nothing without it):
  <sequence>.csv   frame,r11,...,r33,tx,ty,tz,milliseconds,iterations,stopped_by,confidence,reset,
                   state; the first row is the start
  <sequence>.json  how the track was made; written last, so it marks a finished sequence
  <sequence>.mp4   with --overlays: outline and axes drawn on the frames
and to --report an HTML page for every sequence, and index.html that leads to them.

many sequences: --jobs N works in N processes; with --ray the same runs on a Ray cluster (needs
moveit6d[ray] and the data under the same path on every machine). Tracks are the same as in one
process. A worker that is killed is replaced, and its sequence is done again once. With
--resume sequences that --output already holds, made with the same settings, are not done
again, nor are their videos and logs written. --threads is per process.
"""

EXAMPLES = """\
examples:
  moveit6d benchmark tracking --sequences sequences --rivals rivals --output out/ours
  moveit6d benchmark tracking --sequences sequences --only easy_00 hard_00 --per_sequence
  moveit6d benchmark tracking --sequences laval --format laval --protocol paper \\
      --output out/laval --report out/laval/report --jobs 8 --resume
"""


def add_kind(kinds: Any) -> None:
    """Add the kind to `moveit6d benchmark`."""
    parser = add_verb(
        kinds, "tracking", "track whole sequences beside rivals", DESCRIPTION, EXAMPLES
    )
    parser.add_argument("--sequences", type=Path, required=True, metavar="DIR", help="data set")
    parser.add_argument("--format", choices=DATASET_FORMATS, help="if it is not recognised")
    parser.add_argument("--rivals", type=Path, metavar="DIR", help="a folder of CSV files a rival")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only these sequences")
    parser.add_argument("--per_sequence", action="store_true", help="a row for every sequence, too")
    parser.add_argument("--name", default="moveit6d", help="name of our row")
    parser.add_argument(
        "--protocol", choices=PROTOCOLS, default="none", help="when the true pose is given"
    )
    parser.add_argument(
        "--count_resets", action="store_true", help="score frames whose pose was given, too"
    )
    files = parser.add_argument_group("what is written")
    files.add_argument("--output", type=Path, metavar="DIR", help="where tracks are written")
    files.add_argument("--overlays", action="store_true", help="write videos to --output, too")
    files.add_argument("--report", type=Path, metavar="DIR", help="write HTML pages of the runs")
    files.add_argument("--rerun", type=Path, metavar="DIR", help="write an .rrd a sequence")
    files.add_argument("--resume", action="store_true", help="go on with what --output holds")
    add_jobs_options(parser)
    add_tracking_options(parser, part=READ)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Track, score, compare."""
    for option in ("overlays", "resume"):
        if getattr(args, option) and args.output is None:
            raise InputError(f"--{option} needs --output.")
    if args.report is not None:
        require("report", "--report")
    for folder in (args.output, args.report, args.rerun):
        if folder is not None:
            new_folder(folder)
    sequences = chosen(args)
    _check_output(args, sequences)
    trackers = rivals(args.rivals, sequences)
    if args.name in trackers:
        raise InputError(f"--name {args.name}: a rival is called so, too; give another name.")
    setting = Setting.of(args)
    bench = Bench(args, setting, [make_job(sequence, args, setting) for sequence in sequences])
    ending: KeyboardInterrupt | None = None
    try:
        bench.work()
    except KeyboardInterrupt as error:
        ending = error
    bench.show(trackers)
    if ending is not None:
        raise ending  # itself: it knows the signal, and so the exit code
    if bench.errors:
        lost = ", ".join(bench.errors)
        again = " --resume goes on with them." if args.output is not None else ""
        raise InputError(
            f"{len(bench.errors)} of {len(sequences)} sequences could not be tracked: "
            f"{lost}.{again}"
        )
    return 0


def _check_output(args: argparse.Namespace, sequences: list[Sequence]) -> None:
    """`InputError` where a track, a video, a page or a log would destroy an input."""
    kinds = {"output": (".csv", ".json", ".mp4"), "report": (".html",), "rerun": (".rrd",)}
    written = {
        f"--{option}": [folder / f"{one.name}{kind}" for one in sequences for kind in suffixes]
        for option, suffixes in kinds.items()
        if (folder := getattr(args, option)) is not None
    }
    if args.report is not None:
        written["--report"].append(args.report / "index.html")
    folders = [] if args.rivals is None else [args.rivals]
    check_apart(written, [*given_paths(args, *kinds), *files_of_sequences(sequences)], folders)


def chosen(args: argparse.Namespace) -> list[Sequence]:
    """The sequences of the data set, or those of them that are wanted."""
    from ..datasets.catalog import open_dataset

    # Other machines start elsewhere.
    place = args.sequences if args.ray is None else args.sequences.resolve()
    found = open_dataset(place, args.format)
    unknown = set(args.only or ()) - {sequence.name for sequence in found}
    if unknown:
        raise InputError(f"{args.sequences} has no sequence {', '.join(sorted(unknown))}.")
    return [sequence for sequence in found if not args.only or sequence.name in args.only]


def rivals(folder: Path | None, sequences: list[Sequence]) -> dict[str, dict[str, Score]]:
    """Every rival's scores by sequence, from the CSV files in its folder."""
    from ..evaluation.sequence_scores import score_results

    if folder is None:
        return {}
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; it should hold a folder a rival.")
    found = {
        place.name: score_results(sequences, place)
        for place in sorted(folder.iterdir())
        if place.is_dir()
    }
    return {name: scores for name, scores in found.items() if scores}


def make_job(sequence: Sequence, args: argparse.Namespace, setting: Setting) -> SequenceJob:
    """The task for one sequence."""
    from ..datasets.catalog import surrogate
    from ..evaluation.protocols import PROTOCOLS as known
    from .sequence_job import SequenceJob, settings_of_track

    facts = {
        "data": " ".join(filter(None, [str(args.sequences), surrogate(args.sequences)])),
        "protocol": args.protocol,
        **{name: str(value) for name, value in weights_facts(args.weights).items()},
        "moveit6d": versions()["moveit6d"],
    }
    return SequenceJob(
        sequence=sequence,
        config=setting.config,
        threads=setting.threads,
        protocol=known[args.protocol],
        settings=settings_of_track(sequence, setting, args.protocol),
        setting=setting,
        count_resets=args.count_resets,
        # Workers may stand elsewhere.
        movie=args.output.resolve() / f"{sequence.name}.mp4" if args.overlays else None,
        log=args.rerun.resolve() / f"{sequence.name}.rrd" if args.rerun is not None else None,
        page=args.report is not None,
        facts=facts,
    )


class Bench:
    """The sequences of one command: which are done, their scores, what went wrong."""

    def __init__(self, args: argparse.Namespace, setting: Setting, jobs: list[SequenceJob]) -> None:
        self.args, self.setting, self.jobs = args, setting, jobs
        self.levels = {job.sequence.name: job.sequence.level for job in jobs}
        self.scores: dict[str, Score] = {}
        self.errors: dict[str, str] = {}
        self.undrawn: list[str] = []  # kept tracks without a video or log that is wanted

    def work(self) -> None:
        """Do what is not done yet; scores are there as soon as a sequence is finished."""
        from ..evaluation.runner import TrackStore, Workers
        from .sequence_job import run_sequences

        args, store = self.args, None
        if args.output is not None:
            store = TrackStore(args.output)
        for done in run_sequences(
            self.jobs,
            self.setting,
            store=store,
            resume=args.resume,
            workers=Workers(args.jobs, args.ray, args.threads),
        ):
            if done.tracked is not None:
                self._finish(done.job, done.tracked, done.kept)
                continue
            if len(self.jobs) == 1:
                raise InputError(str(done.error))
            self.errors[done.job.sequence.name] = str(done.error)
            note(f"{done.job.sequence.name}: {done.error}")
        if self.undrawn:
            note(
                f"{', '.join(self.undrawn)}: tracked earlier, so that no video or log was written; "
                "without --resume they are tracked again."
            )

    def show(self, trackers: dict[str, dict[str, Score]]) -> None:
        """Print the tables, and write the page that leads to the others."""
        from ..evaluation.track_scores import comparison_table, tracking_table

        names = [job.sequence.name for job in self.jobs]
        ours = {name: self.scores[name] for name in names if name in self.scores}
        if not ours:
            return
        both = {**trackers, self.args.name: ours}
        tables = [comparison_table(both, self.levels)] if trackers else []
        own = tracking_table(ours, self.levels, self.args.per_sequence)
        tables.append(f"{self.args.name}\n\n{own}")
        print("\n\n".join(tables))
        if self.args.report is not None:
            self._index("\n\n".join(tables), ours)

    def _finish(self, job: SequenceJob, found: Tracked, kept: bool) -> None:
        """Score a track and write its page, if one is wanted."""
        from ..evaluation.sequence_scores import score_track
        from ..io import replacing
        from ..rendering.backends import make_renderer
        from .reporting import Gathered
        from .sequence_job import page_of

        name = job.sequence.name
        score = score_track(job.sequence, found.rows, job.count_resets)
        if score is None:
            note(f"{name}: one true pose is too few to score.")
        else:
            self.scores[name] = score
        wanted = [file for file in (job.movie, job.log) if file is not None]
        if kept and not all(file.exists() for file in wanted):
            self.undrawn.append(name)
        text, path = found.page, None if not job.page else self.args.report / f"{name}.html"
        if kept and path is not None:
            gathered = Gathered(found.rows, dict(found.failures))
            text = page_of(job, gathered, make_renderer(self.setting.renderer))
        if text is not None and path is not None:
            with replacing(path) as temporary:
                temporary.write_text(text, encoding="utf-8")

    def _index(self, text: str, ours: dict[str, Score]) -> None:
        """The page that leads to those of the sequences, the worst first."""
        from urllib.parse import quote

        from ..evaluation.tables import percent
        from ..io import replacing
        from ..visualization.report import index_page

        order = sorted(ours, key=lambda name: (ours[name].below_10, -ours[name].mean_add))
        head = ["sequence", "level", "frames", "ADD<10%d", "mean ADD mm", "lost at", "no pose"]
        rows = [
            [
                (name, f"{quote(name)}.html"),
                self.levels[name],
                str(ours[name].frames),
                percent(ours[name].below_10),
                f"{1000 * ours[name].mean_add:.1f}",
                "never" if ours[name].never_lost else str(ours[name].lost_at),
                str(ours[name].missing),
            ]
            for name in order
        ]
        table = {"heading": "Sequences, the worst first", "head": head, "rows": rows}
        facts = self.jobs[0].facts
        verdict = f"{len(ours)} sequences of {facts['data']}, protocol {facts['protocol']}"
        with replacing(self.args.report / "index.html") as temporary:
            temporary.write_text(index_page(self.args.name, verdict, text, table), "utf-8")
