"""Base class of objects that own a file, a thread, a lock or a simulation, and therefore work in one process only.

A forked process gets a copy of such an object that looks usable. But the copy shares the file without the memory behind
it, its threads do not run, and its locks may be held for ever. So such an object remembers the process that made it,
refuses every use in another process, and can be neither pickled nor copied.
"""

import os
import weakref
from typing import Any, ClassVar, NoReturn, Self, SupportsIndex

from svfl_data.errors import UsageError

_owners: "weakref.WeakValueDictionary[int, OwnProcess]" = weakref.WeakValueDictionary()
"""Every living `OwnProcess` object by its `id`, because not all of them can be hashed."""


class OwnProcess:
    """Base class of objects that can be used only in the process that made them.

    Public methods of a subclass begin with ``self.check_process()``. Methods that also run without being called
    (``__exit__``, ``__del__``, a function registered for the end of the process) return at once unless `in_own_process`
    is true. A subclass closes in `forked` what must not stay open in a forked process.
    """

    instead: ClassVar[str] = "make another one in that process"
    """Advice on what to do in another process, which ends the error message."""
    _process: int

    def __new__(cls, *_: Any, **__: Any) -> Self:  # noqa: ANN401 - arguments of the subclass
        """Create the object and remember this process, also if the subclass is a frozen dataclass."""
        self = super().__new__(cls)
        object.__setattr__(self, "_process", os.getpid())
        _owners[id(self)] = self
        return self

    @property
    def in_own_process(self) -> bool:
        """Whether this process is the one that made the object."""
        return self._process == os.getpid()

    def check_process(self) -> None:
        """Raise an error if this process is not the one that made the object.

        Raises:
            UsageError: If another process made the object.
        """
        if not self.in_own_process:
            raise UsageError(
                f"{type(self).__name__} belongs to process {self._process} and was used in process {os.getpid()}, "
                f"a fork of it; {self.instead}"
            )

    def forked(self) -> None:
        """Close what only the parent process may hold open; called in a forked process right after the fork."""

    def __reduce_ex__(self, protocol: SupportsIndex, /) -> NoReturn:
        """Refuse to be pickled or copied by `pickle`, `copy.copy` and `copy.deepcopy`.

        Raises:
            UsageError: Always.
        """
        raise UsageError(
            f"{type(self).__name__} can be neither pickled nor copied, for it holds what only process {self._process} "
            f"has open; {self.instead}"
        )


def _tell_forked() -> None:
    for owner in list(_owners.values()):
        owner.forked()


os.register_at_fork(after_in_child=_tell_forked)
