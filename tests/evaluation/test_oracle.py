"""The proof of the loop in miniature; the whole is `moveit6d benchmark oracle --starts 1000`."""

import pytest

from moveit6d.cli.main import main
from moveit6d.config import ActionMode
from moveit6d.evaluation.oracle import oracle_errors
from moveit6d.geometry.mesh import Mesh
from moveit6d.rendering.backends import make_renderer


@pytest.mark.parametrize("mode", list(ActionMode))
def test_every_loop_ends_within_half_a_step(brick: Mesh, mode: ActionMode) -> None:
    left = list(oracle_errors([brick], make_renderer(), mode, 6))
    assert len(left) == 6 and max(left) < 0.5


def test_the_command_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["benchmark", "oracle", "--starts", "2", "--threads", "1"]) == 0
    assert "all_axes" in capsys.readouterr().out
