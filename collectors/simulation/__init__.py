"""Block worlds in PyBullet: an arm with a compliant gripper, a wrist force-torque sensor and a fixed RGB-D camera."""

from collectors.simulation.admittance import AdmittanceConfig
from collectors.simulation.arms.panda import PandaConfig
from collectors.simulation.arms.ur5e import UR5eConfig
from collectors.simulation.camera import CameraConfig
from collectors.simulation.config import WorldConfig
from collectors.simulation.noise import NoiseConfig
from collectors.simulation.world import World

__all__ = [
    "AdmittanceConfig",
    "CameraConfig",
    "NoiseConfig",
    "PandaConfig",
    "UR5eConfig",
    "World",
    "WorldConfig",
]
