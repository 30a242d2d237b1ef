"""Objects that own a file, a thread, a lock or a simulation, and therefore work in one process only.

A forked process gets a copy of them that looks usable: it shares the file but not the memory behind it, its threads do
not run, its locks may be held for ever. So such an object remembers its process, refuses every use in another one, and
can be neither pickled nor copied.
"""

import os
import weakref
from typing import Any, ClassVar, NoReturn, Self, SupportsIndex

from svfl_data.errors import UsageError

_owners: "weakref.WeakValueDictionary[int, OwnProcess]" = weakref.WeakValueDictionary()
"""Every such object that lives, by its `id`: not all of them can be hashed."""


class OwnProcess:
    """Base of such objects.

    Public methods begin with ``self.check_process()``. What also runs without being called (``__exit__``, ``__del__``,
    a function registered for the end of the process) returns at once unless `in_own_process`. What must not stay open
    in a forked process is given up in `forked`.
    """

    instead: ClassVar[str] = "make another one in that process"
    """What to do in another process; ends the message of the refusal."""
    _process: int

    def __new__(cls, *_: Any, **__: Any) -> Self:  # noqa: ANN401 - arguments of the subclass
        """Remember the process, whatever kind of class the subclass is."""
        self = super().__new__(cls)
        object.__setattr__(self, "_process", os.getpid())
        _owners[id(self)] = self
        return self

    @property
    def in_own_process(self) -> bool:
        """Whether this is the process that made the object."""
        return self._process == os.getpid()

    def check_process(self) -> None:
        """Refuse to be used in another process.

        Raises:
            UsageError: If this is not the process that made the object.
        """
        if not self.in_own_process:
            raise UsageError(
                f"{type(self).__name__} belongs to process {self._process} and was used in process {os.getpid()}, "
                f"a fork of it; {self.instead}"
            )

    def forked(self) -> None:
        """Called in a forked process right after the fork: close here what only the parent may hold."""

    def __reduce_ex__(self, protocol: SupportsIndex, /) -> NoReturn:
        """Refuse `pickle`, `copy.copy` and `copy.deepcopy`.

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
