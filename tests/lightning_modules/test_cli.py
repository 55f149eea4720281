"""`moveit6d fit` on a fresh machine: without data, by the shipped config, killed, resumed."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from PIL import Image

from lightning_modules import cli
from lightning_modules.cli import installed, main
from moveit6d.errors import InputError
from moveit6d.networks.weights_file import load_network
from tests.support.pairs import photos

CONFIG = Path(__file__).parents[2] / "configs" / "fit" / "multi_object_correlation.yaml"


def arguments(folder: Path, steps: int) -> list[str]:
    """The shipped config with a tiny network, few objects and everything written to `folder`."""
    sizes = "{channels: [4, 6, 8], geometry: [4, 4, 4], context: 8, decoder: 8, fine: 8}"
    return [
        "--config",
        str(CONFIG),
        f"--model.network.init_args.config={sizes}",
        "--data.shapes=2",
        "--data.batch_size=4",
        "--data.workers=0",
        "--data.validation_batches=1",
        f"--trainer.max_steps={steps}",
        "--trainer.val_check_interval=5",
        "--model.matching_steps=2",
        f"--output={folder}",
        "--export.every_n_steps=2",
        "--checkpoint.every_n_train_steps=2",
    ]


@pytest.mark.filterwarnings("ignore")
def test_a_fit_without_any_data_writes_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "out"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    main(arguments(out, 4))
    assert not list(elsewhere.iterdir()), "everything goes to --output"
    assert (out / "last.ckpt").is_file()
    assert list(out.glob("lightning_logs/*/config.yaml"))
    loaded = load_network(out / "weights.safetensors")
    assert loaded.facts["steps"] == "4" and loaded.facts["kind"] == "correlation"


def steps_of(checkpoint: Path) -> int:
    return int(torch.load(checkpoint, weights_only=False)["global_step"])


def test_a_killed_fit_goes_on_where_it_was(tmp_path: Path) -> None:
    pictures = tmp_path / "photos"  # read faster than made
    pictures.mkdir()
    Image.fromarray(photos()[0]).save(pictures / "0.png")
    command = [
        sys.executable,
        "-c",
        "import sys; from lightning_modules.cli import main; main(sys.argv[1:])",
    ]
    more = ["--data.photos", str(pictures)]
    checkpoint = tmp_path / "last.ckpt"
    process = subprocess.Popen(
        [*command, *arguments(tmp_path, 10_000), *more],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 600
    while not checkpoint.exists() and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.2)
    process.send_signal(signal.SIGKILL)
    process.wait()
    reached = steps_of(checkpoint)
    assert reached >= 2
    resumed = subprocess.run(
        [*command, *arguments(tmp_path, reached + 4), *more],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert resumed.returncode == 0, resumed.stderr[-2000:]
    assert "Restored all states" in resumed.stderr + resumed.stdout
    assert load_network(tmp_path / "weights.safetensors").facts["steps"] == str(reached + 4)


def test_configurations_that_came_with_the_package_are_found_from_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "configs/fit/my_object.yaml"
    monkeypatch.chdir(tmp_path)
    assert Path(installed(name)).samefile(CONFIG.parents[2] / name)  # as installed to be edited
    monkeypatch.setattr(cli, "_prefix", lambda: str(tmp_path / "prefix"))
    place = tmp_path / "prefix/share/moveit6d" / name
    place.parent.mkdir(parents=True)
    place.write_text("a: 1")
    assert installed(name) == str(place)
    assert installed(f"--data.pairs={name}") == f"--data.pairs={place}"
    for other in ("configs/fit/nothing.yaml", "--data.batch_size=4", "my/configs/fit.yaml"):
        assert installed(other) == other
    (tmp_path / name).parent.mkdir(parents=True)
    (tmp_path / name).write_text("a: 2")
    assert installed(name) == name  # one's own comes first


@pytest.mark.filterwarnings("ignore")
def test_what_is_wrong_in_a_worker_process_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "pairs").mkdir()
    words = [word for word in arguments(tmp_path / "out", 2) if "workers" not in word]
    words += ["--data.workers=1", f"--data.written={tmp_path / 'pairs'}"]
    with pytest.raises(InputError) as error:
        main(words)
    assert "Traceback" not in str(error.value) and "pairs" in str(error.value)
    assert str(error.value).endswith(".")
