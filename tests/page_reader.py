"""A page as a browser without script reads it."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from typing import Any

NASTY = '</script><script>alert(1)</script><img src=x onerror="alert(2)"> & \u2028 {{ 7 * 7 }} %{x} <b>'
"""A name as nobody would wish for."""


class Page(HTMLParser):
    """Visible text, tables by id, scripts, poses that have images, ids, and every address that is asked."""

    VOID = frozenset(("meta", "link", "img", "input", "br", "rect", "path"))

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.scripts: list[str] = []
        self.cells: dict[str, list[list[str]]] = {}
        self.addresses: list[str] = []
        self.handlers: list[str] = []
        self.poses: list[str] = []
        self.ids: list[str] = []
        self._open: list[str] = []
        self._table = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.addresses += [value for key in ("src", "href") if (value := given.get(key))]
        self.handlers += [key for key in given if key.startswith("on")]
        self.poses += [pose for key, pose in attrs if key == "data-pose" and pose is not None]
        self.ids += [name for key, name in attrs if key == "id" and name is not None]
        if tag not in self.VOID:
            self._open.append(tag)
        if tag == "table":
            self._table = given.get("id") or ""
        if tag == "tr":
            self.cells.setdefault(self._table, []).append([])
        if tag in ("td", "th"):
            self.cells[self._table][-1].append("")
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] == "script":
            self.scripts[-1] += data
        elif "style" not in self._open:
            self.words.append(data)
            if {"td", "th"}.intersection(self._open):
                self.cells[self._table][-1][-1] += data

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    @property
    def scene(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.scripts[0])
        return found
