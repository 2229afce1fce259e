"""Page ``nomenclature.md``, from the vocabulary of the product. The site has the page
(`make_site`); ``python docs/scripts/make_nomenclature.py`` prints it.

Name, unit, sign and description come from `flightmech.names`, JSBSim's properties from the tables
of the export; the symbols of LR-743, Digital DATCOM and SIDPAC are those of the tables below.
"""

from __future__ import annotations

from aerodb.exchange.jsbsim.properties import AXIS, REGRESSOR
from flightmech.names import SIGNS, VOCABULARY, Quantity

# as LR-743 writes them; it divides the pitch rate by V, not by 2V
LR743 = {
    "alpha": "alpha",
    "alphadothat": "alphadot c/V",
    "qhat": "q c/V",
    "mach": "M",
    "h": "h",
    "h_radio": "h_R",
    "nz": "n",
    "dnz": "n - 1",
    "x_cg": "x_cg",
    "delta_e": "delta_e",
    "delta_t": "delta_te",
    "delta_f": "delta_f",
    "speedbrake": "delta_sb",
    "gear": "tau_lg",
    "phi": "phi",
    "CL": "C_L",
    "CD": "C_D",
    "CY": "C_Y",
    "Cl": "C_l",
    "Cm": "C_m",
    "Cn": "C_n",
}
# headings of the printed tables and names of the input cards
DATCOM = {
    "alpha": "ALPHA, ALSCHD",
    "mach": "MACH",
    "h": "ALTITUDE, ALT",
    "CL": "CL",
    "CD": "CD",
    "Cm": "CM",
    "S": "SREF",
    "cbar": "CBARR",
    "b": "BLREF",
    "delta_f": "DELTA (SYMFLP)",
    "delta_e": "DELTA (SYMFLP)",
    "delta_a": "DELTAL, DELTAR (ASYFLP)",
    "h_agl": "GRDHT",
}
# names of the channels, with their column of the data array `fdata` (deg, deg/s, g) where there is
# one
SIDPAC = {
    "V": "vt (2)",
    "beta": "beta (3)",
    "alpha": "alpha (4)",
    "p": "p (5)",
    "q": "q (6)",
    "r": "r (7)",
    "phi": "phi (8)",
    "theta": "the (9)",
    "psi": "psi (10)",
    "ax": "ax (11)",
    "ay": "ay (12)",
    "az": "az (13)",
    "delta_e": "el (14)",
    "delta_a": "ail (15)",
    "delta_r": "rdr (16)",
    "CX": "CX",
    "CY": "CY",
    "CZ": "CZ",
    "CL": "CL",
    "CD": "CD",
    "Cl": "Cl",
    "Cm": "Cm",
    "Cn": "Cn",
}

HEAD = """# Nomenclature

Every quantity has one name, one unit and one positive sense: in files, tables, Python, FMUs and
reports. Names are the symbols of the field in ASCII; angles are in radians. Quantities of one
engine or leg take a prefix: `engine1.thrust`, `gear.nose.compression`. Controls that only the
tables of a database know are `device.body_flap.deflection` [rad], `device.spike.setting` [1]. In
Python, `flightmech.names.lookup("delta_e")` returns a row. Other terms: [glossary](glossary.md),
headings of recordings: [column headings](column-headings.md).

The last column has equivalents elsewhere. LR-743 reduces the pitch rate by `c/V`, this product by
`c/(2V)`: a pitch-rate derivative of LR-743 is half of ours. JSBSim's properties are in the unit
that their names end with. SIDPAC's numbers are the columns of its data array.

Signs: {signs}.

| name | unit | positive | quantity | elsewhere |
|---|---|---|---|---|
"""


def page() -> str:
    """Return the page."""
    signs = ", ".join(f"{short} {long}" for short, long in SIGNS.items())
    return HEAD.format(signs=signs) + "".join(map(_row, VOCABULARY.values()))


def _row(quantity: Quantity) -> str:
    name = quantity.name
    jsbsim = (
        f"`{AXIS[name]}`"
        if name in AXIS
        else " x ".join(f"`{part}`" for part in REGRESSOR.get(name, ()))
    )
    elsewhere = {
        "LR-743": LR743.get(name, ""),
        "DATCOM": DATCOM.get(name, ""),
        "JSBSim": jsbsim,
        "SIDPAC": SIDPAC.get(name, ""),
    }
    cells = [
        f"`{name}`",
        quantity.units,
        quantity.sign,
        quantity.long_name,
        "; ".join(f"{program} {symbol}" for program, symbol in elsewhere.items() if symbol),
    ]
    return "| " + " | ".join(cells) + " |\n"


if __name__ == "__main__":
    print(page(), end="")
