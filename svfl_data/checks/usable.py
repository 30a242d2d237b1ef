"""Selection of the episodes that training may use: those in which ``svfl-data validate`` finds no error."""

import sys
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from svfl_data.checks.episode_checks import check_images, check_streams
from svfl_data.checks.finding import Finding
from svfl_data.checks.findings_cache import FindingsCache
from svfl_data.checks.placing import check_place
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, SvflError
from svfl_data.storage.reader import EpisodeReader
from svfl_data.system.progress import progress

STREAMS = "streams"
"""Name of the part of the checks that looks at no image. The other parts have the names of the cameras."""


def check_usable(dataset: Dataset, episodes: Sequence[int], uses: Collection[str] | None = None) -> None:
    """Refuse episodes in which ``svfl-data validate`` finds an error; print in one line how many have warnings.

    Args:
        dataset: Dataset to which the episodes belong.
        episodes: Indices of the episodes to check.
        uses: Groups that will be read, in addition to observations, actions and constants, such as ``streams/wrench``,
            ``cameras/front`` or ``labels/offset``. Findings about other streams, cameras and labels are ignored. None
            means everything.

    Raises:
        DatasetError: If an episode is unfit for training.
        FieldError: If an episode is invalid (`svfl_data.schema.validity`).
        FormatError: If an episode is damaged.
    """
    unfit: list[Finding] = []
    doubtful: list[Finding] = []
    with FindingsCache() as cache:
        for index in progress(episodes, "checking episodes"):
            found = [*check_place(dataset, index), *_findings(dataset.episode(index), uses, cache)]
            for severity, first in (("error", unfit), ("warning", doubtful)):
                first += [finding for finding in found if finding.severity == severity][:1]
    if unfit:
        raise DatasetError(
            f"{dataset.path}: {len(unfit)} of {len(episodes)} episodes are unfit for training; {_first(unfit)}; "
            "svfl-data validate names them all, svfl-data filter DATASET NEW --valid leaves them out"
        )
    if doubtful:
        print(
            f"{dataset.path}: {len(doubtful)} of {len(episodes)} episodes have warnings, which svfl-data validate "
            f"names; {_first(doubtful)}",
            file=sys.stderr,
        )


def sound(dataset: Dataset) -> list[int]:
    """Return the indices of the episodes in which ``svfl-data validate`` finds no error.

    Episodes that cannot be read are left out.
    """
    found: list[int] = []
    with FindingsCache() as cache:
        for index in progress(dataset.indices, "checking episodes"):
            with suppress(SvflError):
                if all(finding.severity != "error" for finding in _findings(dataset.episode(index), None, cache)):
                    found.append(index)
    return found


def _first(findings: Sequence[Finding]) -> str:
    """Describe the first of several findings, with the name of its file but without the folder."""
    return f"the first: {replace(findings[0], episode=Path(findings[0].episode).name)}"


def _findings(reader: EpisodeReader, uses: Collection[str] | None, cache: FindingsCache) -> list[Finding]:
    """Return the findings about the groups that are used; images of cameras that are not used are not looked at."""
    cameras = [camera for camera in reader.cameras if uses is None or f"cameras/{camera}" in uses]
    findings: list[Finding] = []
    for part in (STREAMS, *cameras):
        found = cache.known(reader.seal, part, str(reader.extent))
        if found is None:
            episode = reader.load(images=False)
            found = check_streams(episode) if part == STREAMS else check_images(episode, part)
            cache.keep(reader.seal, part, found)
        findings += found
    return [finding for finding in findings if uses is None or _concerns(finding, uses)]


def _concerns(finding: Finding, uses: Collection[str]) -> bool:
    kind, _, rest = finding.field.partition("/")
    return kind not in ("streams", "cameras", "labels") or f"{kind}/{rest.partition('/')[0]}" in uses
