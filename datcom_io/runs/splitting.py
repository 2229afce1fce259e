"""Splitting of a study into the run decks that the program needs.

The program computes one control device per case.  It puts a SYMFLP on the horizontal tail as soon
as there is one, so wing devices need an aircraft without tail.  In one program run it carries a
part of D(CM) from one flight condition and one deflection to the next, and the whole ground effect
from one flap setting to the next.  Symmetric devices therefore get one deck, and so one run, per
flight condition and deflection.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import NamedTuple

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
# Variables of SYNTHS that place the tails.
_TAIL_POSITIONS = (
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
# Arrays of FLTCON along Mach number and along altitude.
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
    In one program run a part of D(CM) is carried from condition to condition (seen: 0.161 instead
    of 0.25 late in a list of 18) and from deflection to deflection (2 to 7 %), and the ground
    effect of flaps from deflection to deflection (CL wrong by 0.28).

    Examples
    --------
    >>> decks = split_deck("t37_study.toml")                # doctest: +SKIP
    >>> sorted(decks)                                       # doctest: +SKIP
    ['aileron', 'clean', 'elevator_m0.15_h0_d-10', ..., 'ground_flaps_d40']
    """
    plan = read_study(study)
    if is_special(plan.base):
        problem = "LARWB, HYPEFF and TRNJET make cases of their own; a study is an aircraft"
        raise SchemaError(plan.file, [problem])
    problems: list[str] = []
    runs_by_fault: dict[str, list[str]] = {}
    decks: dict[str, DeckFile] = {}
    for run in _planned_runs(plan, problems):
        for label, deck in _run_decks(plan, run, problems):
            # The deck may give a condition twice.
            if label in decks:
                continue
            decks[label] = DeckFile(f"{label}.inp", (deck,))
            # A fault of the study appears in many of its runs and is reported once.
            for finding in check_deck(deck):
                if finding.severity == ERROR:
                    fault = f"line {finding.line} of the study: {finding.text}"
                    runs_by_fault.setdefault(fault, []).append(label)
    problems += _fault_texts(runs_by_fault)
    if problems:
        raise SchemaError(plan.file, problems)
    return decks


def _fault_texts(runs_by_fault: dict[str, list[str]]) -> list[str]:
    """Return each fault of the study once, with the runs that have it."""
    texts = []
    for fault, labels in runs_by_fault.items():
        others = ""
        if len(labels) > 1:
            others = f" and {len(labels) - 1} more"
        texts.append(f"run {labels[0]}{others}: {fault}")
    return texts


class _DeckRun(NamedTuple):
    """One run of a study: its name, its device (empty for the clean aircraft), its plan."""

    name: str
    device: str
    plan: RunPlan

    @property
    def over_ground(self) -> bool:
        """Whether the run is in ground effect."""
        return self.name.startswith("ground")


def _planned_runs(study: DeckStudy, problems: list[str]) -> Iterator[_DeckRun]:
    """Yield the runs of a study; wrong names are added to `problems`."""
    # Without a plan all runs of the deck are made.
    plans = study.plans or dict.fromkeys(_default_runs(study), RunPlan())
    for name, plan in plans.items():
        problem = _wrong_run(study, name)
        if problem:
            problems.append(problem)
            continue
        device = ""
        if name not in ("clean", "build", "ground"):
            device = name.removeprefix("ground_")
        yield _DeckRun(name, device, plan)


def _default_runs(study: DeckStudy) -> Iterator[str]:
    """Yield the names of the runs of a study without a plan."""
    yield "clean"
    yield from study.devices
    if "GRNDEF" not in study.base.namelists:
        return
    yield "ground"
    for name in study.devices:
        if _is_symmetric(study, name) and not is_on_tail(name):
            yield f"ground_{name}"


def _is_symmetric(study: DeckStudy, device: str) -> bool:
    return study.devices[device][0].name == "SYMFLP"


def _wrong_run(study: DeckStudy, name: str) -> str:
    """Return the problem of the name of a run, empty without one."""
    over_ground = [f"ground_{device}" for device in study.devices]
    allowed = ["clean", "build", *study.devices, "ground", *over_ground]
    if name not in allowed:
        return f"run {name!r}; allowed: {', '.join(allowed)}"
    if name.startswith("ground") and "GRNDEF" not in study.base.namelists:
        return f"run {name!r} needs $GRNDEF in the deck"
    return ""


def _run_decks(study: DeckStudy, run: _DeckRun, problems: list[str]) -> Iterator[tuple[str, Deck]]:
    """Yield label and deck of each program run that a run needs.

    It is one run, or one per flight condition and deflection where they must be apart.
    """
    # Cards of the plan come last, so their values overwrite those of the study.
    added = parse_cards(enumerate(run.plan.cards.split("\n"), 1))
    problems += [f"runs.{run.name}.cards, line {line}: {text}" for line, text in added.problems]
    complete = _cut_arrays(make_deck([*_aircraft_items(study, run), *added.items]))
    has_experiments = any(name.startswith("EXPR") for name in complete.namelists)
    if has_experiments and "MACH" in added.namelists.get("FLTCON", {}):
        problems.append(
            f"runs.{run.name}.cards change the Mach numbers that the EXPRnn of the study count; "
            f"write the EXPRnn of the run too"
        )
    symmetric = bool(run.device) and _is_symmetric(study, run.device)
    separate = symmetric
    if run.plan.separate is not None:
        separate = run.plan.separate
    conditions = [("", complete)]
    if separate:
        conditions = _parts(_split_conditions(complete), complete)
    for condition, deck in conditions:
        deflections = [("", deck)]
        if separate and symmetric and _may_split_deflections(run, complete):
            deflections = _parts(_split_deflections(deck), deck)
        for deflection, part in deflections:
            label = "_".join(filter(None, (condition, deflection)))
            name = "_".join(filter(None, (run.name, label)))
            yield name, _with_caseid(part, _run_title(study, run, label))


def _may_split_deflections(run: _DeckRun, deck: Deck) -> bool:
    """Return whether a run may have one deck per deflection.

    TRIM and CONTAB need all deflections, and a tail device in ground effect has no own pages.
    """
    if deck.has("TRIM") or deck.has("CONTAB") or {"TRIM", "CONTAB"} & deck.namelists.keys():
        return False
    return not (run.name.startswith("ground_") and is_on_tail(run.device))


def _run_title(study: DeckStudy, run: _DeckRun, label: str) -> str:
    """Return the CASEID of a run; `label` names flight condition and deflection."""
    part = label.replace("_", " ").upper()
    if run.plan.caseid:
        return _shorten_title(run.plan.caseid, part)
    return _shorten_title(study.title, f"{_run_description(run)} {part}".strip())


def _parts(parts: Iterator[tuple[str, Deck]], deck: Deck) -> list[tuple[str, Deck]]:
    """Return the parts of a deck with their labels.

    A deck that has one part only is returned itself, without label.
    """
    labelled = list(parts)
    if len(labelled) > 1:
        return labelled
    return [("", deck)]


def _aircraft_items(study: DeckStudy, run: _DeckRun) -> Iterator[Item]:
    """Yield the cards of the study that belong to a run."""
    base = study.base
    # With a tail the program would put the device on it.
    on_wing = bool(run.device) and not is_on_tail(run.device)
    yield Card(base.line, "DIM", base.dim)
    yield Card(base.line, "DERIV", base.deriv)
    for card in base.cards:
        if _is_card_of_run(card, base, run):
            yield card
    if run.name == "build":
        for word in ("BUILD", "PART"):
            yield Card(base.line, word, "")
    for namelist, group in base.namelists.items():
        if not _is_namelist_of_run(namelist, study, run):
            continue
        variables = group
        if on_wing and namelist == "SYNTHS":
            variables = {key: group[key] for key in group if key not in _TAIL_POSITIONS}
        yield _as_item(base, namelist, variables)
    if run.device:
        yield from study.devices[run.device]


def _is_namelist_of_run(namelist: str, study: DeckStudy, run: _DeckRun) -> bool:
    """Return whether a namelist of the study, other than its devices, belongs to a run."""
    if namelist in ("SYMFLP", "ASYFLP"):
        return False
    if namelist in (*_TAIL_NAMELISTS, "PROPWR", "JETPWR"):
        return not run.device or is_on_tail(run.device)
    if namelist == "GRNDEF":
        return run.over_ground
    if namelist == "CONTAB":
        return _has_tabs(study, run.device)
    return True


def _is_card_of_run(card: Card, base: Deck, run: _DeckRun) -> bool:
    """Return whether a control card of the study belongs to a run."""
    if card.name == "NACA":
        has_tail = not run.device or is_on_tail(run.device)
        return has_tail or card.text[:1] not in _TAIL_SECTIONS
    if card.name == "TRIM":
        return _can_trim(base, run.device)
    if card.name in ("BUILD", "PART"):
        return run.name == "clean"
    return card.name in ("DAMP", "PLOT", "NAMELIST", "DUMP", "PRINT")


def _can_trim(base: Deck, device: str) -> bool:
    """Return whether a run has the elevator, or a stabilizer that moves."""
    if device:
        return word_of(device) == "elevator"
    return base.value("SYNTHS", "HINAX") is not None


def _has_tabs(study: DeckStudy, device: str) -> bool:
    """Return whether the control tabs belong to a device.

    They belong to the elevator, or without one to any symmetric device.
    """
    owners = [name for name in study.devices if word_of(name) == "elevator"]
    if not owners:
        owners = [name for name in study.devices if _is_symmetric(study, name)]
    return device in owners


def _as_item(deck: Deck, name: str, group: Variables) -> Namelist:
    """Return a resolved namelist as cards, with the lines of the study."""
    assignments = []
    for assignment in assignments_of(group):
        line = deck.line_of(name, assignment.variable)
        assignments.append(assignment._replace(line=line))
    return Namelist(deck.line_of(name), name, tuple(assignments))


def _cut_arrays(deck: Deck) -> Deck:
    """Cut arrays to their count; the values behind it are left over from the study."""
    for name, counter, needed, others in COUNTS:
        count = deck.count(name, counter)
        if not count:
            continue
        group = dict(deck.namelists.get(name, {}))
        is_longer = False
        for array in (*needed, *others):
            if len(group.get(array, ())) > count:
                group[array] = group[array][:count]
                is_longer = True
        if is_longer:
            deck = _with_namelists(deck, {name: group})
    return deck


def _with_namelists(deck: Deck, changed: dict[str, Variables]) -> Deck:
    """Return the deck with namelists replaced; those without variables are left out."""
    items: list[Item] = [item for item in deck.items if isinstance(item, Card)]
    for name, group in {**deck.namelists, **changed}.items():
        if group or name not in changed:
            items.append(_as_item(deck, name, group))
    return make_deck(items)


def _with_caseid(deck: Deck, caseid: str) -> Deck:
    """Return the deck with a CASEID, complete by itself."""
    items: list[Item] = [item for item in deck.items if item.name not in ("CASEID", "NEXT", "SAVE")]
    items.append(Card(deck.line, "CASEID", caseid[:CASEID_COLUMNS]))
    items.append(Card(deck.line, "NEXT", "CASE"))
    return make_deck(items)


def _shorten_title(title: str, label: str) -> str:
    """Return title and label, the title cut so that both fit on a CASEID card."""
    return f"{title[: CASEID_COLUMNS - 1 - len(label)].rstrip()} {label}".strip()


_DESCRIPTIONS = {
    "clean": "CLEAN AIRCRAFT",
    "build": "COMPONENT BUILD-UP",
    "ground": "CLEAN AIRCRAFT IN GROUND EFFECT",
}


def _run_description(run: _DeckRun) -> str:
    """Return the words of a CASEID about a run."""
    if run.name in _DESCRIPTIONS:
        return _DESCRIPTIONS[run.name]
    text = run.device.replace("_", " ").upper()
    if not is_on_tail(run.device):
        text += ", WING-BODY"
    if run.name.startswith("ground_"):
        text += " IN GROUND EFFECT"
    return text


def _split_conditions(deck: Deck) -> Iterator[tuple[str, Deck]]:
    """Yield label and deck of each flight condition, in the order of the program."""
    group = deck.namelists.get("FLTCON", {})
    for mach_index, height_index in _condition_indices(deck):
        # One value remains of each array along Mach number and altitude.
        condition: Variables = {**group, "NMACH": [1.0]}
        if deck.count("FLTCON", "NALT") or "ALT" in group:
            condition["NALT"] = [1.0]
        for names, index in ((_BY_MACH, mach_index), (_BY_HEIGHT, height_index)):
            for variable in names:
                if variable in group:
                    condition[variable] = group[variable][index : index + 1]
        changed = {"FLTCON": condition, **_experiments_at(deck, mach_index)}
        yield _condition_label(condition), _with_namelists(deck, changed)


def _condition_indices(deck: Deck) -> list[tuple[int, int]]:
    """Return the indices of Mach number and altitude of each flight condition."""
    speeds, heights = deck.count("FLTCON", "NMACH") or 0, deck.count("FLTCON", "NALT")
    indices = []
    # LOOP=1 steps both together, 2 has altitude outside, 3 has Mach number outside.
    if deck.loop == 1:
        indices = [(i, i) for i in range(min(speeds, heights or speeds))]
    elif deck.loop == 2:
        for k in range(heights or 1):
            indices += [(i, k) for i in range(speeds)]
    else:
        for i in range(speeds):
            indices += [(i, k) for k in range(heights or 1)]
    return indices


def _split_deflections(deck: Deck) -> Iterator[tuple[str, Deck]]:
    """Yield label and deck of each deflection of a symmetric device."""
    group = deck.namelists.get("SYMFLP", {})
    arrays: tuple[str, ...] = ()
    for name, _, needed, others in COUNTS:
        if name == "SYMFLP":
            arrays = needed + others
    for i, delta in enumerate(deck.schedule("SYMFLP", "DELTA", "NDELTA")):
        deflection: Variables = {**group, "NDELTA": [1.0]}
        for array in arrays:
            if array in group:
                deflection[array] = group[array][i : i + 1]
        yield f"d{delta:g}", _with_namelists(deck, {"SYMFLP": deflection})


def _experiments_at(deck: Deck, mach_index: int) -> dict[str, Variables]:
    """Return the experimental data of one Mach number as those of the first.

    The digits of EXPRnn count the Mach numbers.
    """
    experiments: dict[str, Variables] = {}
    for name in deck.namelists:
        # Namelists without variables are left out of the deck.
        if name.startswith("EXPR"):
            experiments[name] = {}
    if experiments:
        experiments["EXPR01"] = deck.namelists.get(f"EXPR{mach_index + 1:02d}", {})
    return experiments


_LABEL_LETTERS = (
    ("m", "MACH"),
    ("v", "VINF"),
    ("h", "ALT"),
    ("p", "PINF"),
    ("t", "TINF"),
    ("re", "RNNUB"),
)


def _condition_label(group: Variables) -> str:
    """Return the label of a flight condition, such as ``m0.15_h0``."""
    texts = []
    for letter, variable in _LABEL_LETTERS:
        values = group.get(variable, [])
        if values and values[0] is not None:
            texts.append(f"{letter}{float(values[0]):g}")
    return "_".join(texts)
