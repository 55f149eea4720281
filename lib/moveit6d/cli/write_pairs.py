"""`moveit6d write-pairs`: draws training pairs ahead and writes them to disk, in shards.

Never trains.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..errors import InputError
from .common import add_verb, positive, seed
from .contact_sheet import add_data_options, data_of
from .messages import note, progress_bar

DESCRIPTION = """\
Draws the pairs that `moveit6d fit` would draw with the same configuration, and writes them to
--output in shards, for `moveit6d fit --data.written FOLDER`. A pair takes 170 kB. Templates for
descriptors are not written: a configuration that has them (data.pairs.views) needs
--set data.pairs.views.share=0 here and --data.pairs.views.share 0 there.

What a shard holds depends on the configuration, the seed and the shard's number alone. So several
machines can write into one folder, or into several that are put together afterwards: each is given
another --part with otherwise the same arguments. Shards that are there are left alone: after a
crash or a kill run the same command again.
"""

EPILOG = """\
examples:
  moveit6d write-pairs --config configs/fit/multi_object.yaml --output pairs --shards 50
  moveit6d write-pairs --config configs/fit/multi_object.yaml --output pairs --shards 1000 \\
      --part 2/4 --jobs 8
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "write-pairs", "write training pairs to disk", DESCRIPTION, EPILOG)
    add_data_options(parser)
    parser.add_argument("--output", type=Path, required=True, metavar="DIR", help="folder")
    parser.add_argument("--shards", type=positive, required=True, metavar="N", help="files in all")
    parser.add_argument("--batches", type=positive, default=32, metavar="N", help="batches a shard")
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="same seed, same pairs")
    parser.add_argument(
        "--part", type=part, default=(1, 1), metavar="I/N", help="write part I of N (default: 1/1)"
    )
    parser.add_argument(
        "--jobs", type=positive, default=1, metavar="N", help="processes beside each other"
    )
    parser.set_defaults(run=run)


def part(text: str) -> tuple[int, int]:
    """An option's I/N."""
    first, slash, second = text.partition("/")
    if not (slash and first.isdigit() and second.isdigit() and 1 <= int(first) <= int(second)):
        raise argparse.ArgumentTypeError(f"must be I/N with I from 1 to N, found {text!r}")
    return int(first), int(second)


def run(args: argparse.Namespace) -> int:
    """Write the shards of this part that are missing."""
    from ..parallel import run_jobs
    from ..synthesis.training.shards import ShardPlan, ShardWriter, write_shard

    data = data_of(args)
    plan = ShardPlan(args.shards, args.batches, data.batch_size, args.seed)
    source = data.source()
    writer = ShardWriter(source, plan, args.output)
    writer.claim()
    mine = plan.part(*args.part)
    missing = writer.missing(mine)
    tasks = [(source, plan, args.output, number) for number in missing]
    failed = 0
    with progress_bar(len(tasks), "shards", "shard") as bar:
        for job_result in run_jobs(write_shard, tasks, jobs=args.jobs):
            if job_result.error is not None:
                failed += 1
                note(f"shard {missing[job_result.index]}: {job_result.error}")
            bar.update()
    print(f"{args.output}: {len(missing) - failed} shards written, {len(mine) - len(missing)} kept")
    if failed:
        raise InputError(f"{failed} shards are not written; run the same command again.")
    return 0
