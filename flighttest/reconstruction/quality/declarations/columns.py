"""What the name map states about the columns of a file: one column for two channels, units and
names that contradict the heading.

Such a contradiction is a warning, because a heading may be wrong.  It becomes an error where
kinematics show that the channel is not what it is called, and a note where they show that the name
map is right.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np
import xarray as xr

from flightmech.air import pressure_altitude
from flightmech.errors import UnitError
from flightmech.names import lookup
from flightmech.units import known_unit, parse_unit, to_si
from flighttest.reconstruction.quality.checks.mistake_search import (
    GAIN,
    Repair,
    find_mistakes,
    total_disagreement,
)
from flighttest.reconstruction.quality.checks.relations import compare_all
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding, map_entry, map_entry_of
from flighttest.records.readers.channel_correction import line_of
from flighttest.records.readers.name_map import Channel

_SIDES = re.compile(r"^engine\d+\.|^gear\.\w+\.|_(left|right|nose)$")
_ALIKE = (
    {"vd", "hdot"},
    {"alpha", "alpha_vane"},
    {"beta", "beta_vane"},
    {"ax", "ax_imu"},
    {"ay", "ay_imu"},
    {"az", "az_imu"},
)
_ABOUT = {  # the relations that state a channel; the others use it as well
    "phi": ("phi_rate",), "theta": ("theta_rate",), "psi": ("psi_rate",), "p": ("phi_rate",), "q": ("theta_rate",), "r": ("psi_rate",),
    "ax_imu": ("force_x", "along"), "ay_imu": ("force_y",), "az_imu": ("force_z", "pull"),
    "vn": ("track_n",), "ve": ("track_e",), "vd": ("climb",), "alpha_vane": ("vane", "heave"), "beta_vane": ("slip",),
}  # fmt: skip
_UNSTATED = ("", "1", "-", "none", "n/a")  # what files write where they do not know the unit
_POUNDS = {
    "lbf": "lb",
    "kgf": "kg",
}  # headings use the names of masses for forces and the other way round
_CONVERTED = (
    1e-3  # relative difference of a scale from the factor of a unit within which it is that factor
)
_STATIC_ERROR = 0.03  # of the impact pressure, in static pressure
_HEIGHT = 30.0  # m by which two pressure heights of one aeroplane may differ
_SCATTER = 15.0  # m


def column_findings(
    record: xr.DataTree, signals: ResampledChannels
) -> tuple[list[Finding], tuple[str, ...]]:
    """Return the columns that stand for two channels, and the channels that kinematics show to be
    wrong for that reason.

    Parameters
    ----------
    record : DataTree
        Its channels carry the column that they come from.
    signals : Signals
        As recorded.

    Returns
    -------
    findings : list of Finding
    wrong : tuple of str
        Channels to leave out of all other checks.
    """
    findings: list[Finding] = []
    wrong: list[str] = []
    for one, other, what in _shared(record, signals):
        at_fault = _at_fault(signals, one, other)
        names = (other, one) if at_fault == (other,) else (one, other)
        remedy = (
            _own_column(record, names[0])
            or f"give {names[0]} its own column in the name map, or leave it out"
        )
        if at_fault:
            proof = (
                f"hold for {names[1]} and not for {names[0]}"
                if len(at_fault) == 1
                else "do not hold with both"
            )
            findings.append(
                Finding(
                    "error",
                    "column",
                    names,
                    f"{one} and {other} {what}; kinematics {proof}",
                    remedy,
                )
            )
            wrong += at_fault
            continue
        hint = (
            " (h_baro is pressure height, a satellite receiver gives geometric height)"
            if {one, other} == {"h_baro", "h_gps"}
            else ""
        )
        findings.append(
            Finding("warning", "column", names, f"{one} and {other} {what}{hint}", remedy)
        )
    return findings, tuple(wrong)


def heading_findings(
    record: xr.DataTree, signals: ResampledChannels, mistaken: Collection[str] = ()
) -> list[Finding]:
    """Return units, scales and columns of the name map that contradict what the file calls them.

    Parameters
    ----------
    record : DataTree
    signals : Signals
        Mistakes undone.
    mistaken : collection of str
        Channels in which a mistake was found: their motion shows nothing about the name map any
        more.
    """
    known = signals.without(mistaken)
    found = []
    several = (
        len(
            {
                group
                for _, about in _mapped_channels(record)
                for group in about["column"].split("/")[:1]
            }
        )
        > 1
    )
    for name, about in _mapped_channels(record):
        _, channel, file_unit = map_entry_of(record, name)
        if channel is None:
            continue
        found += _unit(record, known, name, channel, file_unit or "")
        found += _twice_converted(record, known, name, channel, file_unit or "")
        column = about["column"]
        found += _column_name(
            name, column.replace("/", " ") if several else column.rpartition("/")[2]
        )
    return found


def with_headings(findings: list[Finding]) -> list[Finding]:
    """Return findings in which a mistake of a unit also states the heading, instead of a finding of
    its own.
    """
    stated = {finding.channels[0]: finding for finding in findings if finding.kind == "stated_unit"}
    proven = {
        finding.channels[0]
        for finding in findings
        if finding.kind in ("unit", "weight") and finding.severity == "error"
    }
    found = []
    for finding in findings:
        name = finding.channels[0]
        if finding.kind in ("unit", "weight") and finding.severity == "error" and name in stated:
            finding = replace(finding, text=f"{finding.text}; {stated[name].text}")
        if finding.kind != "stated_unit" or name not in proven:
            found.append(finding)
    return found


def pressure_height_findings(signals: ResampledChannels) -> list[Finding]:
    """Return whether the recorded pressure height is not that of the static pressure: a satellite
    height, or another altimeter setting.
    """
    if not {"h_baro", "p_static"} <= set(signals.values):
        return []
    mask = signals.mask(("h_baro", "p_static"))
    p_static = signals["p_static"][mask]
    if mask.sum() * signals.step < 5.0 or p_static.min() < 1e3:
        return []
    apart = signals["h_baro"][mask] - pressure_altitude(p_static)
    middle, scatter = float(np.median(apart)), float(np.std(apart))
    q_c = (
        float(np.median(signals["q_c"][mask]))
        if "q_c" in signals
        else 0.05 * float(np.median(p_static))
    )
    port = (
        _STATIC_ERROR * q_c / (12.0 * float(np.median(p_static)) / 101325.0)
    )  # 12 Pa per metre at sea level
    if abs(middle) < _HEIGHT + port and scatter < _SCATTER + port:
        return []
    if abs(middle) > 0.5 * float(np.ptp(signals["h_baro"][mask])) + 1500.0:
        return []  # a unit: the relation of the two names it
    text = (
        f"h_baro differs from the pressure height of p_static by {middle:+.0f} m (scatter "
        f"{scatter:.0f} m): it is the height of a "
        "satellite receiver, or the altimeter was not set to 1013.25 hPa"
    )
    remedy = "map the column of pressure height, or leave h_baro out: p_static gives it"
    evidence = {"difference": middle, "scatter": scatter}
    return [
        Finding("warning", "definition", ("h_baro", "p_static"), text, remedy, evidence=evidence)
    ]


def _mapped_channels(record: xr.DataTree) -> Iterator[tuple[str, dict]]:
    for node in record.children.values():
        for name, x in node.data_vars.items():
            if x.attrs.get("map_entry") and x.attrs.get("column"):
                yield str(name), x.attrs


def _shared(record: xr.DataTree, signals: ResampledChannels) -> Iterator[tuple[str, str, str]]:
    """Yield pairs of channels that come from one column, or from columns with the same samples."""
    users: dict[str, list[str]] = defaultdict(list)
    for name, about in _mapped_channels(record):
        users[about["column"]].append(name)
    for column, names in users.items():
        for one, other in combinations(names, 2):
            if not _one_quantity(one, other):
                yield one, other, f"are read from one column, {column.rpartition('/')[2]!r}"
    column_of = {name: column for column, names in users.items() for name in names}
    for one, other in combinations(sorted(set(column_of) & set(signals.values)), 2):
        same_kind = lookup(one).units == lookup(other).units and not _one_quantity(one, other)
        if (
            same_kind
            and column_of[one] != column_of[other]
            and _equal(signals[one], signals[other])
        ):
            yield (
                one,
                other,
                f"have the same samples, in columns {_short(column_of[one])} and "
                f"{_short(column_of[other])}",
            )


def _short(column: str) -> str:
    return repr(column.rpartition("/")[2])


def _own_column(record: xr.DataTree, name: str) -> str:
    """Return the line of the name map with the one column that is called after a channel and that
    the map leaves out; empty without one.
    """
    leaf, channel, _ = map_entry_of(record, name)
    if channel is None or name not in _WORDS:
        return ""
    table = record[leaf][name].attrs["column"].rpartition("/")[0]
    left_out = re.split(rf"(?:^| ){re.escape(table)}/", str(record.attrs.get("unmapped", "")))[1:]
    fitting = [column for column in left_out if _called_after(column, name) == "own"]
    if len(fitting) != 1:
        return ""
    return f"{line_of(name, channel.changed(column=fitting[0]))}   # in [{leaf}] of the name map"


def _one_quantity(one: str, other: str) -> bool:
    """Whether two channels may well be read from one column: two engines with one lever, vertical
    speed up and down.
    """
    return _SIDES.sub("", one) == _SIDES.sub("", other) or {one, other} in _ALIKE


def _equal(x: np.ndarray, y: np.ndarray) -> bool:
    return float(np.ptp(x)) > 0.0 and bool(np.array_equal(x, y))


def _at_fault(signals: ResampledChannels, one: str, other: str) -> tuple[str, ...]:
    """Return the channel of a pair that breaks kinematics when the other one does not, both where
    it may be either.
    """
    if not {one, other} <= set(signals.values):
        return ()
    explanations, _, comparisons = find_mistakes(signals)
    elsewhere = not any(
        {one, other} & set(explanation.repair.channels) for explanation in explanations
    )
    if elsewhere and all(c.consistent for c in comparisons.values()):
        return ()
    explanations, _, _ = find_mistakes(signals.without((one, other)))
    for explanation in explanations:  # mistakes of other channels must not count
        signals = explanation.repair.apply(signals)
    rest = total_disagreement(signals.without((one, other)))
    if total_disagreement(signals) - rest < GAIN:
        return ()
    with_one, with_other = (
        total_disagreement(signals.without((absent,))) - rest for absent in (other, one)
    )
    found = _worse(one, with_one, other, with_other)
    if found or with_one > GAIN or with_other > GAIN:
        return found or (one, other)
    # one relation reads both: it counts for the channel that it is about
    disagreement = {
        name: c.disagreement for name, c in compare_all(signals).items() if not c.consistent
    }
    blamed = [
        sum(disagreement.get(relation, 0.0) for relation in _ABOUT.get(name, ()))
        for name in (one, other)
    ]
    return _worse(one, blamed[0], other, blamed[1]) or (one, other)


def _worse(one: str, of_one: float, other: str, of_other: float) -> tuple[str, ...]:
    """Return the channel that disagrees when the other one does not."""
    if abs(of_one - of_other) < GAIN or min(of_one, of_other) > GAIN:
        return ()
    return (one,) if of_one > of_other else (other,)


def _unit(
    record: xr.DataTree, signals: ResampledChannels, name: str, channel: Channel, file_unit: str
) -> list[Finding]:
    calibrated = (
        channel.polynomial is not None
        or channel.table is not None
        or isinstance(channel.scale, str)
    )
    if channel.unit is None or calibrated or file_unit.strip().lower() in _UNSTATED:
        return []
    stated, heading = _comparable(channel.unit, file_unit)
    dimension, factor = _parsed(stated)
    other, other_factor = _parsed(heading)
    if other is None or dimension is None:
        return []
    text = (
        f"the name map takes {name} in {channel.unit}, and the file states {file_unit} for "
        f"{channel.columns[0]!r}"
    )
    if other != dimension:
        if len(heading) == 1 or heading == "psi":
            return []  # a symbol in brackets, such as "Height (h)"
        remedy = "check the column, or correct the unit in the name map"
        return [
            Finding(
                "warning",
                "stated_unit",
                (name,),
                f"{text}, which is a unit of another quantity",
                remedy,
            )
        ]
    zero, other_zero = float(to_si(0.0, stated)), float(to_si(0.0, heading))
    if np.isclose(factor, other_factor, rtol=1e-6) and np.isclose(zero, other_zero):
        return []
    slope = other_factor / factor
    shift = (other_zero - slope * zero) * channel.sign * float(channel.scale)
    remedy = f"if the file is right: {map_entry(record, name, slope, shift)}"
    return _weighed(signals, Repair("unit", (name,), text, slope, shift), "stated_unit", remedy)


def _twice_converted(
    record: xr.DataTree, signals: ResampledChannels, name: str, channel: Channel, file_unit: str
) -> list[Finding]:
    """Return whether the scale of a channel is the factor of its unit, which is applied as well."""
    unit = channel.unit or file_unit
    if isinstance(channel.scale, str) or channel.scale == 1.0 or not unit:
        return []
    dimension, factor = _parsed(known_unit(unit))
    if dimension is None or abs(factor - 1.0) < _CONVERTED:
        return []
    if min(abs(channel.scale / factor - 1.0), abs(channel.scale * factor - 1.0)) > _CONVERTED:
        return []
    text = (
        f"the scale {channel.scale:g} of {name} is the factor of its unit {unit}, by which "
        f"the column is converted as well"
    )
    leaf, _, _ = map_entry_of(record, name)
    remedy = (
        f"if that is once too often: {line_of(name, channel.changed(scale=1.0))}   # in "
        f"[{leaf}] of the name map"
    )
    return _weighed(
        signals, Repair("unit", (name,), text, 1.0 / channel.scale), "stated_unit", remedy
    )


def _weighed(signals: ResampledChannels, repair: Repair, kind: str, remedy: str) -> list[Finding]:
    """Return a contradiction: a warning, or a note where the motion shows that the name map is
    right.
    """
    confirmed = (
        repair.channels[0] in signals
        and total_disagreement(repair.apply(signals)) - total_disagreement(signals) > GAIN
    )
    severity, more = (
        ("note", "; kinematics agree with the name map") if confirmed else ("warning", "")
    )
    return [Finding(severity, kind, repair.channels, repair.mistake + more, remedy)]


def _comparable(one: str, other: str) -> tuple[str, str]:
    """Return two units as the product spells them, masses and forces of one name as the same."""
    one, other = known_unit(one), known_unit(other)
    if _parsed(one)[0] != _parsed(other)[0]:
        one, other = _POUNDS.get(one, one), _POUNDS.get(other, other)
        if {one, other} in ({"N", "lb"}, {"N", "kg"}):
            one, other = (f"{unit}f" if unit == "lb" else unit for unit in (one, other))
    return one, other


def _parsed(unit: str) -> tuple[tuple | None, float]:
    try:
        return parse_unit(unit)[:2]
    except UnitError:
        return None, 1.0


# words of a heading that belong to a channel, and those that belong to another one
_WORDS: dict[str, tuple[str, str]] = {
    "h_baro": ("baro press palt", "gps gnss sat geo wgs radio radar agl"),
    "h_gps": ("gps gnss sat geo wgs", "baro press palt"),
    "V_cas": ("cas kcas ias kias calib indic", "tas ktas true gs ground eas"),
    "V": ("tas ktas true", "cas kcas ias kias eas calib indic gs ground"),
    "alpha_vane": ("aoa alpha attack", "aos beta slip"),
    "beta_vane": ("aos beta slip", "aoa alpha attack"),
    "phi": ("roll bank phi", "pitch theta yaw heading psi"),
    "theta": ("pitch theta", "roll bank phi yaw heading psi"),
    "psi": ("heading hdg psi yaw", "track trk course cog roll bank phi pitch theta"),
    "p": ("roll p", "pitch yaw"),
    "q": ("pitch q", "roll yaw"),
    "r": ("yaw r", "roll pitch"),
    "ax_imu": ("long nx ax x", "lateral norm vert ny nz ay az"),
    "ay_imu": ("lat ny ay y", "long norm vert nx nz ax az"),
    "az_imu": ("norm vert nz az z", "long lateral nx ny ax ay"),
    "vn": ("north", "east"),
    "ve": ("east", "north"),
    "delta_e": ("elev stab", "ail rud"),
    "delta_a": ("ail", "elev rud"),
    "delta_r": ("rud", "elev ail"),
}
_LONG = 4  # letters from which a word of a heading may go on: "aileron", "elevator"
_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def _column_name(name: str, column: str) -> list[Finding]:
    """Return whether the heading of a column is that of another quantity: pressure height from
    ``GPS Alt``.
    """
    if name not in _WORDS or _called_after(column, name) != "other":
        return []
    text = (
        f"{name} ({lookup(name).long_name}) is read from the column {column!r}, which is "
        f"called after another quantity"
    )
    return [
        Finding(
            "warning", "column_name", (name,), text, f"check the column of {name} in the name map"
        )
    ]


def _called_after(column: str, name: str) -> str:
    """Return whether a heading is called after a channel (``own``) or another one (``other``);
    empty where it shows neither.
    """
    own, others = (words.split() for words in _WORDS[name])
    tokens = [token.lower() for token in _TOKEN.findall(column)]
    if any(_is_word(token, word) for token in tokens for word in own):
        return "own"
    return "other" if any(_is_word(token, word) for token in tokens for word in others) else ""


def _is_word(token: str, word: str) -> bool:
    return token == word or (len(word) >= 3 and token.startswith(word) and len(token) >= _LONG)
