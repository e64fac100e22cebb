"""Tables for notebooks."""

from __future__ import annotations

from html import escape
from typing import Sequence


def table(headings: Sequence[str], rows: Sequence[Sequence[str]], title: str = "", notes: Sequence[str] = ()) -> str:
    """An HTML table with a title above and notes below it."""
    head = "".join(f"<th>{escape(heading)}</th>" for heading in headings)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return (
        (f"<p><b>{escape(title)}</b></p>" if title else "")
        + f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        + sentences(notes)
    )


def sentences(lines: Sequence[str]) -> str:
    """A paragraph to each."""
    return "".join(f"<p>{escape(line)}</p>" for line in lines)


def number(value: object) -> str:
    """Four digits; nothing for what is not known."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return "" if value is None else str(value)
    return f"{value:.4g}"
