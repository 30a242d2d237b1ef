"""Files that print pages of tags in true size: PDF files with vectors, and PNG files with their resolution."""

from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from fpdf import FPDF
from numpy.typing import NDArray
from PIL import Image

from collectors.apriltags.print_layout import Block, Page
from svfl_data.system.atomic_io import write_atomically

POINT = 72 / 25.4  # points in a millimetre
DPI = 300  # pixels per inch of a page that is drawn as a picture


def pdf(pages: list[Page]) -> bytes:
    """Return a PDF file with the given pages. The same pages give the same bytes.

    Args:
        pages: The pages.
    """
    document = FPDF(unit="mm")
    document.set_creation_date(datetime(2000, 1, 1, tzinfo=UTC))
    document.set_auto_page_break(False)
    for page in pages:
        document.add_page(format=(page.width, page.height))
        for blocks in (*page.tags, page.lines):
            _fill(document, blocks)
        for text in page.texts:
            document.set_font("Helvetica", size=text.size * POINT)
            document.text(text.x, text.y, text.words)
    return bytes(document.output())


def _fill(document: FPDF, blocks: list[Block]) -> None:
    """Fill rectangles as one path, so that no viewer draws seams between neighbours."""
    with document.new_path() as path:
        path.style.fill_color, path.style.stroke_color = "#000000", None
        for block in blocks:
            path.rectangle(block.x, block.y, block.width, block.height)


def picture(page: Page, dpi: int = DPI) -> NDArray[np.uint8]:
    """Draw a page as a grey picture, (H, W) uint8, with the edges of modules rounded to pixels.

    Args:
        page: Page to draw.
        dpi: Resolution of the picture in pixels per inch.
    """
    scale = dpi / 25.4
    image = np.full((round(page.height * scale), round(page.width * scale)), 255, np.uint8)
    for block in [*(block for tag in page.tags for block in tag), *page.lines]:
        left, top = round(block.x * scale), round(block.y * scale)
        right, bottom = round((block.x + block.width) * scale), round((block.y + block.height) * scale)
        image[top : max(bottom, top + 1), left : max(right, left + 1)] = 0
    for text in page.texts:
        place = round(text.x * scale), round(text.y * scale)
        height = text.size * scale * 0.72 / 22  # Hershey's capitals are 22 pixels high at scale 1
        cv2.putText(
            image, text.words, place, cv2.FONT_HERSHEY_SIMPLEX, height, 0, max(1, round(dpi / 150)), cv2.LINE_AA
        )
    return image


def png(page: Page, dpi: int = DPI) -> bytes:
    """Return the bytes of a PNG file of a page that states its resolution, so that it prints in true size.

    Args:
        page: Page to draw.
        dpi: Resolution of the picture in pixels per inch.
    """
    file = BytesIO()
    Image.fromarray(picture(page, dpi)).save(file, "PNG", dpi=(dpi, dpi))
    return file.getvalue()


def write(pages: list[Page], path: Path) -> list[Path]:
    """Write pages as one PDF file, or as PNG files with one file for each page.

    Args:
        pages: Pages to write.
        path: File to write. With the suffix ``.pdf`` it is a PDF file, otherwise a PNG file; the names of further PNG
            files get a number.

    Returns:
        The paths of the files that were written.

    Raises:
        StorageError: If a file cannot be written.
    """
    if path.suffix == ".pdf":
        files = {path: pdf(pages)}
    else:
        names = [path if n == 1 else path.with_stem(f"{path.stem}_{n}") for n in range(1, len(pages) + 1)]
        files = {name: png(page) for name, page in zip(names, pages, strict=True)}
    for name, content in files.items():
        write_atomically(name, content)
    return list(files)
