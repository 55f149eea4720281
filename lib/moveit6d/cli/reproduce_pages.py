"""The manual pages of `moveit6d reproduce`.

Never parses or runs anything.
"""

from __future__ import annotations

DESCRIPTION = """\
Each command runs one table or figure of the paper on a data set and puts our figures beside
the printed ones (and the rivals' as the paper lists them). What does not add up in the
printed ones is noted, not corrected.

  moveit6d reproduce ycb_add       share of frames with ADD(-S) < 10 % d, with and without shift
  moveit6d reproduce ycb_auc       areas under the ADD curve to 0.1 m
  moveit6d reproduce laval         T and R by object and occlusion level, with and without depth
  moveit6d reproduce convergence   starts ever farther from the truth (Eq. 3)
  moveit6d reproduce runtime       one iteration and a frame
  moveit6d reproduce attention     where the network looks
  moveit6d reproduce detection     finding the object without a start

files written to --output: NAME.md (also printed), NAME.json, a CSV a table, PNG and SVG of
the charts; for tables from tracks also tracks/, which are used again by the next command with
the same settings. Data that is not recognised as the published set is called a surrogate.
"""

EPILOG = """\
examples:
  moveit6d synthesize sequence --format laval --output laval
  moveit6d reproduce laval --data laval --output out
  moveit6d reproduce laval --help
"""

TRACKS = """
Tracks run under the paper's protocol: the first pose is given, the true pose is given again
every 15 frames (those frames are not scored), at most 30 iterations a frame.
"""

# Name: one line, what its manual page says, an example.
KINDS = {
    "ycb_add": (
        "YCB-Video table: ADD(-S) below a tenth of the diameter",
        """\
Columns of ours: ADD(-S) as declared, the same after one constant shift a sequence (an oracle
correction, found with the truth), ADD and ADD-S.
"""
        + TRACKS,
        "--data ycbv --output out/ycb",
    ),
    "ycb_auc": (
        "YCB-Video tables: area under the ADD curve to 0.1 m",
        """\
Areas are in the VOC form of YCB-Video's toolbox, which its tables need; the exact integral
stands beside it, and the curve of all frames pooled.
"""
        + TRACKS,
        "--data ycbv --output out/ycb",
    ),
    "laval": (
        "Laval tables: T and R by object and occlusion level",
        """\
R is Laval's own rotation error; the angle has a table of its own. With --no_depth_weights a
second model fills the columns `w/o depth`.
"""
        + TRACKS,
        "--data laval --output out/laval --no_depth_weights flat.safetensors",
    ),
    "convergence": (
        "starts ever farther from the truth (Eq. 3)",
        """\
For m = 0 ... 45 the truth is moved by 6 m unit actions on every axis (reading `formula`) or
by m (reading `total`, which the text's 270 actions fit), in random directions; then loops of
single actions of three units, 200 at most. Prints the share that comes back below 10 % d and
the steps of those. The paper uses the drill of YCB-Video's scene 50.
""",
        "--data ycbv --only 0050.035_power_drill --output out/conv",
    ),
    "runtime": (
        "milliseconds of one iteration and of a frame",
        """\
Times iterations on the first sequence's object (a procedural one without --data) and, with --data,
tracks the sequences under the paper's protocol for iterations and milliseconds a frame.
""",
        "--data ycbv --only 0050.035_power_drill --output out/runtime",
    ),
    "attention": (
        "where networks of different training look",
        """\
Crops a few action units away from the truth; one column for each of --checkpoints (weights
files, named by their steps, and by the file where these are the same) and one for the model itself.
""",
        "--data laval --output out/look --checkpoints early.safetensors",
    ),
    "detection": (
        "finding the object without a start",
        """\
Seeds, sinks and rotation grids in frames of each sequence, judged by the fewest steps (the
paper) and by the confidence; the figure shows the first frame.
""",
        "--data laval --frames 2 --output out/detection",
    ),
}
