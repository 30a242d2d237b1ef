"""A sentence stands in the report of a training or an evaluation where its numbers say so, and nowhere else."""

import math
from dataclasses import fields, replace

import pytest

from svfl_models.centering import report as centering
from svfl_models.centering.config import Latent, TrainingConfig
from svfl_models.cloning import report as cloning
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.evaluate import Evaluation
from svfl_models.cloning.evaluation.action_errors import ActionErrors
from svfl_models.latent.evaluation.alignment import Alignment, PairScores
from svfl_models.latent.evaluation.attention import Attention
from svfl_models.latent.evaluation.pages import tables
from svfl_models.latent.evaluation.results import Evaluation as LatentEvaluation

LATENT = Latent("file", "0" * 64, "poe", "data", "tiny", 10)


def classified(config=None, **changes):
    usual = {
        "test_accuracy": 0.5, "best_test_accuracy": 0.5, "separate_test_accuracy": None, "offset_error_mm": None,
        "epochs": 500, "seconds": 1.0, "parameters": 1, "train_samples": [1] * 4, "confusion": [[1] * 4] * 4,
    }  # fmt: skip
    return " ".join(centering.page(config or TrainingConfig("data"), centering.Result(**usual | changes)).split())


ENDS = {
    "whatever": "The training lasted 500 epochs, whatever the test accuracy.",
    "all": "The training lasted all 500 epochs that it was allowed.",
    "test": "when the test accuracy had not improved for 9, as in the paper.",
    "valid": "when the accuracy on the validation samples had not improved for 9.",
}


@pytest.mark.parametrize(
    ("patience", "valid_samples", "epochs", "end"),
    [
        (0, 0, 500, "whatever"), (9, 0, 500, "all"), (9, 5, 500, "all"), (9, 0, 120, "test"), (9, 5, 120, "valid"),
    ],
)  # fmt: skip
def test_a_classifier_says_by_what_its_training_ended(patience, valid_samples, epochs, end):
    config = TrainingConfig("data", patience=patience, valid_samples=valid_samples)
    said = classified(config, epochs=epochs)
    assert [name for name, words in ENDS.items() if words in said] == [end]


@pytest.mark.parametrize(
    ("changes", "published"),
    [({}, True), ({"train_samples": 11}, False), ({"latent": LATENT, "encoder": "vfp", "group": "none"}, False)],
)
def test_a_classifier_is_compared_with_the_same_cell_of_the_paper_only(changes, published):
    said = classified(replace(TrainingConfig("data"), **changes))
    assert ("paper, same cell" in said) == ("The paper's data are not published" in said) == published


@pytest.mark.parametrize(
    ("use", "words"),
    [("frozen", "it stays as it was"), ("fine-tuned", "it goes on learning"), ("from-scratch", "but random weights")],
)
def test_a_classifier_says_what_became_of_its_encoder(use, words):
    latent = replace(LATENT, use=use)
    said = classified(TrainingConfig("data", encoder="vfp", group="none", latent=latent))
    for one in ("it stays as it was", "it goes on learning", "but random weights"):
        assert (one in said) == (one == words)
    assert "The encoder" not in classified()


@pytest.mark.parametrize(("name", "words"), [
    ("offset_error_mm", "mm off on average"), ("separate_test_accuracy", "separate test set"),
])  # fmt: skip
def test_a_classifier_tells_only_what_was_measured(name, words):
    assert words in classified(**{name: 0.5})
    assert words not in classified(**{name: None})


def cloned(history, **changes):
    usual = {
        "train_loss": 1.0, "valid_loss": 1.0, "valid_gripper": 0.1, "valid_error": 0.1, "valid_xy_mm": 1.0,
        "valid_z_mm": 1.0, "valid_turn_deg": 1.0, "episodes": [4, 2], "steps": [24, 12], "epochs": 3, "seconds": 1.0,
        "parameters": 1,
    }  # fmt: skip
    rows = [{"epoch": epoch, **({} if loss is None else {"valid_loss": loss})} for epoch, loss in enumerate(history)]
    return cloning.page(CloningConfig("data"), "picking", cloning.Result(**usual | changes), rows)


@pytest.mark.parametrize(
    ("losses", "words"),
    [
        ([3, 1, 2], "was lowest after 2 epochs (1) and has risen to 2 since"),
        ([1, 3, 2], "was lowest after 1 epoch (1) and has risen to 2 since"),
        ([-3, -5, -1], "was lowest after 2 epochs (-5) and has risen to -1 since"),
        ([3, 2, 1], None),
        ([3, 1, 1.05], None),
        ([-3, -5, -4.9], None),
        ([1], None),
        ([], None),
        ([None, None], None),
        ([math.nan] * 3, None),
        ([3, 1, math.nan], None),
        ([math.nan, 1, 2], "was lowest after 2 epochs (1) and has risen to 2 since"),
    ],
)
def test_a_policy_says_whether_its_held_out_loss_has_risen(losses, words):
    said = cloned(losses)
    assert ("has risen" in said) == (words is not None)
    assert words is None or words in said


def test_a_policy_tells_only_the_errors_that_its_action_has():
    said = cloned([1], valid_gripper=None, valid_xy_mm=None, valid_z_mm=None, valid_turn_deg=None)
    for words in ("gripper wrong", "(dx, dy) off", "dtheta off"):
        assert words in cloned([1])
        assert words not in said


@pytest.mark.parametrize(("count", "words"), [(1, "1 held-out demonstration ("), (2, "2 held-out demonstrations (")])
def test_demonstrations_are_counted(count, words):
    assert words in cloned([1], episodes=[4, count])


@pytest.mark.parametrize(("success", "told"), [([False, False], False), ([True, False], True)])
def test_the_length_of_successes_is_told_if_there_are_some(success, told):
    found = Evaluation("x", "y", 0, success, [3, 5])
    assert ("3 steps (median)" in str(found)) == told
    assert ("median" in str(found)) == told


@pytest.mark.parametrize("values", [[1.0], [1.0, 2.0], [math.nan, 2.0]])
@pytest.mark.parametrize("held_out", [False, True])
@pytest.mark.parametrize("task", ["picking", "pushing"])
def test_action_errors_say_of_what_they_are(values, held_out, task):
    count = len(values)
    found = ActionErrors("x", "data", task, "picking", held_out, [*range(count)], [6] * count, {"xy_mm": values})
    page = found.page()
    assert ("has learned another task, picking" in page) == (task != "picking")
    assert ("Of one episode the spread between episodes is unknown" in page) == (count == 1)
    assert ("that it has not learned from" in page) == held_out
    assert (" to " in str(found)) == (count > 1)


def evaluated(**parts):
    """The evaluation of a latent model of which nothing else is known."""
    return LatentEvaluation(**{one.name: None for one in fields(LatentEvaluation)} | parts)


@pytest.mark.parametrize("touching", [None, 0.25])
@pytest.mark.parametrize("gaps", [{}, {1: PairScores(9, 0.5, math.nan)}])
def test_pairs_are_told_of_as_far_as_there_are_some(touching, gaps):
    table = tables._alignment(evaluated(alignment=Alignment(0.5, touching, gaps, None)))
    assert ("of those in contact" in table.note) == (touching is not None)
    assert ("foreign pair" in table.note) == bool(gaps)
    assert table.rows == ([("1 step away", "50.0%", "-", "9")] if gaps else [])


@pytest.mark.parametrize(("contact", "free"), [(False, False), (True, False), (True, True)])
def test_attention_by_contact_is_explained_where_it_is_shown(contact, free):
    mass = {"contact": {"image": [0.5, 0.5], "wrench": [0.5, 0.5]}}
    shares = Attention({"image": 0.5, "wrench": 0.5}, mass, mass if contact else None, mass if free else None)
    table = tables._attention(evaluated(attention=shares))
    assert ("By contact" in table.note) == contact
    assert len(table.rows) == 3 + contact + free


def test_what_is_not_known_of_a_model_has_no_table():
    nothing = evaluated()
    for part in (tables._contact, tables._alignment, tables._attention, tables._experts):
        assert part(nothing) is None
    assert tables._next_gripper(None) is None
    assert (tables.number(math.nan), tables.percent(math.nan), tables.number(None)) == ("-", "-", "-")
