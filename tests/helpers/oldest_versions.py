"""Print, as constraints for pip, the oldest versions that pyproject.toml allows: ``make test-oldest`` installs them."""

import re
import tomllib
from pathlib import Path


def oldest(project: dict) -> list[str]:
    """One ``name==version`` for each requirement that has a lower bound or a fixed version."""
    extras = project["optional-dependencies"].values()
    asked = [*project["dependencies"], *(one for requirements in extras for one in requirements)]
    bounds = {re.match(r"([\w.-]+)[>=]=([\w.]+)", one) for one in asked} - {None}
    return sorted({f"{bound[1]}=={bound[2]}" for bound in bounds})


if __name__ == "__main__":
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text()
    print("\n".join(oldest(tomllib.loads(text)["project"])))
