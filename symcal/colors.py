"""Colours that survive colour blindness and grey copies, the same in all drawings."""

INK, FAINT, RULE = "#1a1a1a", "#8a8a8a", "#d9d9d9"
BLUE, GREEN, ORANGE, VERMILION, PURPLE = "#00517F", "#008B66", "#E69F00", "#D55E00", "#CC79A7"
"""Of [OkabeIto2008], green and blue darkened: orange, green and blue then differ by lightness alone."""
