"""The structure that MATLAB's ``datcomimport`` returns for Digital DATCOM, as a table: field, leaf
and variable of our tree, axes, unit.

Names and order of indices are those that the reference page of ``datcomimport`` documents for the
1976 version.  Numbers are as printed: in the units of card DIM (field ``dim``), slopes per degree
or per radian (field ``deriv``), angles in degrees.
"""

from __future__ import annotations

from typing import NamedTuple

from datcom_io.arrays.conditions import si_factor
from flightmech.units import parse_unit

MISSING = 99999.0
"""What a place holds that no page of the listing belongs to."""

STATIC = ("alpha", "mach", "alt", "build", "grndht", "delta")
DYNAMIC = ("alpha", "mach", "alt", "build")
DELTA = ("delta", "mach", "alt")
ALPHA_DELTA = ("alpha", "delta", "mach", "alt")
ALPHA = ("alpha", "mach", "alt")
SINGLE = ("mach", "alt")
INDEX = ("index", "mach", "alt")
JET = ("mach", "alt", "time")
HYPERSONIC = ("alpha", "delta", "mach")

BUILD = (
    frozenset(("body",)),
    frozenset(("wing",)),
    frozenset(("horizontal",)),
    frozenset(("vertical",)),
    frozenset(("body", "wing")),
    frozenset(("body", "horizontal")),
    frozenset(("body", "vertical")),
    frozenset(("body", "wing", "horizontal")),
    frozenset(("body", "wing", "vertical")),
    frozenset(("body", "wing", "horizontal", "vertical")),
)
"""Configurations along the index ``build`` when it is 10, in the order of the program."""

DELTA_DIMENSIONS = {
    "symflp": "delta",
    "tabs": "delta",
    "hypersonic": "delta",
    "asyflp": "delta_pair",
    "spoiler": "deflection",
}
"""Dimension of our leaves along the index ``delta``; in ``static`` and ``downwash`` it is that of the device."""
INDEX_DIMENSIONS = {
    "clalpmach": "node",
    "clalp": "node",
    "cd0mach": "drag_node",
    "cd0": "drag_node",
}
"""Dimension of our leaf ``fairing`` along the first index of a field, by the field's name without its surface."""


class Field(NamedTuple):
    """One array of the structure.

    ``axes`` are its indices; ``units`` those of `layouts.form.Column`; ``at`` what to select in our
    leaf, dimension and label; ``constant`` flags a column whose first row may hold for all rows;
    ``styles`` the values of STYPE for which the field means this variable, none for all;
    ``coordinate`` one that our leaf holds as a coordinate.
    """

    name: str
    leaf: str
    quantity: str
    axes: tuple[str, ...]
    units: str = "1"
    at: tuple[tuple[str, str], ...] = ()
    constant: bool = False
    styles: tuple[int, ...] = ()
    coordinate: bool = False


class Units(NamedTuple):
    """What the units of a case's numbers depend on: cards DIM and DERIV, and the pressure of a jet
    page, ``psf`` or ``psi``.
    """

    dim: str
    deriv: str
    jet_pressure: str = "psf"

    def factor(self, units: str) -> float:
        """Return the factor from a number of the structure to SI."""
        if units == "1/angle":
            units = "1/deg" if self.deriv == "DEG" else "1"
        if units in ("length", "area"):
            return si_factor(units, self.dim)
        return parse_unit(self.jet_pressure if units == "pressure" else units)[1]


def _rows(
    leaf: str,
    axes: tuple[str, ...],
    text: str,
    at: tuple[tuple[str, str], ...] = (),
    styles: tuple[int, ...] = (),
    coordinate: bool = False,
) -> list[Field]:
    """Return fields given as words ``name:variable`` or ``name:variable:units``; an asterisk
    denotes a constant column.
    """
    found = []
    for word in text.split():
        name, quantity, units = (*word.split(":"), "1")[:3]
        found.append(
            Field(name.strip("*"), leaf, quantity, axes, units, at, "*" in name, styles, coordinate)
        )
    return found


_PER = "1/angle"
_PANELS = {
    "ti": "theoretical inboard",
    "ei": "exposed inboard",
    "o": "outboard",
    "tt": "total theoretical",
    "te": "total exposed",
}
_SURFACES = {"w": "wing", "ht": "horizontal tail", "vt": "vertical tail", "vf": "ventral fin"}
_PLANFORM = (
    ("area", "area", "area"),
    ("taperratio", "taper_ratio", "1"),
    ("aspectratio", "aspect_ratio", "1"),
    ("qcsweep", "sweep_c4", "deg"),
    ("mac", "mac", "length"),
    ("qcmac", "x_c4_mac", "length"),
    ("ymac", "y_mac", "length"),
    ("cd0", "CD0", "1"),
    ("friccoeff", "Cf", "1"),
)
_FAIRING = {"w": "wing", "wb": "wing-body", "ht": "horizontal tail", "bht": "horizontal tail-body"}
LABELS = {
    "surface": tuple(_SURFACES.values()),
    "panel": tuple(_PANELS.values()),
    "configuration": tuple(_FAIRING.values()),
}
"""Labels along the dimensions that the structure has in the names of its fields, in the order of our leaves."""
_FAIRED = (
    ("cdlcl2", "CDL_CL2", "1", "w ht"),
    ("clbcl", "Cl_beta_CL", "1/deg", "w ht wb bht"),
    ("fmach0", "mach_break_unswept", "1", "w ht"),
    ("fmach", "mach_break", "1", "w ht"),
    ("macha", "mach_a", "1", "w ht"),
    ("claa", "CL_alpha_a", "1/deg", "w ht"),
    ("machb", "mach_b", "1", "w ht"),
    ("clab", "CL_alpha_b", "1/deg", "w ht"),
    ("clbm06", "Cl_beta_CL_mach_06", "1/deg", "w ht"),
    ("clbm14", "Cl_beta_CL_mach_14", "1/deg", "w ht wb bht"),
    ("clbclmfb", "Cl_beta_CL_break", "1/deg", "wb bht"),
    ("cnam14", "CN_alpha_mach_14", "1/deg", "wb bht"),
)


def _all() -> list[Field]:
    found = _rows("static", STATIC, "cd:CD cl:CL cm:Cm cn:CN ca:CA xcp:xcp")
    found += _rows(
        "static",
        STATIC,
        f"cla:CL_alpha:{_PER} cma:Cm_alpha:{_PER} cyb*:CY_beta:{_PER} cnb*:Cn_beta:{_PER} "
        f"clb:Cl_beta:{_PER}",
    )
    found += _rows("downwash", STATIC, "qqinf:q_ratio eps:epsilon:deg depsdalp:epsilon_alpha")
    found += _rows(
        "dynamic",
        DYNAMIC,
        f"clq*:CL_qhat:{_PER} cmq*:Cm_qhat:{_PER} clad*:CL_alphadothat:{_PER} "
        f"cmad*:Cm_alphadothat:{_PER}",
    )
    found += _rows(
        "dynamic",
        DYNAMIC,
        f"clp*:Cl_phat:{_PER} cyp*:CY_phat:{_PER} cnp*:Cn_phat:{_PER} cnr*:Cn_rhat:{_PER} "
        f"clr:Cl_rhat:{_PER}",
    )
    found += _rows("symflp", DELTA, "dcl_sym:dCL dcm_sym:dCm dclmax_sym:dCLmax dcdmin_sym:dCDmin")
    found += _rows(
        "symflp",
        DELTA,
        "clad_sym:CL_alpha_delta:1/deg cha_sym*:Ch_alpha:1/deg chd_sym:Ch_delta:1/deg",
    )
    found += _rows("symflp", ALPHA_DELTA, "dcdi_sym:dCDi")
    found += _rows(
        "spoiler", DELTA, "xsc:xs_c hsc:hs_c ddc:dd_c dsc:ds_c", styles=(1, 2, 3), coordinate=True
    )
    found += _rows("spoiler", DELTA, "clroll:Cl cn_asy:Cn", styles=(1, 2, 3))
    found += _rows("asyflp", DELTA, "clroll:Cl", styles=(4,))
    found += _rows("asyflp", ALPHA_DELTA, "cn_asy:Cn", styles=(4,))
    found += _rows("asyflp", ALPHA_DELTA, "clroll:Cl", styles=(5,))
    found += _rows(
        "tabs",
        ALPHA_DELTA,
        "fc_con:F_stick:lbf fhmcoeff_free:Ch_tab_free fhmcoeff_lock:Ch_tab_locked",
    )
    found += _rows("tabs", ALPHA_DELTA, "fhmcoeff_gear:Ch_tab_gearing ttab_def:delta_tab_trim:deg")
    found += _rows(
        "trim",
        ALPHA,
        "cl_utrim:CL cd_utrim:CD cm_utrim:Cm delt_trim:delta_trim:deg dcl_trim:dCL "
        "dclmax_trim:dCLmax",
    )
    found += _rows(
        "trim",
        ALPHA,
        "dcdi_trim:dCDi dcdmin_trim:dCDmin cha_trim*:Ch_alpha:1/deg chd_trim:Ch_delta:1/deg",
    )
    tail = (
        "cd_tailutrim:CD_tail cl_tailutrim:CL_tail cm_tailutrim:Cm_tail hm_tailutrim:Ch_tail "
        "aliht_tailtrim:i_tail:deg"
    )
    found += _rows("trim_stabilizer", ALPHA, tail)
    found += _rows(
        "trim_stabilizer",
        ALPHA,
        "cd_tailtrim:CD_tail_trim cl_tailtrim:CL_tail_trim cm_tailtrim:Cm_tail_trim",
    )
    found += _rows("trim_stabilizer", ALPHA, "hm_tailtrim:Ch_tail_trim cl_trimi:CL cd_trimi:CD")
    return found + _special() + _partial_output()


def _special() -> list[Field]:
    found = _rows(
        "hypersonic",
        HYPERSONIC,
        "df_normal:dCN:1/ft df_axial:dCA:1/ft cm_normal:dCm_CN:1/ft cm_axial:dCm_CA:1/ft",
    )
    found += _rows("hypersonic", HYPERSONIC, "cp_normal:xcp_CN cp_axial:zcp_CA")
    found += _rows("jet", JET, "time:time blayer:boundary_layer:text", coordinate=True)
    found += _rows(
        "jet",
        JET,
        "ctrlfrc:F_control:lbf locmach:mach_local reynum:reynolds_local locpres:p_local:pressure",
    )
    found += _rows(
        "jet", JET, "dynpres:qbar_local:pressure ctrlcoeff:C_control corrcoeff:C_control_corrected"
    )
    found += _rows(
        "jet",
        JET,
        "sonicamp:amplification_sonic ampfact:amplification vacthr:F_vacuum:lbf "
        "minpres:p_jet_ratio_min",
    )
    found += _rows(
        "jet",
        JET,
        "minjet:p_jet_min:pressure jetpres:p_jet:pressure massflow:mass_flow:lb/s "
        "propelwt:propellant_mass:lb",
    )
    return found


def _partial_output() -> list[Field]:
    body = (
        "wetarea_b:area_wetted:area xcg_b:x_moment_centre:length zcg_b:z_moment_centre:length "
        "basearea_b:area_base:area"
    )
    found = _rows(
        "auxiliary",
        SINGLE,
        f"{body} cd0_b:CD0 basedrag_b:CD_base fricdrag_b:CD_friction presdrag_b:CD_pressure",
    )
    found += _rows("auxiliary", SINGLE, "lemac:x_behind_mac:length")
    for letter, surface in _SURFACES.items():
        for short, panel in _PANELS.items():
            both = (("surface", surface), ("panel", panel))
            found += [
                Field(f"{name}_{letter}_{short}", "planform", quantity, SINGLE, units, both)
                for name, quantity, units in _PLANFORM
            ]
    for letter in ("w", "ht"):
        words = (
            f"cla_b_{letter}:CL_alpha_body:1/deg cla_{letter}_b:CL_alpha_surface:1/deg "
            f"k_b_{letter}:K_body k_{letter}_b:K_surface"
        )
        found += _rows(
            "interference",
            SINGLE,
            f"{words} xacc_b_{letter}:xac_body",
            at=(("surface", _SURFACES[letter]),),
        )
    found += _rows("interference", SINGLE, "sidewash:sidewash")
    found += _rows(
        "vortex",
        ALPHA,
        "hiv_b_w:i_body_wing hiv_w_h:i_wing_tail hiv_b_h:i_body_tail gamma:gamma "
        "gamma2pialpvr:gamma_tail",
    )
    found += _rows(
        "increments",
        SINGLE,
        "clpgammacl0:Cl_phat clpgammaclp:Cl_phat_ratio_dihedral cnptheta:Cn_phat_twist:1/deg",
    )
    found += _rows(
        "increments",
        SINGLE,
        "cypgamma:dCY_phat_dihedral cypcl:CY_phat_CL clbgamma:Cl_beta_dihedral:1/deg2",
    )
    found += _rows(
        "increments", SINGLE, "cmothetaw:Cm0_twist_wing:1/deg cmothetah:Cm0_twist_tail:1/deg"
    )
    found += _rows(
        "canard_downwash", ALPHA, "espeff:epsilon_effective:deg despdalpeff:epsilon_alpha_effective"
    )
    for name, quantity, units, letters in _FAIRED:
        for letter in letters.split():
            found.append(
                Field(
                    f"{name}_{letter}",
                    "fairing",
                    quantity,
                    SINGLE,
                    units,
                    (("configuration", _FAIRING[letter]),),
                )
            )
    for letter in ("w", "ht"):
        at = (("configuration", _FAIRING[letter]),)
        found.append(Field(f"clalpmach_{letter}", "fairing", "CL_alpha_mach", INDEX, "1", at))
        found.append(Field(f"clalp_{letter}", "fairing", "CL_alpha", INDEX, "1/deg", at))
    found += _rows("fairing", SINGLE, "dragdiv:mach_divergence") + _rows(
        "fairing", INDEX, "cd0mach:CD0_mach cd0:CD0"
    )
    return found


FIELDS: tuple[Field, ...] = tuple(_all())


def select_fields(style: int) -> list[Field]:
    """Return the fields of a case by its STYPE."""
    return [field for field in FIELDS if not field.styles or style in field.styles]


def field_dimension(field: Field, axis: str, device: str) -> str:
    """Return the dimension of our leaf along an index of a field, other than Mach number and
    altitude.
    """
    if axis == "index":
        return INDEX_DIMENSIONS[field.name.rpartition("_")[0] if field.at else field.name]
    if axis == "delta":
        return DELTA_DIMENSIONS.get(field.leaf, device)
    return {"build": "configuration", "grndht": "ground_height"}.get(axis, axis)
