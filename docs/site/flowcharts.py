"""Flowcharts of Mermaid as SVG, so that pages show them without a script from another host.

Drawn is what `docs/architecture.py` writes: nodes with or without a label, and arrows, from the top down or upwards.
"""

import html
import re
from dataclasses import dataclass, field
from itertools import pairwise

LINE, CHARACTER, PADDING = 18.0, 7.6, 12.0  # height of a line, width of a character, space around a label, [px]
GAP, LANE, LAYER_GAP = 24.0, 16.0, 34.0  # between nodes of a layer, for an arrow that passes a layer, between layers
SWEEPS = 12


@dataclass
class Box:
    """A node, or a place where an arrow passes a layer.

    Attributes:
        lines: Lines of the label; none for a place where an arrow passes.
        layer: Number of the layer, from 0 where arrows begin.
        before: Boxes of the layer before that have an arrow to this one.
        after: Boxes of the next layer to which this one has an arrow.
        x: Middle of the box, [px].
    """

    lines: list[str]
    layer: int = 0
    before: list["Box"] = field(default_factory=list)
    after: list["Box"] = field(default_factory=list)
    x: float = 0.0

    @property
    def width(self) -> float:
        """Width of the box, [px]."""
        return max(map(len, self.lines)) * CHARACTER + 2 * PADDING if self.lines else LANE


def svg(source: str) -> str:
    """Return the picture of a flowchart as an SVG element.

    Args:
        source: Text of the flowchart in Mermaid's language.

    Raises:
        ValueError: If a line is none of those that are drawn.
    """
    upwards, labels, arrows = parsed(source)
    layers = layered(labels, arrows)
    place(layers)
    heights = [max(len(box.lines) for box in layer) * LINE + PADDING for layer in layers]
    tops = [sum(heights[:number]) + LAYER_GAP * number for number in range(len(layers))]
    total = tops[-1] + heights[-1]
    if upwards:
        tops = [total - top - height for top, height in zip(tops, heights, strict=True)]
    boxes = [box for layer in layers for box in layer]
    left = min(box.x - box.width / 2 for box in boxes) - 2
    width = max(box.x + box.width / 2 for box in boxes) + 2 - left
    middles = [top + height / 2 for top, height in zip(tops, heights, strict=True)]
    drawn = [curve(box, other, middles, heights) for box in boxes for other in box.after]
    drawn += [label(box, tops[box.layer], heights[box.layer]) for box in boxes if box.lines]
    return (
        f'<svg class="flowchart" role="img" viewBox="{left:.1f} -2 {width:.1f} {total + 4:.1f}" '
        f'style="max-width: {width:.0f}px" xmlns="http://www.w3.org/2000/svg">{"".join(drawn)}</svg>'
    )


def parsed(source: str) -> tuple[bool, dict[str, list[str]], list[tuple[str, str]]]:
    """Return whether arrows point upwards, the lines of each node's label by its name, and the arrows."""
    head, *lines = source.strip().splitlines()
    if head not in ("flowchart BT", "flowchart TB"):
        raise ValueError(f"{head!r} is no flowchart that is drawn here; possible: flowchart BT, flowchart TB")
    labels: dict[str, list[str]] = {}
    arrows: list[tuple[str, str]] = []
    for line in map(str.strip, lines):
        if node := re.fullmatch(r'(\w+)\["(.*)"\]', line):
            labels[node[1]] = re.sub(r"</?i>", "", node[2]).split("<br/>")
        elif re.fullmatch(r"\w+( --> \w+)+", line):
            names = line.split(" --> ")
            arrows += pairwise(names)
        else:
            raise ValueError(f"{line!r} is neither a node nor an arrow that is drawn here")
    for name in (name for arrow in arrows for name in arrow):
        labels.setdefault(name, [name])
    return head.endswith("BT"), labels, arrows


def layered(labels: dict[str, list[str]], arrows: list[tuple[str, str]]) -> list[list[Box]]:
    """Return the boxes in layers, each behind all that have an arrow to it.

    An arrow that passes a layer has a box without a label there.
    """
    boxes = {name: Box(lines) for name, lines in labels.items()}
    for _ in labels:  # the longest way has at most as many arrows as there are nodes
        for start, end in arrows:
            boxes[end].layer = max(boxes[end].layer, boxes[start].layer + 1)
    layers: list[list[Box]] = [[] for _ in range(max(box.layer for box in boxes.values()) + 1)]
    for box in boxes.values():
        layers[box.layer].append(box)
    for start, end in arrows:
        last = boxes[start]
        for layer in range(last.layer + 1, boxes[end].layer):
            last = link(last, Box([], layer))
            layers[layer].append(last)
        link(last, boxes[end])
    return layers


def link(start: Box, end: Box) -> Box:
    """Add an arrow between boxes of neighbouring layers, and return its end."""
    start.after.append(end)
    end.before.append(start)
    return end


def place(layers: list[list[Box]]) -> None:
    """Set the places of all boxes: near the boxes that they have arrows with, without overlap."""
    for layer in layers:
        spread(layer, [0.0] * len(layer))
    for sweep in range(SWEEPS):
        down = sweep % 2 == 0
        for layer in layers if down else reversed(layers):
            wanted = {}
            for box in layer:
                others = (box.before if down else box.after) or (box.after if down else box.before)
                wanted[id(box)] = sum(other.x for other in others) / len(others) if others else box.x
            layer.sort(key=lambda box: wanted[id(box)])
            spread(layer, [wanted[id(box)] for box in layer])


def spread(layer: list[Box], wanted: list[float]) -> None:
    """Place the boxes of a layer in their order, as near to the wanted places as they fit."""
    free = float("-inf")
    for box, x in zip(layer, wanted, strict=True):
        box.x = max(x, free + box.width / 2)
        free = box.x + box.width / 2 + GAP
    shift = sum(x - box.x for box, x in zip(layer, wanted, strict=True)) / len(layer)
    for box in layer:
        box.x += shift


def curve(start: Box, end: Box, middles: list[float], heights: list[float]) -> str:
    """Return the line of an arrow between two boxes, with its head if it ends at a node."""
    down = 1.0 if middles[end.layer] > middles[start.layer] else -1.0
    y0 = middles[start.layer] + (down * heights[start.layer] / 2 if start.lines else 0.0)
    y1 = middles[end.layer] - (down * heights[end.layer] / 2 if end.lines else 0.0)
    half = (y0 + y1) / 2
    path = f"M{start.x:.1f} {y0:.1f}C{start.x:.1f} {half:.1f} {end.x:.1f} {half:.1f} {end.x:.1f} {y1:.1f}"
    head = f'<path class="head" d="M{end.x:.1f} {y1:.1f}l-4 {-7 * down:.0f}h8z"/>' if end.lines else ""
    return f'<path class="arrow" d="{path}"/>{head}'


def label(box: Box, top: float, height: float) -> str:
    """Return the frame and the text of a node; lines after the first are smaller."""
    frame = (
        f'<rect x="{box.x - box.width / 2:.1f}" y="{top:.1f}" width="{box.width:.1f}" height="{height:.1f}" rx="4"/>'
    )
    first = top + height / 2 - (len(box.lines) - 1) * LINE / 2
    texts = ""
    for number, line in enumerate(box.lines):
        kind = ' class="below"' if number else ""
        texts += f'<text{kind} x="{box.x:.1f}" y="{first + number * LINE:.1f}">{html.escape(line)}</text>'
    return frame + texts
