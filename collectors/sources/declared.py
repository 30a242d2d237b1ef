"""Declarations of what a simulated robot records, which follow from the configuration of its world."""

from collectors.simulation.config import WorldConfig
from svfl_data.schema.action_fields import expert, planar_action
from svfl_data.schema.declarations import Declarations


def declarations_of(world: WorldConfig) -> Declarations:
    """Return the declarations of an episode in a simulated world: the standard ones, with the world's action bounds.

    Args:
        world: Configuration of the world.
    """
    action = planar_action(world.max_move, world.max_turn)
    return Declarations([action, expert(action)])
