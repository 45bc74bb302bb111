"""URDF files as elements with lines, and the numbers in them. XML is read with expat, document types (and with them
every entity) refused.

Source: http://wiki.ros.org/urdf/XML
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.documents.document import LARGEST
from symcal.documents.read import CONTROL, MB, read_bytes
from symcal.errors import InputError

Array = NDArray[np.float64]

MM = 1000.0
"""Per metre, URDF's unit."""


_LIMIT = 16 * MB
_MOST, _DEEPEST = 100_000, 100  # elements; a humanoid's file has a few thousand, seven deep


@dataclass(frozen=True, slots=True)
class Element:
    """An XML element with the line of its tag."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def child(self, tag: str) -> Element | None:
        return next((child for child in self.children if child.tag == tag), None)

    def get(self, tag: str, attribute: str) -> str | None:
        child = self.child(tag)
        return None if child is None else child.attributes.get(attribute)


def read_urdf(path: Path) -> Element:
    """The outermost element, `robot`.

    Raises:
        InputError: not a URDF file, or one that is still xacro.
    """
    data = read_bytes(path, _LIMIT)
    parser = expat.ParserCreate()
    top = Element("", {}, 0)
    stack, count = [top], 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > _MOST or len(stack) > _DEEPEST:
            what = f"more than {_MOST} elements" if count > _MOST else "elements nested too deeply"
            raise InputError(f"{what}: not the file of a robot", file=path, line=parser.CurrentLineNumber)
        if any(CONTROL.search(text) for text in attributes.values()):
            raise InputError("a control character in this element", file=path, line=parser.CurrentLineNumber, key=tag)
        element = Element(tag, attributes, parser.CurrentLineNumber)
        stack[-1].children.append(element)
        stack.append(element)

    def doctype(*_: object) -> None:
        raise InputError(
            "a URDF file has no document type: refused, with its entities", file=path, line=parser.CurrentLineNumber
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(f"not valid XML: {expat.errors.messages[error.code]}", file=path, line=error.lineno) from None
    except (UnicodeError, LookupError, ValueError) as error:  # an encoding that expat hands to Python
        raise InputError(f"not valid XML: {error}", file=path) from None
    root = top.children[0]
    if root.tag != "robot":
        message = "not a URDF file: the outermost element must be 'robot'"
        if any(child.tag.startswith("xacro:") for child in root.children):
            message = "this is a xacro file: expand it to URDF first (xacro file.xacro > file.urdf)"
        raise InputError(message, file=path, line=root.line, found=root.tag)
    macro = next((child for child in root.children if child.tag.startswith("xacro:")), None)
    if macro is not None:
        message = "this is a xacro file: expand it to URDF first (xacro file.xacro > file.urdf)"
        raise InputError(message, file=path, line=macro.line, found=macro.tag)
    return root


def name_of(joint: Element) -> str:
    """What a joint is called in messages."""
    return joint.attributes.get("name", "joint")


def numbers(path: Path, joint: Element, tag: str, attribute: str, default: tuple[float, ...]) -> Array:
    """Numbers of an attribute of a joint's child element, as many as the default has.

    Raises:
        InputError: others, or such as are not finite or beyond any length; with their line.
    """
    text = joint.get(tag, attribute)
    if text is None:
        return np.array(default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([math.nan])
    if len(values) != len(default) or not (np.abs(values) <= LARGEST).all():
        line = next(child.line for child in joint.children if child.tag == tag)
        count = "a finite number" if len(default) == 1 else f"{len(default)} finite numbers"
        count += f" of at most {LARGEST:g}" if np.isfinite(values).all() and len(values) == len(default) else ""
        raise InputError(
            f"'{attribute}' of '{tag}' must be {count}", file=path, line=line, key=name_of(joint), found=text
        )
    return values


def origin(path: Path, joint: Element) -> Array:
    """The frame of a joint's `origin` in its parent's, shape (4, 4), mm.

    Raises:
        InputError: not finite numbers.
    """
    xyz = numbers(path, joint, "origin", "xyz", (0.0, 0.0, 0.0))
    return spatial.transform(spatial.rpy_matrix(numbers(path, joint, "origin", "rpy", (0.0, 0.0, 0.0))), xyz * MM)
