"""Side files and JSON attributes are one declared model each: what does not fit is one line, whatever it is."""

import contextlib
import json
import math
from dataclasses import replace

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.index import INDEX, entries
from svfl_data.errors import FieldError, FormatError, SvflError
from svfl_data.sampling.split import load_split, split_episodes, split_file
from svfl_data.sampling.statistics import compute_statistics, load_statistics, save_statistics, statistics_file
from svfl_data.schema.episode import Meta, canonical_json
from svfl_data.storage.metadata import JSON_ATTRIBUTES, checked_meta, parse_meta
from svfl_data.storage.seal import seal
from svfl_data.storage.store import resealed_bytes, write_episode
from svfl_data.system.side_files import BITS_LIMIT, DEPTH_LIMIT, parse_json, plain
from tests.helpers.builders import make_episode

LEAVES = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**200), 2**200), st.floats(), st.text(max_size=8),
    st.sampled_from(["\ud800", "\x1b[2J", "‮", "tare", "low_pass", "gravity", "svfl-split", "1.0"]),
)  # fmt: skip
KEYS = st.one_of(
    st.text(max_size=6),
    st.sampled_from(["format", "format_version", "task", "seed", "config", "parts", "rule", "sha256", "name"]),
    st.sampled_from(["start_ns", "end_ns", "tool", "offset", "cutoff_hz", "mass_kg", "centre_m", "fields", "setup"]),
)
VALUES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(KEYS, inner, max_size=5)),
    max_leaves=12,
)


def outcome(load):
    try:
        load()
    except SvflError as error:
        return str(error)
    return None


def texts(whole):
    """What may stand in a file: any JSON, what the file holds with one value replaced, and what is no JSON."""
    keys = sorted(whole)
    return st.one_of(
        VALUES.map(json.dumps),
        st.builds(lambda key, value: json.dumps(whole | {key: value}), st.sampled_from(keys), VALUES),
        st.sampled_from(keys).map(lambda key: json.dumps({name: whole[name] for name in keys if name != key})),
        st.text(max_size=20),
        st.integers(0, 50).map(lambda cut: json.dumps(whole)[:cut]),
    )


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    dataset = Dataset.create_or_resume(tmp_path_factory.mktemp("side") / "d", "centering", 0, {"a": {"b": 1}})
    for index in range(3):
        write_episode(make_episode(index), dataset.episode_path(index))
    split = split_episodes(dataset.indices, {"train": 0.7, "test": 0.3}, seed=0)
    split.save(dataset)
    save_statistics(dataset, split, compute_statistics(dataset, split["train"]))
    entries(dataset)
    return dataset


def loaders(dataset):
    split = split_episodes(dataset.indices, {"train": 0.7, "test": 0.3}, seed=0)
    return {
        dataset.path / "dataset.json": lambda: Dataset.open(dataset.path),
        split_file(dataset, "default"): lambda: load_split(dataset, "default"),
        statistics_file(dataset, "default"): lambda: load_statistics(dataset, split),
        dataset.path / INDEX: lambda: entries(dataset),
    }


@pytest.mark.slow
@pytest.mark.parametrize("number", range(4))
def test_whatever_stands_in_a_side_file_is_read_or_is_one_line(dataset, number):
    file, load = list(loaders(dataset).items())[number]
    content = file.read_bytes()
    whole = json.loads(content.splitlines()[0] if file.name == INDEX else content)

    @settings(max_examples=150, deadline=None)
    @given(texts(whole))
    def check(text):
        file.write_text(text, encoding="utf-8", errors="surrogatepass")
        said = outcome(load)
        assert said is None or (str(file.parent) in said and said.isprintable())

    try:
        check()
    finally:
        file.write_bytes(content)


@pytest.mark.parametrize("key", JSON_ATTRIBUTES)
def test_whatever_an_attribute_holds_is_metadata_or_one_line(key):
    good = {"task": "t", "index": 0, "seed": 0, "source": "s", "success": True, "config": "{}", "software": "{}"}
    good |= {name: "[]" for name in ("transforms", "annotations", "history")}
    annotation = {"name": "contact", "start_ns": 0, "end_ns": 5, "cutoff_hz": 3, "tool": "x"}

    @settings(max_examples=150, deadline=None)
    @given(st.one_of(VALUES.map(json.dumps), texts(annotation).map(lambda text: f"[{text}]"), st.text(max_size=9)))
    def check(text):
        with contextlib.suppress(FormatError):
            meta = parse_meta(good | {key: text}, "e.hdf5")
            assert checked_meta(meta) == meta  # what can be read can be written again
            canonical_json(getattr(meta, key))

    check()


HOSTILE = {
    "deep": "[" * 5000 + "]" * 5000,
    "just too deep": "[" * (DEPTH_LIMIT + 2) + "]" * (DEPTH_LIMIT + 2),
    "not finite": '{"a": NaN}',
    "infinite": '{"a": 1e999}',
    "surrogate": '{"a": "\\ud800"}',
    "huge integer": json.dumps({"a": 10**60}),
    "endless integer": '{"a": %s}' % ("9" * 5000),
    "not UTF-8": b'{"a": "\xff"}',
    "trailing": "{} {}",
    "empty": "",
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_json_has_bounds(kind):
    with pytest.raises(FormatError, match=r"^where: ") as caught:
        parse_json(HOSTILE[kind], "where")
    assert len(str(caught.value)) < 300


def test_json_has_a_size(tmp_path):
    assert parse_json('{"a": [1]}', "where", limit=10) == {"a": [1]}
    with pytest.raises(FormatError, match=r"where.*\b9 bytes"):
        parse_json('{"a": [1]}', "where", limit=9)


@pytest.mark.parametrize(
    ("attribute", "value", "said"),
    [
        ("annotations", '[{"name": "slip", "start_ns": 0}]', "end_ns"),
        ("annotations", '[{"name": 3, "start_ns": 0, "end_ns": 1}]', "name"),
        ("annotations", '[{"name": "slip", "start_ns": 0, "end_ns": 1%s}]' % ("0" * 30), "annotations"),
        ("history", '[{"when": "today"}]', "tool"),
        ("history", "{}", "history"),
        ("software", '{"svfl": 3}', "software"),
        ("transforms", '[{"name": "low_pass"}]', "low_pass"),
        ("transforms", '[{"name": "gravity", "mass_kg": 1, "centre_m": [[0], [0], [0]]}]', "centre_m"),
        ("config", "[]", "config"),
        ("config", 3, "config"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, attribute, value, said):
    """File and key, by every way of reading."""
    file = tmp_path / "episode_000000.hdf5"
    dataset = Dataset.create_or_resume(tmp_path, "centering", 0, {})
    write_episode(make_episode(), file)
    with h5py.File(file, "a") as content:
        content.attrs[attribute] = value
        content.flush()
    whole = file.read_bytes()
    bare = whole[: whole.rindex(b"\nsvfl-sha256:")] if b"\nsvfl-sha256:" in whole else whole
    file.write_bytes(bare + seal(bare))
    for read in (lambda: dataset.read(0), lambda: dataset.episode(0).meta):
        with pytest.raises(FormatError, match=rf"episode_000000.*{said}"):
            read()


def test_numpy_scalars_are_stored_as_what_they_are():
    config = {
        "flag": np.bool_(True), "gain": np.float32(0.5), "count": np.int64(3), "name": np.str_("x"),
        "matrix": np.eye(2), "pair": (1, np.float64(2.0)),
    }  # fmt: skip
    meta = checked_meta(Meta("t", np.int32(3), np.int64(5), "s", np.bool_(False), config))
    assert (meta.index, meta.seed, meta.success) == (3, 5, False)
    assert [type(value) for value in (meta.index, meta.seed, meta.success)] == [int, int, bool]
    assert json.loads(canonical_json(config)) == meta.config == {
        "flag": True, "gain": 0.5, "count": 3, "name": "x", "matrix": [[1, 0], [0, 1]], "pair": [1, 2],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("value", "found"),
    [
        (math.nan, "nan"),
        (math.inf, "inf"),
        (np.float32("nan"), "nan"),
        ("\ud800", r"\\ud800"),
        ({1: 2}, r"key 1\b.*int"),
        (object(), "object"),
        (2**BITS_LIMIT, rf"{BITS_LIMIT + 1} bits.*\b{BITS_LIMIT}\b"),
        ({"a": {"b": {3}}}, r"key\.a\.b\b.*set"),
        (b"x", "bytes"),
    ],
)
def test_what_could_not_be_read_again_is_not_written(tmp_path, value, found):
    with pytest.raises(FieldError, match=f"^here.*{found}"):
        plain({"key": value}, "here")
    meta = replace(make_episode().meta, config={"key": value})
    with pytest.raises(FieldError, match=rf"episode 0\b.*{found}"):
        write_episode(replace(make_episode(), meta=meta), tmp_path / "e.hdf5")
    assert not list(tmp_path.iterdir())


def test_what_nests_in_itself_is_an_error():
    value: list = []
    value.append(value)
    with pytest.raises(FieldError, match=rf"here.*\b{DEPTH_LIMIT}\b"):
        plain(value, "here")


def test_lines_of_another_version_are_no_lines(dataset):
    file = dataset.path / INDEX
    lines = file.read_text().splitlines()
    try:
        old = [json.dumps({key: value for key, value in json.loads(line).items() if key != "setup"}) for line in lines]
        file.write_text("".join(line + "\n" for line in old))
        assert [entry.content for entry in entries(dataset)] == [json.loads(line)["content"] for line in lines]
    finally:
        file.write_text("".join(line + "\n" for line in lines))


def test_the_index_is_not_believed_about_numbers(dataset):
    file = dataset.path / INDEX
    content = file.read_bytes()
    lines = [json.loads(line) for line in content.splitlines()]
    try:
        file.write_text("".join(json.dumps(line | {"index": 10**6}) + "\n" for line in lines))
        assert [entry.index for entry in entries(dataset)] == [0, 1, 2]
    finally:
        file.write_bytes(content)


def test_an_index_beyond_all_measure_is_not_read(dataset, monkeypatch):
    honest = entries(dataset)
    monkeypatch.setattr("svfl_data.datasets.index.SIZE_LIMIT", 10)
    monkeypatch.setattr("svfl_data.datasets.index._DECODER", None)  # would be an error
    monkeypatch.setattr("svfl_data.datasets.index._remember", lambda *_: None)
    assert [entry.content for entry in entries(dataset)] == [entry.content for entry in honest]


def test_a_resealed_file_keeps_the_bounds(tmp_path):
    file = tmp_path / "e.hdf5"
    write_episode(make_episode(), file)
    with h5py.File(file, "a") as content:
        content.attrs["history"] = "[" * 3000
    with pytest.raises(FormatError, match=r"e\.hdf5.*history"):
        resealed_bytes(file, {"tool": "repair"})
