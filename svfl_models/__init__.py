"""Networks that are equivariant to planar rotations and reflections, and the programs that train them.

The names below are the public interface, which is documented and kept stable; everything else in this package is
private. Each name is loaded when it is first used, and PyTorch is loaded with it.

    >>> import svfl_models
    >>> "SymmetricConv" in dir(svfl_models)
    True
"""

from typing import TYPE_CHECKING

import svfl_data  # noqa: F401 - its import errors say which extra installs a library that is missing
from svfl_data.system.lazy_names import lazy_names

if TYPE_CHECKING:
    from svfl_models.centering.checkpoint import load_classifier as load_classifier
    from svfl_models.centering.classifier import CenteringClassifier as CenteringClassifier
    from svfl_models.centering.config import TrainingConfig as TrainingConfig
    from svfl_models.centering.train import train_centering as train_centering
    from svfl_models.cloning.checkpoint import load_policy as load_policy
    from svfl_models.cloning.config import CloningConfig as CloningConfig
    from svfl_models.cloning.train import train_cloning as train_cloning
    from svfl_models.latent.checkpoint import load_latent as load_latent
    from svfl_models.latent.config import LatentConfig as LatentConfig
    from svfl_models.latent.train import train_latent as train_latent
    from svfl_models.networks.encoders import ForceEncoder as ForceEncoder
    from svfl_models.networks.encoders import Fusion as Fusion
    from svfl_models.networks.encoders import VectorEncoder as VectorEncoder
    from svfl_models.networks.encoders import VisionEncoder as VisionEncoder
    from svfl_models.networks.heads import Actor as Actor
    from svfl_models.networks.heads import Critic as Critic
    from svfl_models.networks.policy import Policy as Policy
    from svfl_models.networks.visual_force import VisualForceEncoder as VisualForceEncoder
    from svfl_models.symmetry.groups import GROUPS as GROUPS
    from svfl_models.symmetry.groups import Group as Group
    from svfl_models.symmetry.layers import SymmetricConv as SymmetricConv
    from svfl_models.symmetry.layers import SymmetricLinear as SymmetricLinear
    from svfl_models.symmetry.testing import assert_equivariant as assert_equivariant
    from svfl_models.symmetry.testing import equivariance_error as equivariance_error

    __version__: str

HOMES = {
    "Actor": "networks.heads", "CenteringClassifier": "centering.classifier", "CloningConfig": "cloning.config",
    "Critic": "networks.heads", "ForceEncoder": "networks.encoders", "Fusion": "networks.encoders",
    "GROUPS": "symmetry.groups", "Group": "symmetry.groups", "LatentConfig": "latent.config",
    "Policy": "networks.policy", "VectorEncoder": "networks.encoders", "SymmetricConv": "symmetry.layers",
    "SymmetricLinear": "symmetry.layers", "TrainingConfig": "centering.config", "VisionEncoder": "networks.encoders",
    "VisualForceEncoder": "networks.visual_force", "assert_equivariant": "symmetry.testing",
    "equivariance_error": "symmetry.testing", "load_classifier": "centering.checkpoint",
    "load_latent": "latent.checkpoint", "load_policy": "cloning.checkpoint", "train_centering": "centering.train",
    "train_cloning": "cloning.train", "train_latent": "latent.train",
}  # fmt: skip
"""The module that defines each public name, relative to this package."""

__getattr__, __dir__ = lazy_names(__name__, HOMES)
