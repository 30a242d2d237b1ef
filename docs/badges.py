"""Draw docs/images/badges from pyproject.toml: version, Python and licence, which tests/test_front_page.py compares.

.venv/bin/python docs/badges.py
"""

import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BADGES = ROOT / "docs" / "images" / "badges"
PYTHON = "Programming Language :: Python :: "
CHARACTER, MARGIN, HEIGHT = 6.8, 7, 20
"""Widest mean width of a character, space beside a text, and height, [px]."""


def badges() -> dict[str, str]:
    """Return the SVG texts of the badges by the names of their files."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    pythons = [one.removeprefix(PYTHON) for one in project["classifiers"] if one.startswith(PYTHON)]
    facts = {
        "version": project["version"],
        "python": f"{pythons[0]} to {pythons[-1]}",
        "licence": project["license"],
    }
    return {f"{name}.svg": badge(name, value) for name, value in facts.items()}


def badge(name: str, value: str) -> str:
    """Return a badge as SVG: a name on grey beside its value on blue.

    Args:
        name: Text of the left part.
        value: Text of the right part.
    """
    left, right = (round(len(text) * CHARACTER) + 2 * MARGIN for text in (name, value))
    text = 'y="14" text-anchor="middle"'
    return f"""\
<svg xmlns="http://www.w3.org/2000/svg" role="img" width="{left + right}" height="{HEIGHT}">
<title>{name}: {value}</title>
<rect width="{left + right}" height="{HEIGHT}" rx="3" fill="#444"/>
<path d="M{left} 0h{right - 3}a3 3 0 0 1 3 3v{HEIGHT - 6}a3 3 0 0 1-3 3h-{right - 3}z" fill="#0060a0"/>
<g fill="#fff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11">
<text x="{left / 2}" {text}>{name}</text><text x="{left + right / 2}" {text}>{value}</text>
</g>
</svg>
"""


def main() -> None:
    """Write the badges."""
    BADGES.mkdir(parents=True, exist_ok=True)
    for name, text in badges().items():
        (BADGES / name).write_text(text)


if __name__ == "__main__":
    main()
