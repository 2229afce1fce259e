"""Configurations by what they are made of: the printed names are many, the parts are five."""

from __future__ import annotations

_PARTS = (
    ("VENTRAL FIN", "fin"),
    ("TWIN VERTICAL PANEL", "panels"),
    ("VERTICAL TAIL", "vertical"),
    ("HORIZONTAL TAIL", "horizontal"),
    ("WING", "wing"),
    ("BODY", "body"),
)

LOW_ASPECT_RATIO = "LOW ASPECT RATIO WINGS AND WING-BODY COMBINATIONS"


def parts(configuration: str) -> frozenset[str]:
    """Return the parts named in a configuration line: ``body wing horizontal vertical fin panels``.

    Examples
    --------
    >>> sorted(parts("WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL"))
    ['body', 'horizontal', 'vertical', 'wing']
    """
    if configuration == LOW_ASPECT_RATIO:
        return frozenset(("body", "wing"))
    return frozenset(part for words, part in _PARTS if words in configuration)


def printed_name(made_of: frozenset[str]) -> str:
    """Return the configuration line that the program prints for parts.

    Examples
    --------
    >>> printed_name(frozenset(("body", "wing", "vertical", "horizontal")))
    'WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL'
    """
    if len(made_of) == 1:
        alone = {"body": "DATCOM BODY ALONE", "wing": "WING ALONE"}
        return next(alone.get(part, words) for words, part in _PARTS if part in made_of)
    order = [("wing", "WING"), ("body", "BODY"), ("horizontal", "HORIZONTAL TAIL"), ("vertical", "VERTICAL TAIL")]
    if made_of == {"body", "wing", "horizontal", "vertical"}:
        order[2:] = order[:1:-1]  # the vertical tail stands first on the page of the plain aeroplane, and only there
    order += [("fin", "VENTRAL FIN"), ("panels", "TWIN VERTICAL PANEL")]
    return "-".join(words for part, words in order if part in made_of)
