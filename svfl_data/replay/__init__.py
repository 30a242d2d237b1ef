"""Prioritised replay of whole episodes, preloaded with demonstrations, for agents that collect further episodes.

Example, with one of the environments of `collectors.environment`::

    buffer = ReplayBuffer.from_demos(Dataset.open("data/block_picking"), episodes=50)
    batch = buffer.sample(64)
    buffer.update_priorities(batch["index"], td_error)

    env = Environment("block_picking")
    observation, _ = env.reset()
    buffer.begin_episode(observation, spec=ReplaySpec.of_environment(env, "block_picking"))
    buffer.add(action, *env.step(action)[:4])

Without further words the inputs are those of the paper. Any others, and any action, are said as for `Samples`::

    inputs = InputSpec(cameras=("front", "wrist"), windows={"streams/tactile/pressure": Window(4, rate_hz=100)})
    buffer = ReplayBuffer.from_demos(Dataset.open("data/mine"), 1, inputs=inputs)
"""

from svfl_data.replay.buffer import ReplayBuffer
from svfl_data.replay.config import ReplayConfig
from svfl_data.replay.specs.recorded_spec import RecordedSpec
from svfl_data.replay.specs.replay_spec import ReplaySpec

__all__ = ["RecordedSpec", "ReplayBuffer", "ReplayConfig", "ReplaySpec"]
