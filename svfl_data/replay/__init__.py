"""Prioritised replay of whole episodes, preloaded with demonstrations, for agents that collect further episodes.

Example, with one of the environments of `collectors.environment`::

    buffer = ReplayBuffer.from_demos(Dataset.open("data/block_picking"), episodes=50)
    batch = buffer.sample(64)
    buffer.update_priorities(batch["index"], td_error)

    env = Environment("block_picking")
    observation, _ = env.reset()
    buffer.begin_episode(observation, spec=ReplaySpec.of_environment(env, "block_picking"))
    buffer.add(action, *env.step(action)[:4])
"""

from svfl_data.replay.buffer import ReplayBuffer
from svfl_data.replay.config import ReplayConfig
from svfl_data.replay.replay_spec import ReplaySpec

__all__ = ["ReplayBuffer", "ReplayConfig", "ReplaySpec"]
