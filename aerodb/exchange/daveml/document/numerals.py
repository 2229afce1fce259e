"""Numbers and lists of numbers as DAVE-ML files write them."""

from __future__ import annotations

import re

import numpy as np

from ...xml_reader import Element

_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d)")  # 1.5D+03


def number(text: str, element: Element) -> float:
    """Return the finite number a text stands for; anything else raises `ParseError` at the element."""
    found = numbers(text, element)
    if found.size != 1:
        raise element.error(f"{text!r}", "one number")
    return float(found[0])


def numbers(text: str, element: Element) -> np.ndarray:
    """Return the finite numbers of a list separated by commas, semicolons or blanks; anything else raises `ParseError`."""
    words = _FORTRAN.sub("e", re.sub("[,;]", " ", text)).split()
    try:
        found = np.array(words, float) if "_" not in text else None
    except ValueError:
        found = None
    if found is None or not np.isfinite(found).all():
        raise element.error(_culprit(words), "finite numbers, separated by commas or blanks")
    return found


def optional(element: Element, attribute: str, default: float) -> float:
    """Return the number of an attribute, or the default when it is not there."""
    return number(element.attributes[attribute], element) if attribute in element.attributes else default


def _culprit(words: list[str]) -> str:
    for word in words:
        try:
            if "_" not in word and np.isfinite(float(word)):
                continue
        except ValueError:
            pass
        return repr(word[:40])
    return "no number"
