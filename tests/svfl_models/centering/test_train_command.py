import re
import subprocess
import sys

import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from svfl_models import cli
from svfl_models.centering import paper_figures
from tests.helpers.builders import make_episode


def command(*arguments):
    try:
        return cli.main(list(map(str, arguments)))
    except SystemExit as end:  # argparse's own way
        return end.code


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "centering"
    Dataset.create_or_resume(folder, "centering", seed=0, config={})
    for index in range(8):
        write_episode(make_episode(index, steps=3, size=76), folder / f"episode_{index:06d}.hdf5")
    return folder


def test_help_has_an_example_and_is_fast(capsys):
    assert command("centering", "--help") == 0
    assert "svfl-train centering --data data/centering --encoder vf" in capsys.readouterr().out
    code = "import sys, svfl_models.cli as c; c.build_parser(); print('torch' in sys.modules, 'escnn' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


def test_a_whole_run(dataset, tmp_path, capsys):
    out = tmp_path / "run"
    arguments = ["centering", "--data", dataset, "--encoder", "f", "--train-samples", 4, "--test-samples", 4]
    assert command(*arguments, "--epochs", 1, "--out", out) == 0
    printed = capsys.readouterr().out
    assert "F SVFL, 4 training samples: test accuracy" in printed
    assert "(paper: no such cell)" in printed
    assert str(out / "checkpoint.ckpt") in printed
    assert str(out / "report.md") in printed


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (["--encoder", "fv"], "--encoder.* 'fv'"),
        (["--model", "mlp"], "--model.* 'mlp'"),
        (["--preset", "big"], "--preset.* 'big'"),
        (["--train-samples", "0"], "--train-samples.* '0' .*at least 1"),
        (["--learning-rate", "-1"], "--learning-rate.* '-1' .*above 0"),
        (["--group", "D5"], "--group.* 'D5'"),
        (["--image-size", "63"], "--image-size.* 63"),
        (["--model", "cnn", "--group", "D8"], "--model cnn .*--group D8"),
        (["--model", "svfl", "--group", "none"], "--model svfl .*--group none"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_2(arguments, facts, capsys):
    assert command("centering", "--data", "nowhere", *arguments) == 2
    assert re.search(facts, capsys.readouterr().err)


def test_no_data_is_one_line_and_exit_code_1(tmp_path, capsys):
    assert command("centering", "--data", tmp_path / "nowhere", "--out", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert error.startswith("svfl-train: ")
    assert "nowhere" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_no_labels_is_one_line_and_exit_code_1(tmp_path, capsys):
    folder = tmp_path / "unlabelled"
    Dataset.create_or_resume(folder, "centering", seed=0, config={})
    episode = make_episode(0, steps=3, size=76)
    del episode.arrays["labels/offset"], episode.arrays["labels/direction"]
    write_episode(episode, folder / "episode_000000.hdf5")
    assert command("centering", "--data", folder, "--out", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert "labels" in error
    assert error.count("\n") == 1


def test_too_few_samples_is_one_line_and_exit_code_1(dataset, tmp_path, capsys):
    assert command("centering", "--data", dataset, "--out", tmp_path / "out") == 1
    assert re.search("100 training .*100 test .* 8", capsys.readouterr().err)


def test_the_papers_figures():
    assert paper_figures.centering_words("vf", "svfl", 100) == "99.3 +- 0.4 %"
    assert paper_figures.centering_figure("f", "svfl", 10) == (48.4, 1.7)
    assert paper_figures.centering_words("f", "svfl", 11) == "no such cell"
    assert {(e, m): sorted(cells) for (e, m), cells in paper_figures.CENTERING.items()} == {
        (e, m): [10, 25, 50, 100] for e in ("v", "f", "vf") for m in ("svfl", "cnn")
    }
