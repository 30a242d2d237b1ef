"""Descriptions of an arm, for ``svfl-data view --urdf``, by somebody who wants other files drawn into the recording."""

import os

from tests.hostile.json_attributes import HIDDEN
from tests.hostile.kind import add, outside

JOINTS = 9
"""As many as the sound episodes have."""
FILE = "arm.urdf"
AXIS = "<axis xyz='0 0 1'/><limit lower='-3' upper='3' effort='1' velocity='1'/>"


def arm(mesh="", name="arm", count=JOINTS, head=""):
    """A chain of links; the first one may have a mesh."""
    drawn = f"<visual><geometry><mesh filename='{mesh}'/></geometry></visual>" if mesh else ""
    links = [f"<link name='l{k}'>{drawn if k == 0 else ''}</link>" for k in range(count + 1)]
    joints = [
        f"<joint name='j{k}' type='revolute'><parent link='l{k}'/><child link='l{k + 1}'/>{AXIS}</joint>"
        for k in range(count)
    ]
    return f"<?xml version='1.0'?>{head}<robot name='{name}'>{''.join(links + joints)}</robot>"


LAUGHS = "<!DOCTYPE robot [<!ENTITY a0 'ha'>" + "".join(
    f"<!ENTITY a{k + 1} '{f'&a{k};' * 10}'>" for k in range(9)
) + "]>"  # fmt: skip
TEXTS = {
    "laughs": lambda folder: arm(name="&a9;", head=LAUGHS),
    "external_entity": lambda folder: arm(
        name="&x;", head=f"<!DOCTYPE robot [<!ENTITY x SYSTEM 'file://{outside(folder)}'>]>"
    ),
    "external_definition": lambda folder: arm(head=f"<!DOCTYPE robot SYSTEM 'file://{outside(folder, 'pipe')}'>"),
    "empty": lambda folder: "",
    "text": lambda folder: "hello",
    "no_robot": lambda folder: "<x/>",
    "deep": lambda folder: "<robot name='x'>" + "<link>" * 50_000 + "</link>" * 50_000 + "</robot>",
    "few_joints": lambda folder: arm(count=2),
    "joint_without_links": lambda folder: "<robot name='x'><link name='a'/><joint name='j' type='revolute'/></robot>",
    "joints_in_a_circle": lambda folder: arm().replace("<child link='l9'/>", "<child link='l0'/>"),
    "joint_to_itself": lambda folder: arm().replace("<child link='l1'/>", "<child link='l0'/>"),
    "unknown_link": lambda folder: arm().replace("<parent link='l3'/>", "<parent link='nobody'/>"),
    "numbers_nan": lambda folder: arm().replace("xyz='0 0 1'", "xyz='nan nan nan'"),
    "numbers_text": lambda folder: arm().replace("xyz='0 0 1'", "xyz='a b c'"),
    "origin_short": lambda folder: arm(mesh="a.stl").replace("<visual>", "<visual><origin xyz='1' rpy='x'/>"),
    "binary": lambda folder: bytes(range(256)).decode("latin-1"),
}
ALLOWED = {
    "numbers_nan": "an axis of no direction draws a still joint", "origin_short": "there is no such mesh to place",
    "external_definition": "what is not fetched does no harm",
}  # fmt: skip
MESHES = {
    "secret": lambda folder: "outside/secret",
    "secret_above": lambda folder: "../" * 20 + str(outside(folder)),
    "secret_absolute": lambda folder: str(outside(folder)),
    "passwords": lambda folder: "/etc/passwd",
    "package": lambda folder: "package://outside/secret",
    "zeros": lambda folder: "/dev/zero",
    "pipe": lambda folder: "outside/pipe",
    "link": lambda folder: "link.stl",
    "network": lambda folder: "http://localhost:1/x.stl",
    "garbage": lambda folder: "garbage.stl",
}


def _written(content):
    def make(folder):
        box = folder.parent
        (box / "link.stl").symlink_to(outside(folder))
        (box / "garbage.stl").write_bytes(b"garbage" * 100)
        (box / FILE).write_text(content(folder), encoding="utf-8")

    return make


def _instead(make):
    return lambda folder: make(folder.parent / FILE, folder)


for name, content in TEXTS.items():
    add("urdfs", name, "urdf", _written(content), ALLOWED.get(name, ""))
for name, mesh in MESHES.items():
    add("urdfs", f"mesh_{name}", "urdf", _written(lambda folder, mesh=mesh: arm(mesh(folder))),
        legal="an arm is drawn without a mesh that is not there")  # fmt: skip
add("urdfs", "escapes", "urdf", _written(lambda folder: arm(name=HIDDEN.encode("ascii", "xmlcharrefreplace").decode())))
add("urdfs", "thousand_joints", "urdf", _written(lambda folder: arm(count=3000)))
add("urdfs", "pipe", "urdf", _instead(lambda file, folder: os.mkfifo(file)))
add("urdfs", "link_to_zeros", "urdf", _instead(lambda file, folder: file.symlink_to("/dev/zero")))
add("urdfs", "link_to_a_secret", "urdf", _instead(lambda file, folder: file.symlink_to(outside(folder))))
add("urdfs", "folder", "urdf", _instead(lambda file, folder: file.mkdir()))
