"""What a setting of a program is: its name, type, possible values and help, as a field of a dataclass declares them."""

import dataclasses
import difflib
import math
import types
import typing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

UNSET = dataclasses.MISSING
_UNION = type(typing.Optional[int])  # noqa: UP045 - `Annotated[...] | None` is of this type


def option(
    description: str,
    *,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    choices: Sequence[object] = (),
    partial: type | None = None,
    keys: Sequence[str] = (),
    metavar: str = "",
    flag: bool = True,
) -> msgspec.Meta:
    """Declare a setting, as metadata of the type of a dataclass's field.

    Args:
        description: Help text, without the default.
        ge: Smallest possible number.
        gt: Number that must be exceeded.
        le: Largest possible number.
        choices: Possible values; none means that all values of the type are possible.
        partial: Dataclass, any of whose fields the setting, a mapping, may replace.
        keys: Possible keys of the setting, a mapping of names to numbers.
        metavar: Stands for the value in the help.
        flag: Whether the command line has an option of its own for the setting.

    Example:
        >>> @dataclass(frozen=True)
        ... class Training:
        ...     epochs: Annotated[int, option("number of epochs to train", ge=1)] = 60
        >>> [setting.name for setting in settings_of(Training)]
        ['epochs']
    """
    extra = {"choices": tuple(choices), "partial": partial, "keys": tuple(keys), "metavar": metavar, "flag": flag}
    limits: dict[str, Any] = {"ge": ge, "gt": gt, "le": le}
    given = {name: limit for name, limit in limits.items() if limit is not None}
    return msgspec.Meta(description=description, extra=extra, **given)


@dataclass(frozen=True)
class Setting:
    """One setting of a program.

    Attributes:
        name: Name in files and in Python, such as ``learning_rate``.
        type: Type of its values, with `msgspec.Meta` for the possible ones.
        default: Value if none is given; `UNSET` if one must be given.
        help: Help text, without the default.
        choices: Possible values; empty if all values of the type are possible.
        partial: Dataclass whose fields the setting, a mapping, replaces; None if it is no such mapping.
        keys: Possible keys of a mapping of names to numbers; empty if the setting is no such mapping.
        metavar: Stands for the value in the help; empty for the usual one.
        flag: Whether the command line has an option of its own for the setting.
    """

    name: str
    type: Any
    default: Any
    help: str = ""
    choices: tuple[Any, ...] = ()
    partial: type | None = None
    keys: tuple[str, ...] = ()
    metavar: str = ""
    flag: bool = True

    @property
    def inside(self) -> tuple["Setting", ...]:
        """Settings inside this one, if its values are mappings with known keys; otherwise none."""
        if self.partial:
            return tuple(settings_of(self.partial))
        return tuple(Setting(key, float, UNSET) for key in self.keys)

    @property
    def plain_type(self) -> Any:  # noqa: ANN401 - a type
        """Type without None and without metadata, such as ``int`` or ``list[str]``."""
        bare = _bare(self.type)
        if isinstance(bare, types.UnionType | _UNION):
            bare = _bare(next(one for one in typing.get_args(bare) if one is not type(None)))
        return bare

    @property
    def optional(self) -> bool:
        """Whether None is a possible value."""
        return type(None) in typing.get_args(_bare(self.type))

    def checked(self, value: object, strict: bool = True) -> Any:  # noqa: ANN401 - a value of the setting's type
        """Return a value as the setting's type.

        Args:
            value: Value as YAML or the command line gives it.
            strict: Whether a text must not stand for a number.

        Raises:
            ValueError: If the value is none of the possible ones; the text says what is possible.
        """
        try:
            found = msgspec.convert(value, self.type, strict=strict)
        except msgspec.ValidationError:
            raise ValueError(f"{value!r} is not {self.words}") from None
        many = found if isinstance(found, list | tuple) else (found,)
        if any(isinstance(one, float) and not math.isfinite(one) for one in many):
            raise ValueError(f"{value!r} is not {self.words}")
        if self.choices and any(one is not None and one not in self.choices for one in many):
            raise ValueError(f"{value!r} is not {self.words}{closest(value, self.choices)}")
        return found

    @property
    def words(self) -> str:
        """Possible values, in words."""
        kind, arguments = self.plain_type, typing.get_args(self.plain_type)
        several = typing.get_origin(kind) in (list, tuple)
        of = _bare(arguments[0]) if several else kind
        limits = self.type if not several else arguments[0]
        one = f"one of {', '.join(map(str, self.choices))}" if self.choices else _kind_words(of, _meta(limits))
        if several:
            count = "" if typing.get_origin(kind) is list or Ellipsis in arguments else f" of {len(arguments)}"
            one = f"a list{count}, each {one}"
        return f"{one}, or null" if self.optional else one


def settings_of(kind: Any) -> Iterator[Setting]:  # noqa: ANN401 - a dataclass
    """Yield the settings that the fields of a dataclass declare, in their order."""
    hints = typing.get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        default = field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        meta = _meta(hints[field.name])
        extra = (meta.extra or {}) if meta else {}
        words = (meta.description or "") if meta else ""
        yield Setting(field.name, hints[field.name], default, words, **extra)


def plain_values(config: Any) -> dict[str, Any]:  # noqa: ANN401 - a dataclass
    """Return a configuration as plain values, as they are after they were written to a file and read again."""
    return {name: _plain(value) for name, value in dataclasses.asdict(config).items()}


def _plain(value: Any) -> Any:  # noqa: ANN401 - any plain value
    if isinstance(value, dict):
        return {name: _plain(one) for name, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def closest(word: object, possible: Sequence[object]) -> str:
    """Return the question whether a possible word was meant that is spelt similarly; empty if none is."""
    spelt = {str(one).lower(): str(one) for one in possible}
    found = difflib.get_close_matches(str(word).lower(), list(spelt), 1)
    return f"; did you mean {spelt[found[0]]}?" if found else ""


def _meta(kind: Any) -> msgspec.Meta | None:  # noqa: ANN401 - a type
    """Return the metadata of a type, or of the type that it is beside None; None if it has none."""
    found = [one for one in getattr(kind, "__metadata__", ()) if isinstance(one, msgspec.Meta)]
    inside = [_meta(one) for one in typing.get_args(kind)] if isinstance(kind, types.UnionType | _UNION) else []
    return next((one for one in [*found, *inside] if one), None)


def _bare(kind: Any) -> Any:  # noqa: ANN401 - a type
    return kind.__origin__ if hasattr(kind, "__metadata__") else kind


def _kind_words(kind: Any, meta: msgspec.Meta | None) -> str:  # noqa: ANN401 - a type
    noun = {int: "an integer", float: "a number", bool: "true or false", str: "a text"}.get(kind, "a mapping")
    if meta is None or kind not in (int, float):
        return noun
    limits = [
        f"{word} {limit:g}"
        for word, limit in (("of at least", meta.ge), ("above", meta.gt), ("of at most", meta.le))
        if limit is not None
    ]
    return " ".join([noun, " and ".join(limits)]).strip()
