"""Declarations of actions that are given: planar with a gripper, a pose change with a gripper, and joint space."""

import math
from collections.abc import Sequence
from dataclasses import replace

from svfl_data.schema.field import Field
from svfl_data.symmetry import ACTION_PARTS, Part

ACTION, EXPERT_ACTION = "actions/action", "actions/expert_action"
MAX_MOVE_M, MAX_TURN_RAD = 0.025, math.pi / 16
"""Largest displacement along each axis, [m], and largest yaw change, [rad], of one action in the paper (Kohler et al.,
CoRL 2023, section 5)."""
POSE_PARTS = (
    Part("vector", (0, 1)), Part("invariant", (2,)), Part("axial", (3, 4)), Part("pseudoscalar", (5,)),
    Part("invariant", (6,)),
)  # fmt: skip
"""Parts of a pose change with a gripper. A rotation vector is axial: under a reflection of the plane, a rotation about
an axis in the plane becomes one about the mirrored axis in the opposite sense."""


def planar_action(max_move: float = MAX_MOVE_M, max_turn: float = MAX_TURN_RAD, path: str = ACTION) -> Field:
    """Return the declaration of the paper's action: gripper opening, dx, dy, dz and dtheta, in base axes.

    Args:
        max_move: Largest magnitude of dx, dy and dz, [m].
        max_turn: Largest magnitude of dtheta, [rad].
        path: Dataset path of the array.

    Example:
        >>> planar_action(max_move=0.05).bounds[1]
        (-0.05, 0.05)
    """
    return Field(
        path=path, name="action" if path == ACTION else "", dtype="float32", shape=("N", 5), unit="-, m, m, m, rad",
        doc="Commanded after observation t: gripper opening, then TCP displacement and yaw change.",
        axes="base", components=("opening", "dx", "dy", "dz", "dtheta"), parts=ACTION_PARTS,
        bounds=((0.0, 1.0), *[(-max_move, max_move)] * 3, (-max_turn, max_turn)),
        delta=(False, True, True, True, True),
    )  # fmt: skip


def pose_action(max_move: float, max_turn: float, path: str = ACTION) -> Field:
    """Return the declaration of a pose change with a gripper: dx, dy, dz, rotation vector rx, ry, rz, gripper opening.

    Args:
        max_move: Largest magnitude of dx, dy and dz, [m].
        max_turn: Largest magnitude of rx, ry and rz, [rad].
        path: Dataset path of the array. Two arms are two actions, such as ``actions/left`` and ``actions/right``.

    Example:
        >>> pose_action(0.02, 0.1).components[-1]
        'opening'
    """
    return Field(
        path=path, name="action" if path == ACTION else "", dtype="float32", shape=("N", 7),
        unit="m, m, m, rad, rad, rad, -",
        doc="Commanded after observation t: TCP displacement, then rotation vector in base axes, then gripper opening.",
        axes="base", components=("dx", "dy", "dz", "rx", "ry", "rz", "opening"), parts=POSE_PARTS,
        bounds=(*[(-max_move, max_move)] * 3, *[(-max_turn, max_turn)] * 3, (0.0, 1.0)),
        delta=(True,) * 6 + (False,),
    )  # fmt: skip


def joint_action(
    bounds: Sequence[tuple[float, float]], components: Sequence[str], delta: bool = False, unit: str = "rad",
    path: str = ACTION,
) -> Field:  # fmt: skip
    """Return the declaration of a joint-space action, which has no planar parts: only plain networks can learn it.

    Args:
        bounds: Smallest and largest command of each joint, in its unit.
        components: Names of the joints, and of the gripper if it is commanded with them.
        delta: Whether commands are changes relative to the measured positions.
        unit: Unit of the commands, or the units of all components, separated by commas.
        path: Dataset path of the array.

    Example:
        >>> joint_action([(-3.14, 3.14)] * 6, [f"joint_{number}" for number in range(6)]).shape
        ('N', 6)
    """
    return Field(
        path=path, name="action" if path == ACTION else "", dtype="float32", shape=("N", len(components)), unit=unit,
        doc="Commanded after observation t: joint positions.", components=tuple(components), bounds=tuple(bounds),
        delta=(delta,) * len(components),
    )  # fmt: skip


def expert(action: Field) -> Field:
    """Return the declaration of what an expert meant where its gripper was perturbed, for the given action.

    Args:
        action: Declaration of ``actions/action``.
    """
    return replace(
        action, path=EXPERT_ACTION, name="expert_action",
        doc="What an expert meant when its gripper was pushed off its way now and then; `action` is what was "
        "commanded.",
    )  # fmt: skip
