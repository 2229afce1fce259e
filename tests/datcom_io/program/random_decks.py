"""Random decks: conventional aircraft, wing-bodies, bodies and wings alone, one in three with a
fault put in.
"""

from __future__ import annotations

import numpy as np

_FLAWS = (
    "",
    "",
    "",
    "",
    "misspelt variable",
    "no angles",
    "no NACA card",
    "more angles than NALPHA",
    "fewer angles than NALPHA",
    "no $",
    "no flight condition",
)


def _numbers(values) -> str:
    return ",".join(
        f"{value:.4f}".rstrip("0").ljust(3, "0") if value else "0.0"
        for value in np.atleast_1d(values).tolist()
    )


def _namelist(name: str, **variables) -> str:
    """Return a namelist, two variables on a line."""
    items = [
        f"{key}={value if isinstance(value, str) else _numbers(value)}"
        for key, value in variables.items()
    ]
    lines, line = [], f" ${name} "
    for item in items:
        for piece in item.replace(",", ",\n").split("\n"):
            if len(line) + len(piece) > 74:
                lines.append(line)
                line = "   "
            line += piece
        line += ","
    lines.append(line.rstrip(",") + "$")
    return "\n".join(lines) + "\n"


def random_deck(seed: int) -> tuple[str, str]:
    """Return the text of a deck and the fault put into it, empty for none."""
    rng = np.random.default_rng(seed)
    flaw = str(rng.choice(_FLAWS))
    unit = str(rng.choice(["M", "FT", "CM", "IN"]))
    scale = {"M": 1.0, "FT": 1.0 / 0.3048, "CM": 100.0, "IN": 1.0 / 0.0254}[unit] * rng.uniform(
        0.6, 1.2
    )
    alphas = np.unique(np.round(rng.uniform(-6.0, 16.0, int(rng.integers(2, 12))), 1))
    machs = np.sort(
        np.round(
            rng.choice(
                [rng.uniform(0.1, 0.55), rng.uniform(0.7, 1.3), rng.uniform(1.45, 3.0)],
                p=[0.8, 0.1, 0.1],
                size=1,
            ),
            2,
        )
    )
    machs = np.unique(np.round(machs * np.array([1.0, 1.05])[: int(rng.integers(1, 3))], 2))
    heights = np.array([0.0, 1500.0])[: int(rng.integers(1, 3))] * scale
    loop = (
        float(rng.choice([1.0, 2.0, 3.0]))
        if len(machs) == len(heights)
        else float(rng.choice([2.0, 3.0]))
    )
    counted = len(alphas) + {"more angles than NALPHA": -1, "fewer angles than NALPHA": 1}.get(
        flaw, 0
    )
    flight = {
        "NMACH": len(machs),
        "MACH(1)": machs,
        "NALT": len(heights),
        "ALT(1)": heights,
        "LOOP": loop,
    }
    if flaw == "no flight condition":
        del flight["MACH(1)"], flight["NMACH"]
    if flaw != "no angles":
        flight |= {"NALPHA": counted, "ALSCHD(1)": alphas}
    body, wing = bool(rng.random() < 0.9), bool(rng.random() < 0.9)
    body = body or not wing
    tail = wing and body and rng.random() < 0.6
    chord, span = rng.uniform(1.2, 2.8), rng.uniform(4.0, 8.0)
    text = f"DIM {unit}\n" + "".join(
        f"{card}\n" for card in ("DERIV RAD", "DAMP", "PART", "BUILD", "PLOT") if rng.random() < 0.3
    )
    text += _namelist("FLTCON", **flight)
    if rng.random() < 0.8:
        text += _namelist(
            "OPTINS",
            SREF=2 * span * chord * 0.8 * scale**2,
            CBARR=chord * scale,
            BLREF=2 * span * scale,
        )
    places = {"XCG": 5.5 * scale, "ZCG": 0.0}
    places |= {"XW": 4.8 * scale, "ZW": -0.4 * scale, "ALIW": rng.uniform(-1, 4)} if wing else {}
    places |= (
        {
            "XH": 11.0 * scale,
            "ZH": 0.8 * scale,
            "ALIH": 0.0,
            "XV": 10.5 * scale,
            "ZV": 0.4 * scale,
            "VERTUP": ".TRUE.",
        }
        if tail
        else {}
    )
    text += _namelist("SYNTHS", **places)
    if body:
        x = np.array([0.0, 0.5, 1.5, 3.0, 6.0, 9.0, 11.0, 13.0]) * scale
        radii = np.array([0.0, 0.35, 0.7, 0.8, 0.8, 0.7, 0.4, 0.1]) * scale * rng.uniform(0.7, 1.2)
        text += _namelist(
            "BODY",
            NX=8.0,
            **{"X(1)": x, "R(1)": radii},
            BNOSE=2.0,
            BTAIL=1.0,
            BLN=3.0 * scale,
            BLA=5.0 * scale,
            ITYPE=1.0,
        )
    if wing:
        text += _planform(
            "WGPLNF", chord * scale, rng.uniform(0.3, 1.0), span * scale, 0.75 * scale, rng
        )
        text += (
            "" if flaw == "no NACA card" else f"NACA W 4 {rng.choice(['0012', '2412', '4415'])}\n"
        )
    if tail:
        text += _planform("HTPLNF", 1.4 * scale, 0.5, 2.6 * scale, 0.2 * scale, rng)
        text += _planform("VTPLNF", 2.2 * scale, 0.5, 2.4 * scale, 0.3 * scale, rng)
        text += "NACA H 4 0010\nNACA V 4 0012\n"
    text += _device(rng, scale, span, chord, tail) if wing and body else ""
    if rng.random() < 0.15 and wing and body:
        text += _namelist("GRNDEF", NGH=2.0, **{"GRDHT(1)": np.array([3.0, 6.0]) * scale})
    if flaw == "misspelt variable":
        text = text.replace("XCG=", "XGC=")
    elif flaw == "no $":
        text = text.replace("$\n", "\n", 1)
    return f"{text}CASEID RANDOM DECK {seed}\nNEXT CASE\n", flaw


def _planform(name: str, root: float, taper: float, span: float, inside: float, rng) -> str:
    return _namelist(
        name,
        CHRDR=root,
        CHRDTP=root * taper,
        SSPN=span,
        SSPNE=span - inside,
        SAVSI=rng.uniform(0, 30),
        CHSTAT=0.25,
        DHDADI=rng.uniform(-2, 6),
        TYPE=1.0,
    )


def _device(rng, scale: float, span: float, chord: float, tail: bool) -> str:
    """Return flaps on the wing, an elevator on the tail, ailerons, or nothing."""
    deltas = np.sort(
        rng.choice([-20.0, -10.0, 0.0, 5.0, 15.0, 25.0], int(rng.integers(1, 4)), replace=False)
    )
    kind = rng.choice(["", "symmetric", "ailerons"], p=[0.6, 0.25, 0.15])
    if kind == "symmetric":
        outer, depth = (2.3, 0.4) if tail else (0.6 * span, 0.25 * chord)
        inner = 0.3 if tail else 1.0
        places = {
            "SPANFI": inner * scale,
            "SPANFO": outer * scale,
            "CHRDFI": depth * scale,
            "CHRDFO": 0.8 * depth * scale,
        }
        return _namelist(
            "SYMFLP",
            FTYPE=1.0,
            NDELTA=len(deltas),
            **{"DELTA(1)": deltas},
            PHETE=0.05,
            PHETEP=0.04,
            **places,
            CB=0.05 * scale,
            TC=0.1 * scale,
            NTYPE=1.0,
        )
    if kind == "ailerons" and not tail:
        places = {
            "SPANFI": 0.65 * span * scale,
            "SPANFO": 0.95 * span * scale,
            "CHRDFI": 0.2 * chord * scale,
            "CHRDFO": 0.15 * chord * scale,
        }
        return _namelist(
            "ASYFLP",
            STYPE=4.0,
            NDELTA=len(deltas),
            **{"DELTAL(1)": deltas, "DELTAR(1)": -deltas},
            PHETE=0.05,
            **places,
        )
    return ""
