"""`moveit6d fit` on a fresh machine: without data, by the shipped config, killed, resumed."""

import errno
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import pytorch_lightning as pl
import torch
from PIL import Image

from lightning_modules import cli
from lightning_modules.cli import installed, main
from moveit6d.errors import InputError
from moveit6d.networks.weights_file import load_network
from tests.support.pairs import photos

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "configs" / "fit" / "multi_object_correlation.yaml"


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

    # The folder is this fit's alone: lengths and rates may change, the network may not.
    no_depth = f"--config={ROOT / 'configs' / 'overlay' / 'no_depth.yaml'}"
    first, config, *rest = arguments(out, 6)
    with pytest.raises(
        InputError, match=r"another model\.network\.init_args\.config\.use_depth; .* --output"
    ):
        main([first, config, *rest, no_depth])
    with pytest.raises(InputError, match=r"another data\.pairs\.zoom\.probability; .* --output"):
        main([*arguments(out, 6), "--data.pairs.zoom.probability=0.1"])
    assert steps_of(out / "last.ckpt") == 4
    main([*arguments(out, 5), "--model.learning_rate=1e-4", "--data.batch_size=2", "--threads=1"])
    assert steps_of(out / "last.ckpt") == 5 and not list(out.glob("*=*.ckpt"))


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
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "0.png").touch()
    words = [word for word in arguments(tmp_path / "out", 2) if "workers" not in word]
    words += ["--data.workers=1", f"--data.photos={tmp_path / 'photos'}"]
    with pytest.raises(InputError) as error:
        main(words)
    assert "Traceback" not in str(error.value) and "no readable picture" in str(error.value)
    assert str(error.value).endswith(".")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            [f"--config={ROOT / 'configs/overlay/gpu.yaml'}"],
            r"the trainer refuses .*gpu.*trainer\.accelerator cpu",
        ),
        (["--data.device=cuda"], r"data\.device is cuda, but PyTorch finds no NVIDIA GPU"),
        (["--data.photos=nowhere"], "Photo folder nowhere does not exist"),
    ],
)
def test_what_is_not_there_is_one_sentence(tmp_path: Path, options: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        main([*arguments(tmp_path, 2), *options])


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("--optimizer=Adam", "unrecognized arguments: --optimizer=Adam"),
        ("--lr_scheduler=StepLR", "unrecognized arguments: --lr_scheduler=StepLR"),
        (
            "--model.network.init_args.config.blocks=1",
            r"model\.network\.config: Option 'blocks' is",
        ),
        ("--model.network.init_args.config.channels=a", r"network\.config\.channels: .* value: a"),
        (
            "--data.rollouts.iterations=a",
            r"data\.rollouts\.iterations: .*int.* value: a; `moveit6d",
        ),
        ("--trainer.max_steps=a", r"trainer\.max_steps: Expected a <class 'int'>. Got value: a;"),
        ("--threads=-1", "threads is -1, must be 0 or more"),
    ],
)
def test_a_refusal_names_the_option_and_the_reason(tmp_path: Path, option: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        main([*arguments(tmp_path, 2), option])


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "content",
    [b"", b"PK" + bytes(90), b"\x80\x04K\x01."],
    ids=["empty", "cut off", "something else"],
)
def test_a_damaged_checkpoint_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "last.ckpt").write_bytes(content)
    with pytest.raises(InputError, match=r"last\.ckpt is damaged or no checkpoint.*: remove it"):
        main(arguments(tmp_path, 2))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["fit.json", "config.yaml"])
def test_a_fit_does_not_write_over_its_configuration(tmp_path: Path, name: str) -> None:
    mine = tmp_path / name
    mine.write_text("threads: 1\n")
    more = [f"--config={mine}", "--trainer.logger=false"]
    with pytest.raises(InputError, match=f"^--output: .*{name} would be replaced, which this run"):
        main([*arguments(tmp_path, 2), *more])
    assert mine.read_text() == "threads: 1\n"


@pytest.mark.filterwarnings("ignore")
def test_a_full_disk_ends_a_fit_with_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written: Not a directory"):
        main(arguments(tmp_path / "file" / "fit", 2))

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "last.ckpt")

    monkeypatch.setattr(pl.Trainer, "save_checkpoint", full)
    with pytest.raises(InputError, match=r"last\.ckpt \(No space left on device\); the last"):
        main(arguments(tmp_path / "out", 2))
