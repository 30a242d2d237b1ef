"""Tools to record, check, read, split, sample, replay and view episodes of manipulation with vision and force.

The names below are the public interface, which is documented and kept stable; everything else in this package is
private. Each name is loaded when it is first used.

    >>> import svfl_data
    >>> "Dataset" in dir(svfl_data)
    True
"""

from typing import TYPE_CHECKING

from svfl_data.system.extras import explain_missing
from svfl_data.system.lazy_names import lazy_names

if TYPE_CHECKING:
    from svfl_data.checks import check_dataset as check_dataset
    from svfl_data.checks import check_episode as check_episode
    from svfl_data.checks import check_file as check_file
    from svfl_data.datasets.dataset import Dataset as Dataset
    from svfl_data.datasets.dataset import open_dataset as open_dataset
    from svfl_data.errors import SvflError as SvflError
    from svfl_data.maintenance.merge import merge as merge
    from svfl_data.maintenance.pack import pack as pack
    from svfl_data.maintenance.pack import unpack as unpack
    from svfl_data.maintenance.repair import repair_dataset as repair_dataset
    from svfl_data.recording.index_locks import NEXT as NEXT
    from svfl_data.recording.recording_clocks import Gap as Gap
    from svfl_data.recording.writer import EpisodeWriter as EpisodeWriter
    from svfl_data.replay.buffer import ReplayBuffer as ReplayBuffer
    from svfl_data.replay.config import ReplayConfig as ReplayConfig
    from svfl_data.sampling.cut import cut_steps as cut_steps
    from svfl_data.sampling.live_cut import LiveCut as LiveCut
    from svfl_data.sampling.samples import Samples as Samples
    from svfl_data.sampling.split import Split as Split
    from svfl_data.sampling.split import load_split as load_split
    from svfl_data.sampling.split import split_episodes as split_episodes
    from svfl_data.sampling.statistics import compute_statistics as compute_statistics
    from svfl_data.sampling.torch_samples import TorchSamples as TorchSamples
    from svfl_data.sampling.windows import wrench_window as wrench_window
    from svfl_data.schema.action_fields import joint_action as joint_action
    from svfl_data.schema.action_fields import planar_action as planar_action
    from svfl_data.schema.action_fields import pose_action as pose_action
    from svfl_data.schema.declarations import Declarations as Declarations
    from svfl_data.schema.declarations import wrench_stream as wrench_stream
    from svfl_data.schema.episode import Camera as Camera
    from svfl_data.schema.episode import Episode as Episode
    from svfl_data.schema.episode import Meta as Meta
    from svfl_data.schema.episode import MissingField as MissingField
    from svfl_data.schema.field import Field as Field
    from svfl_data.schema.fields import FIELDS as FIELDS
    from svfl_data.schema.input_spec import InputSpec as InputSpec
    from svfl_data.schema.input_spec import Window as Window
    from svfl_data.schema.observation import Frame as Frame
    from svfl_data.schema.observation import Observation as Observation
    from svfl_data.schema.optics import Calibration as Calibration
    from svfl_data.schema.optics import image_axes as image_axes
    from svfl_data.schema.robot import Robot as Robot
    from svfl_data.signals.contact import ContactRule as ContactRule
    from svfl_data.signals.contact import contact_intervals as contact_intervals
    from svfl_data.signals.topdown import topdown as topdown
    from svfl_data.signals.transforms import Gravity as Gravity
    from svfl_data.signals.transforms import LowPass as LowPass
    from svfl_data.signals.transforms import Tare as Tare
    from svfl_data.signals.transforms import processed_wrench as processed_wrench
    from svfl_data.storage.reader import EpisodeReader as EpisodeReader
    from svfl_data.storage.reader import read_episode as read_episode
    from svfl_data.storage.store import write_episode as write_episode
    from svfl_data.symmetry import Part as Part
    from svfl_data.symmetry import act as act

    __version__: str

HOMES = {
    "Calibration": "schema.optics", "Camera": "schema.episode", "ContactRule": "signals.contact",
    "Dataset": "datasets.dataset", "Declarations": "schema.declarations", "Episode": "schema.episode",
    "EpisodeReader": "storage.reader",
    "EpisodeWriter": "recording.writer", "FIELDS": "schema.fields", "Field": "schema.field",
    "Frame": "schema.observation",
    "Gap": "recording.recording_clocks", "Gravity": "signals.transforms", "LowPass": "signals.transforms",
    "LiveCut": "sampling.live_cut",
    "Meta": "schema.episode", "MissingField": "schema.episode", "NEXT": "recording.index_locks",
    "Observation": "schema.observation", "Part": "symmetry", "ReplayBuffer": "replay.buffer",
    "ReplayConfig": "replay.config", "Robot": "schema.robot", "Samples": "sampling.samples", "Split": "sampling.split",
    "SvflError": "errors", "Tare": "signals.transforms", "TorchSamples": "sampling.torch_samples", "act": "symmetry",
    "check_dataset": "checks", "check_episode": "checks", "check_file": "checks",
    "compute_statistics": "sampling.statistics", "contact_intervals": "signals.contact", "cut_steps": "sampling.cut",
    "InputSpec": "schema.input_spec", "Window": "schema.input_spec",
    "image_axes": "schema.optics", "joint_action": "schema.action_fields", "load_split": "sampling.split",
    "merge": "maintenance.merge", "open_dataset": "datasets.dataset",
    "pack": "maintenance.pack", "planar_action": "schema.action_fields", "pose_action": "schema.action_fields",
    "processed_wrench": "signals.transforms", "read_episode": "storage.reader",
    "repair_dataset": "maintenance.repair", "split_episodes": "sampling.split", "topdown": "signals.topdown",
    "unpack": "maintenance.pack", "wrench_window": "sampling.windows", "wrench_stream": "schema.declarations",
    "write_episode": "storage.store",
}  # fmt: skip
"""Module of every public name, relative to this package."""

explain_missing()
__getattr__, __dir__ = lazy_names(__name__, HOMES)
