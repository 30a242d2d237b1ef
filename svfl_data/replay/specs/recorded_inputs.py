"""What the transitions of a replay buffer with any inputs and any action consist of."""

from dataclasses import dataclass
from typing import Any

from svfl_data.schema.field import Field
from svfl_data.schema.input_spec import InputSpec


@dataclass(frozen=True)
class RecordedInputs:
    """Inputs and action of transitions, with their declarations and the calibration of the cameras.

    Attributes:
        task: Name of the task.
        inputs: What is taken at each observation.
        action: Path of the action.
        fields: Declarations of the images, windows, vectors and the action, sorted by path, with the sizes that were
            recorded.
        constants: Calibration of the cameras by path, as nested tuples.
        centre: Workspace centre, base (x, y), [m], about which positions rotate; None if the episodes have no
            workspace.
        invariant: Paths of arrays, or ``cameras/NAME``, that stay when a transition is rotated: sensors on the gripper,
            cameras without a pose, and what has no direction.
        moving: Names of the cameras that move and whose poses are known, in the order of the inputs. Their images stay
            when a transition is rotated; their image axes at each frame are rotated.
    """

    task: str
    inputs: InputSpec
    action: str
    fields: tuple[Field, ...]
    constants: dict[str, Any]
    centre: tuple[float, float] | None = None
    invariant: tuple[str, ...] = ()
    moving: tuple[str, ...] = ()

    def field(self, path: str) -> Field:
        """Return the declaration of an input or of the action.

        Raises:
            ValueError: If there is none at the path.
        """
        found = [field for field in self.fields if field.path == path]
        if not found:
            raise ValueError(f"{path} is not declared")
        return found[0]
