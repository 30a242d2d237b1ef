"""Files that print sheets of tags in true size: PDF files with vectors, and PNG files with their resolution."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.print_layout import Block, Page
from svfl_data.system.atomic_io import write_atomically

POINT = 72 / 25.4  # points in a millimetre
DPI = 300  # pixels per inch of a sheet that is drawn as a picture


def pdf(pages: list[Page]) -> bytes:
    """Return the bytes of a PDF file (version 1.4, Helvetica, no compression) with one page for each sheet."""
    objects = [b"<< /Type /Catalog /Pages 2 0 R >>", b"", b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>"]
    kids = []
    for page in pages:
        content = _content(page).encode("latin-1")
        kids.append(f"{len(objects) + 1} 0 R")
        box = f"[0 0 {page.width * POINT:.3f} {page.height * POINT:.3f}]"
        objects += [
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Resources << /Font << /F 3 0 R >> >> "
            f"/Contents {len(objects) + 2} 0 R >>".encode(),
            b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
        ]
    objects[1] = f"<< /Type /Pages /Kids [{' '.join(kids)}] /Count {len(kids)} >>".encode()
    out, offsets = b"%PDF-1.4\n", []
    for number, body in enumerate(objects, start=1):
        offsets.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = "".join(f"{offset:010d} 00000 n \n" for offset in offsets)
    end = f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}trailer\n"
    end += f"<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{len(out)}\n%%EOF\n"
    return out + end.encode()


def _content(page: Page) -> str:
    """Return the content of a page in PDF's language, with lengths in points and y upwards."""

    def filled(blocks: list[Block]) -> str:
        # All rectangles are one path, so that no viewer draws seams between neighbours.
        return " ".join(
            f"{b.x * POINT:.4f} {(page.height - b.y - b.height) * POINT:.4f} {b.width * POINT:.4f} "
            f"{b.height * POINT:.4f} re"
            for b in blocks
        ) + " f"  # fmt: skip

    texts = [
        f"BT /F {text.size * POINT:.2f} Tf {text.x * POINT:.3f} {(page.height - text.y) * POINT:.3f} Td "
        f"({_escaped(text.words)}) Tj ET"
        for text in page.texts
    ]
    return "\n".join(["0 g", *(filled(tag) for tag in page.tags), filled(page.lines), *texts])


def _escaped(words: str) -> str:
    return words.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")


def picture(page: Page, dpi: int = DPI) -> NDArray[np.uint8]:
    """Draw a sheet as a grey picture, (H, W) uint8, with the edges of modules rounded to pixels.

    Args:
        page: Sheet to draw.
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
    """Return the bytes of a PNG file of a sheet that states its resolution, so that it prints in true size.

    Args:
        page: Sheet to draw.
        dpi: Resolution of the picture in pixels per inch.
    """
    _, encoded = cv2.imencode(".png", picture(page, dpi))
    data = encoded.tobytes()
    per_metre = round(dpi / 0.0254)
    chunk = b"pHYs" + struct.pack(">IIB", per_metre, per_metre, 1)
    header = 8 + 25  # signature and IHDR
    return data[:header] + struct.pack(">I", 9) + chunk + struct.pack(">I", zlib.crc32(chunk)) + data[header:]


def write(pages: list[Page], path: Path) -> list[Path]:
    """Write sheets as one PDF file, or as PNG files with one file for each sheet.

    Args:
        pages: Sheets to write.
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
