"""The errors a user can cause: one line each, saying what was asked, what was found, what is possible and where."""


class SvflError(Exception):
    """Root of every error that is the user's to mend; a command prints it in one line and exits with 1.

    Example:
        >>> try:
        ...     Dataset.open("data/none")
        ... except SvflError as error:
        ...     print(error)
        data/none: no such folder
    """

    exit_code = 1


class UsageError(SvflError):
    """A command or function was called with an argument that cannot work; commands exit with 2."""

    exit_code = 2


class FormatError(SvflError):
    """A file or folder is not what its name promises: missing, truncated, foreign or of another version."""


class FieldError(SvflError):
    """An array does not fit its declaration in `svfl_data.schema.fields`: missing, shape, dtype or value."""


class DatasetError(SvflError):
    """A dataset as a whole cannot serve the request: other content, too few episodes, no labels."""


class CollectError(SvflError):
    """A collector could not produce an episode as asked."""


class StorageError(SvflError):
    """The disk refused: no space, no permission, read-only."""


class TrainingError(SvflError):
    """A network cannot be built, loaded or trained as asked."""
