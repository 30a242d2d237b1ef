"""Extension of griffe: a section ``Example:`` of a docstring is one of ``Examples:``, whose lines are code."""

import re
from typing import Any

import griffe


class Examples(griffe.Extension):
    """Renames the section, which griffe would otherwise take for a remark in Markdown."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:  # noqa: ANN401 - what griffe tells besides
        """Rename the section in the docstring of a class, function, attribute or module."""
        if obj.docstring:
            obj.docstring.value = re.sub(r"^Example:$", "Examples:", obj.docstring.value, flags=re.MULTILINE)
