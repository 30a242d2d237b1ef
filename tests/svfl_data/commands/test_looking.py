"""Every command to look with finds fields that nobody knows, by name and unit, and needs none of the others."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from rerun.chunk import RrdReader

from svfl_data.sampling.split import split_episodes
from tests.helpers.open_episode import bare_episode, dataset_of, open_episode

MAKERS = {"many sensors": open_episode, "joints alone": bare_episode}
FIELDS = {"many sensors": (("left_finger", "N"), ("pressure", "kPa")), "joints alone": (("action", "rad"),)}
"""Name and unit of the fields that every output must tell."""


def shown(command, folder, tmp_path, monkeypatch, words):
    """Everything that one command prints or writes, as text."""
    texts = []
    usual = Figure.savefig

    def savefig(figure, *args, **options):
        texts.extend(text.get_text() for text in figure.findobj(Text))
        return usual(figure, *args, **options)

    monkeypatch.setattr(Figure, "savefig", savefig)
    code, out, err = command(words[0], folder, *(str(tmp_path / one) if "." in one else one for one in words[1:]))
    assert code == 0, err
    texts.append(out)
    texts += [page.read_text() for page in tmp_path.glob("*.md")]
    for file in tmp_path.glob("*.rrd"):
        rerun = Path(sys.executable).parent / "rerun"
        done = subprocess.run([rerun, "rrd", "verify", file], capture_output=True, check=False)
        assert done.returncode == 0, done.stderr
        reader = RrdReader(file)
        for store in (None, *reader.blueprints()):  # the blueprint holds the titles
            chunks = reader.stream(store=store).to_chunks()
            texts += [chunk.entity_path for chunk in chunks]
            batches = [chunk.to_record_batch() for chunk in chunks if chunk.is_static or store]
            columns = [(name, one) for batch in batches for name, one in zip(batch.schema.names, batch, strict=True)]
            texts += [str(column.to_pylist()) for name, column in columns if ":" in name]
    return "\n".join(texts)


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize(
    "words",
    [
        ("info",), ("info", "--json"), ("info", "--episode", "0"), ("info", "--episode", "0", "--json"),
        ("plot", "--out", "e.png"), ("view", "--out", "e.rrd"), ("card", "--out", "card.md"), ("stats",),
    ],
    ids=" ".join,
)  # fmt: skip
def test_every_command_finds_a_field_that_nobody_knows(kind, words, command, tmp_path, monkeypatch):
    dataset = dataset_of(tmp_path / "data", MAKERS[kind])
    if words == ("stats",):
        split_episodes(dataset.indices, {"train": 0.7, "valid": 0.3}, 0, "default").save(dataset)
    told = shown(command, dataset.path, tmp_path, monkeypatch, words)
    for name, unit in FIELDS[kind]:
        assert name in told
        assert unit in told


@pytest.mark.parametrize("kind", MAKERS)
def test_validate_checks_every_field_and_names_what_is_lacking(kind, command, tmp_path):
    dataset = dataset_of(tmp_path / "data", MAKERS[kind])
    code, out, _ = command("validate", dataset.path)
    assert code == 0
    assert ("streams/left_finger/wrench: has no tare" in out) == (kind == "many sensors")
    assert ("observations/tcp_velocity: axes are assumed" in out) == (kind == "many sensors")
    found = json.loads(command("validate", dataset.path, "--json")[1])
    assert (found["errors"], found["warnings"]) == (0, 9 if kind == "many sensors" else 0)


def test_info_says_what_a_field_means_and_what_is_assumed(command, tmp_path):
    dataset = dataset_of(tmp_path / "data", open_episode)
    whole, one = command("info", dataset.path)[1], command("info", dataset.path, "--episode", 0)[1]
    assert "to do     put the cup on the plate (3)" in whole
    assert "robots    ur5e (3)" in whole
    assert "camera    wrist: 32 x 32 px, 10 Hz, 33 frames, on the gripper" in whole
    assert "field     streams/tactile/pressure [kPa]: float32 (T, 2, 16, 16)" in whole
    for out in (whole, one):
        assert "axes base; assumed: axes, parts" in out
        assert "bounds dx, dy, dz -0.02 to 0.02 m, rx, ry, rz -0.1 to 0.1 rad, opening 0 to 1" in out
    facts = json.loads(command("info", dataset.path, "--json")[1])
    assert facts["fields"]["streams/tactile/pressure"]["unit"] == "kPa"
    assert facts["fields"]["observations/tcp_velocity"]["assumed"] == ["axes", "parts"]
    assert facts["instructions"] == {"put the cup on the plate": 3}


def test_info_tells_the_fields_of_the_first_episode_that_can_be_read(command, tmp_path):
    dataset = dataset_of(tmp_path / "data", open_episode)
    dataset.episode_path(0).write_bytes(b"")
    out = command("info", dataset.path)[1]
    assert "streams/tactile/pressure [kPa]" in out
    assert "damaged" in out
