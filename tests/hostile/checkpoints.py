"""Checkpoints as a program of ours could have written them, but for one change, also in the folder of a training."""

import json
import shutil

from svfl_models.training.provenance.record import KEY
from tests.hostile.json_attributes import HIDDEN
from tests.hostile.kind import add
from tests.hostile.models import CHECKPOINTS, WHOLE, each, register, whole


def _checkpoint(change):
    """A checkpoint as a program of ours could have written it, but for one change."""

    def make(source, target, folder):
        import torch

        found = torch.load(source, weights_only=True)
        changed = change(found)
        torch.save(found if changed is None else changed, target)

    return make


def _weights(change):
    def changed(found):
        for name, weight in found["state_dict"].items():
            if weight.is_floating_point() and weight.numel():
                found["state_dict"][name] = change(weight)

    return _checkpoint(changed)


def _one_weight(change):
    def changed(found):
        name = next(
            name for name, weight in found["state_dict"].items() if weight.is_floating_point() and weight.ndim > 1
        )
        found["state_dict"][name] = change(found["state_dict"][name])

    return _checkpoint(changed)


def _endless(weight):
    import torch

    return torch.zeros(1).expand(10**11)


def _sparse(weight):
    import torch

    return torch.sparse_coo_tensor(torch.zeros((1, 1), dtype=torch.int64), torch.ones(1), (10**11,))


CHANGES = {
    "weights_nan": _weights(lambda weight: weight * float("nan")),
    "weights_one_nan": _one_weight(lambda weight: weight * float("nan")),
    "weights_infinite": _weights(lambda weight: weight + float("inf")),
    "weights_complex": _one_weight(lambda weight: weight.to(dtype=__import__("torch").complex64)),
    "weights_flat": _one_weight(lambda weight: weight.reshape(-1)),
    "weights_empty": _one_weight(lambda weight: weight[:0]),
    "weights_endless": _one_weight(_endless),
    "weights_sparse": _one_weight(_sparse),
    "weights_text": _checkpoint(lambda found: found["state_dict"].update({next(iter(found["state_dict"])): "x"})),
    "weights_missing": _checkpoint(lambda found: found.pop("state_dict") and None),
    "weights_list": _checkpoint(lambda found: found.update(state_dict=[1, 2])),
    "weights_more": _checkpoint(lambda found: found["state_dict"].update({HIDDEN: found["state_dict"].popitem()[1]})),
    "a_list": _checkpoint(lambda found: [found]),
    "a_tensor": _checkpoint(lambda found: found["state_dict"].popitem()[1]),
    "mark_missing": _checkpoint(lambda found: found.pop("svfl") and None),
    "mark_list": _checkpoint(lambda found: found.update(svfl=[1])),
    "mark_escapes": _checkpoint(lambda found: found["svfl"].update(format=HIDDEN)),
    "mark_number": _checkpoint(lambda found: found["svfl"].update(format=7)),
    "version_escapes": _checkpoint(lambda found: found["svfl"].update(format_version="9\x1b[31m")),
    "version_list": _checkpoint(lambda found: found["svfl"].update(format_version=[])),
    "parameters_missing": _checkpoint(lambda found: found.pop("hyper_parameters") and None),
    "parameters_list": _checkpoint(lambda found: found.update(hyper_parameters=[1])),
    "parameters_empty": _checkpoint(lambda found: found.update(hyper_parameters={})),
    "parameters_text": _checkpoint(lambda found: found.update(hyper_parameters={1: HIDDEN})),
}


def _provenance(change):
    return _checkpoint(lambda found: found.update({KEY: change(found[KEY])}))


def _texts(old):
    """Every text of a session hidden characters."""
    return each(old, lambda leaf: HIDDEN if isinstance(leaf, str) else leaf)


ELSEWHERE = "only svfl-train info and export read it"
OF_PROVENANCE = {
    "provenance_text": _provenance(lambda old: "x"),
    "provenance_numbers": _provenance(lambda old: [1, 2]),
    "provenance_long": _provenance(lambda old: [old[0] | {"command": "x" * 10**7}]),
    "provenance_many": _provenance(lambda old: old * 10**5),
    "provenance_tensor": _provenance(lambda old: [old[0] | {"seeds": __import__("torch").zeros(9)}]),
    "provenance_nested": _provenance(lambda old: [[[[[[old]]]]]]),
    "provenance_escapes": _provenance(lambda old: [_texts(old[0])]),
    "provenance_keys": _provenance(
        lambda old: [old[0] | {"packages": {HIDDEN: HIDDEN}, "data": {HIDDEN: {"path": HIDDEN}}}]
    ),
}


def _leaves(change):
    return _checkpoint(lambda found: found.update(hyper_parameters=each(found["hyper_parameters"], change)))


CHANGES |= {
    "parameters_all_huge": _leaves(lambda old: 10**9 if type(old) is int else old),
    "parameters_all_negative": _leaves(lambda old: -1 if type(old) is int else old),
    "parameters_all_texts": _leaves(lambda old: "x"),
    "parameters_all_null": _leaves(lambda old: None),
    "parameters_all_lists": _leaves(lambda old: [old] * 3),
    "parameters_all_nan": _leaves(lambda old: float("nan") if isinstance(old, float) else old),
    "parameters_escapes": _leaves(lambda old: HIDDEN if isinstance(old, str) else old),
}
LAWFUL = {"parameters_all_nan": "where nothing is a float nothing changes"}
for file in CHECKPOINTS:
    for name, make in CHANGES.items():
        register(file, name, make, LAWFUL.get(name, ""))
    for name, make in OF_PROVENANCE.items():
        register(file, name, make, ELSEWHERE)


def _resumed(file, name, make):
    """A training's folder, as an interrupted one leaves it, but for its checkpoint."""

    def spoil(folder):
        made = folder.parent / "out" / "made"
        shutil.copytree(folder.parent / "models" / file.replace(".ckpt", "_run"), made)
        (made / "result.json").unlink(missing_ok=True)
        make(folder.parent / "models" / file, made / "checkpoint.ckpt", folder)

    add("resumed", f"{file.partition('.')[0]}_{name}", f"{file}_run", spoil)


for file in ("bc.ckpt", "latent.ckpt"):
    for name in ("empty", "text", "truncated", "plain_pickle", "torch_saved_payload", "zip_of_pickles"):
        _resumed(file, name, whole(WHOLE[name]))
    for name in ("weights_nan", "weights_missing", "parameters_missing", "a_list", "weights_flat", "mark_missing"):
        _resumed(file, name, CHANGES[name])


def _run_file(file, name, member, content):
    def spoil(folder):
        made = folder.parent / "out" / "made"
        shutil.copytree(folder.parent / "models" / file.replace(".ckpt", "_run"), made)
        (made / member).write_bytes(content)

    add("resumed", f"{file.partition('.')[0]}_{member.partition('.')[0]}_{name}", f"{file}_run", spoil,
        legal="only what is read again must be right")  # fmt: skip


CONTENTS = {
    "empty": b"", "deep": b"[" * 10**5 + b"]" * 10**5, "binary": b"\xff" * 99, "list": b"[]", "null": b"null",
    "escapes": json.dumps({HIDDEN: HIDDEN}).encode(),
}  # fmt: skip
for file in ("bc.ckpt", "latent.ckpt"):
    for member in ("run.yaml", "metrics.csv", "result.json", "provenance.json"):
        for name, content in CONTENTS.items():
            _run_file(file, name, member, content)
