"""Errors that a user can cause; the message is one line that says what was asked, found and possible, and where."""


class SvflError(Exception):
    """Base class of all errors that the user can correct; a command prints the message in one line and ends.

    Attributes:
        exit_code: Exit code of a command that ends with this error; 1 by default.

    Example:
        >>> try:
        ...     Dataset.open("data/none")
        ... except SvflError as error:
        ...     print(error)
        data/none: no such folder
    """

    exit_code = 1


class UsageError(SvflError):
    """A command or function was called with an argument that cannot work; a command then exits with code 2."""

    exit_code = 2


class FormatError(SvflError):
    """A file or folder is not what its name promises: it is missing, truncated, foreign or of another version."""


class OldVersionError(FormatError):
    """An episode is of version 1 of the format, which only ``svfl-data upgrade`` reads."""


class FieldError(SvflError):
    """An array is missing, or its shape, dtype or values do not fit its declaration in `svfl_data.schema.fields`."""


class DatasetError(SvflError):
    """A dataset as a whole cannot serve the request, because it has other content, too few episodes or no labels."""


class CollectError(SvflError):
    """A collector could not produce an episode as asked."""


class StorageError(SvflError):
    """The disk refused an operation, because it has no space or is read-only, or permission is missing."""


class TrainingError(SvflError):
    """A network cannot be built, loaded or trained as asked."""
