"""Options and files of settings become a configuration, or one sentence."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from moveit6d.cli.settings import (
    EVERYTHING,
    SettingsPart,
    add_settings,
    check_settings,
    fields_of,
    settings_of,
)
from moveit6d.config import PAPER_CONFIG, TrackerConfig
from moveit6d.errors import InputError


def parsed(*options: str, base: TrackerConfig | None = None) -> TrackerConfig:
    base = base or TrackerConfig()
    parser = argparse.ArgumentParser()
    add_settings(parser, base)
    return settings_of(parser.parse_args(options), base)


def test_without_options_it_is_the_base() -> None:
    assert parsed() == TrackerConfig()
    assert parsed(base=PAPER_CONFIG) is PAPER_CONFIG


def test_every_field_has_an_option_that_reads_its_value() -> None:
    words: list[str] = []
    for name, _, _, value in fields_of(TrackerConfig()):
        text = str(value).lower() if isinstance(value, bool) else str(value)
        if isinstance(value, tuple):
            text = text.replace("(", "[").replace(",)", "]").replace(")", "]")
        words += [f"--{name}", "null" if value is None else text]
    assert len(words) > 100 and parsed(*words) == TrackerConfig()
    # Read against other defaults the values are the options' own.
    assert parsed(*words, base=PAPER_CONFIG) == TrackerConfig()


def test_help_shows_what_is_wanted_often_and_all_options_everything(
    capsys: pytest.CaptureFixture[str],
) -> None:
    often = {"--low_confidence", "--max_iterations", "--no_contour", "--all_options"}
    for option, shown in (("--help", False), ("--all_options", True)):
        parser = argparse.ArgumentParser(prog="track")
        add_settings(parser)
        with pytest.raises(SystemExit) as ended:
            parser.parse_args([option])
        text = capsys.readouterr().out
        assert ended.value.code == 0 and all(word in text for word in often)
        names = [name for name, *_ in fields_of(TrackerConfig())]
        assert all(f"--{name} " in text for name in names) == shown
        assert len(text.partition("\n\n")[0].splitlines()) < 20, "the usage stays short"


def test_options_change_one_setting_each() -> None:
    found = parsed("--max_iterations", "3", "--mode", "single", "--no_contour", base=None)
    assert found.loop.max_iterations == 3 and found.loop.mode == "single"
    assert not found.contour.enabled and found.multi_start == TrackerConfig().multi_start
    assert parsed("--contour.scales", "[[2], [1, 1]]").contour.scales == ((2,), (1, 1))
    assert parsed("--contour.enabled", "true", base=PAPER_CONFIG).contour.enabled
    assert parsed("--contour.enabled", "true", base=PAPER_CONFIG).loop == PAPER_CONFIG.loop


def test_a_file_is_read_and_options_go_before_it(tmp_path: Path) -> None:
    file = tmp_path / "tracker.yaml"
    file.write_text("loop:\n  max_iterations: 5\n  fine_scale: 2\nlow_confidence: 0.4\n")
    found = parsed("--config", str(file), "--loop.max_iterations", "7")
    assert found.loop.max_iterations == 7 and found.loop.fine_scale == 2.0
    assert found.low_confidence == 0.4 and found.high_confidence == 0.65


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("loop:\n  iterations: 5\n", r"tracker\.yaml.*iterations"),
        ("loop: {max_iterations: many}\n", r"loop\.max_iterations must be .*int.* found 'many'"),
        ("loop: {max_iterations: 0}\n", "1 or more"),
        ("loop: [", r"tracker\.yaml"),
        ("loop: 3\n", r"tracker\.yaml: loop must be settings by name.* found 3\.$"),
        (
            "recovery: {second_look: false}\n",
            r"tracker\.yaml: recovery\.second_look must be .*False",
        ),
        ("loop: {max_iterations: many}\n", r"tracker\.yaml: setting loop\.max_iterations"),
        ("# nothing\n", r"tracker\.yaml holds no settings"),
        ("- 1\n- 2\n", r"tracker\.yaml holds no settings"),
        (bytes(range(256)), r"tracker\.yaml is not a text file"),
        ("# größe\nloop: {max_iterations: 3}\n".encode("latin-1"), r"tracker\.yaml is not a text"),
    ],
)
def test_a_bad_file_is_one_sentence(tmp_path: Path, text: str | bytes, message: str) -> None:
    content = text if isinstance(text, bytes) else text.encode()
    (tmp_path / "tracker.yaml").write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        parsed("--config", str(tmp_path / "tracker.yaml"))
    assert "\n" not in str(caught.value)


def test_a_file_may_be_written_by_powershell_and_name_others_beside_it(tmp_path: Path) -> None:
    (tmp_path / "loop.yaml").write_text("max_iterations: 5\n")
    (tmp_path / "tracker.yaml").write_text("loop: loop.yaml\n", encoding="utf-16")
    found = parsed("--config", str(tmp_path / "tracker.yaml"), base=PAPER_CONFIG)
    assert found.loop.max_iterations == 5 and found.loop.mode == "single"


def test_a_verb_has_options_for_the_part_that_it_reads_alone() -> None:
    part = SettingsPart(("loop", "low_confidence"), but=("loop.augment", "loop.augment_size"))
    parser = argparse.ArgumentParser()
    add_settings(parser, part=part)
    found = settings_of(parser.parse_args(["--low_confidence", "0.1", "--max_iterations", "3"]))
    assert found.low_confidence == 0.1 and found.loop.max_iterations == 3
    for option in ("--loop.augment", "--high_confidence", "--no_contour", "--max_milliseconds"):
        with pytest.raises(SystemExit):
            parser.parse_args([option, "0"])


def test_names_are_whole() -> None:
    part = SettingsPart(("multi_start", "recovery.enabled"), but=("multi_start.recovery",))
    assert "multi_start.recovery_first" in part and "recovery.enabled" in part
    assert "multi_start.recovery.count" not in part and "recovery.interval" not in part
    assert all(name in EVERYTHING for name, *_ in fields_of(TrackerConfig()))


def test_what_one_way_of_a_verb_does_not_read_is_refused_by_name() -> None:
    parser = argparse.ArgumentParser()
    add_settings(parser)
    args = parser.parse_args(["--no_contour", "--max_iterations", "3"])
    check_settings(args, SettingsPart(("loop", "contour")), "here")
    with pytest.raises(InputError, match=r"^--contour.enabled changes nothing here; leave it out"):
        check_settings(args, SettingsPart(("loop",)), "here")


def test_bad_options_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"contour\.lines must be int, found 'x'"):
        parsed("--contour.lines", "x")
    with pytest.raises(InputError, match=r"nowhere\.yaml does not exist"):
        parsed("--config", str(tmp_path / "nowhere.yaml"))
