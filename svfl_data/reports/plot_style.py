"""Colours and sizes that the panels of the picture of an episode share."""

# Okabe and Ito's palette, whose colours colour-blind people can distinguish; x, y, z also differ in their dashes.
X, Y, Z = "#d55e00", "#009e73", "#0072b2"
GREY, TURN, LABEL = "#555555", "#cc79a7", "#f0e442"
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1)))
CURVES = (X, Y, Z, TURN, "#e69f00", "#56b4e9", "#999999", "#000000")
"""Colours of the components of one field. Of more components, the next ones have these colours and the next dashes."""
NAME = 40  # largest number of characters of a camera's or annotation's name
