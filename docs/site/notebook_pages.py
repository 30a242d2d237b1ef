"""Pages of the notebooks: their texts, their code, and what they showed when they were last run."""

import base64
import json
from pathlib import Path

Pictures = dict[str, bytes]
"""Pictures of a page by their path in the site."""


def notebook_page(file: Path, folder: str) -> tuple[str, Pictures]:
    """Return a stored notebook as a page.

    Args:
        file: The notebook, format 4.
        folder: Folder of the page in the site, such as ``notebooks``.

    Returns:
        The page in Markdown, and its pictures as PNG by their path in the site.
    """
    parts: list[str] = []
    pictures: Pictures = {}
    for cell in json.loads(file.read_text())["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", []):
            if output["output_type"] == "stream":
                parts.append(f"```{{.text .output}}\n{''.join(output['text']).rstrip()}\n```")
            else:
                name = f"{file.stem}_{len(pictures) + 1}.png"
                pictures[f"{folder}/{name}"] = base64.b64decode("".join(output["data"]["image/png"]))
                parts.append(f"![Output of the code above]({name})")
    return "\n\n".join(parts) + "\n", pictures
