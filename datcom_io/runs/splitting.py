"""Splitting a study into the run decks that the program needs.

The program computes one control device per case and puts a SYMFLP on the horizontal tail as soon as
there is one, so wing devices need an aircraft without tail.  In one program run it carries a part
of D(CM) from one flight condition and one deflection to the next, and the whole ground effect from
one flap setting to the next, so symmetric devices get one deck, and so one run, per flight
condition and deflection.
"""

from __future__ import annotations

import os
from collections.abc import Iterator

from datcom_io.decks.aircraft_rules import is_special
from datcom_io.decks.cards import ERROR, Card, Item, Namelist
from datcom_io.decks.check import check_deck
from datcom_io.decks.deck import Deck, Variables, assignments_of, make_deck, parse_cards
from datcom_io.decks.deck_file import DeckFile
from datcom_io.decks.namelists import CASEID_COLUMNS, COUNTS
from datcom_io.runs.study import DeckStudy, RunPlan, is_on_tail, read_study, word_of
from flightmech.errors import SchemaError

_TAIL_NAMELISTS = ("HTPLNF", "HTSCHR", "VTPLNF", "VTSCHR", "VFPLNF", "VFSCHR", "TVTPAN")
_TAIL_SECTIONS = "HVF"
_TAIL_PLACES = (
    "XH",
    "ZH",
    "ALIH",
    "XV",
    "ZV",
    "XVF",
    "ZVF",
    "YV",
    "YF",
    "PHIV",
    "PHIF",
    "VERTUP",
    "HINAX",
)
_BY_MACH, _BY_HEIGHT = ("MACH", "VINF", "RNNUB"), ("ALT", "PINF", "TINF")


def split_deck(study: str | os.PathLike[str] | DeckFile) -> dict[str, DeckFile]:
    """Split a study into complete, checked run decks.

    Parameters
    ----------
    study : path or DeckFile
        A deck of one case that holds the aircraft and all its devices (each a SYMFLP or ASYFLP of
        its own) and GRNDEF, or a TOML file that names such a deck and plans the runs
        (`datcom_io.runs.study`).

    Returns
    -------
    dict of str to DeckFile
        Run name to deck.  Without a plan: ``clean``; every device by its name, those on the wing
        without tail; with GRNDEF ``ground``, and ``ground_flaps`` for every symmetric device of the
        wing.  A plan may request ``build`` (all combinations of components) and
        ``ground_<device>``.  Symmetric devices give one deck for each flight condition and
        deflection, ``elevator_m0.15_h0_d-25``; an elevator with TRIM or CONTAB, which need all
        deflections, one for each flight condition.

    Raises
    ------
    SchemaError
        The study cannot be split, or a run deck would not run; all problems at once.

    Notes
    -----
    In one program run a part of D(CM) is carried from condition to condition (seen: 0.161 instead of 0.25 late in a list of 18) and
    from deflection to deflection (2 to 7 %), and the ground effect of flaps from deflection to deflection (CL wrong by 0.28).

    Examples
    --------
    >>> decks = split_deck("t37_study.toml")                # doctest: +SKIP
    >>> sorted(decks)                                       # doctest: +SKIP
    ['aileron', 'clean', 'elevator_m0.15_h0_d-10', 'elevator_m0.15_h0_d-15', ..., 'ground_flaps_d40']
    """
    read = read_study(study)
    if is_special(read.base):
        raise SchemaError(
            read.file, ["LARWB, HYPEFF and TRNJET make cases of their own; a study is an aircraft"]
        )
    problems: list[str] = []
    wrong_runs: dict[str, list[str]] = {}
    decks: dict[str, DeckFile] = {}
    for name, plan in (read.plans or dict.fromkeys(_all_runs(read), RunPlan())).items():
        wrong = _wrong_run(read, name)
        if wrong:
            problems.append(wrong)
            continue
        for label, run in _runs(read, name, plan, problems):
            if label in decks:  # a condition that the deck gives twice
                continue
            decks[label] = DeckFile(f"{label}.inp", (run,))
            faults = [finding for finding in check_deck(run) if finding.severity == ERROR]
            for finding in faults:
                wrong_runs.setdefault(
                    f"line {finding.line} of the study: {finding.text}", []
                ).append(label)
    problems += [
        f"run {labels[0]}{f' and {len(labels) - 1} more' if labels[1:] else ''}: {text}"
        for text, labels in wrong_runs.items()
    ]
    if problems:
        raise SchemaError(read.file, problems)
    return decks


def _all_runs(study: DeckStudy) -> Iterator[str]:
    yield "clean"
    yield from study.devices
    if "GRNDEF" in study.base.namelists:
        yield "ground"
        yield from (
            f"ground_{name}"
            for name, group in study.devices.items()
            if group[0].name == "SYMFLP" and not is_on_tail(name)
        )


def _wrong_run(study: DeckStudy, name: str) -> str:
    allowed = [
        "clean",
        "build",
        *study.devices,
        "ground",
        *(f"ground_{device}" for device in study.devices),
    ]
    if name not in allowed:
        return f"run {name!r}; allowed: {', '.join(allowed)}"
    if name.startswith("ground") and "GRNDEF" not in study.base.namelists:
        return f"run {name!r} needs $GRNDEF in the deck"
    return ""


def _runs(
    study: DeckStudy, name: str, plan: RunPlan, problems: list[str]
) -> Iterator[tuple[str, Deck]]:
    """Yield label and deck of a run, one per flight condition where they must be apart."""
    device = name.removeprefix("ground_") if name not in ("clean", "build", "ground") else ""
    added = parse_cards(enumerate(plan.cards.split("\n"), 1))
    problems += [f"runs.{name}.cards, line {line}: {text}" for line, text in added.problems]
    whole = _tidy(make_deck([*_aircraft(study, name, device), *added.items]))
    if "MACH" in added.namelists.get("FLTCON", {}) and any(
        namelist.startswith("EXPR") for namelist in whole.namelists
    ):
        problems.append(
            f"runs.{name}.cards change the Mach numbers that the EXPRnn of the study count; "
            f"write the EXPRnn of the run too"
        )
    symmetric = bool(device) and study.devices[device][0].name == "SYMFLP"
    separate = symmetric if plan.separate is None else plan.separate
    one_by_one = (
        symmetric
        and not {"TRIM", "CONTAB"} & {*(card.name for card in whole.cards), *whole.namelists}
        and not (name.startswith("ground_") and is_on_tail(device))
    )
    for condition, deck in _parts(_conditions(whole), whole) if separate else [("", whole)]:
        for deflection, one in (
            _parts(_deflections(deck), deck) if separate and one_by_one else [("", deck)]
        ):
            label = "_".join(filter(None, (condition, deflection)))
            text = f"{_label(name, device)} {label.replace('_', ' ').upper()}".strip()
            title = (
                _title(plan.caseid, label.replace("_", " ").upper())
                if plan.caseid
                else _title(study.title, text)
            )
            yield "_".join(filter(None, (name, label))), _titled(one, title)


def _parts(parts: Iterator[tuple[str, Deck]], whole: Deck) -> list[tuple[str, Deck]]:
    """Return the parts of a deck with their labels, the deck itself without label where it has one
    part only.
    """
    found = list(parts)
    return found if len(found) > 1 else [("", whole)]


def _aircraft(study: DeckStudy, name: str, device: str) -> Iterator[Item]:
    """Yield the cards of the study that belong to a run."""
    base = study.base
    on_wing = bool(device) and not is_on_tail(device)
    yield Card(base.line, "DIM", base.dim)
    yield Card(base.line, "DERIV", base.deriv)
    yield from (card for card in base.cards if _belongs(card, base, name, device))
    if name == "build":
        yield from (Card(base.line, word, "") for word in ("BUILD", "PART"))
    for namelist, group in base.namelists.items():
        if namelist in ("SYMFLP", "ASYFLP") or (
            on_wing and namelist in (*_TAIL_NAMELISTS, "PROPWR", "JETPWR")
        ):
            continue
        if (namelist == "GRNDEF" and not name.startswith("ground")) or (
            namelist == "CONTAB" and not _has_tabs(study, device)
        ):
            continue
        places = _TAIL_PLACES if on_wing and namelist == "SYNTHS" else ()
        yield _as_item(
            base, namelist, {key: values for key, values in group.items() if key not in places}
        )
    if device:
        yield from study.devices[device]


def _belongs(card: Card, base: Deck, name: str, device: str) -> bool:
    """Return whether a control card of the study belongs to a run."""
    if card.name == "NACA":
        return not device or is_on_tail(device) or card.text[:1] not in _TAIL_SECTIONS
    if card.name == "TRIM":
        return _trims(base, device)
    if card.name in ("BUILD", "PART"):
        return name == "clean"
    return card.name in ("DAMP", "PLOT", "NAMELIST", "DUMP", "PRINT")


def _trims(base: Deck, device: str) -> bool:
    """Return whether TRIM has something to trim with: the elevator, or a stabilizer that moves."""
    return word_of(device) == "elevator" if device else base.value("SYNTHS", "HINAX") is not None


def _has_tabs(study: DeckStudy, device: str) -> bool:
    """Return whether the control tabs belong to a device: the elevator, or without one any
    symmetric device.
    """
    elevators = [name for name in study.devices if word_of(name) == "elevator"]
    return device in (
        elevators or [name for name, group in study.devices.items() if group[0].name == "SYMFLP"]
    )


def _as_item(deck: Deck, name: str, group: Variables) -> Namelist:
    """Return a resolved namelist as cards, with the lines of the study."""
    assignments = (
        piece._replace(line=deck.line_of(name, piece.variable)) for piece in assignments_of(group)
    )
    return Namelist(deck.line_of(name), name, tuple(assignments))


def _tidy(deck: Deck) -> Deck:
    """Cut arrays to the count that a run has given; what stands behind it is left over from the
    study.
    """
    for name, counter, needed, others in COUNTS:
        wanted = deck.count(name, counter)
        group = deck.namelists.get(name, {})
        if wanted and any(len(group.get(array, ())) > wanted for array in (*needed, *others)):
            cut = {
                key: values[:wanted] if key in needed or key in others else values
                for key, values in group.items()
            }
            deck = _with_namelists(deck, {name: cut})
    return deck


def _with_namelists(deck: Deck, changed: dict[str, Variables]) -> Deck:
    """Return the deck with namelists replaced; those without variables are left out."""
    cards = [item for item in deck.items if isinstance(item, Card)]
    groups = {
        name: group
        for name, group in {**deck.namelists, **changed}.items()
        if group or name not in changed
    }
    return make_deck([*cards, *(_as_item(deck, name, group) for name, group in groups.items())])


def _titled(deck: Deck, caseid: str) -> Deck:
    cards = [item for item in deck.items if item.name not in ("CASEID", "NEXT", "SAVE")]
    return make_deck(
        [
            *cards,
            Card(deck.line, "CASEID", caseid[:CASEID_COLUMNS]),
            Card(deck.line, "NEXT", "CASE"),
        ]
    )


def _title(title: str, label: str) -> str:
    return f"{title[: CASEID_COLUMNS - 1 - len(label)].rstrip()} {label}".strip()


def _label(name: str, device: str) -> str:
    words = {
        "clean": "CLEAN AIRCRAFT",
        "build": "COMPONENT BUILD-UP",
        "ground": "CLEAN AIRCRAFT IN GROUND EFFECT",
    }
    if name in words:
        return words[name]
    label_text = device.replace("_", " ").upper() + ("" if is_on_tail(device) else ", WING-BODY")
    return label_text + (" IN GROUND EFFECT" if name.startswith("ground_") else "")


def _conditions(deck: Deck) -> Iterator[tuple[str, Deck]]:
    """Yield label and deck of each flight condition, in the order of the program."""
    group = deck.namelists.get("FLTCON", {})
    speeds, heights = deck.count("FLTCON", "NMACH") or 0, deck.count("FLTCON", "NALT")
    if deck.loop == 1:
        pairs = [(i, i) for i in range(min(speeds, heights or speeds))]
    elif deck.loop == 2:
        pairs = [(i, k) for k in range(heights or 1) for i in range(speeds)]
    else:
        pairs = [(i, k) for i in range(speeds) for k in range(heights or 1)]
    for i, k in pairs:
        one: Variables = {**group, "NMACH": [1.0]}
        if heights or "ALT" in group:
            one["NALT"] = [1.0]
        for names, place in ((_BY_MACH, i), (_BY_HEIGHT, k)):
            for variable in names:
                if variable in group:
                    one[variable] = group[variable][place : place + 1]
        yield _condition_label(one), _with_namelists(deck, {"FLTCON": one, **_experiments(deck, i)})


def _deflections(deck: Deck) -> Iterator[tuple[str, Deck]]:
    """Yield label and deck of each deflection of a symmetric device."""
    group = deck.namelists.get("SYMFLP", {})
    arrays = next(needed + others for name, _, needed, others in COUNTS if name == "SYMFLP")
    for i, delta in enumerate(deck.schedule("SYMFLP", "DELTA", "NDELTA")):
        one = {key: values[i : i + 1] if key in arrays else values for key, values in group.items()}
        yield f"d{delta:g}", _with_namelists(deck, {"SYMFLP": {**one, "NDELTA": [1.0]}})


def _experiments(deck: Deck, place: int) -> dict[str, Variables]:
    """Return the experimental data of one Mach number as those of the first; the digits of EXPRnn
    count the Mach numbers.
    """
    others: dict[str, Variables] = {name: {} for name in deck.namelists if name.startswith("EXPR")}
    own = deck.namelists.get(f"EXPR{place + 1:02d}", {})
    return {**others, "EXPR01": own} if others else {}


def _condition_label(group: Variables) -> str:
    words = []
    for letter, variable in (
        ("m", "MACH"),
        ("v", "VINF"),
        ("h", "ALT"),
        ("p", "PINF"),
        ("re", "RNNUB"),
    ):
        value = next(iter(group.get(variable, [])), None)
        if value is not None:
            words.append(f"{letter}{float(value):g}")
    return "_".join(words)
